//! Wrong inputs of the convolution.

use lightsum::conform::checks::convolve::library;
use lightsum::gpu::{Staging, upload};
use lightsum::pass::convolve::{Convolve, Form, Inputs, Library};

use crate::support::gpu_test;

#[test]
fn wrong_inputs_of_convolve_are_named() {
    gpu_test(|ctx| {
        let kernels = upload(ctx, "too few", &[1.0f32; 1000]).unwrap();
        let error = Library::new(ctx, &mut Staging::new(), &kernels, &[0]).err().unwrap().to_string();
        assert!(error.contains("too few") && error.contains("4000 bytes"), "{error}");
        let mut staging = Staging::new();
        let kernels = upload(ctx, "kernels", &library()).unwrap();
        let library = Library::new(ctx, &mut staging, &kernels, &[0; 4]).unwrap();
        let [source, footprint, small] = [("source", 24), ("footprint", 4), ("small", 20)]
            .map(|(name, n)| upload(ctx, name, &vec![0.0f32; n]).unwrap());
        let region = upload(ctx, "region", &[0u32; 6]).unwrap();
        let inputs = Inputs {
            library: &library,
            source: &source,
            footprint: &footprint,
            by_region: true,
            region: &region,
            size: [3, 2],
            widest: 3.0,
            form: Form::Auto,
            occlusion: false,
            layers: false,
        };
        assert!(Convolve::new(ctx, &mut staging, &inputs).is_ok());
        for (wrong, name) in [
            (Inputs { source: &small, ..inputs }, "small"),
            (Inputs { footprint: &small, by_region: false, ..inputs }, "small"),
            (Inputs { region: &small, ..inputs }, "small"),
            (Inputs { size: [0, 2], ..inputs }, "source"),
        ] {
            let error = Convolve::new(ctx, &mut staging, &wrong).err().unwrap().to_string();
            assert!(error.contains(name), "{error}");
        }
    });
}
