//! `atsplat render` as a user runs it: what it writes is what the library renders.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod common;

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use atsplat_camera::{CameraFromWorld, NormalizedIntrinsics};
use atsplat_numeric::Tolerance;
use atsplat_pixels::exr::{self, Values};
use atsplat_pixels::{DecodeLimits, Image, Rounding, decode};
use atsplat_splat::cpu::CpuRenderer;
use atsplat_splat::{Channels, Exposure, RenderOptions, Renderer, RendererConstants, Rendering, View, files};
use atsplat_tests::graphics_required;
use serde_json::{Value, json};

use common::{atsplat, succeed, write_trajectory};

/// A few Gaussians that an independent script wrote.
fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../splat/tests/fixtures/files").join(name)
}

/// Six Gaussians in front of a camera at the origin, one of them with an infinite logit and one with a NaN.
const SCENE: &str = "ply
format ascii 1.0
element vertex 6
property float x
property float y
property float z
property float f_dc_0
property float f_dc_1
property float f_dc_2
property float opacity
property float scale_0
property float scale_1
property float scale_2
property float rot_0
property float rot_1
property float rot_2
property float rot_3
property float uncertainty
end_header
0 0 3 1 0 -1 2 -2 -2.5 -3 1 0 0 0 0.5
0.5 0.1 2.5 0 1 0.5 1 -2 -2 -2 0.9 0.1 0.2 0 0.25
-0.6 -0.2 4 -0.5 0.3 1.5 inf -1.5 -2 -2 1 0 0.5 0 0.125
0.2 -0.4 3.5 1.2 1.2 1.2 -1 -1 -1 -1 1 0 0 0 1
0 0 -5 1 1 1 3 -1 -1 -1 1 0 0 0 1
nan 0 3 1 1 1 3 -1 -1 -1 1 0 0 0 1
";

/// A scene and a trajectory in an empty folder.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("scene.ply"), SCENE).unwrap();
    write_trajectory(&folder.path().join("path.txt"), 12);
    folder
}

fn json_of(text: &str) -> Value {
    serde_json::from_str(text).unwrap()
}

fn record(folder: &Path) -> Value {
    json_of(&fs::read_to_string(folder.join("render.json")).unwrap())
}

/// Every file of a folder, by name.
fn contents(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let files = fs::read_dir(folder).unwrap().map(|file| file.unwrap());
    files.map(|file| (file.file_name().into_string().unwrap(), fs::read(file.path()).unwrap())).collect()
}

/// The view that `render.json` tells of, rendered by the library.
fn rendered(scene: &Path, view: &Value, options: &RenderOptions) -> Rendering<f32> {
    let (gaussians, _) = files::read(scene).unwrap();
    let rows: [f64; 12] = serde_json::from_value(view["camera-from-world"].clone()).unwrap();
    let intrinsics: NormalizedIntrinsics = serde_json::from_value(view["intrinsics"].clone()).unwrap();
    let camera = atsplat_camera::Camera::pinhole(CameraFromWorld::from_rows(&rows).unwrap(), intrinsics);
    let side = |name: &str| u32::try_from(view[name].as_u64().unwrap()).unwrap();
    let size = atsplat_camera::ImageSize { width: side("width"), height: side("height") };
    CpuRenderer::default().render(&gaussians, &View { camera, size }, options).unwrap()
}

fn bits(values: &[f32]) -> Vec<u32> {
    values.iter().map(|value| value.to_bits()).collect()
}

