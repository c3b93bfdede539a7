use atsplat_camera::{CropRect, NormalizedIntrinsics};
use atsplat_numeric::Tolerance;
use atsplat_pixels::ImageU8;
use glam::DVec2;
use proptest::prelude::*;

use super::*;

const fn size(height: u32, width: u32) -> ImageSize {
    ImageSize { width, height }
}

fn intrinsics() -> NormalizedIntrinsics {
    NormalizedIntrinsics::new(0.482_334_223, 0.857_483_091, 0.503, 0.491).unwrap()
}

/// Asserts that the focal lengths are scaled by these factors and the principal point is unchanged, as in the papers.
fn assert_scaled(k: NormalizedIntrinsics, focal: DVec2, context: &str) {
    let before = intrinsics();
    let expected = [before.fx * focal.x, before.fy * focal.y, before.cx, before.cy];
    Tolerance::EXACT.assert([k.fx, k.fy, k.cx, k.cy], expected, context);
}

/// The resampled size, if any, and the first row and column of the crop.
fn geometry(plan: &Plan) -> (Option<ImageSize>, (u32, u32)) {
    let mut outcome = (None, (0, 0));
    for operation in plan.operations() {
        match operation {
            Operation::Resize { size, .. } => outcome.0 = Some(*size),
            Operation::Crop(crop) => outcome.1 = (crop.row, crop.column),
        }
    }
    outcome
}

/// One result of `crop_shim.py`.
struct RescaleCase {
    source: ImageSize,
    target: ImageSize,
    scaled: Option<ImageSize>,
    row_column: (u32, u32),
}

#[test]
fn rescale_and_crop_matches_the_papers_shim() {
    let case = |source, target, scaled, row_column| RescaleCase { source, target, scaled, row_column };
    let cases = [
        case(size(360, 640), size(256, 256), Some(size(256, 455)), (0, 99)),
        case(size(270, 480), size(256, 256), Some(size(256, 455)), (0, 99)),
        case(size(270, 480), size(224, 224), Some(size(224, 398)), (0, 87)),
        case(size(540, 960), size(512, 960), None, (14, 0)),
        case(size(720, 1280), size(512, 960), Some(size(540, 960)), (14, 0)),
        case(size(540, 960), size(448, 768), Some(size(448, 796)), (0, 14)),
        case(size(270, 480), size(256, 448), Some(size(256, 455)), (0, 3)),
        case(size(256, 256), size(256, 256), None, (0, 0)),
    ];
    for RescaleCase { source, target, scaled, row_column } in cases {
        let plan = Preprocessing::of([RescaleAndCrop::new(target.height, target.width).into()]).plan(source).unwrap();
        assert_eq!(plan.output(), target, "{source} to {target}");
        assert_eq!(geometry(&plan), (scaled, row_column), "{source} to {target}");

        let (k, before) = (plan.intrinsics(&intrinsics()).unwrap(), scaled.unwrap_or(source));
        let ratio = |before: u32, after: u32| f64::from(before) / f64::from(after);
        let focal = DVec2::new(ratio(before.width, target.width), ratio(before.height, target.height));
        assert_scaled(k, focal, &format!("{source} to {target}"));
    }
}

#[test]
fn halves_round_to_even_as_in_python() {
    // s = 1/2: 5 · ½ = 2.5 becomes 2 and 7 · ½ = 3.5 becomes 4.
    for (height, scaled) in [(5, 2), (7, 4)] {
        let plan = Preprocessing::of([RescaleAndCrop::new(1, 2).into()]).plan(size(height, 4)).unwrap();
        assert_eq!(geometry(&plan).0, Some(size(scaled, 2)), "{height} rows");
    }
}

#[test]
fn rescale_and_crop_never_enlarges() {
    for (height, width) in [(361, 256), (256, 641), (1000, 1000)] {
        let outcome = Preprocessing::of([RescaleAndCrop::new(height, width).into()]).plan(size(360, 640));
        assert!(matches!(outcome, Err(PreprocessError::TooSmall { .. })), "{height}×{width}: {outcome:?}");
    }
}

