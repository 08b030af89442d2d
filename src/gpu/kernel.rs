//! Kernels: compute pipelines and their bindings.

use std::collections::BTreeSet;
use std::ffi::CStr;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use std::time::Instant;

use ash::vk;

use super::context::Context;
use super::image::Image;
use super::memory::{Buffer, Memory};
use super::resources::Resources;
use crate::error::{Error, Result};

/// A compiled kernel; see [`super::shaders`].
#[derive(Debug)]
pub struct Shader {
    /// Its name, which is also its label in messages.
    pub name: &'static str,
    /// The file it was compiled from, relative to the crate.
    pub file: &'static str,
    /// The flags it was compiled with.
    pub flags: &'static [&'static str],
    /// The compute function.
    pub entry_point: &'static CStr,
    /// SPIR-V without bounds checks.
    pub spirv: &'static [u8],
    /// SPIR-V with every index restricted to its array.
    pub spirv_checked: &'static [u8],
    /// SPIR-V without bounds checks, with arrays as texel buffers.
    pub spirv_texels: &'static [u8],
    /// Invocations of a workgroup along each axis.
    pub workgroup_size: [u32; 3],
    /// Buffers and images of group 0, sorted by slot.
    pub bindings: &'static [BindingInfo],
    /// Size of the push constants, bytes.
    pub push_bytes: u32,
    /// Bindings and structures in words; `hot-reload` refuses a new version that differs in them.
    pub interface: &'static str,
}

impl Shader {
    /// Number of storage buffers that the kernel declares.
    pub fn storage_buffers(&self) -> u32 {
        self.bindings.iter().filter(|binding| binding.kind.is_buffer()).count() as u32
    }
}

impl Shader {
    /// Whether the kernel takes arrays as texel buffers: the device is one where that is faster, and has room for them.
    fn takes_texels(&self, ctx: &Context) -> bool {
        let count = |ty| self.bindings.iter().filter(|binding| binding.descriptor(true) == ty).count();
        let sampled = count(vk::DescriptorType::UNIFORM_TEXEL_BUFFER) + count(vk::DescriptorType::SAMPLED_IMAGE);
        let stored = count(vk::DescriptorType::STORAGE_TEXEL_BUFFER) + count(vk::DescriptorType::STORAGE_IMAGE);
        let info = ctx.info();
        info.texel_buffers && sampled <= info.max_sampled_images as usize && stored <= info.max_storage_images as usize
    }

    /// The SPIR-V for a device.
    pub(super) fn code(&self, ctx: &Context) -> &'static [u8] {
        match (ctx.inner.checked_shaders, self.takes_texels(ctx)) {
            (true, _) => self.spirv_checked,
            (false, true) => self.spirv_texels,
            (false, false) => self.spirv,
        }
    }
}

/// A buffer or image that a kernel declares.
#[derive(Debug)]
pub struct BindingInfo {
    /// Name of the variable.
    pub name: &'static str,
    /// Its `@binding`.
    pub slot: u32,
    /// Its kind.
    pub kind: BindingKind,
    /// Bytes of a texel where it is bound as a texel buffer: 4, 8 (to be read only) or 16, integers of 32 bits. 0: it never is.
    pub texel_bytes: u32,
    /// Bytes that a buffer must have: those in front of a runtime-sized array, or all where there is none. How many elements of the array a
    /// kernel touches, its parameters tell.
    pub fixed_bytes: u32,
}

impl BindingInfo {
    /// `texels`: the kernel takes arrays as texel buffers.
    fn descriptor(&self, texels: bool) -> vk::DescriptorType {
        match (self.texel_bytes > 0 && texels, self.kind) {
            (true, BindingKind::StorageRead) => vk::DescriptorType::UNIFORM_TEXEL_BUFFER,
            (true, _) => vk::DescriptorType::STORAGE_TEXEL_BUFFER,
            (false, kind) => kind.descriptor(),
        }
    }
}

/// The format of texels of 4, 8 or 16 bytes.
pub(super) fn texel_format(bytes: u32) -> vk::Format {
    match bytes {
        4 => vk::Format::R32_UINT,
        8 => vk::Format::R32G32_UINT,
        _ => vk::Format::R32G32B32A32_UINT,
    }
}

