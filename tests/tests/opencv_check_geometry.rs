//! The geometry check on real captures, as they are and with mistakes made on purpose.
#![cfg(feature = "opencv")]
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use atsplat_camera::{Camera, CameraFromWorld, ImageSize, NormalizedIntrinsics};
use atsplat_numeric::Tolerance;
use atsplat_opencv::{GeometryCheck, GeometryCheckOptions, PairChoice, UndistortMode, Undistorter, check_geometry};
use atsplat_pixels::{DecodeLimits, encode_png};
use atsplat_scene::geometry::{Convention, ConventionFit};
use atsplat_scene::{
    FrameImage, ImageFolder, NerfstudioOptions, OpenOptions, Scene, SceneSource, SharedBytes, Warnings, open_with,
};
use atsplat_tests::shared_data;

/// RE10K's 640×360 intrinsics, for the 256×256 centre crops of the full height that stand in for the frames.
const CROP: f64 = 640.0 / 360.0;

fn re10k(test: &str) -> Option<Scene> {
    let scene = only_scene(test, "re10k/000c3ab189999a83", &OpenOptions::default())?;
    let widened = |camera: &Camera| {
        let k = camera.intrinsics;
        Camera { intrinsics: NormalizedIntrinsics { fx: k.fx * CROP, ..k }, ..*camera }
    };
    Some(with_cameras(&scene, widened))
}

type Mistake<'a> = &'a dyn Fn(&Camera) -> Camera;

fn only_scene(test: &str, folder: &str, options: &OpenOptions) -> Option<Scene> {
    let folder = shared_data(test)?.join(folder);
    let mut warnings = Warnings::new();
    let dataset = open_with(&folder, options, &mut warnings).unwrap();
    let key = dataset.keys().first().unwrap().clone();
    Some(dataset.load(&key, &mut warnings).unwrap())
}

fn check(scene: &Scene, pairs: PairChoice) -> GeometryCheck {
    let options = GeometryCheckOptions { pairs, ..GeometryCheckOptions::default() };
    let mut warnings = Warnings::new();
    let image_of = |position: usize| scene.decode_any_shape(position, &DecodeLimits::default());
    let checked = check_geometry(scene, image_of, &options, &mut warnings).unwrap();
    assert_eq!(warnings.total(), 0);
    checked
}

fn median_of(checked: &GeometryCheck, convention: Convention) -> f64 {
    checked.score(convention).unwrap().median_px
}

fn fits(checked: &GeometryCheck) -> Option<Convention> {
    match &checked.fit {
        ConventionFit::Fits { convention, .. } => Some(*convention),
        _ => None,
    }
}

fn with_cameras(scene: &Scene, change: impl Fn(&Camera) -> Camera) -> Scene {
    let mut changed = scene.clone();
    for frame in &mut changed.frames {
        frame.camera = change(&frame.camera);
    }
    changed
}

fn inverted(camera: &Camera) -> Camera {
    let pose = CameraFromWorld::from_rows(&camera.camera_from_world.inverse().to_rows()).unwrap();
    Camera { camera_from_world: pose, ..*camera }
}

#[test]
fn re10k_frames_9_and_126_agree_with_their_poses_and_not_with_inverted_ones() {
    let Some(scene) = re10k("re10k_frames_9_and_126") else { return };
    let pair = || PairChoice::Listed(vec![(9, 126)]);
    let declared = check(&scene, pair());
    assert!(median_of(&declared, Convention::Declared) < 0.4, "as declared");
    assert!(median_of(&declared, Convention::PoseInverted) > 15.0, "under the inverted reading");
    assert_eq!(fits(&declared), Some(Convention::Declared), "{}", declared.fit);

    let wrong = check(&with_cameras(&scene, inverted), pair());
    assert!(median_of(&wrong, Convention::Declared) > 15.0, "inverted on purpose");
    assert!(median_of(&wrong, Convention::PoseInverted) < 0.4, "and turned back");
    assert_eq!(fits(&wrong), Some(Convention::PoseInverted), "{}", wrong.fit);
    assert!(wrong.to_string().contains("poses look inverted"), "{wrong}");
}