#[test]
fn depthsplat_crops_270_by_480_to_256_by_448_without_resampling() {
    let plan = Preprocessing::of([PatchCrop::new(64).into()]).plan(size(270, 480)).unwrap();
    let crop = CropRect { column: 16, row: 7, size: size(256, 448) };
    assert_eq!(plan.operations(), [Operation::Crop(crop)]);
    let k = plan.intrinsics(&intrinsics()).unwrap();
    assert_scaled(k, DVec2::new(480.0 / 448.0, 270.0 / 256.0), "crop");
}

#[test]
fn patch_crop_keeps_whole_patches() {
    let plan = Preprocessing::of([RescaleAndCrop::new(256, 256).into(), PatchCrop::new(64).into()]);
    let re10k = Preprocessing::of([RescaleAndCrop::new(256, 256).into()]);
    assert_eq!(plan.plan(size(360, 640)).unwrap(), re10k.plan(size(360, 640)).unwrap());
}

#[test]
fn patch_crop_rejects_what_depthsplat_asserts_against() {
    let strict = Preprocessing::of([PatchCrop::new(64).into()]);
    assert!(matches!(strict.plan(size(135, 240)), Err(PreprocessError::OddSize { .. })), "odd height");
    assert!(matches!(strict.plan(size(62, 240)), Err(PreprocessError::TooSmall { .. })), "less than one patch");
    let zero = Preprocessing::of([PatchCrop::new(0).into()]);
    assert!(matches!(zero.plan(size(270, 480)), Err(PreprocessError::Empty { .. })), "multiples of nothing");
    let lenient = Preprocessing::of([PatchCrop { multiple: 64, allow_odd_size: true }.into()]);
    assert_eq!(lenient.plan(size(135, 240)).unwrap().output(), size(128, 192));
}

#[test]
fn tokengs_preprocesses_dl3dv_with_a_crop_and_a_resize() {
    let tokengs = Preprocessing::of([
        CentreCrop::new(540, 944).into(),
        Resize { height: 256, width: 448, filter: Resampling::Bilinear }.into(),
    ]);
    let plan = tokengs.plan(size(540, 960)).unwrap();
    assert_eq!((plan.output(), geometry(&plan)), (size(256, 448), (Some(size(256, 448)), (0, 8))));
    let depthsplat = Preprocessing::of([PatchCrop::new(64).into()]).plan(size(270, 480)).unwrap();
    let fx = |plan: &Plan| plan.intrinsics(&intrinsics()).unwrap().fx;
    assert!(fx(&plan) < fx(&depthsplat), "TokenGS has a wider field of view than DepthSplat");
}

#[test]
fn square_crop_crops_before_it_scales() {
    let plan = Preprocessing::of([SquareCrop::resized(224).into()]).plan(size(271, 480)).unwrap();
    let crop = CropRect { column: 104, row: 0, size: size(271, 271) };
    let resize = Operation::Resize { size: size(224, 224), filter: Resampling::Lanczos };
    assert_eq!(plan.operations(), [Operation::Crop(crop), resize]);
    assert_scaled(plan.intrinsics(&intrinsics()).unwrap(), DVec2::new(480.0 / 271.0, 1.0), "square");
    let plain = Preprocessing::of([SquareCrop::default().into()]).plan(size(480, 271)).unwrap();
    assert_eq!((plain.output(), geometry(&plain)), (size(271, 271), (None, (104, 0))));
}

#[test]
fn other_sizes_than_the_expected_one_are_errors() {
    let preprocessing =
        Preprocessing { expected_size: Some(size(270, 480)), ..Preprocessing::of([PatchCrop::new(64).into()]) };
    assert!(preprocessing.plan(size(270, 480)).is_ok());
    let error = preprocessing.plan(size(540, 960)).unwrap_err();
    assert_eq!(error.to_string(), "image size: the protocol expects 480×270, found 960×540");
}

