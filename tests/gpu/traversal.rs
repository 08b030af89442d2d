//! The measurement that decides how shadow rays are traced.

use lightsum::calibrate;
use lightsum::pass::TraversalKernels;
use lightsum::settings::Traversal;

use crate::support::gpu_test;

#[test]
fn the_choice_of_kernel_is_measured_and_kept() {
    gpu_test(|ctx| {
        let dir = tempfile::tempdir().unwrap();
        let cache = dir.path().join("pipelines.bin");
        let file = dir.path().join("pipelines.bin.traversal.json");
        let first = calibrate::choose(ctx, &cache).unwrap();
        if TraversalKernels::visibility(ctx, Traversal::Auto, false).unwrap().cluster.is_none() {
            assert_eq!((first, file.exists()), (Traversal::Single, false), "there is nothing to choose from");
            return;
        }
        let read = || serde_json::from_str::<serde_json::Value>(&std::fs::read_to_string(&file).unwrap()).unwrap();
        let mut measured = read();
        let faster = measured["cluster"].as_f64().unwrap() < measured["single"].as_f64().unwrap();
        assert_eq!(first, if faster { Traversal::Auto } else { Traversal::Single });
        // The times in the file decide.
        for (single, choice) in [(1e9, Traversal::Auto), (1e-9, Traversal::Single)] {
            measured["single"] = single.into();
            std::fs::write(&file, measured.to_string()).unwrap();
            assert_eq!(calibrate::choose(ctx, &cache).unwrap(), choice);
            assert_eq!(read(), measured, "it was measured again");
        }
        // Unless it belongs to another device, or is damaged.
        measured["of"] = "another device".into();
        for text in [measured.to_string(), String::from("{")] {
            std::fs::write(&file, text).unwrap();
            calibrate::choose(ctx, &cache).unwrap();
            assert!(read()["single"].as_f64().unwrap() > 1e-6, "it was not measured again");
        }
    });
}
