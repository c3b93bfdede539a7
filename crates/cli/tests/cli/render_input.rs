//! Input of `atsplat render`: camera files, arguments, and errors.

use std::fs;

use atsplat_numeric::Tolerance;
use atsplat_pixels::{DecodeLimits, decode, exr};
use atsplat_splat::RendererConstants;
use serde_json::{Value, json};

use crate::common::{atsplat, succeed, write_trajectory};
use crate::render_scene::{SCENE, contents, folder, record};

#[test]
fn a_record_is_a_camera_file_that_gives_identical_images() {
    let folder = folder();
    let here = folder.path();
    succeed(here, &["render", "scene.ply", "--orbit", "4", "--size", "40x30", "--up", "-y", "--out", "first"]);
    succeed(here, &["render", "scene.ply", "--cameras", "first/render.json", "--frames", "3,1", "--out", "second"]);
    let (first, second) = (contents(&here.join("first")), contents(&here.join("second")));
    assert_eq!(second.len(), 4, "two images, their record and the lock");
    let again = atsplat(here, &["render", "scene.ply", "--orbit", "1", "--size", "40x30", "--out", "first"]);
    assert!(again.stderr.contains("3 images from another run"), "{}", again.stderr);
    let along = ["render", "scene.ply", "--spline", "second/render.json", "3", "--frames", "0", "--out", "third"];
    let one = atsplat(here, &along);
    let keyed = ["render", "scene.ply", "--cameras", "first/render.json", "--key", "garden", "--out", "third"];
    atsplat(here, &keyed).says(2, "--key requires a dataset");
    one.says(1, "error: --spline second/render.json: ");
    for name in ["000001.png", "000003.png"] {
        assert_eq!(first[name], second[name], "{name}");
    }
}

/// 3DGS writes the camera's axes in the world; a record of the same camera gives the same image.
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
    let record = json!({ "views": [{
        "number": 0, "name": "a", "width": 40, "height": 30,
        "camera-from-world": [cos, 0.0, -sin, translation[0], 0.0, 1.0, 0.0, 0.0, sin, 0.0, cos, translation[2]],
        "intrinsics": { "fx": 0.8, "fy": 1.2, "cx": 0.5, "cy": 0.5 },
    }]});
    for (name, cameras) in [("trained", trained), ("record", record)] {
        fs::write(here.join(name), cameras.to_string()).unwrap();
        succeed(here, &["render", "scene.ply", "--cameras", name, "--out", &format!("of-{name}"), "--formats", "exr"]);
    }
    let image = |name: &str| exr::read(&fs::read(here.join(name)).unwrap(), &DecodeLimits::default()).unwrap();
    let (trained, recorded) = (image("of-trained/000000.exr"), image("of-record/000000.exr"));
    for (a, b) in trained.channels().iter().zip(recorded.channels()) {
        let wide = |samples: &[f32]| samples.iter().map(|sample| f64::from(*sample)).collect::<Vec<_>>();
        Tolerance::absolute(1e-5).assert(wide(&a.samples), wide(&b.samples), &a.name);
        assert!(
            a.samples.iter().any(|sample| sample.to_bits() != a.samples[0].to_bits()),
            "{} shows something",
            a.name
        );
    }
}

/// nerfstudio's cameras look along −z, and +y is up. The field of view is the vertical one.
#[test]
fn reads_a_camera_path_of_nerfstudios_viewer() {
    let folder = folder();
    let here = folder.path();
    let matrix = [0.0, 0.0, -1.0, 1.0, -1.0, 0.0, 0.0, 2.0, 0.0, 1.0, 0.0, 3.5, 0.0, 0.0, 0.0, 1.0];
    let camera = |fov: f64| json!({ "camera_to_world": matrix, "fov": fov, "aspect": 2.0 });
    let mut path = json!({
        "camera_type": "perspective", "render_width": 16, "render_height": 8, "fps": 24, "seconds": 1, "keyframes": [],
        "camera_path": [camera(60.0), camera(90.0)],
    });
    fs::write(here.join("orbit.json"), path.to_string()).unwrap();
    let render = |more: &[&str]| {
        atsplat(here, &[&["render", "scene.ply", "--cameras", "orbit.json", "--out", "out"], more].concat())
    };
    let outcome = render(&["--frames", "1"]);
    assert_eq!(outcome.code, 0, "{}", outcome.stderr);
    let view = record(&here.join("out"))["views"][0].clone();
    assert_eq!((&view["number"], &view["width"], &view["height"]), (&json!(1), &json!(16), &json!(8)));
    let pose: Vec<f64> = serde_json::from_value(view["camera-from-world"].clone()).unwrap();
    let expected = [0.0, -1.0, 0.0, 2.0, 0.0, 0.0, -1.0, 3.5, 1.0, 0.0, 0.0, -1.0];
    Tolerance::F64.assert(pose, expected, "right, down and forward axes");
    let focal = ["fx", "fy"].map(|axis| view["intrinsics"][axis].as_f64().unwrap());
    Tolerance::F64.assert(focal, [0.25, 0.5], "a vertical field of view of 90°");
    render(&["--fov", "60"]).says(1, "--fov conflicts with orbit.json");
    path["camera_type"] = json!("fisheye");
    fs::write(here.join("orbit.json"), path.to_string()).unwrap();
    render(&[]).says(1, "camera_type: camera model fisheye is not supported");
}

