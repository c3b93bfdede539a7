//! Files of Gaussians that other tools wrote, against an independent reader (`crates/splat/tests/fixtures/make_files.py`
//! with the folder of real files), and through every format that can be written.

use std::collections::BTreeMap;

use atsplat_numeric::Tolerance;
use atsplat_splat::files::{Encoding, Format, Output, read, write};
use atsplat_splat::{Cleaning, GaussianParts, SplatError};
use atsplat_tests::shared_data;
use serde::Deserialize;

/// Some rows of each field, and the sums over all rows.
#[derive(Deserialize)]
struct Expected {
    count: usize,
    degree: u8,
    rows: Vec<usize>,
    means: Vec<f64>,
    quaternions: Vec<f64>,
    log_scales: Vec<f64>,
    opacity_logits: Vec<f64>,
    sh: Vec<f64>,
    sum_means: f64,
    sum_quaternions: f64,
    sum_log_scales: f64,
    sum_opacity_logits: f64,
    sum_sh: f64,
}

fn fields(parts: &GaussianParts) -> [Vec<f64>; 5] {
    let wide = |values: &[f32]| values.iter().map(|value| f64::from(*value)).collect();
    [
        wide(parts.means.as_flattened()),
        wide(parts.quaternions.as_flattened()),
        wide(parts.log_scales.as_flattened()),
        wide(&parts.opacity_logits),
        wide(parts.sh.as_flattened()),
    ]
}

#[test]
fn files_of_other_tools_hold_what_an_independent_reader_finds() {
    let Some(data) = shared_data("files_of_other_tools_hold_what_an_independent_reader_finds") else { return };
    let table = include_str!("fixtures/splat_files.json");
    let table: BTreeMap<String, Expected> = serde_json::from_str(table).unwrap();
    assert_eq!(table.len(), 6);
    for (name, expected) in table {
        let (gaussians, import) = read(&data.join("splat_scenes").join(&name)).unwrap();
        assert_eq!((gaussians.len(), gaussians.sh_degree()), (expected.count, expected.degree), "{name}");
        assert_eq!((import.validation.rejected, import.unused.len()), (0, 0), "{name}");
        let rows = gaussians.select(&expected.rows).unwrap();
        let close = Tolerance { absolute: 1e-7, relative: 2e-7 };
        let wanted = [expected.means, expected.quaternions, expected.log_scales, expected.opacity_logits, expected.sh];
        for (found, wanted) in fields(rows.parts()).into_iter().zip(wanted) {
            close.assert(found, wanted, &name);
        }
        let sums = fields(gaussians.parts()).map(|values| values.iter().sum());
        let wanted = [
            expected.sum_means,
            expected.sum_quaternions,
            expected.sum_log_scales,
            expected.sum_opacity_logits,
            expected.sum_sh,
        ];
        Tolerance { absolute: 1e-6, relative: 1e-9 }.assert(sums, wanted, &name);
    }
}

#[test]
fn a_capture_goes_through_every_encoding() {
    let Some(data) = shared_data("a_capture_goes_through_every_encoding") else { return };
    let (guitar, import) = read(&data.join("splat_scenes/guitar.compressed.ply")).unwrap();
    assert_eq!(import.format, Format::CompressedPly);
    assert!(guitar.cleaned(Cleaning::Reject).1.is_clean());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("guitar");
    for encoding in [Encoding::Ascii, Encoding::BinaryLittleEndian, Encoding::BinaryBigEndian] {
        write(&path, &guitar, Output::Ply(encoding)).unwrap();
        let (back, import) = read(&path).unwrap();
        assert_eq!(import.format, Format::Ply(encoding));
        assert!(import.validation.is_clean(), "{:?}", import.validation);
        assert_eq!(back, guitar, "{encoding:?}");
    }
    write(&path, &guitar, Output::Spz3 { antialiased: false }).unwrap();
    let (back, _) = read(&path).unwrap();
    let [means, ..] = fields(guitar.parts());
    Tolerance::absolute(0.5 / 4096.0 + 1e-6).assert(fields(back.parts())[0].iter().copied(), means, "SPZ's centres");
}

/// Coloured points are no Gaussians; the error names what they lack.
#[test]
fn a_point_cloud_is_rejected_by_name() {
    let Some(data) = shared_data("a_point_cloud_is_rejected_by_name") else { return };
    let error = read(&data.join("splat_scenes/brush_init.ply")).unwrap_err();
    let SplatError::Format { expected, found, .. } = &error else { panic!("{error}") };
    assert_eq!((expected.as_str(), found.as_str()), ("a property rot_0", "x, y, z, red, green, blue, alpha"));
}
