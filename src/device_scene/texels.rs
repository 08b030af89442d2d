//! Textures on the device: all levels of all textures are rectangles in the layers of a few images.
//!
//! A device need not choose among descriptors by an index from memory, and limits the size of an image; so a fixed small number of images
//! ("pages") is bound to every kernel, and a texture says which page, layer and place each of its levels has. Kernels read single texels
//! and filter themselves: rectangles have no borders, and wrap at the edge of a texture.

use crate::error::{Error, Result};
use crate::gpu::{Buffer, Context, Image, LayerLimits, LayerUpload, Resources, Staging};
use crate::pass::layout::{LevelRecord, TextureRecord};
use crate::scene::mip::{level_count, size_of_level};
use crate::scene::{Scene, Texture, Wrap};

/// Number of pages that kernels bind; `shaders/include/texture.wgsl` names them.
pub const PAGES: usize = 4;

/// Names of the pages in shaders.
const NAMES: [&str; PAGES] = ["texels_0", "texels_1", "texels_2", "texels_3"];

/// Widths and heights of a layer where textures leave the choice.
const EDGES: [u32; 3] = [1024, 4096, 8192];

/// Textures on the device.
pub struct DeviceTextures {
    /// [`TextureRecord`]s.
    pub records: Buffer,
    /// [`LevelRecord`]s.
    pub levels: Buffer,
    /// The pages; at least one, which may hold nothing.
    pub pages: Vec<Image>,
}

/// A rectangle in the layers of all pages together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Place {
    layer: u32,
    origin: [u32; 2],
}

/// Places of rectangles.
#[derive(Debug, PartialEq, Eq)]
struct Packing {
    /// Width and height of a layer.
    size: [u32; 2],
    layers: u32,
    places: Vec<Place>,
}

impl Packing {
    fn texels(&self) -> u64 {
        u64::from(self.size[0]) * u64::from(self.size[1]) * u64::from(self.layers)
    }
}

/// A row of rectangles in a layer.
struct Shelf {
    layer: u32,
    y: u32,
    height: u32,
    used: u32,
}

/// Places rectangles, none of which is larger than a layer, on shelves: the highest first, each on the first shelf with room.
fn pack_into(size: [u32; 2], rectangles: &[[u32; 2]]) -> Packing {
    let mut order: Vec<usize> = (0..rectangles.len()).collect();
    order.sort_by_key(|&i| (std::cmp::Reverse((rectangles[i][1], rectangles[i][0])), i));
    let mut places = vec![Place { layer: 0, origin: [0; 2] }; rectangles.len()];
    let mut shelves: Vec<Shelf> = Vec::new();
    // Shelves before this one are full.
    let mut open = 0;
    let (mut layer, mut top) = (0, 0);
    for i in order {
        let [width, height] = rectangles[i];
        let room = |shelf: &Shelf| size[0] - shelf.used >= width && shelf.height >= height;
        let found = (open..shelves.len()).find(|&k| room(&shelves[k])).unwrap_or_else(|| {
            if size[1] - top < height {
                (layer, top) = (layer + 1, 0);
            }
            shelves.push(Shelf { layer, y: top, height, used: 0 });
            top += height;
            shelves.len() - 1
        });
        let shelf = &mut shelves[found];
        places[i] = Place { layer: shelf.layer, origin: [shelf.used, shelf.y] };
        shelf.used += width;
        while shelves.get(open).is_some_and(|shelf| shelf.used == size[0]) {
            open += 1;
        }
    }
    // A single layer ends with its last shelf.
    let end = if layer == 0 { top.max(1) } else { size[1] };
    Packing { size: [size[0], end], layers: layer + 1, places }
}

