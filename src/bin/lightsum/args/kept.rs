//! The flag of light that was baked.

use std::path::PathBuf;
use std::sync::Arc;

use clap::Args;
use lightsum::scene::Scene;
use lightsum::{Error, Result};

/// Light that was baked.
#[derive(Clone, Debug, Args)]
pub struct KeptLight {
    /// Show the light that `bake` kept in this file, of the same scene, with no virtual lights.
    ///
    /// Mirrors, glass and narrow lobes show it too. The time of a pass does not depend on the number of lights. Objects, materials and lights
    /// stay as they were baked; the camera moves.
    #[arg(long, value_name = "FILE.glb")]
    pub light_from: Option<PathBuf>,
}

impl KeptLight {
    /// Gives the scene the light. Errors: the file is none of a bake, or of another scene.
    pub fn read(&self, scene: &mut Scene) -> Result<()> {
        let Some(file) = &self.light_from else { return Ok(()) };
        scene.kept_light = Some(Arc::new(lightsum::bake::files::read(file, scene)?));
        scene.files.push(file.clone());
        Ok(())
    }

    /// Refuses objects that move.
    pub fn check_still(&self, moves: bool) -> Result<()> {
        if !moves || self.light_from.is_none() {
            return Ok(());
        }
        let message =
            String::from("kept light is that of a scene that stands still, and objects move here; leave it out");
        Err(Error::Setting { name: "--light-from", message })
    }
}