#[test]
fn files_hold_the_librarys_renders() {
    let folder = folder();
    let here = folder.path();
    let args = "render scene.ply --cameras path.txt --frames 0,7..10:2 --size 80x60 --out out --formats png,exr \
                 --channels depth,scalar,median-depth --background 0.25,0.5,1 --constants gsplat-1.6 --near 0.5 --effects all";
    succeed(here, &args.split_whitespace().collect::<Vec<_>>());
    let names: Vec<String> = contents(&here.join("out")).into_keys().collect();
    assert_eq!(
        names,
        ["000000.exr", "000000.png", "000007.exr", "000007.png", "000009.exr", "000009.png", "render.json"]
    );
    let options = RenderOptions {
        constants: RendererConstants { near: 0.5, ..RendererConstants::named("gsplat-1.6").unwrap() },
        background: [0.25, 0.5, 1.0],
        channels: Channels { depth: true, scalar: true, median_depth: true },
        ..RenderOptions::default()
    };
    let record = record(&here.join("out"));
    for view in record["views"].as_array().unwrap() {
        let expected = rendered(&here.join("scene.ply"), view, &options);
        assert!(expected.census.drawn >= 4, "{:?}", expected.census);
        let file = |at: usize| fs::read(here.join("out").join(view["files"][at].as_str().unwrap())).unwrap();
        let planes = exr::read(&file(0), &DecodeLimits::default()).unwrap();
        for (channel, name) in ["R", "G", "B"].into_iter().enumerate() {
            let plane = planes.get(name).unwrap();
            assert_eq!(plane.values, Values::DisplayReferred, "{name}");
            let wanted: Vec<f32> = expected.rgb.iter().map(|rgb| rgb[channel]).collect();
            assert_eq!(bits(&plane.samples), bits(&wanted), "{name}");
        }
        let of = |name: &str| planes.get(name).unwrap().samples.clone();
        assert_eq!(bits(&of("A")), bits(&expected.alpha));
        assert_eq!(bits(&of("median-depth")), bits(&expected.median_depth.clone().unwrap()));
        assert_eq!(bits(&of("scalar")), bits(&expected.scalar.clone().unwrap()));
        assert_eq!(planes.get("Z").unwrap().values, Values::Depth);
        let composited: Vec<f64> = of("Z").iter().zip(&expected.alpha).map(|(z, a)| f64::from(z * a)).collect();
        let wanted = expected.depth.as_ref().unwrap().iter().map(|depth| f64::from(*depth));
        Tolerance { absolute: 1e-7, relative: 1e-6 }.assert(composited, wanted, "Z is depth over opacity");
        let image = Image::new(80, 60, expected.rgb.as_flattened().to_vec()).unwrap();
        assert_eq!(decode(&file(1), &DecodeLimits::default()).unwrap(), image.to_u8(Rounding::Nearest).unwrap());
    }
    assert_eq!(record["look"]["constants"]["name"], "gsplat-1.6 with near 0.5");
    assert_eq!(record["look"]["constants"]["near"], 0.5);
    assert_eq!(
        (&record["backend"], &record["frames"]["done"]),
        (&json!(Renderer::name(&CpuRenderer::default())), &json!(3))
    );
}

#[test]
fn counts_cleaned_and_culled_gaussians() {
    let folder = folder();
    let here = folder.path();
    let args = ["render", "scene.ply", "--cameras", "path.txt", "--size", "32x24", "--out", "out", "--json"];
    let report = json_of(&succeed(here, &args));
    let import = &report["scene"]["import"];
    assert_eq!((&import["rejected"], &import["repaired"], &import["total"]), (&json!(1), &json!(1), &json!(6)));
    assert_eq!(report["scene"]["gaussians"], 5);
    let census = &report["census"];
    let all: u64 = census.as_object().unwrap().values().map(|count| count.as_u64().unwrap()).sum();
    assert_eq!((all, &census["outside-depth"]), (5 * 12, &json!(12)), "one of five is behind each of twelve");
    assert!(report.get("views").is_none() && record(&here.join("out"))["views"].as_array().unwrap().len() == 12);
    let text = succeed(here, &args[..8]);
    assert!(
        text.contains("5 Gaussians") && text.contains("means: not-a-number") && text.contains("behind the far"),
        "{text}"
    );
}

#[test]
fn the_same_arguments_give_identical_bytes() {
    let folder = folder();
    let here = folder.path();
    let scene = fixture("degree3_little_endian.ply");
    let scene = scene.to_str().unwrap();
    for path in [vec!["--orbit", "5"], vec!["--spline", "path.txt", "5"], vec!["--spline", "path.txt", "4", "--closed"]]
    {
        let mut folders = Vec::new();
        for (out, more) in
            [("one", vec!["--threads", "1"]), ("three", vec!["--threads", "3"]), ("timed", vec!["--timings"])]
        {
            let folder = format!("{out}{}", path.len());
            let mut args = vec!["render", scene, "--size", "70x50", "--formats", "png,exr", "--out", &folder];
            args.extend(["--preview", "preview.png", "--preview-width", "35"]);
            args.extend(path.iter().chain(&more));
            let text = succeed(here, &args);
            assert_eq!(text.contains("frames per second"), out == "timed", "{text}");
            let mut files = contents(&here.join(&folder));
            files.insert("preview".to_owned(), fs::read(here.join("preview.png")).unwrap());
            folders.push(files);
        }
        assert_eq!(folders[0].len(), 2 * path[path.len() - 1].parse().unwrap_or(4) + 2);
        assert!(folders[0] == folders[1] && folders[1] == folders[2], "{path:?}");
        assert_ne!(folders[0]["000000.png"], folders[0]["000001.png"], "the camera moves: {path:?}");
        let first = decode(&folders[0]["preview"], &DecodeLimits::default()).unwrap();
        assert_eq!((first.width(), first.height()), (35, 25));
    }
}