/// Places rectangles in layers of the size, within `limit`, that leaves the least empty. None may be larger than `limit`.
fn pack(rectangles: &[[u32; 2]], limit: [u32; 2]) -> Packing {
    let most = [0, 1].map(|k| rectangles.iter().map(|r| r[k]).max().unwrap_or(1));
    // The largest texture, twice as much, and round numbers.
    let edges = |k: usize| {
        let (most, limit) = (most[k], limit[k]);
        let double = most.saturating_mul(2).min(EDGES[2]);
        [most, double, EDGES[0], EDGES[1], EDGES[2]].map(|edge| edge.min(limit).max(most))
    };
    let mut sizes: Vec<[u32; 2]> = edges(0).into_iter().flat_map(|w| edges(1).map(|h| [w, h])).collect();
    sizes.sort_unstable();
    sizes.dedup();
    let packings = sizes.into_iter().map(|size| pack_into(size, rectangles));
    // The list is never empty, and has small layers first.
    packings.min_by_key(Packing::texels).unwrap_or_else(|| pack_into(most, rectangles))
}

/// Sizes of all levels of some textures, one after the other.
fn all_levels(textures: &[Texture]) -> Vec<[u32; 2]> {
    let of = |size: [u32; 2]| (0..).map_while(move |level| size_of_level(size, level));
    textures.iter().flat_map(|t| of([t.width, t.height])).collect()
}

/// Bytes that textures take on a device, with their levels.
pub fn bytes_of(textures: &[Texture]) -> u64 {
    4 * all_levels(textures).iter().map(|[w, h]| u64::from(*w) * u64::from(*h)).sum::<u64>()
}

/// The packing of a scene's textures, and the number of layers of a page.
fn pack_textures(textures: &[Texture], limits: &LayerLimits) -> Result<(Packing, u32)> {
    for t in textures {
        if t.width > limits.size[0].min(u32::from(u16::MAX)) || t.height > limits.size[1].min(u32::from(u16::MAX)) {
            return Err(Error::Scene(format!(
                "texture {} has {}x{} texels, and the device's images have at most {}x{}; scale it down",
                t.name, t.width, t.height, limits.size[0], limits.size[1]
            )));
        }
    }
    let packing = pack(&all_levels(textures), limits.size);
    let layer_bytes = 4 * u64::from(packing.size[0]) * u64::from(packing.size[1]);
    let of_page = (limits.bytes / layer_bytes).min(u64::from(limits.layers)) as u32;
    if u64::from(packing.layers) > u64::from(of_page) * PAGES as u64 {
        let mib = |bytes: u64| bytes.div_ceil(1 << 20);
        return Err(Error::Scene(format!(
            "{} textures take {} MiB on the device with their filtered levels, and it holds {PAGES} images of {} MiB; \
             scale the textures down, each half of the width and height takes a quarter",
            textures.len(),
            mib(layer_bytes * u64::from(packing.layers)),
            mib(layer_bytes * u64::from(of_page)),
        )));
    }
    Ok((packing, of_page))
}

/// The records of textures and of their levels.
fn records(textures: &[Texture], packing: &Packing, of_page: u32) -> (Vec<TextureRecord>, Vec<LevelRecord>) {
    let wrap = |w: Wrap| match w {
        Wrap::Repeat => 0,
        Wrap::Mirror => 1,
        Wrap::Clamp => 2,
    };
    let mut first = 0;
    let record = |t: &Texture| {
        let count = level_count([t.width, t.height]);
        let flags = u32::from(t.srgb) | wrap(t.wrap[0]) << 1 | wrap(t.wrap[1]) << 3;
        let extent = (t.width as f32 * t.height as f32).sqrt();
        let record = TextureRecord { first, last: first + count - 1, flags, extent };
        first += count;
        record
    };
    let textures_of = textures.iter().map(record).collect();
    let level = |([width, height], place): ([u32; 2], &Place)| LevelRecord {
        origin: place.origin[0] | place.origin[1] << 16,
        size: width | height << 16,
        layer: place.layer % of_page.max(1),
        page: place.layer / of_page.max(1),
    };
    (textures_of, all_levels(textures).into_iter().zip(&packing.places).map(level).collect())
}

