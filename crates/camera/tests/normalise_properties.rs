//! Properties of pose normalisations for ordinary, degenerate and extreme views.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::f64::consts::{PI, TAU};

use atsplat_camera::{
    CameraError, CameraFromWorld, Fallback, MeanCameraScale, PoseNormalisation, WorldFromCamera, normalise,
};
use atsplat_numeric::{Extremes, Tolerance};
use glam::{DMat3, DVec3, EulerRot};
use proptest::prelude::*;

const MEAN_SCALES: [MeanCameraScale; 4] =
    [MeanCameraScale::LongLrm, MeanCameraScale::IlrmMain, MeanCameraScale::Lvsm, MeanCameraScale::None];

fn pose(rotation: DMat3, centre: DVec3) -> WorldFromCamera {
    WorldFromCamera::new(rotation, centre).unwrap()
}

fn turn(y: f64, x: f64, z: f64) -> DMat3 {
    DMat3::from_euler(EulerRot::YXZ, y, x, z)
}

fn mean_camera(scale: MeanCameraScale) -> PoseNormalisation {
    PoseNormalisation::mean_camera(scale)
}

/// The rules that are invariant to rigid motions of the world.
fn invariant_rules() -> Vec<PoseNormalisation> {
    vec![
        PoseNormalisation::FirstViewRelative,
        PoseNormalisation::noposplat(),
        PoseNormalisation::yonosplat(),
        mean_camera(MeanCameraScale::LongLrm),
        mean_camera(MeanCameraScale::Lvsm),
        mean_camera(MeanCameraScale::None),
        PoseNormalisation::Sequence {
            steps: vec![PoseNormalisation::pixelsplat(), mean_camera(MeanCameraScale::None)],
        },
    ]
}

fn any_turn() -> impl Strategy<Value = DMat3> {
    (-PI..PI, -1.5..1.5, -PI..PI).prop_map(|(y, x, z)| turn(y, x, z))
}

fn any_centre(size: f64) -> impl Strategy<Value = DVec3> {
    prop::array::uniform3(-size..size).prop_map(DVec3::from_array)
}

fn any_view() -> impl Strategy<Value = WorldFromCamera> {
    (any_turn(), any_centre(2.0)).prop_map(|(rotation, centre)| pose(rotation, centre))
}

/// Pairs of views whose mean forward or down axis is just above the threshold: almost opposite, or almost upside down.
fn nearly_cancelling_views() -> impl Strategy<Value = Vec<WorldFromCamera>> {
    (any_turn(), 0.022..0.2f64, any::<bool>(), any_centre(1.0), any_centre(1.0), -0.02..0.02f64).prop_map(
        |(base, short_of_opposite, roll, a, b, tilt)| {
            let half = 0.5 * (PI - short_of_opposite);
            let about = |angle: f64| if roll { turn(0.0, 0.0, angle) } else { turn(angle, 0.0, 0.0) };
            vec![pose(base * about(half), a), pose(base * about(-half) * turn(0.0, tilt, 0.0), b)]
        },
    )
}

/// Views that trigger every fallback, in a scene of size one.
fn cancelling_views() -> impl Strategy<Value = Vec<WorldFromCamera>> {
    let kinds = 0usize..4;
    (any_turn(), kinds, any_centre(1.0), any_centre(1.0)).prop_map(|(base, kind, a, b)| {
        let second = [turn(PI, 0.0, 0.0), turn(0.0, 0.0, PI), turn(0.0, PI, 0.0), DMat3::IDENTITY][kind];
        let centre = if kind == 3 { a } else { b };
        vec![pose(base, a), pose(base * second, centre)]
    })
}

fn largest(poses: &[WorldFromCamera]) -> f64 {
    poses.iter().fold(1.0f64, |far, pose| far.maximum_of(pose.centre().abs().max_element()))
}

fn rows(poses: &[WorldFromCamera]) -> Vec<f64> {
    poses.iter().flat_map(WorldFromCamera::to_rows).collect()
}