/// Kind of a binding.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BindingKind {
    /// `var<storage, read>`
    StorageRead,
    /// `var<storage, read_write>`
    StorageReadWrite,
    /// `texture_storage_2d`
    StorageImage,
    /// `texture_2d_array`, read without a sampler
    ImageLayers,
    /// `texture_2d`, likewise
    SampledImage,
}

impl BindingKind {
    fn descriptor(self) -> vk::DescriptorType {
        match self {
            BindingKind::StorageRead | BindingKind::StorageReadWrite => vk::DescriptorType::STORAGE_BUFFER,
            BindingKind::StorageImage => vk::DescriptorType::STORAGE_IMAGE,
            BindingKind::ImageLayers | BindingKind::SampledImage => vk::DescriptorType::SAMPLED_IMAGE,
        }
    }

    fn is_buffer(self) -> bool {
        matches!(self, BindingKind::StorageRead | BindingKind::StorageReadWrite)
    }
}

/// A kernel on a device: its layout at once, its compute pipeline when it is first needed. Clones share them.
#[derive(Clone)]
pub struct Kernel(pub(super) Arc<KernelInner>);

pub(super) struct KernelInner {
    pub ctx: Context,
    pub shader: &'static Shader,
    /// It takes arrays as texel buffers.
    texels: bool,
    set_layout: vk::DescriptorSetLayout,
    pub layout: vk::PipelineLayout,
    pipeline: OnceLock<vk::Pipeline>,
    /// SPIR-V that the pipeline is made from, empty afterwards. Locked meanwhile, so that one thread makes it.
    code: Mutex<Vec<u32>>,
}

impl Kernel {
    /// Makes what is needed to bind the kernel, and leaves its pipeline to [`Context::make_pipelines`] or to the first
    /// command that runs it. With `hot-reload` the kernel is compiled from its file.
    ///
    /// A context makes each kernel once and keeps it, except with `hot-reload`.
    pub fn new(ctx: &Context, shader: &'static Shader) -> Result<Kernel> {
        if cfg!(feature = "hot-reload") {
            return Kernel::make(ctx, shader);
        }
        let address = std::ptr::from_ref(shader) as usize;
        if let Some(kernel) = ctx.kernels().get(&address) {
            return Ok(kernel.clone());
        }
        let kernel = Kernel::make(ctx, shader)?;
        ctx.kernels().insert(address, kernel.clone());
        Ok(kernel)
    }

    fn make(ctx: &Context, shader: &'static Shader) -> Result<Kernel> {
        let code = code(ctx, shader)?;
        check_device(ctx, shader, &code)?;
        let device = ctx.device();
        let failed = |r| ctx.failed(shader.name, r);
        let mut inner = KernelInner {
            ctx: ctx.without_kernels(),
            shader,
            texels: shader.takes_texels(ctx),
            set_layout: vk::DescriptorSetLayout::null(),
            layout: vk::PipelineLayout::null(),
            pipeline: OnceLock::new(),
            code: Mutex::new(code),
        };
        let slots: Vec<_> = shader
            .bindings
            .iter()
            .map(|binding| {
                vk::DescriptorSetLayoutBinding::default()
                    .binding(binding.slot)
                    .descriptor_type(binding.descriptor(inner.texels))
                    .descriptor_count(1)
                    .stage_flags(vk::ShaderStageFlags::COMPUTE)
            })
            .collect();
        let ranges =
            [vk::PushConstantRange::default().stage_flags(vk::ShaderStageFlags::COMPUTE).size(shader.push_bytes)];
        // SAFETY: creations from valid structures on a live device; the layout is from naga's reflection of the module.
        // After a failure `inner` destroys the objects made before it.
        unsafe {
            let create = vk::DescriptorSetLayoutCreateInfo::default().bindings(&slots);
            inner.set_layout = device.create_descriptor_set_layout(&create, None).map_err(failed)?;
            let layouts = [inner.set_layout];
            let mut create = vk::PipelineLayoutCreateInfo::default().set_layouts(&layouts);
            if shader.push_bytes > 0 {
                create = create.push_constant_ranges(&ranges);
            }
            inner.layout = device.create_pipeline_layout(&create, None).map_err(failed)?;
        }
        ctx.name(inner.set_layout, shader.name);
        ctx.name(inner.layout, shader.name);
        Ok(Kernel(Arc::new(inner)))
    }

