//! The convolution kernels of GGX lobes: a table of their sizes and a picture, one row for each alpha.
//!
//!     cargo run --release --example kernels -- kernels.png 0.02 0.1
//!
//! Each kernel is scaled to its brightest texel. The plane of incidence is vertical, the surface normal points up.

use std::error::Error;
use std::time::Instant;

use image::{GrayImage, Luma};
use lightsum::superposition::kernels::{KERNEL_TEXELS, Kernel, KernelLibrary, VIEW_ANGLES, view_cosine};
use lightsum::superposition::lobe::Lobe;

const LAYERS: [usize; 5] = [31, 15, 7, 3, 0];
/// Pixels along each side of a texel, and of a kernel with its margin.
const ZOOM: usize = 4;
const PITCH: usize = KERNEL_TEXELS * ZOOM + 4;

fn main() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args().skip(1);
    let path = args.next().ok_or("usage: kernels PICTURE ALPHA...")?;
    let alphas = args.map(|a| a.parse()).collect::<Result<Vec<f32>, _>>()?;
    let mut picture = GrayImage::new((LAYERS.len() * PITCH) as u32, (alphas.len() * PITCH) as u32);
    for (row, &alpha) in alphas.iter().enumerate() {
        let lobe = Lobe::Ggx { alpha };
        let mut library = KernelLibrary::new();
        let start = Instant::now();
        library.add(0, lobe.clone())?;
        println!("alpha {alpha}: {VIEW_ANGLES} layers in {:.0} ms", start.elapsed().as_secs_f64() * 1e3);
        for (column, layer) in LAYERS.into_iter().enumerate() {
            let kernel = &library.layers()[layer];
            let (tan_beta, energy, captured) = (kernel.tan_beta, kernel.energy, kernel.captured);
            println!(
                "  mu {:.3}: tan beta {tan_beta:.4}, energy {energy:.4}, captured {captured:.4}, of it core {:.4}",
                view_cosine(layer),
                kernel.core_share
            );
            draw(&mut picture, &kernel.core.texture, column * PITCH, row * PITCH);
        }
        for from in [0, 3, 7] {
            println!("  half way between layers, from {from}: {}", between(&library, &lobe, from));
        }
    }
    picture.save(path)?;
    Ok(())
}

fn draw(picture: &mut GrayImage, texture: &[f32], left: usize, top: usize) {
    let brightest = texture.iter().copied().fold(0.0, f32::max);
    for y in 0..KERNEL_TEXELS * ZOOM {
        for x in 0..KERNEL_TEXELS * ZOOM {
            let (u, v) = (KERNEL_TEXELS - 1 - y / ZOOM, x / ZOOM);
            let value = (texture[v * KERNEL_TEXELS + u] / brightest).powf(1.0 / 2.2);
            picture.put_pixel((left + x) as u32, (top + y) as u32, Luma([(value * 255.0).round() as u8]));
        }
    }
}

/// Maximum errors of the look-up: of tan beta, of the energy, and the share of light misplaced by the nearest texture.
fn between(library: &KernelLibrary, lobe: &Lobe, from: usize) -> String {
    let mut worst = [0.0f32; 3];
    for layer in from..VIEW_ANGLES - 1 {
        let mu = 0.5 * (view_cosine(layer) + view_cosine(layer + 1));
        let exact = Kernel::new(lobe, mu);
        let Some(found) = library.look_up(0, mu as f32) else { continue };
        let misplaced: f32 =
            exact.core.texture.iter().zip(&found.nearest.core.texture).map(|(a, b)| 0.5 * (a - b).abs()).sum();
        let relative = |a: f32, b: f32| (a / b - 1.0).abs();
        let errors = [relative(found.tan_beta, exact.tan_beta), relative(found.energy, exact.energy), misplaced];
        worst = std::array::from_fn(|i| worst[i].max(errors[i]));
    }
    let [tan_beta, energy, misplaced] = worst.map(|w| 100.0 * w);
    format!("tan beta {tan_beta:.1} %, energy {energy:.1} %, misplaced {misplaced:.1} %")
}