/// Asserts that normalising before and after a motion of the world agrees within 1e-12 of the larger of the normalised
/// scene and the old world in its units.
fn assert_invariant(
    context: &[WorldFromCamera],
    targets: &[WorldFromCamera],
    motion: &WorldFromCamera,
    rule: &PoseNormalisation,
) -> Result<(), TestCaseError> {
    let moved = |poses: &[WorldFromCamera]| poses.iter().map(|pose| pose.moved_by(motion)).collect::<Vec<_>>();
    let (moved_context, moved_targets) = (moved(context), moved(targets));
    let here = match normalise(context, targets, rule) {
        Ok(here) => here,
        Err(error) => {
            let there = normalise(&moved_context, &moved_targets, rule);
            prop_assert!(there.is_err(), "{}: only one of the two is an error: {error}", rule.name());
            return Ok(());
        }
    };
    let there = normalise(&moved_context, &moved_targets, rule).unwrap();
    prop_assert_eq!(&here.fallbacks, &there.fallbacks, "{}", rule.name());
    let old_world = here.new_from_old.scale * largest(&moved_context).maximum_of(largest(context));
    let size = largest(&here.context).maximum_of(largest(&here.targets)).maximum_of(old_world);
    let slack = Tolerance::absolute(1e-12 * size);
    for (here, there) in [(&here.context, &there.context), (&here.targets, &there.targets)] {
        let check = slack.check(rows(there), rows(here));
        prop_assert!(check.is_ok(), "{}: {} (size {size})", rule.name(), check.unwrap_err());
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(512))]

    #[test]
    fn normalisation_is_invariant_to_rigid_motions(
        context in prop::collection::vec(any_view(), 1..7), targets in prop::collection::vec(any_view(), 0..3),
        rotation in any_turn(), offset in any_centre(50.0),
    ) {
        for rule in invariant_rules() {
            assert_invariant(&context, &targets, &pose(rotation, offset), &rule)?;
        }
    }

    #[test]
    fn nearly_cancelling_axes_are_stable(
        context in nearly_cancelling_views(), rotation in any_turn(), offset in any_centre(2.0),
    ) {
        for rule in invariant_rules() {
            assert_invariant(&context, &[], &pose(rotation, offset), &rule)?;
        }
    }

    #[test]
    fn fallbacks_are_invariant_to_rigid_motions(
        context in cancelling_views(), target in any_view(), rotation in any_turn(), offset in any_centre(2.0),
    ) {
        for rule in invariant_rules() {
            assert_invariant(&context, &[target], &pose(rotation, offset), &rule)?;
        }
    }

    #[test]
    fn the_mean_camera_is_always_a_rotation(
        ordinary in prop::collection::vec(any_view(), 1..7), opposed in nearly_cancelling_views(),
        cancelled in cancelling_views(),
    ) {
        for views in [ordinary, opposed, cancelled] {
            for scale in MEAN_SCALES {
                let found = normalise(&views, &[], &mean_camera(scale)).unwrap();
                let r = found.new_from_old.rotation;
                let product = (r * r.transpose()).to_cols_array();
                prop_assert!(Tolerance::ORTHONORMAL.check(product, DMat3::IDENTITY.to_cols_array()).is_ok(), "{r}");
                prop_assert!(Tolerance::ORTHONORMAL.accepts(r.determinant(), 1.0));
                for view in &found.context {
                    prop_assert!(view.orthonormality_residual() <= Tolerance::ORTHONORMAL.absolute);
                }
            }
        }
    }

    #[test]
    fn normalisation_is_idempotent(context in prop::collection::vec(any_view(), 2..6)) {
        let rules = [PoseNormalisation::noposplat(), mean_camera(MeanCameraScale::LongLrm)];
        for rule in rules {
            let Ok(once) = normalise(&context, &[], &rule) else { continue };
            prop_assume!(once.fallbacks.is_empty());
            let twice = normalise(&once.context, &[], &rule).unwrap();
            let slack = Tolerance::absolute(1e-10);
            prop_assert!(slack.check(rows(&twice.context), rows(&once.context)).is_ok(), "{}", rule.name());
            prop_assert!(slack.accepts(twice.new_from_old.scale, 1.0));
        }
    }

    #[test]
    fn normalised_scale_is_invariant_to_scaling_the_world(
        context in prop::collection::vec(any_view(), 2..6), factor in 0.01..100.0f64,
    ) {
        let scaled: Vec<_> = context.iter().map(|view| view.scaled_by(factor).unwrap()).collect();
        let scales = [MeanCameraScale::LongLrm, MeanCameraScale::IlrmMain, MeanCameraScale::Lvsm];
        for rule in scales.map(mean_camera) {
            let (here, there) = (normalise(&context, &[], &rule).unwrap(), normalise(&scaled, &[], &rule).unwrap());
            let slack = Tolerance::absolute(1e-11 * largest(&here.context) * here.new_from_old.scale.maximum_of(1.0));
            prop_assert!(slack.check(rows(&there.context), rows(&here.context)).is_ok(), "{}", rule.name());
            let product = there.new_from_old.scale * factor / here.new_from_old.scale;
            prop_assert!(Tolerance::absolute(1e-9).accepts(product, 1.0));
        }
    }

    #[test]
    fn the_reported_transform_is_the_one_applied(
        context in prop::collection::vec(any_view(), 2..6), target in any_view(), point in any_centre(3.0),
    ) {
        for rule in invariant_rules() {
            let Ok(found) = normalise(&context, &[target], &rule) else { continue };
            let change = found.new_from_old;
            let slack = Tolerance::absolute(1e-9 * change.scale.maximum_of(1.0));
            let moved = change.new_pose_from_old(&target).unwrap();
            prop_assert!(slack.check(moved.to_rows(), found.targets[0].to_rows()).is_ok());
            // A point has the same direction in both cameras, at a distance multiplied by `scale`.
            let old = target.inverse().transform_point(point) * change.scale;
            let new = moved.inverse().transform_point(change.new_from_old(point));
            prop_assert!(slack.check(new.to_array(), old.to_array()).is_ok());
            let back = change.old_from_new(change.new_from_old(point));
            prop_assert!(Tolerance::absolute(1e-9).check(back.to_array(), point.to_array()).is_ok());
        }
    }

    #[test]
    fn nothing_panics_on_extreme_centres(
        centres in prop::collection::vec(prop::array::uniform3(prop::num::f64::NORMAL | prop::num::f64::ZERO | prop::num::f64::SUBNORMAL), 1..5),
    ) {
        let views: Vec<_> = centres.iter().map(|centre| pose(DMat3::IDENTITY, DVec3::from_array(*centre))).collect();
        for rule in invariant_rules().into_iter().chain([mean_camera(MeanCameraScale::IlrmMain)]) {
            if let Ok(found) = normalise(&views, &views, &rule) {
                prop_assert!(rows(&found.context).iter().all(|entry| entry.is_finite()), "{}", rule.name());
            }
        }
    }
}

