//! Real images, decoded and preprocessed, against the papers' code with Pillow inside
//! (`crates/scene/tests/fixtures/make_preprocess_golden.py --folder`).

use std::path::Path;

use atsplat_camera::{ImageSize, NormalizedIntrinsics};
use atsplat_files::Sha256Digest;
use atsplat_pixels::{DecodeLimits, decode};
use atsplat_scene::preprocess::{Preprocessing, Step};
use atsplat_tests::shared_data;
use serde::Deserialize;

#[derive(Deserialize)]
struct Golden {
    intrinsics: NormalizedIntrinsics,
    cases: Vec<Case>,
}

#[derive(Deserialize)]
struct Case {
    image: String,
    source: ImageSize,
    steps: Vec<Step>,
    sha256: Sha256Digest,
    frozen: NormalizedIntrinsics,
}

#[test]
fn a_real_capture_comes_out_as_the_papers_code_makes_it() {
    let Some(data) = shared_data("a_real_capture_comes_out_as_the_papers_code_makes_it") else { return };
    let fixture = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/preprocess_desk.json");
    let golden: Golden = serde_json::from_slice(&std::fs::read(fixture).unwrap()).unwrap();
    assert!(golden.cases.len() >= 9, "the fixture holds only {} cases", golden.cases.len());
    for Case { image, source, steps, sha256, frozen } in golden.cases {
        let file = data.join("dl3dv_like/desk/nerfstudio/images_8").join(&image);
        let decoded = decode(&std::fs::read(file).unwrap(), &DecodeLimits::default()).unwrap();
        assert_eq!((decoded.width(), decoded.height()), (source.width, source.height), "{image}");
        let plan = Preprocessing::of(steps.clone()).plan(source).unwrap();
        let digest = Sha256Digest::of(plan.apply(&decoded).unwrap().samples());
        assert_eq!(digest, sha256, "{image} through {steps:?}");
        assert_eq!(plan.intrinsics(&golden.intrinsics).unwrap(), frozen, "{image} through {steps:?}");
    }
}
