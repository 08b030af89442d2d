//! The window with all that draws in it. Fields are dropped in their order.

use std::sync::Arc;

use egui::ViewportId;
use lightsum::Result;
use lightsum::gpu::surface::{Presenter, WindowDevice};
use lightsum::gpu::{Context, ContextOptions, Messages, Timers};
use winit::window::Window;

use super::painter::Painter;
use crate::args::View;
use crate::render::pipeline_cache;

/// Scopes of a frame that are timed.
const SCOPES: u32 = 160;

/// The window, its device, and what was made on it.
pub struct Stage {
    /// Draws the panel.
    pub painter: Painter,
    /// Shows frames.
    pub presenter: Presenter,
    /// Times of the GPU passes.
    pub timers: Timers,
    /// The device as the engine sees it.
    pub context: Context,
    /// The device.
    pub device: WindowDevice,
    /// Input of the panel.
    pub input: egui_winit::State,
    /// The window.
    pub window: Arc<Window>,
}

impl Stage {
    /// Opens a device for a window.
    pub fn new(window: Window, args: &View) -> Result<Stage> {
        let window = Arc::new(window);
        let choice = args.shown.device.device.clone().unwrap_or_default();
        let device = WindowDevice::new(window.clone(), &choice, args.shown.device.validation)?;
        let options = ContextOptions {
            pipeline_cache: pipeline_cache(),
            max_memory: args.shown.device.max_device_memory,
            own_work: true,
            ..ContextOptions::default()
        };
        let context = device.lend(&options)?;
        let size = window.inner_size();
        let presenter = Presenter::new(&device, &context, [size.width, size.height])?;
        let painter = Painter::new(&device, &presenter)?;
        let side = device.info().max_image_dimension as usize;
        let scale = window.scale_factor() as f32;
        let panel = egui::Context::default();
        panel.set_visuals(egui::Visuals::dark());
        let input = egui_winit::State::new(panel, ViewportId::ROOT, &window, Some(scale), None, Some(side));
        Ok(Stage { painter, presenter, timers: Timers::new(&context, SCOPES)?, context, device, input, window })
    }

    /// Ends everything; returns the bytes of the device's memory that were not given back, and the layer's messages to come.
    pub fn end(self) -> (u64, Messages) {
        let Stage { painter, presenter, timers, context, device, input, window } = self;
        let messages = device.messages();
        // Waits for the frame in flight.
        drop(presenter);
        drop(timers);
        let bytes = painter.end() + context.allocated_bytes();
        drop((context, device, input, window));
        (bytes, messages)
    }
}
