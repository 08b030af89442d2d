//! Compilation of kernels side by side, for a driver that puts it off to the first dispatch.
//!
//! lavapipe compiles a kernel when it first runs, on the one thread of the queue, and keeps the code in a folder of its own, which
//! all devices read. So before the first pass on an empty folder further devices, one for each core, run each kernel with no
//! workgroups, and the pass finds their code. A file beside the pipeline cache says which kernels need none of this any more.
//!
//! File: one line for each kernel, in hexadecimal: a checksum of driver, device and SPIR-V.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use super::cache::fnv1a;
use super::image::Image;
use super::kernel::{BindingKind, Bound, Kernel, Shader};
use super::memory::{Buffer, Memory};
use super::{Context, ContextOptions, DeviceChoice};
use crate::error::{Error, Result};
use crate::output::write_cache;

/// Compiles those of the shaders that have not been compiled before, the ones with much code first. Returns their number.
///
/// Does nothing on other drivers, on a host's device that allows no work of ours, without a file to remember by, or where the driver keeps
/// no code.
pub(super) fn compile_ahead(ctx: &Context, mut shaders: Vec<&'static Shader>) -> Result<usize> {
    let Some(file) = ctx.pipeline_cache_path().map(beside) else { return Ok(0) };
    if !ctx.inner.own_work || ctx.info().driver != "llvmpipe" || !driver_keeps_code() {
        return Ok(0);
    }
    let known: BTreeSet<String> =
        std::fs::read_to_string(&file).unwrap_or_default().lines().map(str::to_owned).collect();
    // An image's format is a part of the code, and here it is not known.
    let is_image = |kind| matches!(kind, BindingKind::StorageImage | BindingKind::SampledImage);
    shaders.retain(|shader| !shader.bindings.iter().any(|binding| is_image(binding.kind)));
    shaders.retain(|shader| !known.contains(&key(ctx, shader)));
    if shaders.is_empty() {
        return Ok(0);
    }
    let threads = std::thread::available_parallelism().map_or(1, usize::from).min(shaders.len());
    let next = AtomicUsize::new(0);
    std::thread::scope(|scope| {
        let workers: Vec<_> = (0..threads).map(|_| scope.spawn(|| compile(ctx, &shaders, &next))).collect();
        // A worker that panics has found an error of this program, which the panic has told.
        workers.into_iter().try_for_each(|worker| {
            worker.join().unwrap_or_else(|_| {
                Err(Error::Resource { name: "kernels".into(), message: "a thread that compiles them panicked".into() })
            })
        })
    })?;
    let lines: BTreeSet<String> = known.into_iter().chain(shaders.iter().map(|shader| key(ctx, shader))).collect();
    let text: String = lines.into_iter().map(|line| line + "\n").collect();
    if let Err(error) = write_cache(&file, text.as_bytes()) {
        log::warn!("the list of compiled kernels is not kept: {error}");
    }
    Ok(shaders.len())
}

/// Compiles shaders on a device of its own, until none is left.
fn compile(ctx: &Context, shaders: &[&'static Shader], next: &AtomicUsize) -> Result<()> {
    let options = ContextOptions {
        device: DeviceChoice::Index(ctx.info().index),
        checked_shaders: ctx.inner.checked_shaders,
        no_texel_buffers: !ctx.info().texel_buffers,
        ..ContextOptions::default()
    };
    let ctx = Context::headless(&options)?;
    // No kernel runs, but each is bound to what it could read.
    let fixed = shaders.iter().flat_map(|shader| shader.bindings).map(|binding| u64::from(binding.fixed_bytes)).max();
    let buffer = Buffer::new(&ctx, "no data", fixed.unwrap_or(0).max(16), Memory::Device)?;
    let texels = Image::layered(&ctx, "no texels", 1, 1, 1)?;
    ctx.submit_and_wait("no texels", None, |rec| rec.image_to_general(&texels))?;
    while let Some(shader) = shaders.get(next.fetch_add(1, Ordering::Relaxed)) {
        let kernel = Kernel::new(&ctx, shader)?;
        let of_kind = |kind| match kind {
            BindingKind::ImageLayers => Bound::Image(&texels),
            _ => Bound::Buffer(&buffer),
        };
        let bound: Vec<_> = shader.bindings.iter().map(|binding| (binding.name, of_kind(binding.kind))).collect();
        let bindings = kernel.bind(&bound)?;
        let push = vec![0; shader.push_bytes as usize];
        let start = Instant::now();
        ctx.submit_and_wait(shader.name, None, |rec| rec.dispatch_none(&kernel, &bindings, &push))?;
        log::debug!("{}: compiled in {:.3} s", shader.name, start.elapsed().as_secs_f64());
    }
    Ok(())
}

/// Whether the driver may keep compiled code: as it is told by Mesa's variables.
fn driver_keeps_code() -> bool {
    let set = |name| std::env::var_os(name).is_some_and(|value| !value.is_empty());
    let yes =
        |name| std::env::var(name).is_ok_and(|value| matches!(value.to_lowercase().as_str(), "1" | "true" | "yes"));
    let off = ["MESA_SHADER_CACHE_DISABLE", "MESA_GLSL_CACHE_DISABLE"].into_iter().any(yes);
    let has_place = ["MESA_SHADER_CACHE_DIR", "XDG_CACHE_HOME", "HOME"].into_iter().any(set);
    has_place && !off
}

fn beside(cache: &Path) -> PathBuf {
    let mut name = cache.as_os_str().to_owned();
    name.push(".compiled");
    PathBuf::from(name)
}

fn key(ctx: &Context, shader: &Shader) -> String {
    let info = ctx.info();
    let code = shader.code(ctx);
    let driver = [info.driver.as_bytes(), info.driver_version.as_bytes(), &info.cache_uuid].concat();
    format!("{:016x}{:016x}", fnv1a(&driver), fnv1a(code))
}
