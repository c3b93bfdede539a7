//! Preprocessing compared with the papers' code and Pillow (`fixtures/make_preprocess_golden.py`).

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::Path;

use atsplat_camera::{ImageSize, NormalizedIntrinsics, PrincipalPointRule};
use atsplat_files::Sha256Digest;
use atsplat_numeric::{SPLIT_MIX_STEP, Tolerance, split_mix};
use atsplat_pixels::ImageU8;
use atsplat_scene::preprocess::{Preprocessing, Step};
use serde::Deserialize;

#[derive(Deserialize)]
struct Golden {
    intrinsics: NormalizedIntrinsics,
    cases: Vec<Case>,
}

#[derive(Deserialize)]
struct Case {
    seed: u64,
    source: ImageSize,
    steps: Vec<Step>,
    size: ImageSize,
    sha256: Sha256Digest,
    frozen: NormalizedIntrinsics,
    corrected: NormalizedIntrinsics,
}

#[test]
fn images_and_intrinsics_match_the_papers_code() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/preprocess_golden.json");
    let golden: Golden = serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap();
    assert!(golden.cases.len() > 100, "the fixture has only {} cases", golden.cases.len());
    for case in golden.cases {
        let what = format!("{} of seed {} through {:?}", case.source, case.seed, case.steps);
        let mut preprocessing = Preprocessing::of(case.steps.clone());
        let plan = preprocessing.plan(case.source).unwrap();
        let image = plan.apply(&noise(case.seed, case.source)).unwrap();
        assert_eq!((image.width(), image.height()), (case.size.width, case.size.height), "{what}");
        assert_eq!(Sha256Digest::of(image.samples()), case.sha256, "{what}");
        assert_eq!(plan.intrinsics(&golden.intrinsics).unwrap(), case.frozen, "{what}");

        preprocessing.principal_point = PrincipalPointRule::Corrected;
        let corrected = preprocessing.plan(case.source).unwrap().intrinsics(&golden.intrinsics).unwrap();
        let numbers = |k: NormalizedIntrinsics| [k.fx, k.fy, k.cx, k.cy];
        // A crop of the whole image is omitted here and computed there: one rounding.
        Tolerance { absolute: 1e-12, relative: 1e-12 }.assert(numbers(corrected), numbers(case.corrected), &what);
    }
}

/// The script's images: the top byte of `SplitMix64` for each sample.
fn noise(seed: u64, size: ImageSize) -> ImageU8 {
    let count = u64::from(size.width) * u64::from(size.height) * 3;
    let state = |index: u64| (index + (seed << 32)).wrapping_add(1).wrapping_mul(SPLIT_MIX_STEP);
    let sample = |index: u64| split_mix(state(index)).to_be_bytes()[0];
    ImageU8::new(size.width, size.height, (0..count).map(sample).collect()).unwrap()
}
