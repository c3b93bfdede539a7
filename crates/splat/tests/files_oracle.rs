//! Every format against independent readers: `fixtures/make_files.py` wrote the files and the values that plyfile and
//! NumPy read from them.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use atsplat_numeric::Tolerance;
use atsplat_splat::files::{Encoding, Format, ImportReport, parse, read};
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

fn imported(name: &str) -> (Gaussians, ImportReport) {
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

/// Without its flag, an extension that would mirror the Gaussians is not read.
#[test]
fn undeclared_extensions_of_spz_4_are_reported() {
    let path = fixtures().join("files/version4.spz");
    let mut bytes = std::fs::read(&path).unwrap();
    let left_up_front = [0xadbe_0003u32, 4, 7].map(u32::to_le_bytes);
    bytes.splice(32..32, left_up_front.as_flattened().iter().copied());
    bytes[16] += 12;
    let (plain, import) = parse(&bytes, &path).unwrap();
    assert_eq!(import.unused, ["bytes between the header and the table of streams"]);
    bytes[14] |= 2;
    let (mirrored, import) = parse(&bytes, &path).unwrap();
    assert_eq!(import.unused, [""; 0]);
    assert_ne!(mirrored.parts().means, plain.parts().means);
}

/// Eight bits may be a fraction of 255; that a file has integers is no error, because all of them are read exactly.
#[test]
fn integers_among_the_properties_are_suspicious() {
    for name in ["odd_types_ascii.ply", "odd_types_big_endian.ply"] {
        let (_, import) = imported(name);
        assert_eq!(
            import.integers,
            ["opacity is stored as char", "y is stored as short", "f_dc_2 is stored as int"],
            "{name}, whose label is not read"
        );
    }
    assert_eq!(imported("degree1_ascii.ply").1.suspicions(), [""; 0]);
    assert_eq!(imported("compressed_degree1.ply").1.suspicions(), [""; 0], "bytes by its definition");
    let types = |name: &str| match name {
        "f_dc_0" | "f_dc_2" => "uint8",
        "rot_0" | "rot_1" | "rot_2" | "rot_3" | "scale_1" => "short",
        "x" => "double",
        _ => "float",
    };
    let names = "f_dc_0 f_dc_1 f_dc_2 x y z rot_0 rot_1 rot_2 rot_3 scale_0 scale_1 scale_2 opacity";
    let properties: String = names.split(' ').flat_map(|name| ["property ", types(name), " ", name, "\n"]).collect();
    let text =
        format!("ply\nformat ascii 1.0\nelement vertex 1\n{properties}end_header\n200 0 9 1 2 3 1 0 0 7 -1 -2 -3 2\n");
    let (gaussians, import) = parse(text.as_bytes(), Path::new("f.ply")).unwrap();
    assert_eq!(gaussians.parts().sh, [[200.0, 0.0, 9.0]]);
    assert_eq!(
        import.suspicions(),
        [
            "f_dc_0, f_dc_2 are stored as uchar: read as these integers, not as fractions of a range",
            "rot_0, rot_1, rot_2 and 2 more are stored as short: read as these integers, not as fractions of a range",
        ]
    );
}

/// Opacities of 0 and 1 are bytes like any others, though their logits are infinite.
#[test]
fn stored_opacities_of_0_and_1_are_no_problem() {
    let (gaussians, import) = imported("rows.splat");
    assert_eq!(import.validation.count(Field::OpacityLogits, Problem::Infinite), 0);
    assert_eq!(import.validation.repaired, 0);
    assert_eq!(gaussians.parts().opacity_logits[..2], [-20.0, 20.0]);
}
