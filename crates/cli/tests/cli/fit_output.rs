//! The files that `atsplat fit` writes.

use atsplat_files::Sha256Digest;
use atsplat_numeric::Tolerance;
use atsplat_splat::files::{self, Encoding, Format};
use tempfile::tempdir;

use crate::common::{SCENE, atsplat, photograph, read_json, succeed};

/// The centres of an SPZ are rounded to 2⁻¹². What it cannot store is an error before the first step.
#[test]
fn gaussians_are_written_in_the_format_of_their_extension() {
    let folder = tempdir().unwrap();
    let here = folder.path();
    photograph(here);
    let views = ["fit", "photos", "--views", "..", "--size", "32x32", "--steps", "1"];
    let read = |name: &'static str| {
        succeed(here, &[&views[..], &["--start", SCENE, "--strategy", "fixed", "--out", name]].concat());
        let (gaussians, import) = files::read(&here.join(name)).unwrap();
        let centres: Vec<f64> = gaussians.parts().means.as_flattened().iter().copied().map(f64::from).collect();
        let record = read_json(&here.join(format!("{name}.json")));
        let hash = Sha256Digest::of(&std::fs::read(here.join(name)).unwrap());
        assert_eq!(record["file-sha256"], hash.to_string());
        assert_eq!(record["commit"].as_str(), option_env!("ATSPLAT_COMMIT"), "as the builds of these tests record it");
        (import.format, centres)
    };
    let [ply, spz] = ["fitted.PLY", "fitted.spz"].map(read);
    assert_eq!((ply.0, spz.0), (Format::Ply(Encoding::BinaryLittleEndian), Format::Spz(3)));
    Tolerance::absolute(2e-4).assert(spz.1, ply.1, "centres");

    let fit = |more: [&str; 6]| atsplat(here, &[&views[..], &more].concat());
    let written = fit(["--start", SCENE, "--strategy", "mip-splatting", "--out", "mip.ply"]);
    assert_eq!(written.code, 0, "{}", written.stderr);
    for (start, strategy, out, code, expected) in [
        (SCENE, "mip-splatting", "no.spz", 2, "--strategy mip-splatting requires --out with a file that ends in .ply"),
        ("mip.ply", "fixed", "no.spz", 1, "--out no.spz: expected a file that ends in .ply, because the initial"),
        (SCENE, "fixed", "no.splat", 2, "expected a file that ends in .ply or .spz, found \"no.splat\""),
    ] {
        fit(["--start", start, "--strategy", strategy, "--out", out]).says(code, expected);
        assert!(!here.join(out).exists(), "{out}");
    }
}