fn mean(views: &[WorldFromCamera]) -> atsplat_camera::Normalised {
    normalise(views, &[], &mean_camera(MeanCameraScale::LongLrm)).unwrap()
}

#[test]
fn a_single_view_becomes_the_identity() {
    let view = pose(turn(0.3, -0.2, 1.0), DVec3::new(5.0, -3.0, 2.0));
    let found = mean(&[view]);
    assert_eq!(found.fallbacks, [Fallback::SingleView, Fallback::CoincidentCentres]);
    Tolerance::F64.assert(found.context[0].to_rows(), WorldFromCamera::IDENTITY.to_rows(), "identity");
    Tolerance::EXACT.assert([found.new_from_old.scale], [1.0], "scale unchanged");
}

#[test]
fn opposite_views_use_the_first_forward_axis() {
    let base = turn(0.7, 0.2, 0.1);
    let views = [pose(base, DVec3::ZERO), pose(base * turn(PI, 0.0, 0.0), DVec3::X)];
    let found = mean(&views);
    assert_eq!(found.fallbacks, [Fallback::ForwardsCancel], "their down axes agree");
    Tolerance::F64.assert(found.context[0].forward().to_array(), [0.0, 0.0, 1.0], "the first view looks forward");
    Tolerance::F64.assert(found.context[0].down().to_array(), [0.0, 1.0, 0.0], "and is upright");
}

#[test]
fn a_panorama_stays_upright() {
    let views: Vec<_> = (0..8)
        .map(|i| {
            let rotation = turn(f64::from(i) * TAU / 8.0, 0.0, 0.0);
            pose(rotation, rotation * DVec3::Z)
        })
        .collect();
    let found = mean(&views);
    assert_eq!(found.fallbacks, [Fallback::ForwardsCancel]);
    for view in &found.context {
        Tolerance::F64.assert(view.down().to_array(), [0.0, 1.0, 0.0], "upright");
    }
}

#[test]
fn cancelling_down_axes_use_the_first_down_axis() {
    let views = [pose(DMat3::IDENTITY, DVec3::ZERO), pose(turn(0.0, 0.0, PI), DVec3::X)];
    let found = mean(&views);
    assert_eq!(found.fallbacks, [Fallback::DownsCancel]);
    Tolerance::F64.assert(found.context[0].down().to_array(), [0.0, 1.0, 0.0], "the first view is upright");
}

