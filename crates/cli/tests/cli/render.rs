//! `atsplat render` as a user runs it: its files equal the renders of the library.

use std::fs;
use std::process::Command;

use atsplat_numeric::Tolerance;
use atsplat_pixels::exr::{self, Values};
use atsplat_pixels::{DecodeLimits, Image, Rounding, decode};
use atsplat_splat::cpu::CpuRenderer;
use atsplat_splat::gpu::adapters;
use atsplat_splat::{Channels, Exposure, RenderOptions, Renderer, RendererConstants};
use atsplat_tests::skip_without_graphics;
use serde_json::{Value, json};

use crate::common::{atsplat, printed_json, started, succeed};
use crate::render_scene::{bits, contents, fixture, folder, record, rendered};

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
        ["000000.exr", "000000.png", "000007.exr", "000007.png", "000009.exr", "000009.png", "render.json", "run.lock"]
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
        assert!(expected.counts.drawn >= 4, "{:?}", expected.counts);
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
    assert_eq!(record["settings"]["constants"]["name"], "gsplat-1.6 with near 0.5");
    assert_eq!(record["settings"]["constants"]["near"], 0.5);
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
    let report = printed_json(here, &args);
    let import = &report["scene"]["import"];
    assert_eq!((&import["rejected"], &import["repaired"], &import["total"]), (&json!(1), &json!(1), &json!(6)));
    assert_eq!(report["scene"]["gaussians"], 5);
    let counts = &report["gaussian-counts"];
    let all: u64 = counts.as_object().unwrap().values().map(|count| count.as_u64().unwrap()).sum();
    assert_eq!((all, &counts["outside-depth"]), (5 * 12, &json!(12)), "one of five is behind each of twelve");
    assert!(report.get("views").is_none() && record(&here.join("out"))["views"].as_array().unwrap().len() == 12);
    let text = succeed(here, &args[..8]);
    assert!(
        text.contains("5 Gaussians") && text.contains("means: not-a-number") && text.contains("beyond the far"),
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
        // Images, and the record, the lock and the preview.
        assert_eq!(folders[0].len(), 2 * path[path.len() - 1].parse().unwrap_or(4) + 3);
        assert!(folders[0] == folders[1] && folders[1] == folders[2], "{path:?}");
        assert_ne!(folders[0]["000000.png"], folders[0]["000001.png"], "the camera moves: {path:?}");
        let first = decode(&folders[0]["preview"], &DecodeLimits::default()).unwrap();
        assert_eq!((first.width(), first.height()), (35, 25));
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
    let report = printed_json(here, &args);
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
    let with_scalar = printed_json(
        here,
        &["render", "scene.ply", "--orbit", "1", "--size", "8x8", "--out", "out", "--round-trip", "ply,spz3", "--json"],
    );
    let row = &with_scalar["round-trip"]["rows"][1];
    assert!(row["fault"].as_str().unwrap().contains("expected"), "SPZ has no place for a scalar: {row}");
}

#[test]
fn a_failed_frame_is_counted_and_the_others_are_written() {
    let folder = folder();
    let here = folder.path();
    // The largest image that a camera file can ask for needs more memory than a render may take.
    let view = |number: usize, [width, height]: [u32; 2]| {
        json!({ "number": number, "name": "v", "width": width, "height": height,
                "camera-from-world": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0],
                "intrinsics": { "fx": 0.8, "fy": 1.2, "cx": 0.5, "cy": 0.5 } })
    };
    let (small, largest) = ([4, 2], [65_535; 2]);
    let views = json!({ "views": [view(0, small), view(1, largest), view(2, small)] });
    fs::write(here.join("views"), views.to_string()).unwrap();
    let args = ["render", "scene.ply", "--cameras", "views", "--out", "out", "--strict"];
    let outcome = atsplat(here, &args);
    assert_eq!(outcome.code, 4, "{}", outcome.stderr);
    assert!(outcome.stdout.contains("2 of 3 frames") && outcome.stderr.contains("frame 1: "), "{}", outcome.stderr);
    let made = record(&here.join("out"));
    assert_eq!(made["frames"], json!({ "requested": 3, "done": 2, "failed": 1 }));
    assert!(made["views"][1]["fault"].as_str().unwrap().contains("the limit is"), "{made}");
    assert!(here.join("out/000002.png").exists() && !here.join("out/000001.png").exists());
    fs::write(here.join("views"), json!({ "views": [view(1, largest)] }).to_string()).unwrap();
    atsplat(here, &args[..args.len() - 1]).says(1, "no frame could be rendered");
    assert_eq!(record(&here.join("out")), made, "the record of images that were not replaced");
}