#[test]
fn a_record_is_a_camera_file_that_gives_identical_images() {
    let folder = folder();
    let here = folder.path();
    succeed(here, &["render", "scene.ply", "--orbit", "4", "--size", "40x30", "--up", "-y", "--out", "first"]);
    succeed(here, &["render", "scene.ply", "--cameras", "first/render.json", "--frames", "3,1", "--out", "second"]);
    let (first, second) = (contents(&here.join("first")), contents(&here.join("second")));
    assert_eq!(second.len(), 3);
    let again = atsplat(here, &["render", "scene.ply", "--orbit", "1", "--size", "40x30", "--out", "first"]);
    assert!(again.stderr.contains("3 images of another call"), "{}", again.stderr);
    for name in ["000001.png", "000003.png"] {
        assert_eq!(first[name], second[name], "{name}");
    }
}

/// 3DGS writes the camera's axes in the world; a record of the same camera gives the same picture.
#[test]
fn reads_the_cameras_of_a_trained_model() {
    let folder = folder();
    let here = folder.path();
    let (sin, cos) = 0.1f64.sin_cos();
    let trained = json!([{
        "id": 0, "img_name": "a", "width": 40, "height": 30, "position": [0.25, 0.0, -0.5],
        "rotation": [[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]], "fy": 36.0, "fx": 32.0,
    }]);
    // camera from world: the transposed rotation, and the centre seen from the camera.
    let translation = [-(cos * 0.25 - sin * -0.5), 0.0, -(sin * 0.25 + cos * -0.5)];
    let own = json!({ "views": [{
        "number": 0, "name": "a", "width": 40, "height": 30,
        "camera-from-world": [cos, 0.0, -sin, translation[0], 0.0, 1.0, 0.0, 0.0, sin, 0.0, cos, translation[2]],
        "intrinsics": { "fx": 0.8, "fy": 1.2, "cx": 0.5, "cy": 0.5 },
    }]});
    for (name, cameras) in [("trained", trained), ("own", own)] {
        fs::write(here.join(name), cameras.to_string()).unwrap();
        succeed(here, &["render", "scene.ply", "--cameras", name, "--out", &format!("of-{name}"), "--formats", "exr"]);
    }
    let picture = |name: &str| exr::read(&fs::read(here.join(name)).unwrap(), &DecodeLimits::default()).unwrap();
    let (trained, own) = (picture("of-trained/000000.exr"), picture("of-own/000000.exr"));
    for (a, b) in trained.channels().iter().zip(own.channels()) {
        let wide = |samples: &[f32]| samples.iter().map(|sample| f64::from(*sample)).collect::<Vec<_>>();
        Tolerance::absolute(1e-5).assert(wide(&a.samples), wide(&b.samples), &a.name);
        assert!(
            a.samples.iter().any(|sample| sample.to_bits() != a.samples[0].to_bits()),
            "{} shows something",
            a.name
        );
    }
}

