//! Datasets round-trip through the loaders.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::Path;

use atsplat_camera::{Camera, CameraFromWorld, Distortion, ImageSize, NormalizedIntrinsics, PixelIntrinsics};
use atsplat_numeric::Tolerance;
use atsplat_pixels::{DecodeLimits, Rounding, exr};
use atsplat_rooms::{
    EffectChoice, EffectKind, GENERATOR, ImageEncoding, Layout, Request, Route, SceneKind, SceneSeed, Simulation,
    Split, WriteOptions, write_dataset,
};
use atsplat_scene::{SceneSource, Warnings, open};
use glam::{DMat3, DVec3};

const SMALL: ImageSize = ImageSize { width: 8, height: 6 };

fn requests() -> Vec<Request> {
    let request = |split, number| Request {
        size: ImageSize { width: 40, height: 30 },
        frames: 3,
        effects: EffectChoice::Auto,
        ..Request::new(SceneKind::Yards, SceneSeed { split, number })
    };
    vec![request(Split::Train, 0), request(Split::Train, 1), request(Split::Test, 0)]
}

/// The simulations of the dataset that is written, with their lenses only where the layout stores them.
fn written(folder: &Path, layout: Layout) -> Vec<Simulation> {
    let options = WriteOptions { layout, encoding: ImageEncoding::Png, depth: true };
    let mut warnings = Warnings::default();
    let mut reported = Vec::new();
    let entries =
        write_dataset(folder, requests(), &options, &mut warnings, |simulation, _| reported.push(simulation.key()))
            .unwrap();
    assert_eq!(warnings.total(), 0, "{warnings:?}");
    assert_eq!(reported, entries.iter().map(|entry| entry.key.clone()).collect::<Vec<_>>());
    let manifest: serde_json::Value =
        serde_json::from_slice(&std::fs::read(folder.join("manifest.json")).unwrap()).unwrap();
    assert_eq!(manifest["scenes"].as_array().unwrap().len(), 3);
    assert_eq!(manifest["scenes"][2]["key"], "yards-test-00000000");
    let simulation = |request| {
        let simulation = Simulation::new(request).unwrap();
        if layout.stores_lenses() { simulation } else { simulation.without_lens() }
    };
    requests().into_iter().map(simulation).collect()
}

/// Compares the dataset loaded from `path` with the simulation.
fn check(path: &Path, depth: &Path, simulation: &Simulation, key: &str) {
    let mut warnings = Warnings::default();
    let dataset = open(path, &mut warnings).unwrap();
    let scene = dataset.load(key, &mut warnings).unwrap();
    assert_eq!(scene.frames.len(), 3);
    let size = simulation.request().size;
    for (at, frame) in scene.frames.iter().enumerate() {
        let expected = simulation.camera(at).unwrap();
        let close = Tolerance::F32_ROUND_TRIP;
        let pose = |camera: &Camera| camera.camera_from_world.to_rows();
        Tolerance::absolute(2e-6).assert(pose(&frame.camera), pose(&expected), "pose");
        let PixelIntrinsics { fx, fy, cx, cy } = expected.intrinsics.pixel_from_normalized(size);
        let k = frame.camera.intrinsics.pixel_from_normalized(size);
        Tolerance::absolute(1e-4).assert([k.fx, k.fy, k.cx, k.cy], [fx, fy, cx, cy], "intrinsics");
        assert_eq!(frame.camera.distortion, expected.distortion);
        let image = scene.decode(at, &DecodeLimits::default()).unwrap();
        assert_eq!(image, simulation.image(at).unwrap().to_u8(Rounding::Nearest).unwrap());
        let file = depth.join(simulation.key()).join(format!("{}.exr", frame.name));
        let channels = exr::read(&std::fs::read(file).unwrap(), &DecodeLimits::default()).unwrap();
        let truth = simulation.geometry(at).unwrap();
        let depths = |samples: &[f32]| samples.iter().map(|depth| f64::from(*depth)).collect::<Vec<_>>();
        Tolerance::EXACT.assert(depths(&channels.get("Z").unwrap().samples), depths(&truth.depth), "depth");
        close.assert([frame.camera.camera_from_world.determinant()], [1.0], "a rotation");
    }
}

