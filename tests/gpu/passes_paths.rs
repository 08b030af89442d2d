//! The steps of eye paths where there are no mirrors and no glass.

use lightsum::scene::{Scene, builtin};
use lightsum::settings::Settings;

use crate::rig::{Rig, gallery_with_tables};
use crate::support::gpu_test;

#[test]
fn scenes_without_mirrors_and_glass_do_not_pay() {
    gpu_test(|ctx| {
        let steps = |scene: &Scene, settings: Settings| {
            let rig = Rig::new(ctx, scene, [9, 5], settings);
            let slots = rig.frame().eye.points.position.bytes() / 16;
            (rig.frame().eye.lists.len(), slots / 45)
        };
        let defaults = Settings { particles: 1, ..Settings::plain() };
        assert_eq!(steps(&builtin::furnace(0.5, 1.0), defaults.clone()), (0, 1));
        assert_eq!(steps(&gallery_with_tables(), defaults.clone()), (8, 3));
        assert_eq!(steps(&gallery_with_tables(), Settings { split: false, ..defaults.clone() }), (8, 1));
        assert_eq!(steps(&gallery_with_tables(), Settings { max_specular: 0, ..defaults.clone() }), (0, 1));
        // Mirrors without a base have one component.
        let mut scene = builtin::furnace(0.5, 1.0);
        scene.materials[0].surface = lightsum::scene::Surface::Mirror;
        assert_eq!(steps(&scene, defaults.clone()), (8, 2));
        scene.materials[0].metallic = 1.0;
        assert_eq!(steps(&scene, defaults), (8, 1));
    });
}
