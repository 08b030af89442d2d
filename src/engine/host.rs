//! For hosts: the view by matrices or by a G-buffer, light in images of the host.

use ash::vk;
use glam::Mat4;

use super::Engine;
use crate::error::{Error, Result};
use crate::gpu::{Image, Recorder};
use crate::pass::g_buffer_read::GBufferImages;
use crate::pass::resolve::Resolve;
use crate::scene::Camera;

impl Engine {
    /// [`Engine::set_camera`] with the camera of a view matrix and a projection ([`Camera::from_matrices`]), at the size of the present
    /// image. Lens and shutter stay those of the present camera.
    pub fn set_matrices(&mut self, view: Mat4, projection: Mat4) -> Result<()> {
        let camera = Camera::from_matrices(view, projection, self.plan.view.within().size)?;
        let camera = match self.plan.view.camera() {
            None => camera,
            Some(&old) => {
                let focus = if old.has_lens() { Some(old.focus_distance()) } else { None };
                Camera { aperture: old.aperture, focus, shutter: old.shutter, ..camera }
            }
        };
        self.set_camera(camera)
    }

    /// Reads what the host's rasterizer shows, in place of eye rays: for a view [`View::GBuffer`](crate::view::View::GBuffer), before a pass, and again only when the images have
    /// changed. Then call [`Engine::restart`], and [`Engine::set_camera`] if the camera moved: the camera tells from where
    /// points are seen. The scene of the engine lights them and casts their shadows, so it is the one that the host shows.
    ///
    /// Pixels whose numbers tell no surface see nothing ([`crate::pass::g_buffer`]); [`Records::refused`](crate::pass::g_buffer::Records::refused) counts them.
    /// New buffers of pixels, as [`Engine::resize`] and some settings make them, see nothing until this is called again.
    ///
    /// Errors, after which the command buffer is not to be submitted: another view; before [`Engine::record_setup`]; those of the images, see
    /// [`GBufferImages`].
    pub fn record_g_buffer(&mut self, rec: &mut Recorder, images: &GBufferImages) -> Result<()> {
        let misuse = |message: &str| Error::Resource { name: String::from("G-buffer"), message: message.to_owned() };
        if !self.set_up {
            return Err(misuse("the engine is not set up; record_setup comes before"));
        }
        self.apply_edits()?;
        let records = self.frame.eye.g_buffer();
        let records = records.ok_or_else(|| misuse("the view is none of a host; set View::GBuffer"))?;
        images.check(self.plan.view.size())?;
        rec.begin();
        // Those of new buffers would overwrite what is read.
        self.record_uploads(rec)?;
        images.record(&self.context, rec, records)?;
        self.upload = false;
        Ok(())
    }

    /// [`Engine::record_image`] into an image of the host ([`Image::adopt`]): R32G32B32A32_SFLOAT or R16G16B16A16_SFLOAT, usage STORAGE, of
    /// the view's size. `layouts`: that of the image when the commands begin, and that which they leave; all pixels are written, so the
    /// first may be UNDEFINED. A barrier makes the image visible to all later commands of the queue, of any stage.
    ///
    /// [`Engine::image`] is not written. After [`Engine::resize`] give an image of the new size; tree, scene and pipelines stay.
    ///
    /// Errors: another format or size; no layout can be left as UNDEFINED; the image belongs to another context.
    pub fn record_image_to(&self, rec: &mut Recorder, image: &Image, layouts: [vk::ImageLayout; 2]) -> Result<()> {
        let ([width, height], [before, after]) = (self.plan.view.size(), layouts);
        if [image.width(), image.height()] != [width, height] {
            let message = format!("has {}x{} pixels, but the view has {width}x{height}", image.width(), image.height());
            return Err(Error::Resource { name: image.name().to_owned(), message });
        }
        let resolve = Resolve::new(&self.context, &self.frame.output.film, image)?;
        rec.begin();
        if self.new_image {
            // The sums are as new, and hold anything until the next pass clears them.
            self.frame.output.record_clear(rec)?;
        }
        rec.change_layout(image, before, vk::ImageLayout::GENERAL)?;
        rec.scope("resolve", |rec| resolve.record(rec))?;
        rec.change_layout(image, vk::ImageLayout::GENERAL, after)
    }
}