impl DeviceTextures {
    /// Places a scene's textures with all their levels on the device. Errors: they are more or larger than the device holds.
    pub(super) fn new(context: &Context, staging: &mut Staging, scene: &Scene) -> Result<DeviceTextures> {
        Self::within(context, staging, scene, &Image::layer_limits(context)?)
    }

    /// The same in images that stay within `limits`.
    pub fn within(
        context: &Context,
        staging: &mut Staging,
        scene: &Scene,
        limits: &LayerLimits,
    ) -> Result<DeviceTextures> {
        let textures = &scene.textures;
        let (packing, of_page) = pack_textures(textures, limits)?;
        let (texture_records, level_records) = records(textures, &packing, of_page);
        let mut pages = Vec::new();
        for first in (0..packing.layers).step_by(of_page.max(1) as usize) {
            let layers = of_page.min(packing.layers - first);
            let name = format!("scene texels {}", pages.len());
            let page = Image::layered(context, &name, packing.size[0], packing.size[1], layers);
            pages.push(page.map_err(|error| match error {
                Error::OutOfMemory { bytes: Some(bytes), .. } => Error::Scene(format!(
                    "no memory on the device for {} MiB of its {} textures, which take {} MiB; scale them down",
                    bytes.div_ceil(1 << 20),
                    textures.len(),
                    (4 * packing.texels()).div_ceil(1 << 20),
                )),
                error => error,
            })?);
        }
        let records = staging.stage(context, "scene textures", &texture_records)?;
        let levels = staging.stage(context, "levels of scene textures", &level_records)?;
        let mut upload = LayerUpload::new(context, staging, &pages, bytes_of(textures))?;
        for (index, (texture, record)) in (0u32..).zip(textures.iter().zip(&texture_records)) {
            let mut fill = |level: usize, texels: &[[u8; 4]]| {
                let LevelRecord { origin, size, layer, page } = level_records[level];
                let [origin, size] = [origin, size].map(|packed| [packed & 0xffff, packed >> 16]);
                upload.fill(page as usize, layer, origin, size, texels)
            };
            fill(record.first as usize, &texture.texels)?;
            let levels = texture.levels(scene.counts_by_alpha(index));
            for (level, (_, texels)) in (record.first as usize + 1..).zip(levels) {
                fill(level, &texels)?;
            }
        }
        upload.finish()?;
        Ok(DeviceTextures { records, levels, pages })
    }