/// Of 101 evenly timed cameras three, of which the first two are adjacent: the middle in time is at camera 50.
#[test]
fn a_path_follows_the_times_of_its_cameras() {
    let folder = folder();
    let here = folder.path();
    write_trajectory(&here.join("long.txt"), 101);
    let render = |out: &str, args: &[&str]| {
        atsplat(here, &[&["render", "scene.ply", "--size", "8x6", "--out", out], args].concat())
    };
    let poses = |out: &str, args: &[&str]| -> (Value, Vec<Vec<f64>>) {
        let outcome = render(out, args);
        assert_eq!(outcome.code, 0, "{args:?}: {}", outcome.stderr);
        let record = record(&here.join(out));
        let views = record["views"].as_array().unwrap().iter();
        let rows = views.map(|view| serde_json::from_value(view["camera-from-world"].clone()).unwrap());
        (record["path"]["spacing"].clone(), rows.collect())
    };
    let along = ["--spline", "long.txt", "3", "--frames", "0,1,100"];
    let with = |spacing: &'static str| [&along[..], &["--spacing", spacing]].concat();
    let (_, given) = poses("given", &["--cameras", "long.txt", "--frames", "0,1,50,100"]);
    let (spacing, timed) = poses("timed", &with("time"));
    assert_eq!(spacing, "time");
    assert_eq!((&timed[0], &timed[2]), (&given[0], &given[3]));
    // 1.02 units away from camera 1. The path bends a little more between its keys than the cameras do.
    Tolerance::absolute(0.06).assert(timed[1].clone(), given[2].clone(), "the middle in time");
    let (spacing, even) = poses("even", &with("even"));
    assert_eq!((spacing, &even[1]), (json!("even"), &given[1]));
    assert_eq!(poses("default", &along).0, "arc-length");

    let back = render("none", &["--spline", "long.txt", "--frames", "0,5,2", "--spacing", "time"]);
    let names_them =
        back.stderr.contains("found 66734 µs of frame 2 ") && back.stderr.contains("166835 µs of frame 5 ");
    assert!(back.code == 1 && names_them && back.stderr.contains("--frames"), "{}", back.stderr);
    // A record has no times, and numbers of frames are none.
    let rows = fs::read_to_string(here.join("path.txt")).unwrap();
    let numbered = rows.lines().enumerate().map(|(number, row)| match row.split_once(' ') {
        Some((_, rest)) => format!("{number} {rest}\n"),
        None => format!("{row}\n"),
    });
    fs::write(here.join("numbered.txt"), numbered.collect::<String>()).unwrap();
    for file in ["given/render.json", "numbered.txt"] {
        let rejected = render("none", &["--spline", file, "--spacing", "time"]);
        let message = format!("--spacing time: {file} records no times of its cameras");
        rejected.says(1, &message);
        assert!(rejected.stderr.contains("--spacing even"), "{}", rejected.stderr);
        assert_eq!(render("fine", &["--spline", file, "4", "--spacing", "even"]).code, 0, "{file}");
    }
    assert!(!here.join("none").exists());
}