    /// The pipeline, made through the context's pipeline cache if this is the first use.
    pub(super) fn pipeline(&self) -> Result<vk::Pipeline> {
        let KernelInner { ctx, shader, layout, pipeline, code, .. } = &*self.0;
        if let Some(made) = pipeline.get() {
            return Ok(*made);
        }
        // The code is whole until the pipeline stands, whatever thread failed before.
        let mut code = code.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(made) = pipeline.get() {
            return Ok(*made);
        }
        let device = ctx.device();
        let failed = |r| ctx.failed(shader.name, r);
        let start = Instant::now();
        // SAFETY: creations from valid structures on a live device; the SPIR-V was made and validated by naga, and the
        // layout from its reflection. Vulkan lets several threads create pipelines through one cache.
        let made = unsafe {
            let create = vk::ShaderModuleCreateInfo::default().code(&code);
            let module = device.create_shader_module(&create, None).map_err(failed)?;
            ctx.name(module, shader.name);
            let stage = vk::PipelineShaderStageCreateInfo::default()
                .stage(vk::ShaderStageFlags::COMPUTE)
                .module(module)
                .name(shader.entry_point);
            let create = [vk::ComputePipelineCreateInfo::default().stage(stage).layout(*layout)];
            let made = device.create_compute_pipelines(ctx.inner.cache.handle, &create, None);
            device.destroy_shader_module(module, None);
            // One pipeline was asked for; on failure Vulkan returns null for it, which is nothing to destroy.
            made.map_err(|(_, r)| failed(r))?.swap_remove(0)
        };
        ctx.name(made, shader.name);
        log::debug!("the pipeline of {} took {:.1} ms", shader.name, start.elapsed().as_secs_f64() * 1e3);
        *code = Vec::new();
        Ok(*pipeline.get_or_init(|| made))
    }

    /// Whether the pipeline stands.
    pub(super) fn is_made(&self) -> bool {
        self.0.pipeline.get().is_some()
    }

    /// Bytes of SPIR-V that wait to become the pipeline; 0 once it stands.
    pub(super) fn waiting_bytes(&self) -> usize {
        size_of_val(self.0.code.lock().unwrap_or_else(PoisonError::into_inner).as_slice())
    }

