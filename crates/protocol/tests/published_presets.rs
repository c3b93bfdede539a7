//! Every value of the published presets that changes a number, stated once more: as the papers' code has it, and not read from
//! the preset's own file.

use atsplat_camera::{Camera, CameraFromWorld, ImageSize, NormalizedIntrinsics};
use atsplat_numeric::Tolerance;
use atsplat_protocol::{Aggregation, Filters, LensDistortion, Preset};
use glam::{DMat3, DVec3};
use serde_json::{Value, json};

/// A method's pose normalisation, near and far plane.
type Setting = (&'static str, Value, [f64; 2]);

struct Published {
    name: &'static str,
    views: usize,
    /// Fewest and most targets of an entry.
    targets: (usize, usize),
    scenes: u64,
    preprocessing: &'static str,
    lens: LensDistortion,
    filters: Filters,
    methods: Vec<Setting>,
}

const SQUARE: &str = "only 640×360: rescale-and-crop 256×256 (lanczos); principal point frozen";
/// The centre of 270 rows and 480 columns: rows 7 to 262, columns 16 to 463.
const PATCHES: &str = "only 480×270: patch-crop to multiples of 64; principal point frozen";

fn wide_fields_dropped() -> Filters {
    Filters { max_fov_degrees: Some(100.0), ..Filters::default() }
}

fn of_dl3dv() -> Filters {
    Filters { determinant: true, max_translation: Some(1e3), ..wide_fields_dropped() }
}

fn baseline_one() -> Value {
    json!({ "rule": "baseline-one", "minimum": 1e-3 })
}

fn none() -> Value {
    json!({ "rule": "none" })
}

fn pixelsplat() -> Setting {
    ("pixelSplat", baseline_one(), [0.1, 1000.0])
}

fn mvsplat() -> Setting {
    ("MVSplat", none(), [1.0, 100.0])
}

fn depthsplat(far: f64) -> Setting {
    ("DepthSplat", none(), [0.5, far])
}

fn ilrm() -> Setting {
    ("iLRM", json!({ "rule": "mean-camera", "scale": "ilrm-main" }), [0.01, 500.0])
}

fn of_re10k(name: &'static str, scenes: u64, filters: Filters, methods: Vec<Setting>) -> Published {
    let (views, targets, lens) = (2, (3, 3), LensDistortion::Used);
    Published { name, views, targets, scenes, preprocessing: SQUARE, lens, filters, methods }
}

fn on_dl3dv(
    name: &'static str,
    views: usize,
    targets: (usize, usize),
    preprocessing: &'static str,
    methods: Vec<Setting>,
) -> Published {
    let (scenes, lens, filters) = (140, LensDistortion::Ignored, of_dl3dv());
    Published { name, views, targets, scenes, preprocessing, lens, filters, methods }
}

fn published() -> Vec<Published> {
    let from = |minimum: f64, maximum: Option<f64>| Filters {
        min_baseline: Some(minimum),
        max_baseline: maximum,
        ..wide_fields_dropped()
    };
    let relative = |rule: Value| json!({ "rule": "sequence", "steps": [rule, { "rule": "first-view-relative" }] });
    let long_lrm = ("Long-LRM", json!({ "rule": "mean-camera", "scale": "long-lrm" }), [0.01, 1e6]);
    let noposplat = relative(json!({ "rule": "baseline-one", "minimum": 1e-3, "maximum": 1e10 }));
    let yonosplat = relative(json!({ "rule": "max-pairwise", "minimum": 1e-3, "maximum": 100.0 }));
    let noposplat = ("NoPoSplat", noposplat, [0.1, 100.0]);
    let on_re10k = || vec![pixelsplat(), mvsplat(), depthsplat(100.0)];
    let by_overlap = || [vec![noposplat.clone()], on_re10k()].concat();
    let later = || vec![depthsplat(200.0), ilrm()];
    let square = "only 480×270: rescale-and-crop 256×256 (lanczos); principal point frozen";
    let small_square = "only 480×270: rescale-and-crop 224×224 (lanczos); principal point frozen";
    let high = "only 960×540: rescale-and-crop 960×512 (lanczos); principal point frozen";
    vec![
        of_re10k("re10k-2v-256", 6474, wide_fields_dropped(), [on_re10k(), vec![ilrm(), long_lrm]].concat()),
        of_re10k("re10k-overlap", 5601, from(1e-3, Some(1e10)), [by_overlap(), vec![ilrm()]].concat()),
        of_re10k("acid-2v-256", 1595, wide_fields_dropped(), on_re10k()),
        of_re10k("acid-overlap", 1341, from(1e-3, Some(1e10)), by_overlap()),
        on_dl3dv("dl3dv-2v-256x448", 2, (50, 50), PATCHES, later()),
        on_dl3dv("dl3dv-4v-256x448", 4, (50, 50), PATCHES, later()),
        on_dl3dv("dl3dv-6v-256x448", 6, (50, 50), PATCHES, later()),
        on_dl3dv("dl3dv-12v-512x960", 12, (87, 100), high, later()),
        Published {
            filters: from(1e-3, Some(100.0)),
            ..on_dl3dv("dl3dv-6v-224", 6, (8, 8), small_square, vec![("YoNoSplat", yonosplat, [0.1, 100.0])])
        },
        on_dl3dv("re10k-to-dl3dv-256", 2, (50, 50), square, vec![mvsplat(), depthsplat(200.0), ilrm()]),
        on_dl3dv("dl3dv-6v-extrapolation", 6, (20, 20), PATCHES, later()),
        of_re10k(
            "re10k-extrapolation",
            6424,
            from(1e-3, None),
            [vec![("latentSplat", baseline_one(), [0.1, 1000.0])], on_re10k(), vec![ilrm()]].concat(),
        ),
    ]
}

#[test]
fn frames_images_cameras_and_filters_are_the_published_ones() {
    for protocol in published() {
        let preset = Preset::named(protocol.name).unwrap();
        let index = &preset.index;
        let found = (index.context_views, index.targets, index.scenes);
        assert_eq!(found, (protocol.views, protocol.targets, protocol.scenes), "{}", protocol.name);
        assert_eq!(preset.preprocessing.to_string(), protocol.preprocessing, "{}", protocol.name);
        assert_eq!((preset.lens_distortion, &preset.filters), (protocol.lens, &protocol.filters), "{}", protocol.name);
        assert_eq!(preset.aggregation, Aggregation::SceneMeans, "{}", protocol.name);
    }
}

/// Those of ATSplat are inferred: the mean camera with Long-LRM's scale, and iLRM's planes.
#[test]
fn poses_and_planes_are_those_that_each_method_published() {
    for protocol in published() {
        let preset = Preset::named(protocol.name).unwrap();
        let names: Vec<&str> = preset.methods.iter().map(|method| method.method.as_str()).collect();
        assert_eq!(names, protocol.methods.iter().map(|(name, ..)| *name).collect::<Vec<_>>(), "{}", protocol.name);
        let atsplat = ("ATSplat", json!({ "rule": "mean-camera", "scale": "long-lrm" }), [0.01, 500.0]);
        for (method, poses, planes) in protocol.methods.into_iter().chain([atsplat]) {
            let place = format!("{}, {method}", protocol.name);
            let setting = preset.setting_for(method);
            assert_eq!(serde_json::to_value(setting.pose_normalisation).unwrap(), poses, "{place}");
            Tolerance::EXACT.assert([setting.near_far.near, setting.near_far.far], planes, &place);
        }
    }
}

#[test]
fn renderers_metrics_and_bins_are_the_published_ones() {
    // Gaussians nearer than 0.2 near planes are culled: the scene is scaled by 1 / near first.
    let renderer = json!({
        "rasteriser": "diff-gaussian-rasterization (dcharatan's modified version)", "near-cull": 0.2,
        "near-cull-unit": "near-planes", "dilation": 0.3, "alpha-max": 0.99, "alpha-min-inverse": 255.0,
        "transmittance-stop": 1e-4, "extent": "three-sigma-tiles", "max-sh-degree": 3, "background": [0.0, 0.0, 0.0],
        "principal-point": "ignored",
    });
    for protocol in published() {
        let preset = Preset::named(protocol.name).unwrap();
        assert_eq!(preset.metrics.ids(), ["psnr", "ssim", "lpips"], "{}", protocol.name);
        assert_eq!(serde_json::to_value(&preset.renderer).unwrap(), renderer, "{}", protocol.name);
        let bins = preset.overlap_bins.map(|bins| serde_json::to_value(bins).unwrap());
        let expected = json!({
            "rule": "published", "names": ["small", "medium", "large"], "edges": [0.05, 0.3, 0.55, 0.8], "estimator": "roma",
        });
        assert_eq!(bins, protocol.name.ends_with("-overlap").then_some(expected), "{}", protocol.name);
    }
}

/// The metrics of the numbers that a method's paper reports, where its code scores in another way than the preset says.
fn metrics_of_paper(preset: &str, method: &str) -> &'static [&'static str] {
    match method {
        // On these indices, only NoPoSplat's paper reports numbers, and its code scores in several ways.
        _ if preset.ends_with("-overlap") => &[],
        "pixelSplat" | "latentSplat" => &["psnr-8bit-truncated", "ssim-8bit-truncated", "lpips-8bit-truncated"],
        "Long-LRM" => &["ssim-uniform-7x7", "lpips-clipped"],
        _ => &[],
    }
}

