use atsplat_camera::CameraFromWorld;
use atsplat_splat::RendererConstants;
use glam::{DMat3, DVec3};

use super::*;
use crate::{Background, Strategy};

/// A view of one row; its camera is turned by a right angle.
fn view(distortion: Distortion, rgb: &[[f32; 3]]) -> TrainingView {
    let rotation = DMat3::from_cols(DVec3::Y, DVec3::new(-1.0, 0.0, 0.0), DVec3::Z);
    let pose = CameraFromWorld::new(rotation, DVec3::new(0.5, -1.0, 2.0)).unwrap();
    let intrinsics = NormalizedIntrinsics::new(0.9, 0.8, 0.5, 0.4).unwrap();
    let camera = Camera { distortion, ..Camera::pinhole(pose, intrinsics) };
    let size = ImageSize { width: u32::try_from(rgb.len()).unwrap(), height: 1 };
    TrainingView { name: "not part of it".to_owned(), view: View { camera, size }, rgb: rgb.to_vec() }
}

/// With another text, no checkpoint of an earlier version is resumed.
#[test]
fn the_hashed_text_of_a_run_is_that_of_earlier_versions() {
    let config = FitConfig {
        background: Background::Colour([0.25, 0.5, 1.0]),
        pose_rate: Some(1e-5),
        constants: RendererConstants::named("pixelsplat-family").unwrap(),
        ..FitConfig::new(Strategy::Mcmc, 7)
    };
    let lens = Distortion::OpenCv { k1: 0.1, k2: 0.2, k3: 0.3, p1: 0.4, p2: 0.5 };
    let views = [view(lens, &[[0.25, 0.5, 1.0], [0.0, 0.125, 0.75]]), view(Distortion::None, &[[1.0, 0.5, 0.25]])];
    let pose = "CameraFromWorld(Rigid { rotation: DMat3 { x_axis: DVec3(0.0, 1.0, 0.0), y_axis: DVec3(-1.0, 0.0, 0.0), \
                z_axis: DVec3(0.0, 0.0, 1.0) }, translation: DVec3(0.5, -1.0, 2.0) })";
    let intrinsics = "NormalizedIntrinsics { fx: 0.9, fy: 0.8, cx: 0.5, cy: 0.4 }";
    let expected = [
        "FitConfig { strategy: Mcmc, steps: 7, seed: 0, sh_degree: 3, background: Colour([0.25, 0.5, 1.0]), d_ssim: \
         0.2, rates: Rates { means: 0.00016, final_means: 1.6e-6, colours: 0.0025, opacities: 0.05, scales: 0.005, \
         rotations: 0.001 }, absolute_gradients: false, pose_rate: Some(1e-5), exposure_rate: None, extent: None, \
         max_gaussians: 1000000, memory_limit: 8589934592, constants: RendererConstants { name: \"pixelsplat-family\", \
         near: 0.2, far: inf, near_is_culled: true, blur: 0.3, max_alpha: 0.99, min_alpha: 0.00392156862745098, \
         min_transmittance: 0.0001, jacobian_margin: 0.3, min_compensation: 0.005, extent: ThreeSigmaTiles, \
         principal_point: FieldOfView, sh_axes: E3nn, max_sh_degree: 3, clamped_gradient: Inria } }"
            .to_owned(),
        format!(
            "View {{ camera: Camera {{ camera_from_world: {pose}, intrinsics: {intrinsics}, distortion: OpenCv {{ k1: \
             0.1, k2: 0.2, k3: 0.3, p1: 0.4, p2: 0.5 }} }}, size: ImageSize {{ width: 2, height: 1 }} }} \
             959d89434ba5239f05b54d220d7ce0ad64d7c18f16896fecaf6b721148fa9a98"
        ),
        format!(
            "View {{ camera: Camera {{ camera_from_world: {pose}, intrinsics: {intrinsics}, distortion: None }}, size: \
             ImageSize {{ width: 1, height: 1 }} }} 95128540caa5ebf017c64254c63156b06f3d763f99033d23fa0191b8074086b2"
        ),
    ];
    let lines = lines_of(&views);
    assert_eq!(run_text(&config, &lines), expected.join("\n"));
    assert_eq!(run_hash(&config, &lines), Sha256Digest::of(expected.join("\n").as_bytes()).to_string());
    assert_eq!(views_hash(&views), Sha256Digest::of(expected[1..].join("\n").as_bytes()).to_string());
}

/// Of the variants that the other test does not have.
#[test]
fn hashed_names_of_choices_are_those_of_earlier_versions() {
    assert_eq!(format!("{:?}", Strategy::ALL), "[Gaussians3d, MipSplatting, Mcmc, Fixed]");
    let backgrounds = [Background::Black, Background::White, Background::Random];
    assert_eq!(format!("{backgrounds:?}"), "[Black, White, Random]");
    let chosen = |name: &str| {
        let constants = RendererConstants::named(name).unwrap();
        let RendererConstants { extent, principal_point, sh_axes, clamped_gradient, .. } = constants;
        format!("{extent:?} {principal_point:?} {sh_axes:?} {clamped_gradient:?}")
    };
    assert_eq!(chosen("exact"), "Exact Full Standard Exact");
    assert_eq!(chosen("inria"), "ThreeSigmaTiles Centre Standard Inria");
    assert_eq!(of_lens(Distortion::Fisheye { k: [0.1, 0.2, 0.3, 0.4] }), "Fisheye { k: [0.1, 0.2, 0.3, 0.4] }");
}

/// By its settings and views; only checkpoints of earlier versions need the hash of both.
#[test]
fn a_run_is_recognised_by_its_settings_and_views() {
    let config = FitConfig::new(Strategy::Fixed, 7);
    let views = TrainingViews::from(vec![view(Distortion::None, &[[1.0, 0.5, 0.25]])]);
    let path = Path::new("state");
    let metadata = |run: String, of_views: Option<String>| Metadata {
        step: 0,
        run,
        views: of_views,
        configuration: Some(serde_json::from_str(&serde_json::to_string(&config).unwrap()).unwrap()),
        start: String::new(),
        device: "cpu".to_owned(),
        sh_degree: 0,
        reached_degree: 0,
        filtered: false,
        memory: Vec::new(),
        history: History::default().facts(),
        empty_steps: 0,
        joint_corrections: true,
        elapsed: None,
        tensors: String::new(),
    };
    let written = metadata("of renamed fields".to_owned(), Some(views_hash(&views)));
    let earlier = metadata(run_hash(&config, &lines_of(&views)), None);
    let longer = FitConfig { steps: 8, ..config.clone() };
    let other_views = TrainingViews::from(vec![view(Distortion::None, &[[1.0, 0.5, 0.75]])]);
    for metadata in [&written, &earlier] {
        check_run(metadata, &config, &views, path).unwrap();
        let error = |config: &FitConfig, views: &TrainingViews| {
            check_run(metadata, config, views, path).unwrap_err().to_string()
        };
        let of_steps = error(&longer, &views);
        assert!(of_steps.contains("configuration: ") && of_steps.contains("steps: 7, now 8"), "{of_steps}");
        let of_views = error(&config, &other_views);
        assert!(of_views.contains("views: expected those that this run trains on"), "{of_views}");
    }
}