/// MotionCtrl's lists hold no lens: --fov and --size say it, and a record of the same cameras gives the same pictures.
#[test]
fn bare_poses_use_the_requested_lens() {
    let folder = folder();
    let here = folder.path();
    let (sin, cos) = 0.1f64.sin_cos();
    // World to camera, row by row.
    let rows = [cos, 0.0, -sin, -0.3, 0.0, 1.0, 0.0, 0.1, sin, 0.0, cos, 0.45];
    let identity = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0];
    fs::write(here.join("poses.json"), json!([identity, rows]).to_string()).unwrap();
    // 90° across, square pixels.
    let view = |number: usize, rows: [f64; 12]| {
        json!({ "number": number, "name": number.to_string(), "width": 40, "height": 30, "camera-from-world": rows,
                "intrinsics": { "fx": 0.5, "fy": 0.5 * 40.0 / 30.0, "cx": 0.5, "cy": 0.5 } })
    };
    fs::write(here.join("own.json"), json!({ "views": [view(0, identity), view(1, rows)] }).to_string()).unwrap();
    let render = |cameras: &str, more: &[&str]| {
        let args = [
            "render",
            "scene.ply",
            "--cameras",
            cameras,
            "--out",
            cameras.trim_end_matches(".json"),
            "--formats",
            "exr",
        ];
        atsplat(here, &[&args, more].concat())
    };
    for more in [&[][..], &["--fov", "90"], &["--size", "40x30"]] {
        let outcome = render("poses.json", more);
        let message = outcome.stderr.contains("poses.json holds camera matrices without intrinsics");
        assert!(outcome.code == 1 && message && outcome.stderr.contains("--fov"), "{more:?}: {}", outcome.stderr);
    }
    assert_eq!(render("poses.json", &["--fov", "90", "--size", "40x30"]).code, 0);
    assert_eq!(render("own.json", &[]).code, 0);
    let picture = |name: &str| exr::read(&fs::read(here.join(name)).unwrap(), &DecodeLimits::default()).unwrap();
    for frame in ["000000.exr", "000001.exr"] {
        let (poses, own) = (picture(&format!("poses/{frame}")), picture(&format!("own/{frame}")));
        for (a, b) in poses.channels().iter().zip(own.channels()) {
            let wide = |samples: &[f32]| samples.iter().map(|sample| f64::from(*sample)).collect::<Vec<_>>();
            Tolerance::absolute(1e-5).assert(wide(&a.samples), wide(&b.samples), &a.name);
        }
    }
    assert_ne!(picture("own/000000.exr"), picture("own/000001.exr"), "two views");
    let outcome = render("own.json", &["--fov", "90"]);
    assert!(outcome.code == 1 && outcome.stderr.contains("own.json has intrinsics of its own"), "{}", outcome.stderr);
}