#[test]
fn the_right_axis_is_used_if_the_first_down_axis_is_forward() {
    // The forward axis of the others is the down axis of the first; their three down axes cancel.
    let first = pose(DMat3::from_cols(DVec3::X, DVec3::Z, -DVec3::Y), DVec3::ZERO);
    let up = pose(DMat3::from_cols(-DVec3::Y, DVec3::X, DVec3::Z), DVec3::X);
    let down = pose(DMat3::from_cols(DVec3::Y, -DVec3::X, DVec3::Z), DVec3::Y);
    let behind = pose(DMat3::from_cols(DVec3::X, -DVec3::Z, DVec3::Y), DVec3::Z);
    let found = mean(&[first, up, down, behind]);
    assert_eq!(found.fallbacks, [Fallback::DownsCancel, Fallback::FirstDownAlongForward]);
    Tolerance::F64.assert(found.context[0].right().to_array(), [1.0, 0.0, 0.0], "right axis unchanged");
}

/// A pose whose `[R | t]` is rounded as a file stores it.
fn stored(rotation: DMat3, centre: DVec3, rounded: fn(f64) -> f64) -> WorldFromCamera {
    let rows = pose(rotation, centre).inverse().to_rows().map(rounded);
    CameraFromWorld::from_rows(&rows).unwrap().inverse()
}

/// A clip that only pans, as RE10K's text and as a chunk.
#[test]
fn coincident_centres_keep_their_scale() {
    let centre = DVec3::new(3.0, 1.0, -2.0);
    let with_nine_decimals = |number: f64| (number * 1e9).round() / 1e9;
    #[expect(clippy::cast_possible_truncation, reason = "what a chunk stores")]
    let in_f32 = |number: f64| f64::from(number as f32);
    for rounded in [with_nine_decimals as fn(f64) -> f64, in_f32] {
        let views = [(0.1, 0.3), (-0.1, 0.2), (0.4, -0.2)].map(|(y, x)| stored(turn(y, x, 0.1), centre, rounded));
        for scale in [MeanCameraScale::LongLrm, MeanCameraScale::Lvsm] {
            let found = normalise(&views, &[], &mean_camera(scale)).unwrap();
            assert_eq!(found.fallbacks, [Fallback::CoincidentCentres]);
            Tolerance::EXACT.assert([found.new_from_old.scale], [1.0], "rounding of a file is not a baseline");
        }
        let quirk = normalise(&views, &[], &mean_camera(MeanCameraScale::IlrmMain)).unwrap();
        assert!(quirk.fallbacks.is_empty(), "iLRM divides by the distance from the old origin");
        Tolerance::relative(1e-6).assert([quirk.new_from_old.scale], [1.0 / 3.0], "largest coordinate");
    }
}

/// The published scale is kept wherever the poses state a baseline; a note says where it is small.
#[test]
fn a_small_rig_far_from_the_origin_has_its_published_scale() {
    let rig = |offset: DVec3| {
        let at = |turned: f64, x: f64| pose(turn(turned, 0.2, 0.0), DVec3::new(1e-2 * x, 2e-3 * x, 0.0) + offset);
        [at(0.1, 0.0), at(-0.1, 1.0), at(0.0, -0.7)]
    };
    let of = |offset: DVec3, scale| normalise(&rig(offset), &[], &mean_camera(scale)).unwrap();
    for scale in [MeanCameraScale::LongLrm, MeanCameraScale::Lvsm] {
        let (near, far) = (of(DVec3::ZERO, scale), of(DVec3::new(1e6, -3e5, 0.0), scale));
        assert_eq!((&near.fallbacks[..], &far.fallbacks[..]), (&[][..], &[Fallback::CloseCentres][..]));
        Tolerance::relative(1e-5).assert([far.new_from_old.scale], [near.new_from_old.scale], "of the rig");
    }
    assert!(of(DVec3::splat(1e6), MeanCameraScale::None).fallbacks.is_empty(), "nothing is divided");
}

#[test]
fn baselines_outside_the_range_are_errors() {
    let at = |x: f64| pose(DMat3::IDENTITY, DVec3::new(x, 0.0, 0.0));
    let error = normalise(&[at(0.0), at(5e-4)], &[], &PoseNormalisation::pixelsplat()).unwrap_err();
    assert!(matches!(error, CameraError::BaselineOutOfRange { rule: "baseline-one", .. }), "{error}");
    assert_eq!(error.to_string(), "baseline-one: expected a distance of at least 0.001, found 0.0005");
    let wide = PoseNormalisation::BaselineOne { minimum: 1e-3, maximum: Some(100.0) };
    let error = normalise(&[at(0.0), at(101.0)], &[], &wide).unwrap_err();
    assert_eq!(error.to_string(), "baseline-one: expected a distance between 0.001 and 100, found 101");
    let zero = PoseNormalisation::MaxPairwise { minimum: 0.0, maximum: None };
    assert!(normalise(&[at(1.0), at(1.0)], &[], &zero).is_err(), "nothing to divide by");
    assert!(normalise(&[at(1.0)], &[], &PoseNormalisation::pixelsplat()).is_err(), "one view has no baseline");
    assert!(matches!(normalise(&[], &[at(1.0)], &PoseNormalisation::None), Err(CameraError::TooFewPoses { .. })));
    let negative = PoseNormalisation::MeanCamera { scale: MeanCameraScale::None, scene_scale: -1.0 };
    assert!(normalise(&[at(1.0)], &[], &negative).is_err());
}