    /// Buffers and pages by their names in shaders; the first page stands for those that there are not.
    pub fn resources(&self) -> Resources {
        let buffers = Resources::of([("textures", &self.records), ("texture_levels", &self.levels)]);
        let page = |i: usize| self.pages.get(i).unwrap_or(&self.pages[0]);
        (0..PAGES).fold(buffers, |all, i| all.with_image(NAMES[i], page(i)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIMITS: LayerLimits = LayerLimits { size: [16384, 16384], layers: 2048, bytes: 2 << 30 };

    fn texture(width: u32, height: u32) -> Texture {
        // Only sizes matter here.
        Texture {
            name: format!("{width}x{height}"),
            width,
            height,
            texels: Vec::new(),
            srgb: true,
            wrap: [Wrap::Repeat; 2],
        }
    }

    /// Fails if rectangles overlap or lie outside their layers.
    fn check(packing: &Packing, rectangles: &[[u32; 2]]) {
        assert_eq!(packing.places.len(), rectangles.len());
        let ends = |i: usize| [0, 1].map(|k| packing.places[i].origin[k] + rectangles[i][k]);
        let mut order: Vec<usize> = (0..rectangles.len()).collect();
        order.sort_by_key(|&i| (packing.places[i].layer, packing.places[i].origin[1]));
        for (n, &i) in order.iter().enumerate() {
            let a = packing.places[i];
            assert!(a.layer < packing.layers && ends(i)[0] <= packing.size[0] && ends(i)[1] <= packing.size[1], "{i}");
            for &j in &order[n + 1..] {
                let b = packing.places[j];
                if b.layer != a.layer || b.origin[1] >= ends(i)[1] {
                    break;
                }
                assert!(b.origin[0] >= ends(i)[0] || a.origin[0] >= ends(j)[0], "{a:?} and {b:?} overlap");
            }
        }
    }

    #[test]
    fn textures_of_awkward_sizes_do_not_overlap() {
        let sets: [&[(u32, u32)]; 6] = [
            &[],
            &[(1, 1)],
            &[(27, 3), (1, 1), (13, 17), (101, 97), (3, 27), (1, 500)],
            &[(4096, 4096)],
            &[(16384, 1), (1, 16384), (640, 480)],
            &[(3000, 3000), (3000, 3000), (512, 512), (2047, 2049)],
        ];
        for set in sets {
            let textures: Vec<_> = set.iter().map(|&(w, h)| texture(w, h)).collect();
            let levels = all_levels(&textures);
            check(&pack(&levels, LIMITS.size), &levels);
        }
        for limit in [[64, 64], [97, 101]] {
            let levels = all_levels(&[texture(64, 64), texture(31, 7), texture(1, 64), texture(53, 59)]);
            check(&pack(&levels, limit), &levels);
        }
    }

    #[test]
    fn little_is_left_empty() {
        let wasted = |set: Vec<Texture>| {
            let (packing, _) = pack_textures(&set, &LIMITS).unwrap();
            (4 * packing.texels()) as f64 / bytes_of(&set) as f64
        };
        assert!(wasted(vec![texture(4096, 4096); 30]) < 1.03);
        assert!(wasted(vec![texture(1024, 1024); 7]) < 1.1);
        assert!(wasted(vec![texture(3000, 3000); 11]) < 1.1);
        // No two have one height, which shelves hold worst.
        assert!(wasted((1..60).map(|i| texture(37 * i, 2400 - 40 * i)).collect()) < 1.3);
    }

    #[test]
    fn a_texture_may_fill_a_page() {
        // One page holds the texture and nothing else; its levels lie on the next.
        let limits = LayerLimits { size: [512, 512], layers: 2048, bytes: 4 * 512 * 512 };
        let (packing, of_page) = pack_textures(&[texture(512, 512)], &limits).unwrap();
        assert_eq!((packing.size, packing.layers, of_page), ([512, 512], 2, 1));
        let (textures, levels) = records(&[texture(512, 512)], &packing, of_page);
        assert_eq!((textures[0].first, textures[0].last, levels.len()), (0, 9, 10));
        assert_eq!((levels[0].page, levels[0].layer, levels[1].page, levels[1].layer), (0, 0, 1, 0));
        // Thirty of 4096 x 4096 take two pages of 2 GiB.
        let (packing, of_page) = pack_textures(&vec![texture(4096, 4096); 30], &LIMITS).unwrap();
        let (_, levels) = records(&vec![texture(4096, 4096); 30], &packing, of_page);
        assert_eq!(levels.iter().map(|level| level.page).max(), Some(1));
    }

    #[test]
    fn more_than_the_device_holds_is_refused() {
        let refused = |set: &[Texture], limits: LayerLimits| pack_textures(set, &limits).unwrap_err().to_string();
        let wide = refused(&[texture(20000, 4)], LIMITS);
        assert!(wide.contains("20000x4") && wide.contains("16384x16384") && wide.contains("scale it down"), "{wide}");
        let many = refused(&vec![texture(8192, 8192); 40], LIMITS);
        assert!(many.contains("40 textures") && many.contains(" MiB") && many.contains("scale the textures"), "{many}");
        // A single texture that is larger than an image may be.
        let large = refused(&[texture(600, 600)], LayerLimits { size: [600, 600], layers: 8, bytes: 1 << 20 });
        assert!(large.contains("1 textures"), "{large}");
    }
}
