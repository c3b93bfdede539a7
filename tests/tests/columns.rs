//! Real datasets as columns: inspected and exported.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::Path;

use atsplat_numeric::Tolerance;
use atsplat_scene::export::{ExportFormat, export};
use atsplat_scene::inspect::{InspectOptions, Inspection, SizeSampling, inspect};
use atsplat_scene::{SceneSource as _, WarningKind, Warnings, open};
use atsplat_tests::shared_data;

fn inspected(path: &Path) -> (Inspection, Warnings) {
    let mut warnings = Warnings::new();
    let dataset = open(path, &mut warnings).unwrap();
    let options = InspectOptions { sizes: SizeSampling::All, per_scene: true };
    let report = inspect(&dataset, dataset.format, &options, &mut warnings, &|| {});
    (report, warnings)
}

#[test]
fn the_fox_is_67_frames_of_which_17_have_no_image() {
    let Some(data) = shared_data("the_fox_is_67_frames_of_which_17_have_no_image") else { return };
    let (report, warnings) = inspected(&data.join("fox"));
    assert_eq!((report.format.name(), report.frames), ("nerfstudio", 67));
    assert_eq!((report.images.files, report.images.missing, report.images.headers_read), (50, 17, 50));
    assert_eq!(warnings.count(WarningKind::MissingImage), 17);
    assert_eq!((report.lenses.opencv, report.lenses.pinhole), (67, 0), "distortion is kept");
    let [size] = report.sizes[..] else { panic!("one size, found {:?}", report.sizes) };
    assert_eq!((size.size.width, size.size.height, size.frames), (1080, 1920, 50));
    assert_eq!(report.per_scene[0].images, 50);
}

#[test]
fn one_re10k_scene_has_279_frames() {
    let Some(data) = shared_data("one_re10k_scene_has_279_frames") else { return };
    let (report, _) = inspected(&data.join("re10k/chunk"));
    assert_eq!((report.format.name(), report.frames, report.images.encoded), ("torch-chunks", 279, 279));
    assert!(report.is_complete());
    // A chunk holds f32: the trajectory's numbers to six decimals, from another reader.
    let (text, _) = inspected(&data.join("re10k/000c3ab189999a83"));
    assert_eq!((text.format.name(), text.frames), ("re10k", 279));
    let numbers = |report: &Inspection| {
        let b = report.baselines;
        [b.step, b.rotation_degrees, b.extent, b.path_length].map(|s| s.median.unwrap())
    };
    Tolerance { absolute: 1e-5, relative: 1e-4 }.assert(numbers(&report), numbers(&text), "baselines");
}

#[test]
fn ten_trajectories_become_160_lines_of_csv() {
    let Some(data) = shared_data("ten_trajectories_become_160_lines_of_csv") else { return };
    let mut warnings = Warnings::new();
    let dataset = open(data.join("trajectories/cameractrl_16f"), &mut warnings).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("cameras.csv");
    let summary = export(&dataset, &path, ExportFormat::Csv, &mut warnings, &|| {}).unwrap();
    assert_eq!((summary.scenes, summary.skipped, summary.frames), (10, 0, 160));
    let text = std::fs::read_to_string(path).unwrap();
    assert_eq!(text.lines().count(), 161);
    // Every number that the files state stands in the table.
    let scene = dataset.load(&dataset.keys()[0], &mut warnings).unwrap();
    let line = text.lines().nth(1).unwrap();
    let cells: Vec<f64> = line.split(',').filter_map(|cell| cell.parse().ok()).collect();
    let camera = scene.frames[0].camera;
    for value in camera.camera_from_world.to_rows().into_iter().chain([camera.intrinsics.fx, camera.intrinsics.fy]) {
        assert!(cells.contains(&value), "{value} in {line}");
    }
}