/// Killed while it replaces the images of another scene. No record tells of the mixture, and no other process adds to it.
#[test]
fn an_interrupted_render_leaves_no_record_of_earlier_images() {
    let folder = folder();
    let here = folder.path();
    let again = ["render", "scene.ply", "--orbit", "3", "--size", "64x48", "--out", "out"];
    succeed(here, &again);
    let scene = fixture("degree3_little_endian.ply");
    let long = ["--threads", "1", "render", scene.to_str().unwrap(), "--orbit", "50000", "--size", "64x48"];
    let mut child = started(here, &[&long[..], &["--out", "out"]].concat(), "out/000003.png");
    let second = atsplat(here, &again);
    child.kill().unwrap();
    child.wait().unwrap();
    second.says(1, "out is being written by process ");
    assert!(here.join("out/000003.png").exists() && !here.join("out/render.json").exists());
    let fit = ["fit", "out", "--views", "..", "--strategy", "fixed", "--steps", "1", "--out", "fitted.ply"];
    assert_eq!(atsplat(here, &fit).code, 1, "images without cameras");
    succeed(here, &again);
    assert_eq!(record(&here.join("out"))["frames"]["done"], 3, "a killed process keeps no lock");
}

/// The images are made by then: their record says what went wrong behind them.
#[test]
fn a_failed_round_trip_keeps_the_record() {
    let folder = folder();
    let here = folder.path();
    let args = ["render", "scene.ply", "--orbit", "1", "--size", "8x6", "--out", "out", "--round-trip", "ply"];
    let mut command = Command::new(env!("CARGO_BIN_EXE_atsplat"));
    let outcome = command.args(args).current_dir(here).env("TMPDIR", here.join("nowhere")).output().unwrap();
    let message = String::from_utf8(outcome.stderr).unwrap();
    assert!(outcome.status.code() == Some(1) && message.contains("a folder for the round trip in"), "{message}");
    let fault = record(&here.join("out"))["round-trip"]["fault"].as_str().unwrap().to_owned();
    assert!(fault.contains("nowhere"), "{fault}");
}

#[test]
fn cpu_and_reference_agree() {
    let folder = folder();
    let here = folder.path();
    for device in ["cpu", "reference"] {
        let args = ["render", "scene.ply", "--orbit", "2", "--size", "24x18", "--formats", "exr", "--device", device];
        succeed(here, &[&args[..], &["--out", device]].concat());
        assert!(record(&here.join(device))["backend"].as_str().unwrap().starts_with(device));
    }
    let image = |name: &str| exr::read_rgb(&fs::read(here.join(name)).unwrap(), &DecodeLimits::default()).unwrap().0;
    let wide = |image: &Image| image.samples().iter().map(|sample| f64::from(*sample)).collect::<Vec<_>>();
    for name in ["000000.exr", "000001.exr"] {
        let (cpu, reference) = (image(&format!("cpu/{name}")), image(&format!("reference/{name}")));
        Tolerance::absolute(1e-4).assert(wide(&cpu), wide(&reference), name);
    }
}