    /// The shader's name.
    pub fn name(&self) -> &'static str {
        self.0.shader.name
    }

    /// The shader it was made from.
    pub fn shader(&self) -> &'static Shader {
        self.0.shader
    }

    /// Joins the kernel with its buffers and images: each of its bindings is named exactly once.
    pub fn bind(&self, resources: &[(&str, Bound<'_>)]) -> Result<Bindings> {
        let KernelInner { shader, .. } = &*self.0;
        let misuse = |message: String| Error::Shader { name: shader.name.to_owned(), message };
        for (i, (name, _)) in resources.iter().enumerate() {
            if shader.bindings.iter().all(|binding| binding.name != *name) {
                return Err(misuse(format!("has no binding {name}")));
            }
            if resources[..i].iter().any(|(other, _)| other == name) {
                return Err(misuse(format!("binding {name} is named twice")));
            }
        }
        let find = |name: &str| resources.iter().find(|(other, _)| *other == name).map(|(_, bound)| *bound);
        let chosen = shader.bindings.iter().map(|binding| (binding, find(binding.name)));
        self.bind_chosen(chosen.collect())
    }

    /// Joins the kernel with what it declares of `sets`, or where they lack a name, of `shared`. Errors: a name is missing in
    /// all of them, or stands twice in `sets`.
    pub fn bind_from(&self, sets: &[&Resources], shared: &Resources) -> Result<Bindings> {
        let shader = self.0.shader;
        let mut chosen = Vec::with_capacity(shader.bindings.len());
        for binding in shader.bindings {
            let mut own = sets.iter().flat_map(|set| set.find(binding.name));
            let first = own.next();
            if own.next().is_some() {
                let message = format!("binding {} is named twice", binding.name);
                return Err(Error::Shader { name: shader.name.to_owned(), message });
            }
            chosen.push((binding, first.or_else(|| shared.find(binding.name).next())));
        }
        self.bind_chosen(chosen)
    }

    fn bind_chosen(&self, found: Vec<(&'static BindingInfo, Option<Bound<'_>>)>) -> Result<Bindings> {
        let &KernelInner { ref ctx, shader, texels, .. } = &*self.0;
        let misuse = |message: String| Error::Shader { name: shader.name.to_owned(), message };
        let mut chosen = Vec::with_capacity(found.len());
        for (binding, bound) in found {
            let bound = bound.ok_or_else(|| misuse(format!("binding {} is missing", binding.name)))?;
            bound.check(ctx, binding).map_err(|why| misuse(format!("binding {}: {why}", binding.name)))?;
            chosen.push((binding, bound));
        }
        let mut inner = BindingsInner {
            kernel: self.clone(),
            pool: vk::DescriptorPool::null(),
            set: vk::DescriptorSet::null(),
            views: Vec::new(),
            seen_by_host: chosen.iter().filter_map(|(_, bound)| bound.seen_by_host()).collect(),
            _retained: chosen.iter().map(|(_, bound)| bound.retain()).collect(),
        };
        // There is nothing to bind, or only what is measured and has no memory.
        if !chosen.iter().all(|(_, bound)| bound.is_backed()) || chosen.is_empty() {
            return Ok(Bindings(Arc::new(inner)));
        }
        let failed = |r| ctx.failed(shader.name, r);
        let device = ctx.device();
        let kinds = [BindingKind::StorageRead, BindingKind::StorageImage, BindingKind::ImageLayers];
        let sizes: Vec<_> = kinds
            .map(BindingKind::descriptor)
            .into_iter()
            .chain([vk::DescriptorType::UNIFORM_TEXEL_BUFFER, vk::DescriptorType::STORAGE_TEXEL_BUFFER])
            .map(|ty| {
                let count = shader.bindings.iter().filter(|binding| binding.descriptor(texels) == ty).count();
                vk::DescriptorPoolSize::default().ty(ty).descriptor_count(count as u32)
            })
            .filter(|size| size.descriptor_count > 0)
            .collect();
        // SAFETY: the pool holds exactly one set of this layout; `inner` destroys it.
        unsafe {
            let create = vk::DescriptorPoolCreateInfo::default().max_sets(1).pool_sizes(&sizes);
            inner.pool = device.create_descriptor_pool(&create, None).map_err(failed)?;
            let layouts = [self.0.set_layout];
            let allocate = vk::DescriptorSetAllocateInfo::default().descriptor_pool(inner.pool).set_layouts(&layouts);
            inner.set = device.allocate_descriptor_sets(&allocate).map_err(failed)?.swap_remove(0);
        }
        ctx.name(inner.pool, shader.name);
        ctx.name(inner.set, shader.name);
        for (binding, bound) in chosen {
            let write = vk::WriteDescriptorSet::default()
                .dst_set(inner.set)
                .dst_binding(binding.slot)
                .descriptor_type(binding.descriptor(texels));
            match bound {
                // SAFETY: set and buffer are alive, the buffer has the usage and no more texels than the device takes (`DeviceInfo::texel_buffers`);
                // `inner` destroys the view. No command uses the set yet.
                Bound::Buffer(buffer) if texels && binding.texel_bytes > 0 => unsafe {
                    let create = vk::BufferViewCreateInfo::default()
                        .buffer(buffer.handle())
                        .format(texel_format(binding.texel_bytes))
                        .range(vk::WHOLE_SIZE);
                    inner.views.push(device.create_buffer_view(&create, None).map_err(failed)?);
                    let view = &inner.views[inner.views.len() - 1..];
                    device.update_descriptor_sets(&[write.texel_buffer_view(view).descriptor_count(1)], &[]);
                },
                // SAFETY: set and buffer are alive and of the declared type; no command uses the set yet.
                Bound::Buffer(buffer) => unsafe {
                    let info = [vk::DescriptorBufferInfo::default().buffer(buffer.handle()).range(buffer.size())];
                    device.update_descriptor_sets(&[write.buffer_info(&info)], &[]);
                },
                // SAFETY: set and image are alive and of the declared type; no command uses the set yet.
                Bound::Image(image) => unsafe {
                    let info = [vk::DescriptorImageInfo::default()
                        .image_view(image.view())
                        .image_layout(vk::ImageLayout::GENERAL)];
                    device.update_descriptor_sets(&[write.image_info(&info)], &[]);
                },
            }
        }
        Ok(Bindings(Arc::new(inner)))
    }
}

impl Drop for KernelInner {
    fn drop(&mut self) {
        let device = self.ctx.device();
        // SAFETY: recorders retain the kernel until their commands are done. Null handles are ignored.
        unsafe {
            device.destroy_pipeline(self.pipeline.get().copied().unwrap_or_default(), None);
            device.destroy_pipeline_layout(self.layout, None);
            device.destroy_descriptor_set_layout(self.set_layout, None);
        }
    }
}

/// A buffer or an image to bind.
#[derive(Clone, Copy)]
pub enum Bound<'a> {
    /// A buffer as a whole.
    Buffer(&'a Buffer),
    /// An image, in the layout GENERAL.
    Image(&'a Image),
}

impl<'a> From<&'a Buffer> for Bound<'a> {
    fn from(buffer: &'a Buffer) -> Self {
        Bound::Buffer(buffer)
    }
}

impl<'a> From<&'a Image> for Bound<'a> {
    fn from(image: &'a Image) -> Self {
        Bound::Image(image)
    }
}