#[test]
fn notes_name_the_metrics_of_methods_that_score_in_another_way() {
    for protocol in published() {
        let preset = Preset::named(protocol.name).unwrap();
        for (method, ..) in protocol.methods {
            for metric in metrics_of_paper(protocol.name, method) {
                let is_named = preset.notes.iter().any(|note| note.contains(metric));
                assert!(is_named, "{}, {method}: {metric}", protocol.name);
            }
        }
    }
}

/// Of the scene that was captured in 2K, each copy is half as large as of the others.
#[test]
fn presets_of_dl3dv_name_the_scene_that_its_size_drops() {
    let presets = Preset::names().map(|name| Preset::named(name).unwrap());
    let sized = presets.filter(|preset| preset.dataset == "dl3dv" && preset.preprocessing.expected_size.is_some());
    let names_it = |preset: &Preset| preset.notes.iter().any(|note| note.contains("07d9f9724ca854fa"));
    let found: Vec<(String, bool)> = sized.map(|preset| (preset.name.clone(), names_it(&preset))).collect();
    assert_eq!(found.len(), 7, "{found:?}");
    assert!(found.iter().all(|(_, is_named)| *is_named), "{found:?}");
}

/// Presets that are added to the published ones need a line here.
#[test]
fn every_published_preset_is_checked() {
    let is_published = |name: &&str| {
        let preset = Preset::named(name).unwrap();
        preset.stands_for.is_none() && !preset.index.accepted.is_empty()
    };
    let names: Vec<&str> = Preset::names().filter(is_published).collect();
    assert_eq!(names, published().iter().map(|protocol| protocol.name).collect::<Vec<_>>());
}