/// MotionCtrl's lists hold no lens: --fov and --size say it, and a record of the same cameras gives the same images.
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
    fs::write(here.join("record.json"), json!({ "views": [view(0, identity), view(1, rows)] }).to_string()).unwrap();
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
    for (more, missing) in [
        (&[][..], "the field of view with --fov and the image size with --size"),
        (&["--fov", "90"], "the image size with --size"),
        (&["--size", "40x30"], "the field of view with --fov"),
    ] {
        let message = format!("poses.json contains camera matrices without intrinsics: set {missing}\n");
        render("poses.json", more).says(1, &message);
    }
    assert_eq!(render("poses.json", &["--fov", "90", "--size", "40x30"]).code, 0);
    assert_eq!(render("record.json", &[]).code, 0);
    let image = |name: &str| exr::read(&fs::read(here.join(name)).unwrap(), &DecodeLimits::default()).unwrap();
    for frame in ["000000.exr", "000001.exr"] {
        let (poses, recorded) = (image(&format!("poses/{frame}")), image(&format!("record/{frame}")));
        for (a, b) in poses.channels().iter().zip(recorded.channels()) {
            let wide = |samples: &[f32]| samples.iter().map(|sample| f64::from(*sample)).collect::<Vec<_>>();
            Tolerance::absolute(1e-5).assert(wide(&a.samples), wide(&b.samples), &a.name);
        }
    }
    assert_ne!(image("record/000000.exr"), image("record/000001.exr"), "two views");
    let message = "--fov conflicts with record.json, which states the intrinsics of its cameras: leave out --fov";
    render("record.json", &["--fov", "90"]).says(1, message);
    let outcome = render("nowhere.json", &["--fov", "90", "--size", "40x30"]);
    assert!(outcome.code == 1 && !outcome.stderr.contains("intrinsics"), "{}", outcome.stderr);
}