/// Nothing takes the place of an adapter that is not there.
#[test]
fn renders_on_the_chosen_adapter_or_not_at_all() {
    let folder = folder();
    let here = folder.path();
    let args = ["render", "scene.ply", "--orbit", "1", "--size", "24x18", "--formats", "exr"];
    succeed(here, &[&args[..], &["--out", "cpu"]].concat());
    let unknown = atsplat(here, &[&args[..], &["--device", "wgpu:77", "--out", "gpu"]].concat());
    assert_eq!(unknown.code, 1, "{}", unknown.stderr);
    for part in ["error: --device wgpu:77: ", "expected number 77, found ", "; `atsplat adapters` lists"] {
        assert!(unknown.stderr.contains(part), "{part}: {}", unknown.stderr);
    }
    let on_adapter = [&args[..], &["--device", "wgpu", "--out", "gpu"]].concat();
    let mut named = Command::new(env!("CARGO_BIN_EXE_atsplat"));
    named.args(&on_adapter).current_dir(here).env("ATSPLAT_ADAPTER", "no such adapter");
    let message = String::from_utf8(named.output().unwrap().stderr).unwrap();
    let expected = "expected one named 'no such adapter', by the environment variable ATSPLAT_ADAPTER, found ";
    assert!(message.contains("error: --device wgpu: ") && message.contains(expected), "{message}");
    assert!(!here.join("gpu").exists());

    if adapters().is_empty() {
        atsplat(here, &on_adapter).says(1, "found none");
        return skip_without_graphics("cli render", "none listed");
    }
    succeed(here, &on_adapter);
    let backend = record(&here.join("gpu"))["backend"].as_str().unwrap().to_owned();
    assert!(backend.starts_with("gpu"), "{backend}");
    let image = |name: &str| exr::read_rgb(&fs::read(here.join(name)).unwrap(), &DecodeLimits::default()).unwrap().0;
    let wide = |image: &Image| image.samples().iter().map(|sample| f64::from(*sample)).collect::<Vec<_>>();
    let (ours, theirs) = (image("cpu/000000.exr"), image("gpu/000000.exr"));
    Tolerance::absolute(1.0 / 255.0).assert(wide(&theirs), wide(&ours), "an adapter");
}

#[test]
fn skipped_effects_are_reported_and_stay_within_the_tolerance() {
    let folder = folder();
    let here = folder.path();
    let scene = fixture("degree3_little_endian.ply");
    let mut images = Vec::new();
    for effects in ["all", "auto", "none"] {
        let args =
            ["render", scene.to_str().unwrap(), "--orbit", "3", "--size", "32x24", "--formats", "exr", "--effects"];
        let more = [effects, "--tolerance", "0.01", "--background", "white", "--out", effects, "--explain"];
        let text = succeed(here, &[&args[..], &more[..]].concat());
        assert!(text.contains("view-dependence") && text.contains(" ms to decide"), "{text}");
        let rows = record(&here.join(effects))["effects"]["effects"].clone();
        let row = rows.as_array().unwrap().iter().find(|row| row["effect"] == "background").unwrap().clone();
        assert_eq!(row[if effects == "none" { "skipped" } else { "runs" }], 3, "{effects}: {row}");
        let read = |at: usize| {
            let file = fs::read(here.join(effects).join(format!("{at:06}.exr"))).unwrap();
            exr::read_rgb(&file, &DecodeLimits::default()).unwrap().0.into_samples()
        };
        images.push((0..3).flat_map(read).map(f64::from).collect::<Vec<_>>());
    }
    let args = ["render", "scene.ply", "--orbit", "1", "--size", "8x6", "--formats", "exr", "--effects", "none"];
    atsplat(here, &[&args[..], &["--out", "plane"]].concat())
        .prints(0, "depth: skipped in 1 frame, its image is not written");
    Tolerance::absolute(0.01 + 1e-5).assert(images[1].clone(), images[0].clone(), "auto is all");
    assert!(Tolerance::absolute(0.5).check(images[2].clone(), images[0].clone()).is_err(), "none is black");
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
            let image = exr::read_rgb(&file, &DecodeLimits::default()).unwrap().0;
            let expected = rendered(&here.join("scene.ply"), view, &options);
            assert_eq!(bits(image.samples()), bits(expected.rgb.as_flattened()), "{word}");
            assert_eq!(fs::read(here.join(&again).join(name)).unwrap(), file, "{word}: a record keeps its exposures");
        }
    }
}
