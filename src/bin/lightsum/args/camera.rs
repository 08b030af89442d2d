//! Flags of the camera.

use clap::Args;
use glam::{DVec3, Vec3};

use super::values::{angle, direction, distance, image_height, length, length_or_0, orbit, point};

/// The camera; each flag overrides a value of the scene's camera.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Camera (overrides the scene's; a model without one is framed)")]
pub struct Camera {
    /// Name of a camera of the glTF file [default: its first].
    #[arg(long, value_name = "NAME", conflicts_with = "orbit")]
    pub camera: Option<String>,
    /// Eye point, scene units.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = point)]
    pub eye: Option<DVec3>,
    /// Point at the centre of the image, scene units.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = point)]
    pub target: Option<DVec3>,
    /// Frame the whole scene: azimuth, from positive z towards positive x, and elevation of the eye, degrees.
    ///
    /// Replaces the scene's camera, as do the 20,20 from which a model without one is seen.
    #[arg(long, value_name = "AZIMUTH,ELEVATION", allow_hyphen_values = true, value_parser = orbit, conflicts_with_all = ["eye", "target", "up"])]
    pub orbit: Option<[f32; 2]>,
    /// Up direction, of any length [default: the scene's, or 0,1,0].
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = direction)]
    pub up: Option<Vec3>,
    /// Vertical angle of view in degrees, between 0 and 180 [default: the scene's, or 45].
    #[arg(long, value_name = "DEG", allow_negative_numbers = true, value_parser = angle)]
    pub fov: Option<f32>,
    /// Height of the image in scene units: an orthographic camera, whose rays are parallel [default: the scene's, or an angle of view].
    ///
    /// The rays start in the plane through the eye; what lies behind it is not seen. --fov makes an orthographic camera of a scene a
    /// perspective one. Without a lens (--aperture 0) and mirror images (--superposition off).
    #[arg(long, value_name = "HEIGHT", allow_negative_numbers = true, value_parser = image_height, conflicts_with = "fov")]
    pub ortho: Option<f32>,
    /// Diameter of the lens in scene units, for depth of field [default: the scene's, or 0, a pinhole].
    ///
    /// The blur grows in proportion. Any value but 0 costs a convolution in each pass.
    #[arg(long, value_name = "DIAMETER", allow_negative_numbers = true, value_parser = length_or_0)]
    pub aperture: Option<f32>,
    /// Focus distance along the viewing direction, scene units [default: the scene's, or that of the target].
    #[arg(long, value_name = "DISTANCE", allow_negative_numbers = true, value_parser = length)]
    pub focus: Option<f32>,
    /// Time for which the shutter is open, seconds, around the moment that is shown: what moves is blurred [default: the scene's, or 0].
    ///
    /// Objects and camera move by the path and the animation. The blur grows in proportion. Any value but 0 costs a convolution in each pass,
    /// where something moves.
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true, value_parser = distance)]
    pub shutter: Option<f32>,
}