/// What a manifest says of a dataset of one small scene.
fn manifest(folder: &Path, request: Request, options: WriteOptions) -> serde_json::Value {
    let request = Request { size: SMALL, ..request };
    write_dataset(folder, [request], &options, &mut Warnings::default(), |_, _| {}).unwrap();
    serde_json::from_slice(&std::fs::read(folder.join("manifest.json")).unwrap()).unwrap()
}

/// Whatever changes the files changes the manifest.
#[test]
fn the_manifest_says_how_the_dataset_was_made() {
    let plain = WriteOptions { layout: Layout::Nerfstudio, encoding: ImageEncoding::Png, depth: false };
    let [request, _, _] = <[Request; 3]>::try_from(requests()).unwrap();
    let mut shifted = routed();
    if let Route::Given(cameras) = &mut shifted.route {
        cameras[1].0 = 20_000;
    }
    let cases = [
        (request.clone(), plain),
        (request.clone(), WriteOptions { layout: Layout::Chunks, ..plain }),
        (request.clone(), WriteOptions { encoding: ImageEncoding::Jpeg(20), ..plain }),
        (request.clone(), WriteOptions { encoding: ImageEncoding::Jpeg(90), ..plain }),
        (request.clone(), WriteOptions { depth: true, ..plain }),
        (Request { effects: EffectChoice::Only(Vec::new()), ..request.clone() }, plain),
        (Request { effects: EffectChoice::None, ..request }, plain),
        (routed(), plain),
        (shifted, plain),
    ];
    let mut found: Vec<serde_json::Value> = Vec::new();
    for (request, options) in cases {
        let folder = tempfile::tempdir().unwrap();
        let manifest = manifest(folder.path(), request, options);
        assert_eq!(manifest["generator"], GENERATOR);
        assert!(!found.contains(&manifest), "{options:?}: {manifest}");
        found.push(manifest);
    }
    assert_eq!((&found[2]["images"]["jpeg"], &found[2]["layout"]), (&20.into(), &"nerfstudio".into()));
    assert_eq!(found[0]["scenes"][0]["requested_effects"], "auto");
}

#[test]
fn a_dataset_that_is_not_finished_has_no_manifest_of_an_earlier_one() {
    let folder = tempfile::tempdir().unwrap();
    let options = WriteOptions { layout: Layout::Nerfstudio, encoding: ImageEncoding::Png, depth: false };
    let [request, _, _] = <[Request; 3]>::try_from(requests()).unwrap();
    manifest(folder.path(), request.clone(), options);
    let broken = Request { samples: 0, ..request };
    let error = write_dataset(folder.path(), [broken], &options, &mut Warnings::default(), |_, _| {}).unwrap_err();
    assert_eq!(error.to_string(), "simulating scene \"yards-train-00000000\": samples: expected 1 to 256, found 0");
    assert!(!folder.path().join("manifest.json").exists());
}

#[test]
fn re10k_round_trips() {
    let folder = tempfile::tempdir().unwrap();
    let simulations = written(folder.path(), Layout::Re10k);
    let depth = folder.path().join("depth");
    check(&folder.path().join("train"), &depth, &simulations[0], "yards-train-00000000");
    check(&folder.path().join("train"), &depth, &simulations[1], "yards-train-00000001");
    check(&folder.path().join("test"), &depth, &simulations[2], "yards-test-00000000");
}

#[test]
fn chunks_round_trip_and_are_not_mixed() {
    let folder = tempfile::tempdir().unwrap();
    let simulations = written(folder.path(), Layout::Chunks);
    let depth = folder.path().join("depth");
    check(&folder.path().join("train"), &depth, &simulations[0], "yards-train-00000000");
    check(&folder.path().join("test"), &depth, &simulations[2], "yards-test-00000000");
    let options = WriteOptions { layout: Layout::Chunks, encoding: ImageEncoding::Jpeg(90), depth: false };
    let again = write_dataset(folder.path(), requests(), &options, &mut Warnings::default(), |_, _| {});
    assert!(again.is_err(), "old chunks must not be mixed with new ones");
}

#[test]
fn nerfstudio_round_trips() {
    let folder = tempfile::tempdir().unwrap();
    let simulations = written(folder.path(), Layout::Nerfstudio);
    assert!(simulations[0].camera(0).unwrap().distortion != Distortion::None, "a lens is stored");
    let depth = folder.path().join("depth");
    for simulation in &simulations {
        check(folder.path(), &depth, simulation, &simulation.key());
    }
}

