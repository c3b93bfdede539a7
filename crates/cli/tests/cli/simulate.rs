//! `atsplat data simulate` as a user runs it.

use crate::common::{atsplat, json_of, printed_json, started, succeed, write_trajectory};

#[test]
fn simulated_scenes_are_readable_in_every_layout() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let simulate = |out: &str, more: &[&str]| {
        let plain = ["data", "simulate", out, "--scenes", "2", "--frames", "3", "--size", "32x24", "--json"];
        succeed(here, &[&plain, more].concat())
    };
    for (layout, inside) in [("re10k", "test"), ("chunks", "test"), ("nerfstudio", "")] {
        let report = json_of(&simulate(layout, &["--layout", layout]));
        assert_eq!(report["scenes"][1]["key"], "rooms-test-00000001", "{report}");
        let found = printed_json(here, &["data", "inspect", &format!("{layout}/{inside}"), "--json"]);
        assert_eq!((&found["scenes"]["read"], &found["frames"]), (&2.into(), &6.into()), "{layout}: {found}");
    }
    atsplat(here, &["data", "simulate", "re10k", "--scenes", "1"]).says(1, "not empty");
    assert_eq!(atsplat(here, &["data", "simulate", "new", "--effects", "fog"]).code, 2);
    assert!(!here.join("new").exists(), "usage errors create no folder");
}

/// Killed after its first scene.
#[test]
fn a_folder_has_one_simulation_and_tells_if_that_did_not_end() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let simulate = ["data", "simulate", "out", "--frames", "2", "--size", "24x16", "--samples", "1", "--scenes"];
    let many = [&simulate[..], &["4000"]].concat();
    let mut child = started(here, &many, "out/test/rooms-test-00000000.txt");
    let second = atsplat(here, &many);
    child.kill().unwrap();
    child.wait().unwrap();
    second.says(1, "out is being written by process ");
    assert!(!here.join("out/manifest.json").exists());
    let message = "out is not empty: a simulation of 4000 scenes into it did not end (planned.json lists them); remove the folder";
    atsplat(here, &many).says(1, message);
    std::fs::remove_dir_all(here.join("out")).unwrap();
    let one = [&simulate[..], &["1"]].concat();
    succeed(here, &one);
    assert!(here.join("out/manifest.json").is_file() && !here.join("out/planned.json").exists());
    atsplat(here, &one).says(1, "out is not empty; choose a new or empty folder, or remove this one");
    let failed = atsplat(here, &["data", "simulate", "new", "--route", "nowhere"]);
    assert!(failed.code == 1 && !here.join("new").exists(), "{}", failed.stderr);
}

/// What an effect costs is a time with an interval or not measurable, never negative; what auto leaves out is within bounds.
#[test]
fn costs_of_effects_are_not_negative_and_compared_with_all() {
    let folder = tempfile::tempdir().unwrap();
    let plain = ["--scenes", "2", "--frames", "3", "--size", "48x32", "--costs"];
    let simulate =
        |out: &str, more: &[&str]| succeed(folder.path(), &[&["data", "simulate", out], &plain[..], more].concat());
    let text = simulate("text", &["--plot", "costs.svg"]);
    let plot = std::fs::read_to_string(folder.path().join("costs.svg")).unwrap();
    for shown in ["2 rooms, 48×32, 4 rays a pixel", "soft shadows", "of 2 scenes"] {
        assert!(plot.contains(shown), "{shown}: {plot}");
    }
    let measured: Vec<&str> = text.lines().filter(|line| line.starts_with("    ")).collect();
    for name in ["soft shadows", "the frame", "with all effects", "difference"] {
        assert!(measured.iter().any(|line| line.trim_start().starts_with(name)), "{name}: {text}");
    }
    assert!(measured.iter().all(|line| !line.contains(" -") && !line.contains("(-")), "a negative cost: {text}");
    assert!(text.contains("median ms a frame") && text.contains("all effects take "), "{text}");
    let report = json_of(&simulate("json", &["--json"]));
    for scene in report["scenes"].as_array().unwrap() {
        let costs = &scene["costs"];
        assert!(costs["difference"]["beyond"].as_f64().unwrap() <= 1e-3, "{costs}");
        let effects = costs["effects"].as_array().unwrap();
        assert_eq!(effects.len(), scene["effects"].as_array().unwrap().len(), "each effect that runs is measured");
        for time in effects.iter().map(|effect| &effect["time"]).chain([&costs["frame"], &costs["all"]]) {
            let [low, high] = [0, 1].map(|end| time["interval"][end].as_f64().unwrap());
            assert!(0.0 <= low && low <= high && time["secs"].is_null() == (low <= 0.0), "{time}");
            assert!(time["secs"].as_f64().is_none_or(|secs| low <= secs && secs <= high), "{time}");
        }
    }
    let none = simulate("none", &["--effects", "none"]);
    assert!(none.contains("0/2") && !none.contains("    soft shadows"), "{none}");
}

