//! The texts that identify simulated data, which must stay as earlier versions have them: with others, results and baselines of the
//! same images are those of other data.

use atsplat_camera::{Camera, CameraFromWorld, Distortion, ImageSize, NormalizedIntrinsics};
use atsplat_files::Sha256Digest;
use glam::{DMat3, DVec3};

use crate::source::fingerprint;
use crate::{EffectChoice, EffectKind, GENERATOR, Request, Route, SceneKind, SceneSeed, Split};

/// The text of [`cameras`].
const CAMERAS: &str = "[(33333, Camera { camera_from_world: CameraFromWorld(Rigid { rotation: DMat3 { x_axis: \
                       DVec3(0.0, 1.0, 0.0), y_axis: DVec3(-1.0, 0.0, 0.0), z_axis: DVec3(0.0, 0.0, 1.0) }, \
                       translation: DVec3(0.5, -1.0, 2.0) }), intrinsics: NormalizedIntrinsics { fx: 0.9, fy: 0.8, cx: \
                       0.5, cy: 0.4 }, distortion: OpenCv { k1: 0.1, k2: 0.2, k3: 0.3, p1: 0.4, p2: 0.5 } })]";

/// A camera that is turned by a right angle, with its time.
fn cameras() -> Vec<(i64, Camera)> {
    let rotation = DMat3::from_cols(DVec3::Y, DVec3::new(-1.0, 0.0, 0.0), DVec3::Z);
    let pose = CameraFromWorld::new(rotation, DVec3::new(0.5, -1.0, 2.0)).unwrap();
    let distortion = Distortion::OpenCv { k1: 0.1, k2: 0.2, k3: 0.3, p1: 0.4, p2: 0.5 };
    let intrinsics = NormalizedIntrinsics::new(0.9, 0.8, 0.5, 0.4).unwrap();
    vec![(33_333, Camera { distortion, ..Camera::pinhole(pose, intrinsics) })]
}

#[test]
fn fingerprints_are_those_of_earlier_versions() {
    let room = Request::new(SceneKind::Rooms, SceneSeed { split: Split::Test, number: 3 });
    let expected = "frame 7 of Request { kind: Rooms, seed: SceneSeed { split: Test, number: 3 }, frames: 150, size: \
                    ImageSize { width: 256, height: 256 }, samples: 4, effects: Auto, route: Natural }";
    assert_eq!(fingerprint(7, &format!("{room:?}")), format!("{GENERATOR}, {expected}"));
    let yard = Request {
        size: ImageSize { width: 24, height: 16 },
        effects: EffectChoice::Only(vec![EffectKind::SoftShadows, EffectKind::MotionBlur]),
        route: Route::Given(cameras()),
        ..Request::new(SceneKind::Yards, SceneSeed { split: Split::Train, number: 12 })
    };
    let expected = format!(
        "frame 0 of Request {{ kind: Yards, seed: SceneSeed {{ split: Train, number: 12 }}, frames: 100, size: \
         ImageSize {{ width: 24, height: 16 }}, samples: 4, effects: Only([SoftShadows, MotionBlur]), route: \
         Given({CAMERAS}) }}"
    );
    assert_eq!(fingerprint(0, &format!("{yard:?}")), format!("{GENERATOR}, {expected}"));
    assert_eq!(format!("{:?} {:?}", EffectChoice::All, EffectChoice::None), "All None");
    let effects =
        "[SoftShadows, SpecularReflection, IndirectLight, ExposureDrift, LensDistortion, MotionBlur, SensorNoise]";
    assert_eq!(format!("{:?}", EffectKind::ALL), effects);
}

/// Manifests of simulated datasets have it.
#[test]
fn the_digest_of_a_route_is_that_of_earlier_versions() {
    assert_eq!(Route::Natural.digest(), None);
    assert_eq!(Route::Given(cameras()).digest(), Some(Sha256Digest::of(CAMERAS.as_bytes())));
}