impl Bound<'_> {
    fn retain(&self) -> Arc<dyn Send + Sync> {
        match self {
            Bound::Buffer(buffer) => buffer.0.clone(),
            Bound::Image(image) => image.0.clone(),
        }
    }

    /// A buffer that the host may write or read.
    fn seen_by_host(&self) -> Option<Buffer> {
        match self {
            Bound::Buffer(buffer) if buffer.memory() != Memory::Device => Some((*buffer).clone()),
            _ => None,
        }
    }

    fn is_backed(&self) -> bool {
        match self {
            Bound::Buffer(buffer) => buffer.is_backed(),
            Bound::Image(image) => image.is_backed(),
        }
    }

    fn check(&self, ctx: &Context, binding: &BindingInfo) -> std::result::Result<(), String> {
        let (ours, name) = match self {
            Bound::Buffer(buffer) => (buffer.belongs_to(ctx), buffer.name()),
            Bound::Image(image) => (image.belongs_to(ctx), image.name()),
        };
        if !ours {
            return Err(format!("{name} belongs to another context"));
        }
        match (self, binding.kind) {
            (Bound::Buffer(_), kind) if !kind.is_buffer() => Err(format!("wants an image, but {name} is a buffer")),
            (Bound::Image(_), kind) if kind.is_buffer() => Err(format!("wants a buffer, but {name} is an image")),
            (Bound::Image(image), BindingKind::StorageImage | BindingKind::SampledImage) if image.is_layered() => {
                Err(format!("wants an image without layers, but {name} has some"))
            }
            (Bound::Image(image), BindingKind::StorageImage) if image.is_read_only() => {
                Err(format!("wants an image to store to, but {name} was adopted to be read"))
            }
            (Bound::Image(image), BindingKind::ImageLayers) if !image.is_layered() => {
                Err(format!("wants an image with layers, but {name} has none"))
            }
            (Bound::Buffer(buffer), _) if buffer.size() > ctx.info().max_storage_buffer_range => Err(format!(
                "{name} has {} bytes, and kernels see no more than {} (maxStorageBufferRange)",
                buffer.bytes(),
                ctx.info().max_storage_buffer_range
            )),
            (Bound::Buffer(buffer), _) if buffer.size() < u64::from(binding.fixed_bytes) => {
                Err(format!("{name} has {} bytes, and the kernel reads {}", buffer.bytes(), binding.fixed_bytes))
            }
            _ => Ok(()),
        }
    }
}

/// The resources bound to one kernel, kept alive. Clones share them.
#[derive(Clone)]
pub struct Bindings(pub(super) Arc<BindingsInner>);

impl Bindings {
    /// The kernel.
    pub fn kernel(&self) -> &Kernel {
        &self.0.kernel
    }
}

pub(super) struct BindingsInner {
    pub kernel: Kernel,
    pool: vk::DescriptorPool,
    /// Null if the kernel binds nothing.
    pub set: vk::DescriptorSet,
    /// Of the texel buffers.
    views: Vec<vk::BufferView>,
    /// Those of the buffers that the host may write or read.
    pub seen_by_host: Vec<Buffer>,
    _retained: Vec<Arc<dyn Send + Sync>>,
}

impl Drop for BindingsInner {
    fn drop(&mut self) {
        let device = self.kernel.0.ctx.device();
        // SAFETY: recorders retain the bindings until their commands are done; the set goes with its pool. The buffers of the views are
        // retained until then.
        unsafe {
            device.destroy_descriptor_pool(self.pool, None);
            for &view in &self.views {
                device.destroy_buffer_view(view, None);
            }
        }
    }
}

