//! Feature coverage on a real capture: an estimator of overlap has to fall as views move apart.
#![cfg(feature = "opencv")]
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use atsplat_camera::{Camera, CameraFromWorld, NormalizedIntrinsics};
use atsplat_numeric::Tolerance;
use atsplat_opencv::{Coverage, FeatureCoverage, feature_overlap};
use atsplat_pixels::DecodeLimits;
use atsplat_protocol::overlap::{OverlapEstimator, OverlapView};
use atsplat_scene::{Scene, SceneSource, Warnings, open};
use atsplat_tests::shared_data;

/// The scene's frames are 256×256 centre crops of 640×360 images.
const CROP: f64 = 640.0 / 360.0;

fn re10k(test: &str) -> Option<Scene> {
    let folder = shared_data(test)?.join("re10k/000c3ab189999a83");
    let mut warnings = Warnings::new();
    let dataset = open(&folder, &mut warnings).unwrap();
    let key = dataset.keys().first().unwrap().clone();
    let mut scene = dataset.load(&key, &mut warnings).unwrap();
    for frame in &mut scene.frames {
        let k = frame.camera.intrinsics;
        frame.camera.intrinsics = NormalizedIntrinsics { fx: k.fx * CROP, ..k };
    }
    Some(scene)
}

fn coverage(scene: &Scene, pair: (usize, usize), reread: impl Fn(&Camera) -> Camera) -> Coverage {
    let image = |position| scene.decode(position, &DecodeLimits::default()).unwrap();
    let camera = |position: usize| reread(&scene.frames[position].camera);
    let (first, second) = ((camera(pair.0), image(pair.0)), (camera(pair.1), image(pair.1)));
    FeatureCoverage::default().coverage((&first.0, &first.1), (&second.0, &second.1)).unwrap()
}

#[test]
fn coverage_falls_as_real_views_move_apart() {
    let Some(scene) = re10k("coverage_falls") else { return };
    let mut before = f64::INFINITY;
    for gap in [0, 10, 40, 117] {
        let covered = coverage(&scene, (9, 9 + gap), |camera| *camera);
        println!("frames 9 and {}: {covered:?}", 9 + gap);
        assert!(covered.overlap() < before, "gap {gap}: {} after {before}", covered.overlap());
        before = covered.overlap();
    }
    Tolerance::EXACT.assert([coverage(&scene, (9, 9), |camera| *camera).overlap()], [1.0], "itself");
    println!("frames 25 and 161 (NoPoSplat ships 0.2853): {:?}", coverage(&scene, (25, 161), |camera| *camera));
}

#[test]
fn inverted_poses_verify_hardly_any_match() {
    let Some(scene) = re10k("inverted_poses_verify") else { return };
    let inverted = |camera: &Camera| {
        let pose = CameraFromWorld::from_rows(&camera.camera_from_world.inverse().to_rows()).unwrap();
        Camera { camera_from_world: pose, ..*camera }
    };
    let right = coverage(&scene, (9, 49), |camera| *camera);
    let wrong = coverage(&scene, (9, 49), inverted);
    assert_eq!(right.tentative, wrong.tentative, "the images are the same");
    assert!(right.verified * 10 > right.tentative * 9, "{right:?}");
    assert!(wrong.verified * 4 < wrong.tentative, "{wrong:?}");
}

#[test]
fn the_named_estimator_is_this_one() {
    let Some(scene) = re10k("the_named_estimator") else { return };
    let image = |position| scene.decode(position, &DecodeLimits::default()).unwrap();
    let (first, second) = (image(9), image(49));
    let view = |position: usize, image| OverlapView {
        camera: &scene.frames[position].camera,
        image: Some(image),
        depth: None,
    };
    let (a, b) = (view(9, &first), view(49, &second));
    let estimator = OverlapEstimator::FeatureCoverage { measure: None };
    assert!(estimator.estimate(&a, &b).is_err(), "nothing measures it");
    let estimator = estimator.with_features(Some(feature_overlap));
    let named = estimator.estimate(&a, &b).unwrap();
    let direct = FeatureCoverage::default().overlap((a.camera, &first), (b.camera, &second)).unwrap();
    Tolerance::EXACT.assert([named], [direct], "estimate");
    let blind = OverlapView { image: None, ..a };
    assert!(estimator.estimate(&blind, &b).is_err(), "no image");
}