#[test]
fn every_mistake_made_in_a_real_re10k_scene_is_named() {
    let Some(scene) = re10k("every_mistake_in_re10k") else { return };
    let pairs = || PairChoice::Spread(8);
    let declared = check(&scene, pairs());
    assert_eq!(fits(&declared), Some(Convention::Declared), "{}", declared.fit);
    assert!(median_of(&declared, Convention::Declared) < 0.4);

    let focal = |factor_x: f64, factor_y: f64| {
        move |camera: &Camera| {
            let k = camera.intrinsics;
            let intrinsics = NormalizedIntrinsics::new(k.fx * factor_x, k.fy * factor_y, k.cx, k.cy).unwrap();
            Camera { intrinsics, ..*camera }
        }
    };
    let flipped = |camera: &Camera| {
        let pose = camera.camera_from_world.inverse().opengl_from_opencv().inverse();
        Camera { camera_from_world: pose, ..*camera }
    };
    let both = |camera: &Camera| {
        let file = camera.camera_from_world.inverse().opengl_from_opencv();
        Camera { camera_from_world: CameraFromWorld::from_rows(&file.to_rows()).unwrap(), ..*camera }
    };
    let mistakes: [(Mistake<'_>, Convention); 6] = [
        (&inverted, Convention::PoseInverted),
        (&flipped, Convention::AxesFlipped),
        (&both, Convention::PoseInvertedAxesFlipped),
        (&focal(2.0, 2.0), Convention::FocalHalved),
        (&focal(0.5, 0.5), Convention::FocalDoubled),
        (&focal(1.0 / CROP, 1.0), Convention::FocalFromFy),
    ];
    for (mistake, name) in mistakes {
        let checked = check(&with_cameras(&scene, mistake), pairs());
        assert_eq!(fits(&checked), Some(name), "{}", checked.fit);
        let (mended, truth) = (median_of(&checked, name), median_of(&declared, Convention::Declared));
        assert!(Tolerance::absolute(0.01).accepts(mended, truth), "{name}: {mended} px, the true cameras {truth} px");
    }
}

#[test]
fn fox_agrees_once_its_lens_is_undone() {
    let Some(scene) = only_scene("fox_agrees", "fox", &OpenOptions::default()) else { return };
    let imaged: Vec<usize> =
        (0..scene.frames.len()).filter(|i| matches!(scene.frames[*i].image, FrameImage::File(_))).collect();
    let neighbours = imaged.windows(2).map(|pair| (pair[0], pair[1])).collect();
    let checked = check(&scene, PairChoice::Listed(neighbours));
    assert!(checked.pairs.len() >= 40, "{} pairs", checked.pairs.len());
    assert!(median_of(&checked, Convention::Declared) < 0.6);
    assert!(median_of(&checked, Convention::NoDistortion) > median_of(&checked, Convention::Declared));
    assert_eq!(fits(&checked), Some(Convention::Declared), "{}", checked.fit);
}

#[test]
fn inverted_fox_is_named_in_spite_of_its_repeating_wallpaper() {
    let Some(scene) = only_scene("inverted_fox", "fox", &OpenOptions::default()) else { return };
    let wrong = with_cameras(&scene, inverted);
    let checked = check(&wrong, PairChoice::Spread(12));
    assert_eq!(fits(&checked), Some(Convention::PoseInverted), "{}", checked.fit);
    assert!(median_of(&checked, Convention::PoseInverted) < 1.0, "wider baselines than between neighbours");
}

#[test]
fn desk_agrees_at_both_resolutions() {
    for images in [ImageFolder::Downscaled(8), ImageFolder::Downscaled(4)] {
        let nerfstudio = NerfstudioOptions { images, ..NerfstudioOptions::default() };
        let options = OpenOptions { nerfstudio, ..OpenOptions::default() };
        let Some(scene) = only_scene("desk_agrees", "dl3dv_like/desk", &options) else { return };
        let checked = check(&scene, PairChoice::Spread(8));
        assert_eq!(fits(&checked), Some(Convention::Declared), "{images:?}: {}", checked.fit);
        assert!(median_of(&checked, Convention::Declared) < 0.4, "{images:?}");
        assert!(median_of(&checked, Convention::PoseInverted) > 10.0, "{images:?}");
    }
}

/// Images that were undistorted agree with a pinhole: what `data undistort` writes.
#[test]
fn undistorted_fox_agrees_without_a_lens() {
    let Some(mut scene) = only_scene("undistorted_fox", "fox", &OpenOptions::default()) else { return };
    scene.frames.retain(|frame| matches!(frame.image, FrameImage::File(_)));
    scene.frames.truncate(16);
    for position in 0..scene.frames.len() {
        let image = scene.decode(position, &DecodeLimits::default()).unwrap();
        let size = ImageSize { width: image.width(), height: image.height() };
        let frame = &mut scene.frames[position];
        let undistorter = Undistorter::new(&frame.camera, size, UndistortMode::KeepK).unwrap();
        frame.image =
            FrameImage::Encoded(SharedBytes::new(encode_png(&undistorter.undistort(&image).unwrap()).unwrap()));
        frame.camera = Camera::pinhole(frame.camera.camera_from_world, undistorter.intrinsics());
    }
    let neighbours = (1..scene.frames.len()).map(|at| (at - 1, at)).collect();
    let checked = check(&scene, PairChoice::Listed(neighbours));
    assert!(checked.pairs.len() >= 12, "{} pairs", checked.pairs.len());
    assert!(median_of(&checked, Convention::Declared) < 0.6, "{checked}");
}
