//! Draws the panel, with memory of its own on the window's device.

use std::sync::{Arc, Mutex, PoisonError};

use ash::vk;
use egui::{ClippedPrimitive, TextureId, TexturesDelta};
use egui_ash_renderer::allocator::GpuAllocator;
use egui_ash_renderer::{Options, RenderMode, Renderer, RendererError};
use gpu_allocator::vulkan::{Allocator, AllocatorCreateDesc};
use lightsum::gpu::surface::{Canvas, Presenter, WindowDevice};
use lightsum::{Error, Result};

/// The painter. Fields are dropped in this order.
pub struct Painter {
    renderer: Renderer<GpuAllocator>,
    allocator: Arc<Mutex<Allocator>>,
    /// Textures that the frame in flight still uses.
    unused: Vec<TextureId>,
    device: WindowDevice,
}

fn failed(error: RendererError) -> Error {
    match error {
        RendererError::Vulkan(vk::Result::ERROR_DEVICE_LOST) => {
            Error::DeviceLost { during: "while the panel was drawn".into() }
        }
        error => Error::Resource { name: String::from("the window's panel"), message: error.to_string() },
    }
}

impl Painter {
    /// For the frames of a presenter.
    pub fn new(device: &WindowDevice, presenter: &Presenter) -> Result<Painter> {
        let allocator = Allocator::new(&AllocatorCreateDesc {
            instance: device.instance().clone(),
            device: device.device().clone(),
            physical_device: device.physical(),
            debug_settings: Default::default(),
            buffer_device_address: false,
            allocation_sizes: Default::default(),
        });
        let allocator = allocator.map_err(|error| failed(RendererError::GpuAllocator(error)))?;
        let allocator = Arc::new(Mutex::new(allocator));
        let renderer = Renderer::with_gpu_allocator(
            allocator.clone(),
            device.device().clone(),
            RenderMode::RenderPass(presenter.render_pass()),
            Options::default(),
        );
        Ok(Painter { renderer: renderer.map_err(failed)?, allocator, unused: Vec::new(), device: device.clone() })
    }

    /// Uploads changed textures; no frame may be in flight.
    pub fn update(&mut self, mut changes: TexturesDelta) -> Result<()> {
        for id in self.unused.drain(..) {
            self.renderer.free_texture(id).map_err(failed)?;
        }
        for (id, parts) in changes.set.drain() {
            for part in &parts {
                let renderer = &mut self.renderer;
                let set = self.device.with_queue(|queue, pool| renderer.set_texture(queue, pool, id, part));
                set.map_err(failed)?;
            }
        }
        self.unused.extend(changes.free.drain());
        Ok(())
    }

    /// Draws.
    pub fn draw(&mut self, canvas: &Canvas, scale: f32, shapes: &[ClippedPrimitive]) -> Result<()> {
        self.renderer.cmd_draw(canvas.commands, canvas.extent, scale, shapes).map_err(failed)
    }

    /// Ends the painter; returns the bytes that it has not given back.
    pub fn end(self) -> u64 {
        let Painter { renderer, allocator, device, .. } = self;
        drop(renderer);
        let bytes = allocator.lock().unwrap_or_else(PoisonError::into_inner).generate_report().total_allocated_bytes;
        drop(allocator);
        drop(device);
        bytes
    }
}