#[test]
fn errors_name_unsupported_camera_formats() {
    let folder = folder();
    let here = folder.path();
    for (text, message) in [
        (r#"[{"cameras": {}, "shots": {}}]"#, "a reconstruction of OpenSfM"),
        (r"[[1, 2, 3]]", "a list of 1, the first of which is a list of 3"),
        (r#"{"camera_path": [], "keyframes": []}"#, "a camera path of nerfstudio's viewer"),
        (r#"{"views": [], "sfm_data_version": "0.3"}"#, "a scene of OpenMVG"),
        ("{\"views\": [],\n\"views\": []}", "\"views\" a second time at line 2"),
    ] {
        fs::write(here.join("odd.json"), text).unwrap();
        let outcome = atsplat(here, &["render", "scene.ply", "--cameras", "odd.json", "--out", "out"]);
        assert!(outcome.code == 1 && outcome.stderr.contains(message), "{text}: {}", outcome.stderr);
        assert!(outcome.stderr.contains("odd.json"), "{}", outcome.stderr);
    }
}

#[test]
fn a_round_trip_is_lossless_for_ply_and_measured_for_others() {
    let folder = folder();
    let here = folder.path();
    let scene = fixture("degree3_little_endian.ply");
    let mut args = vec!["render", scene.to_str().unwrap(), "--orbit", "3", "--size", "64x48", "--out", "out"];
    args.extend(["--round-trip", "ply,ply-ascii,ply-big-endian,spz2,spz3"]);
    let text = succeed(here, &args);
    assert!(text.contains("identical") && text.contains(" dB"), "{text}");
    args.push("--json");
    let report = json_of(&succeed(here, &args));
    let rows = report["round-trip"]["rows"].as_array().unwrap();
    for row in &rows[..3] {
        assert_eq!(
            (&row["identical"], &row["psnr-db"], &row["largest-difference"]),
            (&json!(true), &Value::Null, &json!(0.0))
        );
    }
    for row in &rows[3..] {
        let (psnr, share) = (row["psnr-db"].as_f64().unwrap(), row["size-over-ply"].as_f64().unwrap());
        assert!((10.0..200.0).contains(&psnr) && share < 0.7, "{row}");
        assert!(row["worst-view-psnr-db"].as_f64().unwrap() <= psnr + 1e-9, "{row}");
    }
    let with_scalar = json_of(&succeed(
        here,
        &["render", "scene.ply", "--orbit", "1", "--size", "8x8", "--out", "out", "--round-trip", "ply,spz3", "--json"],
    ));
    let row = &with_scalar["round-trip"]["rows"][1];
    assert!(row["fault"].as_str().unwrap().contains("expected"), "SPZ has no place for a scalar: {row}");
}

#[test]
fn a_failed_frame_is_counted_and_the_others_are_written() {
    let folder = folder();
    let here = folder.path();
    let view = |number: usize, width: u32| {
        json!({ "number": number, "name": "v", "width": width, "height": 2,
                "camera-from-world": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0],
                "intrinsics": { "fx": 0.8, "fy": 1.2, "cx": 0.5, "cy": 0.5 } })
    };
    fs::write(here.join("views"), json!({ "views": [view(0, 4), view(1, 70_000), view(2, 4)] }).to_string()).unwrap();
    let args = ["render", "scene.ply", "--cameras", "views", "--out", "out", "--strict"];
    let outcome = atsplat(here, &args);
    assert_eq!(outcome.code, 4, "{}", outcome.stderr);
    assert!(outcome.stdout.contains("2 of 3 frames") && outcome.stderr.contains("frame 1: "), "{}", outcome.stderr);
    let record = record(&here.join("out"));
    assert_eq!(record["frames"], json!({ "asked": 3, "done": 2, "failed": 1 }));
    assert!(record["views"][1]["fault"].as_str().unwrap().contains("70000"), "{record}");
    assert!(here.join("out/000002.png").exists() && !here.join("out/000001.png").exists());
    fs::write(here.join("views"), json!({ "views": [view(1, 70_000)] }).to_string()).unwrap();
    let outcome = atsplat(here, &args[..args.len() - 1]);
    assert_eq!(outcome.code, 1, "nothing was rendered");
    assert!(outcome.stderr.contains("no frame could be rendered"), "{}", outcome.stderr);
}

#[test]
fn an_empty_scene_renders_as_background() {
    let folder = folder();
    let here = folder.path();
    let empty = SCENE.replace("vertex 6", "vertex 0").split_inclusive("end_header\n").next().unwrap().to_owned();
    fs::write(here.join("empty.ply"), empty).unwrap();
    let args =
        ["render", "empty.ply", "--cameras", "path.txt", "--frames", "3", "--size", "4x3", "--background", "0,1,0.2"];
    let outcome = atsplat(here, &[&args[..], &["--out", "out"]].concat());
    assert_eq!(outcome.code, 0, "{}", outcome.stderr);
    assert!(outcome.stderr.contains("no Gaussian is left"), "{}", outcome.stderr);
    let picture = decode(&fs::read(here.join("out/000003.png")).unwrap(), &DecodeLimits::default()).unwrap();
    assert_eq!(picture.samples(), [0, 255, 51].repeat(12));
    let outcome = atsplat(here, &["render", "empty.ply", "--orbit", "--out", "out"]);
    assert_eq!(outcome.code, 1);
    assert!(outcome.stderr.contains("no visible Gaussian"), "{}", outcome.stderr);
}

#[test]
fn usage_errors_are_reported_before_anything_is_written() {
    let folder = folder();
    let here = folder.path();
    let start = ["render", "scene.ply", "--out", "out"];
    for more in [
        &[][..],
        &["--orbit", "--cameras", "path.txt"],
        &["--orbit", "0"],
        &["--spline", "path.txt", "many"],
        &["--orbit", "--closed"],
        &["--orbit", "--frames", "0"],
        &["--cameras", "path.txt", "--frames", "5..2"],
        &["--cameras", "path.txt", "--elevation", "3"],
        &["--orbit", "--size", "40"],
        &["--orbit", "--background", "grey"],
        &["--orbit", "--up", "sideways"],
        &["--orbit", "--constants", "brush"],
        &["--orbit", "--channels", "depth"],
        &["--orbit", "--formats", "gif"],
        &["--orbit", "--preview", "preview.gif"],
        &["--orbit", "--fps", "12"],
        &["--orbit", "--backend", "cuda"],
        &["--orbit", "--round-trip", "splat"],
        &["--orbit", "--effects", "fog"],
        &["--orbit", "--tolerance", "-1"],
        &["--orbit", "--preview", "out/000000.png"],
        &["--orbit", "--adapter", "0"],
        &["--orbit", "--adapter", "0", "--backend", "reference"],
        &["--orbit", "--formats", "exr,exr"],
        &["--orbit", "--round-trip", "ply,spz3,ply"],
        &["--orbit", "--formats", "exr", "--channels", "depth", "--effects", "none"],
        &["--orbit", "--formats", "exr", "--channels", "depth,scalar", "--effects", "depth,lens"],
        &["--orbit", "--exposure", "-1"],
        &["--orbit", "--exposure", "bright"],
    ] {
        let outcome = atsplat(here, &[&start[..], more].concat());
        assert_eq!(outcome.code, 2, "{more:?}: {}", outcome.stderr);
        assert!(!here.join("out").exists(), "{more:?}");
    }
    let swallowed = atsplat(here, &["render", "--out", "out", "--orbit", "scene.ply"]);
    assert!(swallowed.code == 2 && swallowed.stderr.contains("comes before"), "{}", swallowed.stderr);
    let help = succeed(here, &["render", "--help"]);
    assert!(help.find("<SCENE>").unwrap() < help.find("--orbit").unwrap(), "{help}");
}

/// The record replaces nothing that it was made from.
#[test]
fn a_record_never_replaces_its_camera_file() {
    let folder = folder();
    let here = folder.path();
    succeed(here, &["render", "scene.ply", "--orbit", "2", "--size", "8x6", "--out", "out"]);
    let before = contents(&here.join("out"));
    for args in [["--cameras", "out/render.json"], ["--spline", "out/../out/render.json"]] {
        let outcome =
            atsplat(here, &[&["render", "scene.ply"], &args[..], &["--frames", "0", "--out", "out"]].concat());
        assert_eq!(outcome.code, 1, "{}", outcome.stderr);
        assert!(outcome.stderr.contains("would replace the cameras"), "{}", outcome.stderr);
        assert_eq!(contents(&here.join("out")), before);
    }
}

#[test]
fn warns_of_images_without_gaussians() {
    let folder = folder();
    let here = folder.path();
    let view = |number: usize, z: f64| {
        json!({ "number": number, "name": "v", "width": 8, "height": 6,
                "camera-from-world": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, z],
                "intrinsics": { "fx": 0.8, "fy": 1.2, "cx": 0.5, "cy": 0.5 } })
    };
    fs::write(here.join("views"), json!({ "views": [view(0, 0.0), view(1, -100.0)] }).to_string()).unwrap();
    let outcome = atsplat(here, &["render", "scene.ply", "--cameras", "views", "--out", "out"]);
    assert_eq!(outcome.code, 0, "{}", outcome.stderr);
    assert!(outcome.stderr.contains("no Gaussian is drawn in 1 of 2 frames"), "{}", outcome.stderr);
}

/// The pictures are made by then: their record says what went wrong behind them.
#[test]
fn a_failed_round_trip_keeps_the_record() {
    let folder = folder();
    let here = folder.path();
    let args = ["render", "scene.ply", "--orbit", "1", "--size", "8x6", "--out", "out", "--round-trip", "ply"];
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_atsplat"));
    let outcome = command.args(args).current_dir(here).env("TMPDIR", here.join("nowhere")).output().unwrap();
    let message = String::from_utf8(outcome.stderr).unwrap();
    assert!(outcome.status.code() == Some(1) && message.contains("a folder for the round trip in"), "{message}");
    let fault = record(&here.join("out"))["round-trip"]["fault"].as_str().unwrap().to_owned();
    assert!(fault.contains("nowhere"), "{fault}");
}

#[test]
fn errors_name_unreadable_and_unwritable_files() {
    let folder = folder();
    let here = folder.path();
    fs::write(here.join("taken"), b"a file").unwrap();
    fs::write(here.join("notes.ply"), b"no Gaussians at all").unwrap();
    fs::write(here.join("broken.json"), br#"{"views": [{"number": 0}]}"#).unwrap();
    fs::write(here.join("cut.json"), br#"[{"id": 0, "img_"#).unwrap();
    fs::write(here.join("exposure.json"), br#"{"0": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]}"#).unwrap();
    let odd = RendererConstants { max_alpha: 1.5, ..RendererConstants::default() };
    fs::write(here.join("odd.toml"), toml::to_string(&odd).unwrap()).unwrap();
    let cases: [(&[&str], &str); 13] = [
        (&["scene.ply", "--orbit", "--constants", "odd.toml", "--out", "out"], "odd.toml: constants: max-alpha"),
        (&["scene.ply", "--cameras", "cut.json", "--out", "out"], "cut.json: expected JSON"),
        (
            &["scene.ply", "--orbit", "2", "--exposure", "exposure.json", "--out", "out"],
            "no exposure for the view \"1\"",
        ),
        (&["scene.ply", "--orbit", "2", "--exposure", "broken.json", "--out", "out"], "a 3×4 array"),
        (&["scene.ply", "--orbit", "--out", "taken"], "taken"),
        (&["scene.ply", "--orbit", "--out", "out", "--preview", "taken/preview.png"], "taken"),
        (&["notes.ply", "--orbit", "--out", "out"], "expected a PLY, SPZ or .splat file"),
        (&["nowhere.ply", "--orbit", "--out", "out"], "nowhere.ply"),
        (&["scene.ply", "--cameras", "notes.ply", "--out", "out"], "notes.ply"),
        (&["scene.ply", "--cameras", "broken.json", "--out", "out"], "camera 0"),
        (&["scene.ply", "--cameras", "path.txt", "--out", "out"], "--size"),
        (&["scene.ply", "--cameras", "path.txt", "--frames", "12", "--out", "out"], "12 frames"),
        (&["scene.ply", "--orbit", "--near", "5", "--far", "4", "--out", "out"], "near plane"),
    ];
    for (args, expected) in cases {
        let outcome = atsplat(here, &[&["render"], args].concat());
        assert_eq!(outcome.code, 1, "{args:?}: {}", outcome.stderr);
        assert!(outcome.stderr.contains(expected), "{args:?}: {}", outcome.stderr);
    }
    assert!(!here.join("out/render.json").exists(), "a record belongs to images that were written");
}

#[test]
fn cpu_and_reference_agree() {
    let folder = folder();
    let here = folder.path();
    for backend in ["cpu", "reference"] {
        let args = ["render", "scene.ply", "--orbit", "2", "--size", "24x18", "--formats", "exr", "--backend", backend];
        succeed(here, &[&args[..], &["--out", backend]].concat());
        assert!(record(&here.join(backend))["backend"].as_str().unwrap().starts_with(backend));
    }
    let picture = |name: &str| exr::read_rgb(&fs::read(here.join(name)).unwrap(), &DecodeLimits::default()).unwrap().0;
    let wide = |image: &Image| image.samples().iter().map(|sample| f64::from(*sample)).collect::<Vec<_>>();
    for name in ["000000.exr", "000001.exr"] {
        let (cpu, reference) = (picture(&format!("cpu/{name}")), picture(&format!("reference/{name}")));
        Tolerance::absolute(1e-4).assert(wide(&cpu), wide(&reference), name);
    }
}

/// On an adapter where there is one; else the processor takes over, and says so. One that was named has to be there.
#[test]
fn renders_on_an_adapter_or_falls_back_to_the_cpu() {
    let folder = folder();
    let here = folder.path();
    let args = ["render", "scene.ply", "--orbit", "1", "--size", "24x18", "--formats", "exr"];
    succeed(here, &[&args[..], &["--out", "cpu"]].concat());
    let named = ["--backend", "gpu", "--adapter", "no such adapter", "--out", "none"];
    let outcome = atsplat(here, &[&args[..], &named].concat());
    assert!(outcome.code == 1 && outcome.stderr.contains("no such adapter"), "{}", outcome.stderr);

    let outcome = atsplat(here, &[&args[..], &["--backend", "gpu", "--out", "gpu"]].concat());
    assert_eq!(outcome.code, 0, "{}", outcome.stderr);
    let backend = record(&here.join("gpu"))["backend"].as_str().unwrap().to_owned();
    let taken_over = outcome.stderr.lines().any(|line| line.contains("cpu, ") && line.contains(" renders: "));
    assert_eq!(backend.starts_with("cpu"), taken_over, "{backend}: {}", outcome.stderr);
    let required = graphics_required();
    assert!(!required || backend.starts_with("gpu"), "{backend}: {}", outcome.stderr);
    let picture = |name: &str| exr::read_rgb(&fs::read(here.join(name)).unwrap(), &DecodeLimits::default()).unwrap().0;
    let wide = |image: &Image| image.samples().iter().map(|sample| f64::from(*sample)).collect::<Vec<_>>();
    let (ours, theirs) = (picture("cpu/000000.exr"), picture("gpu/000000.exr"));
    Tolerance::absolute(1.0 / 255.0).assert(wide(&theirs), wide(&ours), "an adapter");
}

#[test]
fn skipped_effects_are_reported_and_stay_within_the_tolerance() {
    let folder = folder();
    let here = folder.path();
    let scene = fixture("degree3_little_endian.ply");
    let mut pictures = Vec::new();
    for effects in ["all", "auto", "none"] {
        let args =
            ["render", scene.to_str().unwrap(), "--orbit", "3", "--size", "32x24", "--formats", "exr", "--effects"];
        let more = [effects, "--tolerance", "0.01", "--background", "white", "--out", effects, "--explain"];
        let text = succeed(here, &[&args[..], &more[..]].concat());
        assert!(text.contains("view-dependence") && text.contains(" ms to decide"), "{text}");
        let rows = record(&here.join(effects))["effects"]["effects"].clone();
        let row = rows.as_array().unwrap().iter().find(|row| row["effect"] == "background").unwrap().clone();
        assert_eq!(row[if effects == "none" { "left-out" } else { "runs" }], 3, "{effects}: {row}");
        let read = |at: usize| {
            let file = fs::read(here.join(effects).join(format!("{at:06}.exr"))).unwrap();
            exr::read_rgb(&file, &DecodeLimits::default()).unwrap().0.into_samples()
        };
        pictures.push((0..3).flat_map(read).map(f64::from).collect::<Vec<_>>());
    }
    let args = ["render", "scene.ply", "--orbit", "1", "--size", "8x6", "--formats", "exr", "--effects", "none"];
    let text = succeed(here, &[&args[..], &["--out", "plane"]].concat());
    assert!(text.contains("depth: left out in 1 frame, its image is not written"), "{text}");
    Tolerance::absolute(0.01 + 1e-5).assert(pictures[1].clone(), pictures[0].clone(), "auto is all");
    assert!(Tolerance::absolute(0.5).check(pictures[2].clone(), pictures[0].clone()).is_err(), "none is black");
}

#[test]
fn exposes_by_gain_by_name_and_from_a_record() {
    let folder = folder();
    let here = folder.path();
    let array = [[1.1, 0.2, -0.1, 0.01], [0.05, 0.9, 0.3, -0.02], [0.0, -0.15, 1.2, 0.03]];
    fs::write(here.join("exposure.json"), json!({ "0": array, "1": array, "another": array }).to_string()).unwrap();
    let args = ["render", "scene.ply", "--size", "24x18", "--formats", "exr", "--effects", "all"];
    let exposures = [("gain", "1.5", Exposure::uniform(1.5)), ("listed", "exposure.json", Exposure::from_3dgs(array))];
    for (out, word, exposure) in exposures {
        let text =
            succeed(here, &[&args[..], &["--orbit", "2", "--out", out, "--exposure", word, "--explain"]].concat());
        assert!(text.contains("exposure         runs"), "{text}");
        let again = format!("{out}-again");
        succeed(here, &[&args[..], &["--cameras", &format!("{out}/render.json"), "--out", &again]].concat());
        let options = RenderOptions {
            channels: Channels { depth: true, ..Channels::default() },
            exposure: Some(exposure),
            ..RenderOptions::default()
        };
        for view in record(&here.join(out))["views"].as_array().unwrap() {
            let name = view["files"][0].as_str().unwrap();
            let file = fs::read(here.join(out).join(name)).unwrap();
            let picture = exr::read_rgb(&file, &DecodeLimits::default()).unwrap().0;
            let expected = rendered(&here.join("scene.ply"), view, &options);
            assert_eq!(bits(picture.samples()), bits(expected.rgb.as_flattened()), "{word}");
            assert_eq!(fs::read(here.join(&again).join(name)).unwrap(), file, "{word}: a record keeps its exposures");
        }
    }
}