/// pixelSplat and latentSplat replace their planes by ones from the baseline, in the network and in the renderer (`bounds_shim.py`): where
/// the disparity is three image sides, and half a pixel.
#[test]
fn planes_by_disparity_are_those_of_two_methods() {
    let camera = |x: f64, focal: f64| {
        let pose = CameraFromWorld::new(DMat3::IDENTITY, DVec3::new(-x, 0.0, 0.0)).unwrap();
        Camera::pinhole(pose, NormalizedIntrinsics::new(focal, focal, 0.5, 0.5).unwrap())
    };
    let size = ImageSize { width: 256, height: 256 };
    for protocol in published() {
        let preset = Preset::named(protocol.name).unwrap();
        for (method, ..) in protocol.methods {
            let place = format!("{}, {method}", protocol.name);
            let planes = preset.setting_for(method).disparity_planes;
            assert_eq!(planes.is_some(), ["pixelSplat", "latentSplat"].contains(&method), "{place}");
            let Some(planes) = planes else { continue };
            // Pixels of 1/(256 · 0.8) and 1/(256 · 1.0), on average 1/227.6; baselines of 1 and 0.02.
            for baseline in [1.0, 0.02] {
                let context = [camera(0.0, 0.8), camera(baseline, 1.0), camera(0.3 * baseline, 0.8), camera(0.0, 1.0)];
                let found = planes.of(&context, size);
                let pixel = f64::midpoint(1.0 / 204.8, 1.0 / 256.0);
                let expected = [baseline / (768.0 * pixel), baseline / (0.5 * pixel)];
                Tolerance::relative(1e-12).assert([found.near, found.far], expected, &place);
            }
            // Wide images count their shorter side, and both sides of their pixels.
            let found = planes.of(&[camera(0.0, 1.0), camera(1.0, 1.0)], ImageSize { width: 448, height: 256 });
            let pixel = f64::midpoint(1.0 / 448.0, 1.0 / 256.0);
            Tolerance::relative(1e-12).assert([found.near, found.far], [1.0 / (768.0 * pixel), 2.0 / pixel], &place);
        }
    }
}