#[test]
fn near_and_far_scale_with_baselines_but_not_with_mean_cameras() {
    let at = |x: f64| pose(DMat3::IDENTITY, DVec3::new(x, 0.0, 0.0));
    let views = [at(0.0), at(1.0), at(4.0)];
    let multiplier = |rule: PoseNormalisation| normalise(&views, &[], &rule).unwrap().near_far_multiplier;
    let rules = [PoseNormalisation::None, PoseNormalisation::noposplat(), mean_camera(MeanCameraScale::LongLrm)];
    Tolerance::F64.assert(rules.map(multiplier), [1.0, 0.25, 1.0], "near and far");
}

/// Long-LRM `data/dataset.py:208-213`: translations are multiplied by `1 / (scene_scale * position_max)`.
#[test]
fn lengths_are_divided_by_the_scale_of_the_scene() {
    let at = |x: f64| pose(DMat3::IDENTITY, DVec3::new(x, 0.0, 0.0));
    let across = |scale, scene_scale: f64| {
        let rule = PoseNormalisation::MeanCamera { scale, scene_scale };
        let found = normalise(&[at(-2.0), at(2.0)], &[at(1.0)], &rule).unwrap();
        [found.context[0].centre().x, found.context[1].centre().x, found.targets[0].centre().x]
    };
    Tolerance::F64.assert(across(MeanCameraScale::LongLrm, 2.0), [-0.5, 0.5, 0.25], "twice Long-LRM's length");
    Tolerance::F64.assert(across(MeanCameraScale::LongLrm, 0.5), [-2.0, 2.0, 1.0], "half of it");
    Tolerance::F64.assert(across(MeanCameraScale::None, 4.0), [-0.5, 0.5, 0.25], "lengths of the dataset");
}

/// Weights record the name of the rule that they were trained with.
#[test]
fn another_scale_of_the_scene_is_another_name() {
    let of = |scene_scale| PoseNormalisation::MeanCamera { scale: MeanCameraScale::LongLrm, scene_scale }.name();
    assert_eq!([of(1.0), of(1.35)], ["mean-camera (long-lrm)", "mean-camera (long-lrm, lengths / 1.35)"]);
}

#[test]
fn rules_are_parsed_by_kebab_case_names() {
    let parse = |text: &str| serde_json::from_str::<PoseNormalisation>(text);
    assert_eq!(parse(r#"{"rule": "none"}"#).unwrap(), PoseNormalisation::None);
    assert_eq!(parse(r#"{"rule": "baseline-one"}"#).unwrap(), PoseNormalisation::pixelsplat());
    assert_eq!(parse(r#"{"rule": "mean-camera"}"#).unwrap(), mean_camera(MeanCameraScale::LongLrm));
    assert_eq!(
        parse(r#"{"rule": "mean-camera", "scale": "ilrm-main"}"#).unwrap(),
        mean_camera(MeanCameraScale::IlrmMain)
    );
    let sequence =
        r#"{"rule":"sequence","steps":[{"rule":"baseline-one","maximum":1e10},{"rule":"first-view-relative"}]}"#;
    assert_eq!(parse(sequence).unwrap(), PoseNormalisation::noposplat());
    assert_eq!(PoseNormalisation::noposplat().name(), "baseline-one, then first-view-relative");
    assert!(parse(r#"{"rule": "mean-camera", "scael": "lvsm"}"#).is_err(), "a misspelt parameter is an error");
    for rule in ["none", "first-view-relative"] {
        let error = parse(&format!(r#"{{"rule": "{rule}", "minimum": 0.5}}"#)).unwrap_err().to_string();
        assert!(error.contains("unknown field `minimum`"), "{rule}: {error}");
    }
    for rule in invariant_rules() {
        let text = serde_json::to_string(&rule).unwrap();
        assert_eq!(parse(&text).unwrap(), rule, "{text}");
    }
}