#[test]
fn a_corrected_principal_point_stays_on_the_optical_axis() {
    let corrected = Preprocessing {
        principal_point: PrincipalPointRule::Corrected,
        ..Preprocessing::of([RescaleAndCrop::new(256, 256).into()])
    };
    let k = corrected.plan(size(360, 640)).unwrap().intrinsics(&intrinsics()).unwrap();
    Tolerance::F64.assert([k.cx, k.cy], [(0.503 * 455.0 - 99.0) / 256.0, 0.491], "principal point");
}

#[test]
fn empty_and_enormous_images_are_errors() {
    let outcome = Preprocessing::default().plan(size(0, 640));
    assert!(matches!(outcome, Err(PreprocessError::Empty { .. })), "{outcome:?}");
    for step in [RescaleAndCrop::new(0, 256).into(), CentreCrop::new(256, 0).into(), SquareCrop::resized(0).into()] {
        let outcome = Preprocessing::of([step]).plan(size(360, 640));
        assert!(matches!(outcome, Err(PreprocessError::Empty { .. })), "{step:?}: {outcome:?}");
    }
    for step in [Resize::new(u32::MAX, u32::MAX).into(), SquareCrop::resized(u32::MAX).into()] {
        let outcome = Preprocessing::of([step]).plan(size(360, 640));
        assert!(matches!(outcome, Err(PreprocessError::TooLarge { .. })), "{step:?}: {outcome:?}");
    }
}

#[test]
fn a_plan_rejects_images_of_another_size() {
    let plan = Preprocessing::of([CentreCrop::new(2, 2).into()]).plan(size(4, 4)).unwrap();
    let image = ImageU8::new(5, 4, vec![0; 60]).unwrap();
    assert!(matches!(plan.apply(&image), Err(PreprocessError::WrongImage { .. })));
}

#[test]
fn a_crop_keeps_the_expected_pixels() {
    let samples: Vec<u8> = (0..6 * 8 * 3).map(|i| u8::try_from(i % 251).unwrap()).collect();
    let image = ImageU8::new(8, 6, samples).unwrap();
    let plan = Preprocessing::of([PatchCrop::new(4).into()]).plan(size(6, 8)).unwrap();
    let crop = plan.apply(&image).unwrap();
    assert_eq!((crop.width(), crop.height()), (8, 4));
    assert_eq!(crop.pixel(3, 0), image.pixel(3, 1));
    assert_eq!(crop.pixel(7, 3), image.pixel(7, 4));
}

#[test]
fn presets_round_trip_and_unknown_fields_are_errors() {
    let text = r#"{"expected-size":{"width":480,"height":270},"principal-point":"corrected","steps":[
        {"step":"rescale-and-crop","height":256,"width":256},
        {"step":"resize","height":8,"width":9,"filter":"box"},
        {"step":"patch-crop","multiple":64}]}"#;
    let read: Preprocessing = serde_json::from_str(text).unwrap();
    let expected = Preprocessing {
        expected_size: Some(size(270, 480)),
        principal_point: PrincipalPointRule::Corrected,
        steps: vec![
            RescaleAndCrop::new(256, 256).into(),
            Resize { height: 8, width: 9, filter: Resampling::Box }.into(),
            PatchCrop::new(64).into(),
        ],
    };
    assert_eq!(read, expected);
    let again: Preprocessing = serde_json::from_str(&serde_json::to_string(&read).unwrap()).unwrap();
    assert_eq!(again, read);
    for wrong in [
        r#"{"steps":[{"step":"rescale-and-crop","height":256,"widht":256}]}"#,
        r#"{"steps":[{"step":"rescale-and-crop","height":256}]}"#,
        r#"{"steps":[{"step":"patch-crop","multiple":64,"filter":"box"}]}"#,
        r#"{"steps":[{"step":"center-crop","height":2,"width":2}]}"#,
        r#"{"step":[]}"#,
    ] {
        assert!(serde_json::from_str::<Preprocessing>(wrong).is_err(), "{wrong}");
    }
}