#[test]
fn errors_name_unsupported_camera_formats() {
    let folder = folder();
    let here = folder.path();
    for (text, message) in [
        (r#"[{"cameras": {}, "shots": {}}]"#, "a reconstruction of OpenSfM"),
        (r"[[1, 2, 3]]", "a list of 1, the first of which is a list of 3"),
        (r#"{"camera_path": [], "keyframes": []}"#, "render_width: expected 1 to 65535 pixels, found nothing"),
        (r#"{"views": [], "sfm_data_version": "0.3"}"#, "a scene of OpenMVG"),
        ("{\"views\": [],\n\"views\": []}", "\"views\" a second time at line 2"),
    ] {
        fs::write(here.join("odd.json"), text).unwrap();
        let outcome = atsplat(here, &["render", "scene.ply", "--cameras", "odd.json", "--out", "out"]);
        outcome.says(1, message);
        assert!(outcome.stderr.contains("odd.json"), "{}", outcome.stderr);
    }
}

#[test]
fn an_empty_scene_renders_as_background() {
    let folder = folder();
    let here = folder.path();
    let empty = SCENE.replace("vertex 6", "vertex 0").split_inclusive("end_header\n").next().unwrap().to_owned();
    fs::write(here.join("empty.ply"), &empty).unwrap();
    let args =
        ["render", "empty.ply", "--cameras", "path.txt", "--frames", "3", "--size", "4x3", "--background", "0,1,0.2"];
    atsplat(here, &[&args[..], &["--out", "out"]].concat()).says(0, "no Gaussian is left");
    let image = decode(&fs::read(here.join("out/000003.png")).unwrap(), &DecodeLimits::default()).unwrap();
    assert_eq!(image.samples(), [0, 255, 51].repeat(12));
    atsplat(here, &["render", "empty.ply", "--orbit", "--out", "out"]).says(1, "no visible Gaussian");
    let only_nan = empty.replace("vertex 0", "vertex 1") + SCENE.lines().next_back().unwrap() + "\n";
    fs::write(here.join("nan.ply"), only_nan).unwrap();
    for scene in ["empty.ply", "nan.ply"] {
        let args = ["render", scene, "--cameras", "path.txt", "--size", "4x3", "--out", "strict", "--strict"];
        atsplat(here, &args).says(4, "no Gaussian is left");
    }
    let outcome = atsplat(here, &["render", "nan.ply", "--orbit", "--out", "out"]);
    assert!(outcome.stderr.contains("1 removed, 0 repaired; 1  means: not-a-number"), "{}", outcome.stderr);
}

#[cfg(unix)]
#[test]
fn what_is_in_the_place_of_the_output_folder_is_named() {
    let folder = folder();
    let here = folder.path();
    std::os::unix::fs::symlink("gone", here.join("link")).unwrap();
    for (out, found) in [("scene.ply", "the file scene.ply"), ("link/below", "the broken symbolic link link to gone")] {
        let message = format!("error: creating the folder {out}: expected a folder, found {found}");
        atsplat(here, &["render", "scene.ply", "--orbit", "2", "--size", "8x6", "--out", out]).says(1, &message);
    }
    assert!(fs::read_to_string(here.join("scene.ply")).unwrap() == SCENE && !here.join("gone").exists());
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
        &["--spline", "path.txt", "--closed", "--spacing", "time"],
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
        &["--orbit", "--device", "cuda"],
        &["--orbit", "--backend", "gpu"],
        &["--orbit", "--round-trip", "splat"],
        &["--orbit", "--effects", "fog"],
        &["--orbit", "--tolerance", "-1"],
        &["--orbit", "--tolerance", "0.1", "--effects", "all"],
        &["--orbit", "--rounding", "truncate", "--formats", "exr"],
        &["--orbit", "--preview", "out/000000.png"],
        &["--orbit", "--adapter", "0"],
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
    atsplat(here, &["render", "--out", "out", "--orbit", "scene.ply"]).says(2, "comes before");
    let help = succeed(here, &["render", "--help"]);
    assert!(help.find("<SCENE>").unwrap() < help.find("--orbit").unwrap(), "{help}");
    assert!(help.contains("on a circle around the scene; 60 by default"), "{help}");
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
        outcome.says(1, "would overwrite the input cameras");
        assert_eq!(contents(&here.join("out")), before);
    }
}

/// A trajectory states no size; its intrinsics are those of images of 16 : 9.
#[test]
fn warns_of_a_size_that_squeezes_images_without_a_stated_size() {
    let folder = folder();
    let here = folder.path();
    for (size, squeezes) in [("64x36", false), ("48x48", true)] {
        let args = ["render", "scene.ply", "--cameras", "path.txt", "--frames", "0,1", "--size", size, "--out", size];
        let outcome = atsplat(here, &args);
        assert_eq!(outcome.code, 0, "{}", outcome.stderr);
        let said = outcome.stderr.matches("--size 48×48 squeezes images: expected an image of about 86×48").count();
        assert_eq!(said, usize::from(squeezes), "{size}: {}", outcome.stderr);
    }
}

#[test]
fn warns_of_images_without_gaussians() {
    let folder = folder();
    let here = folder.path();
    let view = |number: usize, [x, z]: [f64; 2]| {
        json!({ "number": number, "name": "v", "width": 8, "height": 6,
                "camera-from-world": [1, 0, 0, x, 0, 1, 0, 0, 0, 0, 1, z],
                "intrinsics": { "fx": 0.8, "fy": 1.2, "cx": 0.5, "cy": 0.5 } })
    };
    for (moved, cause) in
        [([1000.0, 0.0], "do the cameras belong to this scene"), ([0.0, -100.0], "they are behind the camera")]
    {
        fs::write(here.join("views"), json!({ "views": [view(0, [0.0; 2]), view(1, moved)] }).to_string()).unwrap();
        let outcome = atsplat(here, &["render", "scene.ply", "--cameras", "views", "--out", "out"]);
        assert_eq!(outcome.code, 0, "{}", outcome.stderr);
        let expected = format!("no Gaussian is drawn in 1 of 2 frames: {cause}");
        assert!(outcome.stderr.contains(&expected), "{}", outcome.stderr);
    }
    let strict = atsplat(here, &["render", "scene.ply", "--cameras", "views", "--out", "strict", "--strict"]);
    assert_eq!(strict.code, 4, "{}", strict.stderr);
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
    let cases: [(&[&str], &str); 12] = [
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
        (&["scene.ply", "--cameras", "path.txt", "--frames", "12", "--out", "out"], "positions below 12"),
    ];
    for (args, expected) in cases {
        atsplat(here, &[&["render"], args].concat()).says(1, expected);
    }
    atsplat(here, &["render", "scene.ply", "--orbit", "--near", "5", "--far", "4", "--out", "out"])
        .says(2, "--near, --far: expected a near plane");
    assert!(!here.join("out").exists(), "a record belongs to images that were written, and a folder to its files");
}
