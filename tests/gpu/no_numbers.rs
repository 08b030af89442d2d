//! Passes with values that are no numbers leave no trace in the film, and others take their place.

use std::cell::Cell;

use lightsum::gpu::{Buffer, Context, Staging, download};
use lightsum::pass::layout::MaterialRecord;
use lightsum::scene::{Camera, Scene};
use lightsum::settings::Settings;
use lightsum::{Error, Renderer};

use crate::rig::gallery;
use crate::scenes::renderer;
use crate::support::gpu_test;

fn small() -> (Scene, Camera, Settings) {
    let scene = gallery();
    let camera = Camera { resolution: [32, 24], ..scene.camera.unwrap() };
    // With filters, summands, mirrors and glass: with every pass that adds to the film.
    let settings = Settings { particles: 4, max_depth: 3, photons: 200, summands: true, ..Settings::default() };
    (scene, camera, settings)
}

/// The materials on the device, as they are and with a base colour that is no number.
struct Fault {
    ctx: Context,
    buffer: Buffer,
    sound: Vec<MaterialRecord>,
}

impl Fault {
    fn new(ctx: &Context, renderer: &Renderer) -> Fault {
        let buffer = renderer.engine().device_scene().materials.clone();
        let sound = download(ctx, &buffer).unwrap();
        Fault { ctx: ctx.clone(), buffer, sound }
    }

    fn write(&self, base: Option<f32>) {
        let mut records = self.sound.clone();
        for record in &mut records {
            record.base[0] = base.unwrap_or(record.base[0]);
        }
        let mut staging = Staging::new();
        staging.stage_into(&self.ctx, &self.buffer, 0, &records).unwrap();
        self.ctx.submit_and_wait("a fault", None, |rec| staging.record(rec)).unwrap();
    }
}

fn film(renderer: &Renderer) -> Vec<u8> {
    renderer.film().unwrap().to_bytes()
}

#[test]
fn a_pass_with_a_value_that_is_no_number_is_repeated_with_the_next_sequence_number() {
    gpu_test(|ctx| {
        let (scene, camera, settings) = small();
        for value in [f32::NAN, f32::INFINITY, 1e35] {
            let mut faulty = renderer(ctx, &scene, camera, &settings);
            (0..2).for_each(|_| faulty.pass().unwrap());
            // How often a pass asks whether to stop: the fault is over before the last time, so the pass that follows is sound.
            let asked = Cell::new(0);
            let count = || {
                asked.set(asked.get() + 1);
                false
            };
            assert!(faulty.pass_unless(&count).unwrap());
            let (all, fault) = (asked.replace(0), Fault::new(ctx, &faulty));
            let strike = || {
                match asked.replace(asked.get() + 1) {
                    0 => fault.write(Some(value)),
                    n if n == all - 1 => fault.write(None),
                    _ => {}
                }
                false
            };
            assert!(faulty.pass_unless(&strike).unwrap());
            assert!(asked.get() > all, "{value}: the pass was made twice");
            assert_eq!((faulty.passes(), faulty.engine().passes()), (4, 5), "{value}");
            let statistics = faulty.statistics();
            assert_eq!((statistics.passes, statistics.passes_rendered, statistics.passes_left_out), (4, 4, 1));
            let saved = faulty.save_state().unwrap();
            faulty.pass().unwrap();

            let mut sound = renderer(ctx, &scene, camera, &settings);
            (0..3).for_each(|_| sound.pass().unwrap());
            sound.engine_mut().set_passes(4);
            (0..2).for_each(|_| sound.pass().unwrap());
            assert!(film(&faulty) == film(&sound), "{value}: the film is that of the other passes");
            let layers = faulty.layers().unwrap();
            assert!(layers.color.iter().chain(&layers.albedo).all(|v| v.is_finite()), "{value}");

            let mut resumed = renderer(ctx, &scene, camera, &settings);
            resumed.load_state(4, &saved).unwrap();
            resumed.pass().unwrap();
            assert_eq!((resumed.passes(), resumed.engine().passes()), (5, 6));
            assert!(film(&resumed) == film(&sound), "{value}: a state knows the sequence number");
        }
    });
}

#[test]
fn passes_that_are_never_numbers_are_an_error_and_leave_the_sums() {
    gpu_test(|ctx| {
        let (scene, camera, settings) = small();
        let mut faulty = renderer(ctx, &scene, camera, &settings);
        (0..2).for_each(|_| faulty.pass().unwrap());
        let (before, fault) = (film(&faulty), Fault::new(ctx, &faulty));
        fault.write(Some(f32::NAN));
        match faulty.pass() {
            Err(error @ Error::NoNumber { passes: 8, pixels: 1.., .. }) => {
                let message = error.to_string();
                assert!(message.contains("8 passes in a row") && message.contains("emission"), "{message}");
            }
            other => panic!("{other:?}"),
        }
        assert_eq!(faulty.passes(), 2);
        assert!(film(&faulty) == before);
        fault.write(None);
        faulty.pass().unwrap();
        assert_eq!((faulty.passes(), faulty.engine().passes()), (3, 11));
    });
}
