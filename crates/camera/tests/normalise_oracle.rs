//! Pose normalisations compared with the papers' formulas in extended precision (`fixtures/make_fixtures.py normalise`).

#![expect(clippy::expect_used, clippy::panic, reason = "a test fails by panicking")]

use std::collections::BTreeMap;

use atsplat_camera::{MeanCameraScale, PoseNormalisation, WorldFromCamera, normalise};
use atsplat_numeric::{Extremes, Tolerance};
use serde::Deserialize;

#[derive(Deserialize)]
struct Normalisations {
    cases: Vec<Case>,
}

#[derive(Deserialize)]
struct Case {
    name: String,
    context: Vec<[f64; 12]>,
    targets: Vec<[f64; 12]>,
    expected: BTreeMap<String, Expected>,
}

#[derive(Deserialize)]
struct Expected {
    context: Vec<[f64; 12]>,
    targets: Vec<[f64; 12]>,
    factor: f64,
}

fn rule(name: &str) -> PoseNormalisation {
    match name {
        "baseline-one" => PoseNormalisation::pixelsplat(),
        "first-view-relative" => PoseNormalisation::FirstViewRelative,
        "noposplat" => PoseNormalisation::noposplat(),
        "max-pairwise" => PoseNormalisation::MaxPairwise { minimum: 1e-3, maximum: None },
        "mean-camera none" => PoseNormalisation::mean_camera(MeanCameraScale::None),
        "mean-camera long-lrm" => PoseNormalisation::mean_camera(MeanCameraScale::LongLrm),
        "mean-camera ilrm-main" => PoseNormalisation::mean_camera(MeanCameraScale::IlrmMain),
        "mean-camera lvsm" => PoseNormalisation::mean_camera(MeanCameraScale::Lvsm),
        other => panic!("the fixture contains an unknown rule: {other}"),
    }
}

fn poses(rows: &[[f64; 12]]) -> Vec<WorldFromCamera> {
    rows.iter().map(|rows| WorldFromCamera::from_rows(rows).expect("fixture poses are rigid")).collect()
}

/// `ATSPLAT_NORMALISE_FIXTURE` is the path of another output of the script, for example from real trajectories.
fn fixture() -> String {
    match std::env::var("ATSPLAT_NORMALISE_FIXTURE") {
        Ok(path) => std::fs::read_to_string(path).expect("the named fixture is readable"),
        Err(_) => include_str!("fixtures/normalise.json").to_owned(),
    }
}

#[test]
fn rules_match_the_published_formulas() {
    let fixture: Normalisations = serde_json::from_str(&fixture()).expect("the fixture is JSON of this shape");
    let mut compared = 0;
    for case in fixture.cases {
        let (context, targets) = (poses(&case.context), poses(&case.targets));
        for (name, expected) in &case.expected {
            let what = format!("{}, {name}", case.name);
            let found = normalise(&context, &targets, &rule(name)).expect(&what);
            assert!(found.fallbacks.is_empty(), "{what}: {:?}", found.fallbacks);
            let offset = context.iter().fold(0.0f64, |far, pose| far.maximum_of(pose.centre().length()));
            let slack = Tolerance { absolute: 1e-12 * (1.0f64).maximum_of(offset * expected.factor), relative: 0.0 };
            for (found, expected) in [(&found.context, &expected.context), (&found.targets, &expected.targets)] {
                let found = found.iter().flat_map(WorldFromCamera::to_rows);
                slack.assert(found, expected.iter().flatten().copied(), &what);
                compared += 1;
            }
            Tolerance::relative(1e-12).assert([found.new_from_old.scale], [expected.factor], &what);
        }
    }
    assert!(compared >= 6 * 8 * 2, "the fixture has fewer cases than the committed one: {compared}");
}
