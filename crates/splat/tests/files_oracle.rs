//! Every format against independent readers: `fixtures/make_files.py` wrote the files and the values that plyfile and
//! NumPy read from them.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use atsplat_numeric::Tolerance;
use atsplat_splat::files::{Encoding, Format, Import, read};
use atsplat_splat::{Field, Gaussians, Problem};
use serde::Deserialize;

/// The values that an independent reader found in one file: selected `rows` of each field.
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
    filter_3d: Option<Vec<f64>>,
    scalars: Option<Vec<f64>>,
}

fn fixtures() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures")
}

fn imported(name: &str) -> (Gaussians, Import) {
    read(&fixtures().join("files").join(name)).unwrap()
}

fn flat<const N: usize>(values: &[[f32; N]]) -> Vec<f64> {
    values.iter().flatten().map(|value| f64::from(*value)).collect()
}

fn wide(values: &[f32]) -> Vec<f64> {
    values.iter().map(|value| f64::from(*value)).collect()
}

#[test]
fn matches_independent_readers() {
    let table = std::fs::read(fixtures().join("files.json")).unwrap();
    let table: BTreeMap<String, Expected> = serde_json::from_slice(&table).unwrap();
    assert_eq!(table.len(), std::fs::read_dir(fixtures().join("files")).unwrap().count());
    for (name, expected) in table {
        let (gaussians, import) = imported(&name);
        assert_eq!((gaussians.len(), gaussians.sh_degree()), (expected.count, expected.degree), "{name}");
        assert_eq!(import.validation.rejected, 0, "{name}");
        let rows = gaussians.select(&expected.rows).unwrap().into_parts();
        // PLY stores exact floats; quantised values are rounded to f32 once on each side.
        let close = if matches!(import.format, Format::Ply(_)) {
            Tolerance::EXACT
        } else {
            Tolerance { absolute: 1e-7, relative: 2e-7 }
        };
        let check = |found: Vec<f64>, expected_values: Vec<f64>, field: &str| {
            close.assert(found, expected_values, &format!("{name}: {field}"));
        };
        check(flat(&rows.means), expected.means, "means");
        check(flat(&rows.quaternions), expected.quaternions, "quaternions");
        check(flat(&rows.log_scales), expected.log_scales, "log-scales");
        check(wide(&rows.opacity_logits), expected.opacity_logits, "opacity logits");
        check(flat(&rows.sh), expected.sh, "spherical harmonics");
        for (found, expected_values, field) in
            [(rows.filter_3d, expected.filter_3d, "filter"), (rows.scalars, expected.scalars, "scalars")]
        {
            assert_eq!(found.is_some(), expected_values.is_some(), "{name}: {field}");
            check(wide(&found.unwrap_or_default()), expected_values.unwrap_or_default(), field);
        }
    }
}

#[test]
fn reports_the_format_and_unused_contents() {
    for (name, format, unused, antialiased) in [
        ("degree3_little_endian.ply", Format::Ply(Encoding::BinaryLittleEndian), &[][..], None),
        (
            "odd_types_ascii.ply",
            Format::Ply(Encoding::Ascii),
            &["property label", "element face", "element camera"],
            None,
        ),
        ("compressed_degree1.ply", Format::CompressedPly, &[], None),
        ("version2.spz", Format::Spz(2), &[], Some(false)),
        ("version3.spz", Format::Spz(3), &[], Some(true)),
        ("version4_left_up_front.spz", Format::Spz(4), &["extension 0xadbe0002"], Some(false)),
        ("rows.splat", Format::Splat, &[], None),
    ] {
        let (_, import) = imported(name);
        assert_eq!(import.format, format, "{name}");
        assert_eq!(import.unused, unused, "{name}");
        assert_eq!(import.antialiased, antialiased, "{name}");
    }
}

/// Opacities 0 and 1 have infinite logits.
#[test]
fn infinite_logits_are_clamped_and_counted() {
    let (gaussians, import) = imported("rows.splat");
    assert_eq!(import.validation.count(Field::OpacityLogits, Problem::Infinite), 2);
    assert_eq!(import.validation.repaired, 2);
    assert_eq!(gaussians.parts().opacity_logits[..2], [-20.0, 20.0]);
}