/// The first yard needs a lens, the second does not. One that is requested is an error, whatever the scene draws.
#[test]
fn a_layout_without_lenses_has_none_in_its_images_and_says_so() {
    let absent_in = |layout| {
        let folder = tempfile::tempdir().unwrap();
        let options = WriteOptions { layout, encoding: ImageEncoding::Png, depth: false };
        let [first, second, _] = <[Request; 3]>::try_from(requests()).unwrap();
        let requests = [first, second].map(|request| Request { size: SMALL, ..request });
        write_dataset(folder.path(), requests, &options, &mut Warnings::default(), |_, _| {}).unwrap();
        let manifest = std::fs::read(folder.path().join("manifest.json")).unwrap();
        let manifest: serde_json::Value = serde_json::from_slice(&manifest).unwrap();
        [0, 1].map(|scene: usize| manifest["scenes"][scene]["absent_effects"].clone())
    };
    let lens = serde_json::json!([{ "effect": "lens-distortion", "reason": "left out: this layout stores no lens" }]);
    for layout in [Layout::Re10k, Layout::Chunks] {
        assert_eq!(absent_in(layout), [lens.clone(), serde_json::Value::Null], "{layout:?}");
        let options = WriteOptions { layout, encoding: ImageEncoding::Png, depth: false };
        let only = EffectChoice::Only(vec![EffectKind::MotionBlur, EffectKind::LensDistortion]);
        for (effects, found) in [(EffectChoice::All, "all"), (only, "motion-blur,lens-distortion")] {
            let folder = tempfile::tempdir().unwrap();
            let request = Request { size: SMALL, effects, ..requests().remove(1) };
            let written = write_dataset(folder.path(), [request], &options, &mut Warnings::default(), |_, _| {});
            let expected = format!(
                "simulating scene \"yards-train-00000001\": effects: expected no lens-distortion, which only the nerfstudio \
                 layout can store, found {found}"
            );
            assert_eq!(written.unwrap_err().to_string(), expected);
        }
    }
    assert_eq!(absent_in(Layout::Nerfstudio), [const { serde_json::Value::Null }; 2]);
}

/// A scene along a route that zooms out and has its first time twice.
fn routed() -> Request {
    let shots = [(0, 1.2, 0.0), (0, 0.9, 0.05), (40_000, 0.6, 0.1)];
    let route = shots.map(|(time, focal, x)| {
        let pose = CameraFromWorld::new(DMat3::IDENTITY, DVec3::new(-x, 0.0, 0.0)).unwrap();
        (time, Camera::pinhole(pose, NormalizedIntrinsics::new(focal, focal * 4.0 / 3.0, 0.5, 0.5).unwrap()))
    });
    let [request, _, _] = <[Request; 3]>::try_from(requests()).unwrap();
    Request { route: Route::Given(route.to_vec()), effects: EffectChoice::None, ..request }
}

#[test]
fn each_frame_of_a_route_keeps_its_focal_length() {
    let folder = tempfile::tempdir().unwrap();
    let options = WriteOptions { layout: Layout::Nerfstudio, encoding: ImageEncoding::Png, depth: true };
    write_dataset(folder.path(), [routed()], &options, &mut Warnings::default(), |_, _| {}).unwrap();
    let simulation = Simulation::new(routed()).unwrap();
    check(folder.path(), &folder.path().join("depth"), &simulation, &simulation.key());
}

/// The second image would replace the first.
#[test]
fn a_repeated_time_is_rejected_where_files_are_named_after_it() {
    for (layout, depth) in [(Layout::Re10k, false), (Layout::Chunks, true)] {
        let folder = tempfile::tempdir().unwrap();
        let options = WriteOptions { layout, encoding: ImageEncoding::Png, depth };
        let written = write_dataset(folder.path(), [routed()], &options, &mut Warnings::default(), |_, _| {});
        let error = written.unwrap_err().to_string();
        let start = "simulating scene \"yards-train-00000000\": trajectory: expected distinct times";
        let end = "found 0 µs again";
        assert!(error.starts_with(start) && error.ends_with(end), "{error}");
        assert_eq!(folder.path().read_dir().unwrap().count(), 0, "nothing is written");
    }
}