#[test]
fn display_is_one_line_with_all_parameters() {
    let preprocessing = Preprocessing {
        expected_size: Some(size(270, 480)),
        ..Preprocessing::of([RescaleAndCrop::new(224, 224).into(), PatchCrop::new(16).into()])
    };
    assert_eq!(
        preprocessing.to_string(),
        "only 480×270: rescale-and-crop 224×224 (lanczos), then patch-crop to multiples of 16; principal point frozen"
    );
    assert_eq!(Preprocessing::default().to_string(), "as it is; principal point frozen");
}

prop_compose! {
    fn any_steps()(kinds in prop::collection::vec((0..5u8, 1..300u32, 1..300u32, any::<bool>()), 0..4)) -> Vec<Step> {
        kinds.into_iter().map(|(kind, a, b, flag)| match kind {
            0 => RescaleAndCrop::new(a, b).into(),
            1 => PatchCrop { multiple: a % 40, allow_odd_size: flag }.into(),
            2 => CentreCrop::new(a, b).into(),
            3 => SquareCrop { size: flag.then_some(a), filter: Resampling::Box }.into(),
            _ => Resize::new(a, b).into(),
        }).collect()
    }
}

proptest! {
    #[test]
    fn operations_are_valid_for_their_input(steps in any_steps(), height in 0..400u32, width in 0..400u32) {
        let Ok(plan) = Preprocessing::of(steps).plan(size(height, width)) else { return Ok(()) };
        let mut reached = plan.source();
        for operation in plan.operations() {
            reached = match operation {
                Operation::Resize { size, .. } => *size,
                Operation::Crop(crop) => {
                    prop_assert!(crop.column + crop.size.width <= reached.width);
                    prop_assert!(crop.row + crop.size.height <= reached.height);
                    crop.size
                }
            };
        }
        prop_assert_eq!(reached, plan.output());
        prop_assert!(reached.width > 0 && reached.height > 0);
    }

    #[test]
    fn rescale_and_crop_reaches_its_target_from_any_larger_size(
        height in 1..3000u32, width in 1..3000u32, rows in 0..4000u32, columns in 0..4000u32,
    ) {
        let source = size(height + rows, width + columns);
        let plan = Preprocessing::of([RescaleAndCrop::new(height, width).into()]).plan(source).unwrap();
        prop_assert_eq!(plan.output(), size(height, width));
        let scaled = geometry(&plan).0.unwrap_or(source);
        prop_assert!(scaled.height == height || scaled.width == width, "the shim asserts that one side matches");
    }

    /// Maps one point through the operations in pixels, and projects it with the new K.
    #[test]
    fn corrected_intrinsics_follow_the_pixels(
        steps in any_steps(), height in 300..400u32, width in 300..400u32, x in -1.0..1.0f64, y in -1.0..1.0f64,
    ) {
        let preprocessing =
            Preprocessing { principal_point: PrincipalPointRule::Corrected, ..Preprocessing::of(steps) };
        let Ok(plan) = preprocessing.plan(size(height, width)) else { return Ok(()) };
        let project = |k: &NormalizedIntrinsics, size: ImageSize| {
            let k = k.pixel_from_normalized(size);
            [k.fx * x + k.cx, k.fy * y + k.cy]
        };
        let mut point = project(&intrinsics(), plan.source());
        let mut reached = plan.source();
        for operation in plan.operations() {
            match operation {
                Operation::Resize { size, .. } => {
                    point[0] *= f64::from(size.width) / f64::from(reached.width);
                    point[1] *= f64::from(size.height) / f64::from(reached.height);
                    reached = *size;
                }
                Operation::Crop(crop) => {
                    point[0] -= f64::from(crop.column);
                    point[1] -= f64::from(crop.row);
                    reached = crop.size;
                }
            }
        }
        let found = project(&plan.intrinsics(&intrinsics()).unwrap(), plan.output());
        let tolerance = Tolerance { absolute: 1e-9, relative: 1e-12 };
        prop_assert!(tolerance.check(found, point).is_ok(), "{found:?} against {point:?}");
    }
}