/// The SPIR-V to run.
#[cfg(not(feature = "hot-reload"))]
fn code(ctx: &Context, shader: &'static Shader) -> Result<Vec<u32>> {
    ash::util::read_spv(&mut std::io::Cursor::new(shader.code(ctx)))
        .map_err(|e| Error::Shader { name: shader.name.to_owned(), message: format!("embedded SPIR-V: {e}") })
}

/// The SPIR-V to run, compiled from the file as it is now: in the folder `LIGHTSUM_SHADERS` if that is set.
#[cfg(feature = "hot-reload")]
fn code(ctx: &Context, shader: &'static Shader) -> Result<Vec<u32>> {
    use super::wgsl;
    use std::path::{Path, PathBuf};

    let failed = |message: String| Error::Shader { name: shader.name.to_owned(), message };
    let file = Path::new(shader.file);
    let (Some(parent), Some(stem)) = (file.parent(), file.file_stem().and_then(|stem| stem.to_str())) else {
        return Err(failed(format!("{} is no path of a shader", shader.file)));
    };
    let dir = match std::env::var_os("LIGHTSUM_SHADERS") {
        Some(dir) if parent == Path::new("shaders") => PathBuf::from(dir),
        _ => Path::new(env!("CARGO_MANIFEST_DIR")).join(parent),
    };
    let source = wgsl::load(&dir, &dir.display().to_string(), stem, shader.flags).map_err(failed)?;
    let compiled = wgsl::compile(&source).map_err(failed)?;
    if compiled.interface() != shader.interface || compiled.workgroup_size != shader.workgroup_size {
        return Err(failed("bindings, structures or workgroup size have changed; build the program again".into()));
    }
    Ok(match (ctx.inner.checked_shaders, shader.takes_texels(ctx)) {
        (true, _) => compiled.spirv_checked,
        (false, true) => compiled.spirv_texels,
        (false, false) => compiled.spirv,
    })
}

/// Refuses a kernel that the device cannot run.
fn check_device(ctx: &Context, shader: &Shader, code: &[u32]) -> Result<()> {
    let info = ctx.info();
    let refuse = |message: String| Err(Error::Shader { name: shader.name.to_owned(), message });
    if shader.push_bytes > info.max_push_bytes {
        return refuse(format!(
            "{} bytes of push constants, the device takes {}",
            shader.push_bytes, info.max_push_bytes
        ));
    }
    if shader.storage_buffers() > info.max_storage_buffers {
        return refuse(format!(
            "{} storage buffers, the device takes {}",
            shader.storage_buffers(),
            info.max_storage_buffers
        ));
    }
    let invocations: u64 = shader.workgroup_size.iter().map(|n| u64::from(*n)).product();
    let fits = shader.workgroup_size.iter().zip(info.max_workgroup_size).all(|(n, max)| *n <= max);
    if !fits || invocations > u64::from(info.max_workgroup_invocations) {
        return refuse(format!("workgroups of {:?} are more than the device takes", shader.workgroup_size));
    }
    for (operation, name) in subgroup_operations(code) {
        if !info.subgroup_operations.contains(operation) {
            return refuse(format!("needs subgroup operations ({name}) that {} does not have", info.name));
        }
    }
    Ok(())
}

/// The subgroup operations that a SPIR-V module declares (OpCapability, numbers of the SPIR-V specification).
fn subgroup_operations(code: &[u32]) -> BTreeSet<(vk::SubgroupFeatureFlags, &'static str)> {
    const HEADER_WORDS: usize = 5;
    const OP_CAPABILITY: u32 = 2 << 16 | 17;
    // Capabilities come first in a module, two words each.
    code.get(HEADER_WORDS..)
        .unwrap_or_default()
        .chunks_exact(2)
        .take_while(|instruction| instruction[0] == OP_CAPABILITY)
        .filter_map(|instruction| match instruction[1] {
            61 => Some((vk::SubgroupFeatureFlags::BASIC, "basic")),
            62 => Some((vk::SubgroupFeatureFlags::VOTE, "vote")),
            63 => Some((vk::SubgroupFeatureFlags::ARITHMETIC, "arithmetic")),
            64 => Some((vk::SubgroupFeatureFlags::BALLOT, "ballot")),
            65 => Some((vk::SubgroupFeatureFlags::SHUFFLE, "shuffle")),
            66 => Some((vk::SubgroupFeatureFlags::SHUFFLE_RELATIVE, "relative shuffle")),
            68 => Some((vk::SubgroupFeatureFlags::QUAD, "quad")),
            _ => None,
        })
        .collect()
}
