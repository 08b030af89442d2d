//! Buffers of a pass, for hosts that read them in shaders of their own: what the eye sees, the light there, and the virtual lights.
//!
//! All are storage buffers ([`Buffer::handle`]) with the further usages TRANSFER_SRC, TRANSFER_DST and INDIRECT_BUFFER, of the queue family
//! of the context. They are written by [`Engine::record_pass`] and hold their content until the next one; the recorder's barrier makes it
//! visible to compute and transfer commands, and other stages need a barrier from COMPUTE_SHADER, SHADER_WRITE. Changes of size, settings
//! or scene may make other buffers: ask again after each.
//!
//! `examples/shaders/virtual_lights.wgsl` and `.glsl` read the lights and ask the tree whether they are visible;
//! `examples/lights_for_rasterizer.rs` runs them. `examples/shaders/kept_light.wgsl` and `.glsl` read light kept in textures.

use super::Engine;
use crate::error::Result;
use crate::gpu::Buffer;
use crate::pass::g_buffer::Records;
use crate::pass::kept_light::KeptBuffers;

/// Buffers of the latest pass. Those of pixels are arrays of vec4 of 32-bit floats, row by row from the top, with a vec4 for each pixel;
/// what follows these in a buffer are the second components of pixels with mirrors, glass and narrow lobes.
#[non_exhaustive]
#[derive(Clone, Copy)]
pub struct PassBuffers<'a> {
    /// Point seen, moved off its surface so that rays may start there; w: distance along its ray, 0 where there is none.
    pub position: &'a Buffer,
    /// Unit geometric normal on the eye's side; w: internal.
    pub geometric_normal: &'a Buffer,
    /// Unit shading normal on the eye's side; w: alpha of the specular lobe.
    pub normal: &'a Buffer,
    /// Diffuse albedo, zero where nothing is seen; w: internal.
    pub albedo: &'a Buffer,
    /// w: depth along the view direction, of what mirrors show along the straightened path; xyz: product of the reflectances on the way.
    pub depth: &'a Buffer,
    /// Irradiance from the emitters, after filters; undefined where no light is reflected ([`crate::pass::ShadingPoints::LIT`]).
    pub direct: &'a Buffer,
    /// Irradiance from all other light, likewise. The radiance of a matte surface is albedo / pi times both.
    pub indirect: &'a Buffer,
    /// Direction back along the ray; w: flags, see [`crate::pass::ShadingPoints::flags`].
    pub flags: &'a Buffer,
    /// The virtual lights.
    pub lights: VirtualLights<'a>,
    /// The tree, to ask whether a light is visible.
    pub tree: TreeBuffers<'a>,
    /// The points that the next pass lights, if the view is an atlas ([`crate::view::Atlas`]): four words a texel, namely the number of its
    /// triangle in the order of the leaves ([`crate::accel::Bvh::leaf_numbers`]) or all ones, the bits of u and v, and 1 if it is seen from
    /// the back. A host may write them from a visibility buffer of its own, after [`Engine::record_setup`] and before each pass, with a
    /// barrier to compute shaders; it calls [`Engine::restart`] when they show other points. They are not checked: the triangle must
    /// exist, and u and v lie in it.
    pub texels: Option<&'a Buffer>,
    /// The surfaces that the next pass lights, if the view is a G-buffer of the host ([`crate::View::GBuffer`]). [`Engine::record_g_buffer`] writes them, or the
    /// host itself does, after [`Engine::record_setup`] and before a pass, with a barrier to compute shaders.
    pub g_buffer: Option<&'a Records>,
    /// Light kept in textures; `None`: the scene has none.
    pub kept_light: Option<&'a KeptBuffers>,
}

/// Virtual lights of a pass: those of class c of pixels are `lights[c * of_class .. (c + 1) * of_class]`. A pixel at (x, y) has the class
/// x mod w + w (y mod h), with w and h of [`crate::Settings::pattern`] (at a shading rate of 2 x and y are halved first); each class alone gives the whole light of the scene, so that a host
/// may take one of them or all, divided by their number. Slots without a light send nothing.
#[non_exhaustive]
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LightLayout {
    /// Lights of a class.
    pub of_class: u32,
    /// Number of classes.
    pub classes: u32,
    /// Distance below which lights on surfaces count as being this far away.
    pub clip: f32,
    /// Distance at which parallel light starts.
    pub far: f32,
}

/// The virtual lights of the latest pass.
#[non_exhaustive]
#[derive(Clone, Copy)]
pub struct VirtualLights<'a> {
    /// [`crate::pass::layout::PointLight`]s: 96 bytes each.
    pub buffer: &'a Buffer,
    /// Which of them light a pixel, and how.
    pub layout: LightLayout,
}

/// The binary tree and its triangles: arrays of vec4, as `shaders/include/bvh.wgsl` and [`crate::accel`] describe them.
#[non_exhaustive]
#[derive(Clone, Copy)]
pub struct TreeBuffers<'a> {
    /// Number of nodes; a walk ends there.
    pub nodes: u32,
    /// Lower corners; w: bits of the index of the node after those below this one.
    pub node_min: &'a Buffer,
    /// Upper corners; w: bits of 8 times the first triangle of a leaf, plus their number, or 0.
    pub node_max: &'a Buffer,
    /// First corners of the triangles.
    pub v0: &'a Buffer,
    /// Edges to their second corners.
    pub e1: &'a Buffer,
    /// Edges to their third corners.
    pub e2: &'a Buffer,
}

impl Engine {
    /// Buffers of the pass that was recorded last. Errors: a scene edit that waits does not fit the device.
    pub fn pass_buffers(&self) -> Result<PassBuffers<'_>> {
        let (frame, scene) = (&self.frame, &self.scene);
        let parameters = self.plan.parameters(self.passes.saturating_sub(1))?;
        let seen = frame.upsample.as_ref().map_or(frame.eye.seen(), |upsample| upsample.seen());
        let points = seen.points;
        let filtered = frame.discontinuity.as_ref().map_or(&frame.shade.lighting, |filter| &filter.filtered);
        let lit = frame.discontinuity_lobes.as_ref().map_or(filtered, |filter| &filter.filtered);
        let lighting = frame.upsample.as_ref().map_or(lit, |upsample| &upsample.lighting);
        let layout = LightLayout {
            of_class: parameters.pattern[3],
            classes: parameters.pattern[2],
            clip: parameters.up[3],
            far: parameters.forward[3],
        };
        Ok(PassBuffers {
            position: &points.position,
            geometric_normal: &points.geometric,
            normal: &points.shading,
            albedo: &points.kd,
            depth: &seen.paths.throughput,
            direct: &lighting.direct,
            indirect: &lighting.indirect,
            flags: &points.wo,
            lights: VirtualLights { buffer: frame.lights(), layout },
            tree: TreeBuffers {
                nodes: parameters.scene[0],
                node_min: &scene.node_min,
                node_max: &scene.node_max,
                v0: &scene.v0,
                e1: &scene.e1,
                e2: &scene.e2,
            },
            texels: frame.eye.texels(),
            g_buffer: frame.eye.g_buffer(),
            kept_light: scene.kept_light.as_ref(),
        })
    }
}
