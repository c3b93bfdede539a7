//! Preprocessing against the papers' own code with Pillow inside (`fixtures/make_preprocess_golden.py`).

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::fmt::Write as _;
use std::path::Path;

use atsplat_camera::{ImageSize, NormalizedIntrinsics, PrincipalPointRule};
use atsplat_numeric::Tolerance;
use atsplat_pixels::ImageU8;
use atsplat_scene::preprocess::{Preprocessing, Step};
use serde::Deserialize;
use sha2::{Digest as _, Sha256};

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
    sha256: String,
    frozen: NormalizedIntrinsics,
    corrected: NormalizedIntrinsics,
}

#[test]
fn pictures_and_intrinsics_come_out_as_the_papers_code_makes_them() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/preprocess_golden.json");
    let golden: Golden = serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap();
    assert!(golden.cases.len() > 100, "the fixture holds only {} cases", golden.cases.len());
    for case in golden.cases {
        let what = format!("{} of seed {} through {:?}", case.source, case.seed, case.steps);
        let mut preprocessing = Preprocessing::of(case.steps.clone());
        let plan = preprocessing.plan(case.source).unwrap();
        let picture = plan.apply(&noise(case.seed, case.source)).unwrap();
        assert_eq!((picture.width(), picture.height()), (case.size.width, case.size.height), "{what}");
        assert_eq!(hex(&Sha256::digest(picture.samples())), case.sha256, "{what}");
        assert_eq!(plan.intrinsics(&golden.intrinsics).unwrap(), case.frozen, "{what}");

        preprocessing.principal_point = PrincipalPointRule::Corrected;
        let corrected = preprocessing.plan(case.source).unwrap().intrinsics(&golden.intrinsics).unwrap();
        let numbers = |k: NormalizedIntrinsics| [k.fx, k.fy, k.cx, k.cy];
        // A crop of the whole picture is left out here and computed there: one rounding.
        Tolerance { absolute: 1e-12, relative: 1e-12 }.assert(numbers(corrected), numbers(case.corrected), &what);
    }
}

/// `SplitMix64`'s top byte, sample by sample: the script's pictures.
fn noise(seed: u64, size: ImageSize) -> ImageU8 {
    let count = u64::from(size.width) * u64::from(size.height) * 3;
    let sample = |index: u64| {
        let z = (index + (seed << 32)).wrapping_add(1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
        let z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        (z ^ (z >> 31)).to_be_bytes()[0]
    };
    ImageU8::new(size.width, size.height, (0..count).map(sample).collect()).unwrap()
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut text, byte| {
        write!(text, "{byte:02x}").unwrap();
        text
    })
}