/// A route's own lens is ignored in every layout. Of the yards, the second and the fourth need a lens.
#[test]
fn a_layout_without_lenses_leaves_lens_distortion_out_or_rejects_it() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_trajectory(&here.join("route.txt"), 3);
    let route = std::fs::read_to_string(here.join("route.txt")).unwrap();
    std::fs::write(here.join("repeated.txt"), route.replace("66734 ", "33367 ")).unwrap();
    std::fs::write(here.join("bent.txt"), route.replace(" 0.5 0.5 0 0 ", " 0.5 0.5 0.1 0 ")).unwrap();
    let simulate = |out: &str, layout: &str, more: &[&str]| {
        let plain = ["data", "simulate", out, "--size", "24x16", "--samples", "1", "--layout", layout];
        atsplat(here, &[&plain[..], more].concat())
    };
    for (route, warning) in [("repeated", "duplicate-timestamp"), ("bent", "lens-distortion")] {
        let data = format!("{route}.txt");
        let outcome = simulate(route, "chunks", &["--effects", "none", "--scenes", "3..4", "--route", &data]);
        outcome.says(0, warning);
        assert!(!outcome.stderr.contains("note: lens distortion"), "{route}: {}", outcome.stderr);
    }
    let yards = ["--kind", "yards", "--frames", "2", "--scenes", "4"];
    let told =
        "note: lens distortion is left out in 2 of 4 scenes: --layout chunks stores none, --layout nerfstudio does\n";
    for (layout, absent) in [("chunks", 2), ("nerfstudio", 0)] {
        let outcome = simulate(layout, layout, &yards);
        assert_eq!((outcome.code, outcome.stderr.contains(told)), (0, absent > 0), "{}", outcome.stderr);
        let line = "  lens distortion: left out: this layout stores no lens\n";
        assert_eq!(outcome.stdout.matches(line).count(), absent, "{}", outcome.stdout);
        let inspected = succeed(here, &["data", "inspect", if absent > 0 { "chunks/test" } else { layout }]);
        let lenses = if absent > 0 { "lenses    8 pinhole\n" } else { "lenses    4 pinhole, 4 OpenCV\n" };
        assert!(inspected.contains(lenses), "{inspected}");
    }
    for effects in ["all", "motion-blur,lens-distortion"] {
        let said = format!(
            "--effects {effects}: lens-distortion requires a layout that stores it: --layout nerfstudio (found --layout re10k)"
        );
        simulate("bent-re10k", "re10k", &["--effects", effects]).says(2, &said);
    }
    assert!(!here.join("bent-re10k").exists(), "usage errors create no folder");
}

/// The strength of an effect is drawn for each scene and may be 0.
#[test]
fn requested_effects_that_scenes_have_none_of_are_counted() {
    let folder = tempfile::tempdir().unwrap();
    let plain =
        ["data", "simulate", "out", "--size", "24x16", "--samples", "1", "--frames", "2", "--scenes", "12", "--json"];
    let outcome = atsplat(folder.path(), &[&plain[..], &["--effects", "sensor-noise,specular-reflection"]].concat());
    assert_eq!(outcome.code, 0, "{}", outcome.stderr);
    let report = json_of(&outcome.stdout);
    let scenes = report["scenes"].as_array().unwrap();
    let of = |list: &str, effect: &str| {
        let has = |scene: &&serde_json::Value| {
            scene[list].as_array().is_some_and(|effects| effects.iter().any(|found| found["effect"] == effect))
        };
        scenes.iter().filter(has).count()
    };
    let (noisy, without) = (of("effects", "sensor-noise"), of("absent_effects", "sensor-noise"));
    assert!(noisy > 0 && without > 0 && noisy + without == 12, "{noisy} noisy scenes, {without} without");
    let warning = format!("warning: --effects sensor-noise: {without} of 12 scenes have none that can be seen\n");
    assert!(outcome.stderr.contains(&warning), "{}", outcome.stderr);
    assert!(!outcome.stderr.contains("specular"), "every room has glossy surfaces: {}", outcome.stderr);
}

#[test]
fn a_route_of_several_scenes_is_chosen_by_its_own_option() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    std::fs::create_dir(here.join("routes")).unwrap();
    write_trajectory(&here.join("routes/a.txt"), 3);
    write_trajectory(&here.join("routes/b.txt"), 2);
    let args = ["data", "simulate", "out", "--scenes", "1", "--size", "24x16", "--samples", "1", "--route", "routes"];
    atsplat(here, &args).says(1, "routes contains 2 scenes (a, b …): choose one with --route-key\n");
    atsplat(here, &[&args[..], &["--route-key", "b"]].concat()).prints(0, "1 scene, 2 frames");
}

#[test]
fn simulated_cameras_follow_a_given_route() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_trajectory(&here.join("route.txt"), 5);
    let args = ["data", "simulate", "out", "--scenes", "3..4", "--route", "route.txt", "--size", "24x16", "--depth"];
    let message = succeed(here, &args);
    assert!(message.starts_with("rooms-test-00000003: ") && message.contains("1 scene, 5 frames"), "{message}");
    assert_eq!(here.join("out/depth/rooms-test-00000003").read_dir().unwrap().count(), 5);
}
