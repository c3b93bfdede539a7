//! Round trips, and malformed input.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::{Path, PathBuf};

use atsplat_files::FileError;
use atsplat_numeric::Tolerance;
use atsplat_splat::files::{Encoding, Format, ImportReport, Output, parse, read, write};
use atsplat_splat::{GaussianParts, Gaussians, SplatError, sh_coefficients};
use proptest::prelude::*;

const ENCODINGS: [Encoding; 3] = [Encoding::Ascii, Encoding::BinaryLittleEndian, Encoding::BinaryBigEndian];

fn files_in(folder: &str) -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join(folder);
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    files
}

/// Up to ten Gaussians of any degree, with values drawn from `values`.
fn gaussians(values: impl Strategy<Value = f32> + Clone + 'static) -> impl Strategy<Value = Gaussians> {
    (0..10usize, 0..=4u8, any::<[bool; 2]>()).prop_flat_map(move |(count, sh_degree, [has_filter, has_scalar])| {
        let floats = 11 + 3 * sh_coefficients(sh_degree) + 2;
        prop::collection::vec(values.clone(), count * floats).prop_map(move |values| {
            let mut values = values.into_iter();
            let mut next = || values.next().unwrap();
            Gaussians::new(GaussianParts {
                means: (0..count).map(|_| [(); 3].map(|()| next())).collect(),
                quaternions: (0..count).map(|_| [(); 4].map(|()| next())).collect(),
                log_scales: (0..count).map(|_| [(); 3].map(|()| next())).collect(),
                opacity_logits: (0..count).map(|_| next()).collect(),
                sh_degree,
                sh: (0..count * sh_coefficients(sh_degree)).map(|_| [(); 3].map(|()| next())).collect(),
                filter_3d: has_filter.then(|| (0..count).map(|_| next()).collect()),
                scalars: has_scalar.then(|| (0..count).map(|_| next()).collect()),
            })
            .unwrap()
        })
    })
}

fn bits(gaussians: &Gaussians) -> Vec<u32> {
    let parts = gaussians.parts();
    let optional = [&parts.filter_3d, &parts.scalars].into_iter().flatten().flatten();
    let all = parts.means.as_flattened().iter().chain(parts.quaternions.as_flattened());
    let all = all.chain(parts.log_scales.as_flattened()).chain(&parts.opacity_logits);
    all.chain(parts.sh.as_flattened()).chain(optional).map(|value| value.to_bits()).collect()
}

fn finite() -> impl Strategy<Value = f32> + Clone {
    prop::num::f32::POSITIVE | prop::num::f32::NEGATIVE | prop::num::f32::SUBNORMAL | prop::num::f32::ZERO
}

fn small() -> impl Strategy<Value = f32> + Clone {
    -0.95..0.95f32
}

fn round_trip(gaussians: &Gaussians, output: Output) -> Gaussians {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("file");
    write(&path, gaussians, output).unwrap();
    let (back, import) = read(&path).unwrap();
    assert_eq!(import.validation.rejected, 0);
    let antialiased = match output {
        Output::Ply(_) => None,
        Output::Spz2 { antialiased } | Output::Spz3 { antialiased } => Some(antialiased),
    };
    assert_eq!(import.antialiased, antialiased);
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "no partial file remains");
    back
}

/// Without the fields that SPZ cannot store, and with non-zero quaternions.
fn for_spz(gaussians: Gaussians) -> Gaussians {
    let mut parts = gaussians.into_parts();
    (parts.filter_3d, parts.scalars) = (None, None);
    parts.quaternions.iter_mut().for_each(|quaternion| quaternion[0] += 1.0);
    Gaussians::new(parts).unwrap()
}

/// Header of a PLY file of two Gaussians of degree 0.
fn ply_header(format: &str) -> String {
    let names = "x y z rot_0 rot_1 rot_2 rot_3 scale_0 scale_1 scale_2 opacity f_dc_0 f_dc_1 f_dc_2";
    let properties: String = names.split(' ').flat_map(|name| ["property float ", name, "\n"]).collect();
    format!("ply\nformat {format} 1.0\nelement vertex 2\n{properties}end_header\n")
}

fn rotation_difference(a: &[f32; 4], b: &[f32; 4]) -> f64 {
    let unit = |q: &[f32; 4]| {
        let norm = q.iter().map(|part| f64::from(*part).powi(2)).sum::<f64>().sqrt();
        q.map(|part| f64::from(part) / norm)
    };
    let cosine: f64 = unit(a).iter().zip(unit(b)).map(|(a, b)| a * b).sum();
    1.0 - cosine.abs()
}

proptest! {
    #[test]
    fn ply_is_bit_exact(gaussians in gaussians(finite()), encoding in prop::sample::select(&ENCODINGS[..])) {
        let back = round_trip(&gaussians, Output::Ply(encoding));
        prop_assert_eq!(back.sh_degree(), gaussians.sh_degree());
        prop_assert_eq!(bits(&back), bits(&gaussians));
    }

    #[test]
    fn spz_is_within_its_quantisation_steps(gaussians in gaussians(small()), output in prop::sample::select(&[Output::Spz2 { antialiased: true }, Output::Spz3 { antialiased: false }, Output::Spz3 { antialiased: true }][..])) {
        let gaussians = for_spz(gaussians);
        let back = round_trip(&gaussians, output);
        let (old, new) = (gaussians.parts(), back.parts());
        let wide = |values: &[f32]| values.iter().map(|value| f64::from(*value)).collect::<Vec<_>>();
        let within = |step: f64, new: &[f32], old: &[f32], field: &str| {
            Tolerance::absolute(step / 2.0 + 1e-6).assert(wide(new), wide(old), field);
        };
        within(1.0 / 4096.0, new.means.as_flattened(), old.means.as_flattened(), "means");
        within(1.0 / 16.0, new.log_scales.as_flattened(), old.log_scales.as_flattened(), "log-scales");
        // At most 0.05 within these logits: the sigmoid's slope is at least 0.2, a step 1/255.
        within(0.05, &new.opacity_logits, &old.opacity_logits, "logits");
        let coefficients = sh_coefficients(old.sh_degree);
        for (new, old) in new.sh.chunks_exact(coefficients).zip(old.sh.chunks_exact(coefficients)) {
            for (k, (new, old)) in new.iter().zip(old).enumerate() {
                // The higher ones are rounded twice, to 1/128 first.
                let step = match k {
                    0 => 1.0 / (255.0 * 0.15),
                    1..4 => 1.0 / 16.0 + 1.0 / 128.0,
                    _ => 1.0 / 8.0 + 1.0 / 128.0,
                };
                within(step, new, old, "coefficients");
            }
        }
        // Version 2 infers w from three bytes: where it is near zero it is off by up to √(2 · √3 / 255) ≈ 0.12.
        let bound = if matches!(output, Output::Spz2 { .. }) { 1e-2 } else { 1e-5 };
        for (new, old) in new.quaternions.iter().zip(&old.quaternions) {
            let difference = rotation_difference(new, old);
            prop_assert!(difference < bound, "{old:?} → {new:?}: {difference:e}");
        }
    }

    /// Quantised values are stable when written again.
    #[test]
    fn spz_is_stable_after_one_round_trip(gaussians in gaussians(small())) {
        let once = round_trip(&for_spz(gaussians), Output::Spz3 { antialiased: false });
        let twice = round_trip(&once, Output::Spz3 { antialiased: false });
        prop_assert_eq!(&once.parts().means, &twice.parts().means);
        prop_assert_eq!(&once.parts().log_scales, &twice.parts().log_scales);
        prop_assert_eq!(&once.parts().opacity_logits, &twice.parts().opacity_logits);
        prop_assert_eq!(&once.parts().sh, &twice.parts().sh);
    }

    #[test]
    fn flipped_bytes_give_a_value_or_an_error(
        at in any::<prop::sample::Index>(), flips in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..4),
    ) {
        // The seeds of the fuzzer hold SPZ without gzip, whose checksum would catch every flip.
        let files = files_in("../../fuzz/corpus/splat_files");
        let path = at.get(&files);
        let mut bytes = std::fs::read(path).unwrap();
        for (at, byte) in flips {
            *at.get_mut(&mut bytes) = byte;
        }
        parse(&bytes, path).ok();
    }

    #[test]
    fn any_header_gives_a_value_or_an_error(
        lines in prop::collection::vec(
            prop::sample::select(&[
                "ply", "format ascii 1.0", "format binary_big_endian 1.0", "element vertex 9223372036854775807",
                "element vertex 2", "element chunk 1", "element sh 2", "element face 18446744073709551615",
                "property list uchar int x", "property float x", "property float f_rest_0", "property uint packed_position",
                "property", "element", "comment \u{fffd}", "end_header", "", "1 2 3", "property list float int x",
            ][..]), 0..12),
    ) {
        let text = format!("ply\n{}\n", lines.join("\n"));
        parse(text.as_bytes(), Path::new("any.ply")).ok();
    }
}

#[test]
fn every_truncation_gives_an_error() {
    for path in files_in("tests/fixtures/files") {
        let bytes = std::fs::read(&path).unwrap();
        for length in 0..bytes.len() {
            let outcome = parse(&bytes[..length], &path);
            let whole_rows = path.extension().is_some_and(|extension| extension == "splat") && length % 32 == 0;
            // A text may end within its last number, or without its last line break; gzip within its trailer.
            let last = length + 24 > bytes.len();
            assert!(outcome.is_err() || whole_rows || last, "{} cut at {length}", path.display());
        }
    }
}

fn error_of(bytes: &[u8], name: &str) -> String {
    parse(bytes, Path::new(name)).unwrap_err().to_string()
}

#[test]
fn hostile_headers_give_precise_errors() {
    let required = "property float x\nproperty float y\nproperty float z\n\
        property float rot_0\nproperty float rot_1\nproperty float rot_2\nproperty float rot_3\n\
        property float scale_0\nproperty float scale_1\nproperty float scale_2\nproperty float opacity\n\
        property float f_dc_0\nproperty float f_dc_1\n";
    let ply = |format: &str, count: &str, more: &str| {
        format!("ply\nformat {format} 1.0\nelement vertex {count}\n{required}{more}end_header\n")
    };
    let dc = "property float f_dc_2\n";
    for (text, expected) in [
        (
            ply("binary_little_endian", "9223372036854775807", dc),
            "f.ply: element \"vertex\": expected at least 516508834063867445192 bytes for 9223372036854775807 rows, found 0 bytes",
        ),
        (
            ply("ascii", "4611686018427387904", dc),
            "f.ply: element \"vertex\": expected at least 129127208515966861312 bytes for 4611686018427387904 rows, found 0 bytes",
        ),
        (
            ply("ascii", "9223372036854775808", dc),
            "f.ply: header line 3: expected a count of rows below 2⁶³, found \"element vertex 9223372036854775808\"",
        ),
        (
            ply("ascii", "1", ""),
            "f.ply: element \"vertex\": expected a property f_dc_2, found x, y, z, rot_0, rot_1, rot_2, rot_3, scale_0, \
             scale_1, scale_2, opacity, f_dc_0, …",
        ),
        (
            ply("ascii", "1", &format!("{dc}property float f_rest_0\n")),
            "f.ply: header: expected 0, 9, 24, 45 or 72 properties f_rest_*, for degrees 0 to 4, found 1",
        ),
        (
            ply("ascii", "1", &format!("{dc}property float x\n")),
            "f.ply: header line 18: expected each property once, found \"property float x\"",
        ),
        (
            ply("ascii", "1", &format!("{dc}property half g\n")),
            "f.ply: header line 18: expected a property of a known type, found \"property half g\"",
        ),
        (
            ply("ascii", "1", dc) + "1 2 3",
            "f.ply: element \"vertex\": expected at least 28 bytes for 1 rows, found 5 bytes",
        ),
        (
            ply("ascii", "1", dc) + "1 2 3 4 5 6 7 8 9 10 11 12 13 o",
            "f.ply: line 19: expected a number of type F32, found \"o\"",
        ),
        (
            ply("ascii", "1", dc) + "1 2 3 4 5 6 7 8 9 10 11 12 13\n14\n",
            "f.ply: line 19: expected another number, found the end of the line",
        ),
        (
            "ply\nelement vertex 1\nend_header\n".to_owned(),
            "f.ply: header line 3: expected a line \"format\", found none before end_header",
        ),
    ] {
        assert_eq!(error_of(text.as_bytes(), "f.ply"), expected);
    }
}

#[test]
fn rejects_hostile_spz_before_allocating() {
    let header = |version: u8, count: u32, degree: u8, fraction: u8, streams: u8| {
        let mut bytes = b"NGSP".to_vec();
        bytes.extend([version, 0, 0, 0]);
        bytes.extend(count.to_le_bytes());
        bytes.extend([degree, fraction, 0, streams]);
        bytes.extend(32u32.to_le_bytes());
        bytes.extend([0; 12]);
        bytes
    };
    for (bytes, expected) in [
        (header(2, u32::MAX, 4, 12, 0), "a file that can hold 4294967295 Gaussians of 390842023845 bytes"),
        (header(4, u32::MAX, 4, 12, 6), "a file that can hold 4294967295 Gaussians"),
        (header(4, 5, 0, 12, 6), "5 streams"),
        (header(4, 5, 0, 12, 5), "32 bytes and the streams after them"),
        (header(5, 5, 0, 12, 5), "version 1 to 4"),
        (header(3, 5, 5, 12, 5), "spherical harmonics of degree 0 to 4"),
        (header(3, 5, 0, 32, 5), "fewer than 32 fractional bits"),
    ] {
        let error = error_of(&bytes, "f.spz");
        assert!(error.contains(expected), "{error}");
    }
}

/// A flag of another writer may change what the file means, such as Gaussians of several levels of detail.
#[test]
fn unknown_flags_of_spz_are_reported() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/files/version4.spz");
    let mut bytes = std::fs::read(&path).unwrap();
    assert!(parse(&bytes, &path).unwrap().1.unused.is_empty());
    bytes[14] |= 0x85;
    let import = parse(&bytes, &path).unwrap().1;
    assert_eq!((import.unused, import.antialiased), (vec!["flags 0x84".to_owned()], Some(true)));
}

/// The reference decompresses whole streams, and fails on such bytes.
#[test]
fn rejects_bytes_after_the_frame_of_an_spz_stream() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/files/version4.spz");
    let mut bytes = std::fs::read(&path).unwrap();
    // Compressed size of the last of six streams: 24 coefficients of 6 Gaussians.
    bytes[32 + 5 * 16] += 3;
    bytes.extend([7; 3]);
    let error = parse(&bytes, &path).unwrap_err().to_string();
    assert!(error.ends_with("SPZ stream: expected 144 bytes, found more"), "{error}");
}

/// Another stream, for example.
#[test]
fn bytes_after_the_gzip_stream_of_spz_are_reported() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/files/version2.spz");
    let mut bytes = std::fs::read(&path).unwrap();
    bytes.extend(bytes.clone());
    let (gaussians, import) = parse(&bytes, &path).unwrap();
    assert_eq!((gaussians.len(), import.unused), (6, vec!["bytes after the gzip stream".to_owned()]));
}

/// Rows without properties take no bytes, so any number of them costs nothing.
#[test]
fn rows_without_properties_cost_nothing() {
    for format in ["ascii", "binary_little_endian"] {
        let many =
            format!("ply\nformat {format} 1.0\nelement void 9223372036854775807\nelement vertex 1\nend_header\n");
        assert!(error_of(many.as_bytes(), "f.ply").contains("a property x"));
    }
}

/// Rows beyond the header's count would be ignored; blank lines of text are not rows.
#[test]
fn rejects_rows_after_the_last() {
    let row = "0 1 2 1 0 0 0 -1 -2 -3 0.25 0.5 0.5 0.5\n";
    let expected = "expected the end of the file after the 2 rows of element \"vertex\", found";
    let text = |rows: &str| ply_header("ascii") + rows;
    parse(text(&(row.repeat(2) + "\n \r\n")).as_bytes(), Path::new("f.ply")).unwrap();
    assert_eq!(
        error_of(text(&(row.repeat(2) + "\n" + &row.repeat(3))).as_bytes(), "f.ply"),
        format!("f.ply: line 22: {expected} 3 more")
    );
    let header = ply_header("binary_little_endian");
    let binary = |bytes: usize| [header.as_bytes(), &vec![0; bytes]].concat();
    let at = header.len() + 2 * 56;
    for (bytes, found) in [(3 * 56 + 5, "61 bytes, enough for 1 more"), (2 * 56 + 1, "1 bytes")] {
        assert_eq!(error_of(&binary(bytes), "f.ply"), format!("f.ply: byte {at}: {expected} {found}"));
    }
}

/// One Gaussian of degree 1 with `colours` among its chunk's ranges; `extra` is a property of the chunk that is not
/// read.
fn compressed(sh_type: &str, colours: &[&str], extra: &str) -> String {
    let lines = |kind: &str, names: &[String]| -> String {
        names.iter().flat_map(|name| ["property ", kind, " ", name.as_str(), "\n"]).collect()
    };
    let axes = ["x", "y", "z", "scale_x", "scale_y", "scale_z"];
    let ranges = ["min", "max"].into_iter().flat_map(|end| axes.map(|axis| format!("{end}_{axis}")));
    let ranges: Vec<String> = ranges.chain(colours.iter().chain([&extra]).map(|name| (*name).to_owned())).collect();
    let packed = ["position", "rotation", "scale", "color"].map(|name| format!("packed_{name}"));
    let rest: Vec<String> = (0..9).map(|k| format!("f_rest_{k}")).collect();
    format!(
        "ply\nformat ascii 1.0\nelement chunk 1\n{}element vertex 1\n{}element sh 1\n{}end_header\n{}\n\
         0 0 0 0\n0 64 128 192 255 1 2 3 4\n",
        lines("float", &ranges),
        lines("uint", &packed),
        lines(sh_type, &rest),
        vec!["0"; ranges.len()].join(" ")
    )
}

/// Numbers of another type would be taken for bytes, and a missing range of a colour for [0, 1].
#[test]
fn compressed_ply_has_the_types_and_ranges_of_its_format() {
    let colours = ["min_r", "min_g", "min_b", "max_r", "max_g", "max_b"];
    let (gaussians, import) = parse(compressed("uchar", &colours, "quality").as_bytes(), Path::new("f.ply")).unwrap();
    assert_eq!(import.unused, ["property quality of element chunk"]);
    let byte = |byte: f32| ((byte + 0.5) / 256.0 - 0.5) * 8.0;
    let (first, second) = ([-4.0, byte(192.0), byte(2.0)], [byte(64.0), 4.0, byte(3.0)]);
    assert_eq!(gaussians.parts().sh[1..], [first, second, [byte(128.0), byte(1.0), byte(4.0)]]);
    for (sh_type, colours, expected) in [
        ("float", &colours[..], "f.ply: element \"sh\": expected f_rest_0 as uchar, found another type"),
        ("char", &colours[..], "f.ply: element \"sh\": expected f_rest_0 as uchar, found another type"),
        (
            "uchar",
            &colours[1..],
            "f.ply: element \"chunk\": expected a property min_r, found min_x, min_y, min_z, min_scale_x, min_scale_y, \
             min_scale_z, max_x, max_y, max_z, max_scale_x, max_scale_y, max_scale_z, …",
        ),
    ] {
        assert_eq!(error_of(compressed(sh_type, colours, "quality").as_bytes(), "f.ply"), expected);
    }
}

#[test]
fn a_git_lfs_pointer_gives_a_helpful_error() {
    // As long as four rows of `.splat` would be.
    let pointer = format!("{:<128}", "version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n");
    for name in ["scene.ply", "scene.spz", "scene.splat"] {
        let error = parse(pointer.as_bytes(), Path::new(name)).unwrap_err();
        assert!(matches!(error, SplatError::LfsPointer { .. }), "{error}");
        assert!(error.to_string().contains(name) && error.to_string().contains("git lfs pull"), "{error}");
    }
}

#[test]
fn rejects_unknown_formats() {
    assert_eq!(
        error_of(b"GIF89a", "f.gif"),
        "f.gif: first bytes: expected a PLY, SPZ or .splat file, found \"GIF89a\""
    );
    assert_eq!(error_of(&[0; 33], "f.SPLAT"), "f.SPLAT: file size: expected a multiple of 32 bytes, found 33 bytes");
    assert!(matches!(
        read(Path::new("absent.ply")),
        Err(SplatError::Io(FileError { action: "reading Gaussians", .. }))
    ));
}

/// Any bytes can be a coordinate; whole headers of gzip are too small for one.
#[test]
fn rows_that_begin_like_gzip_are_rows() {
    let rows = |x: [u8; 4]| {
        let centre = [x, 2f32.to_le_bytes(), 3f32.to_le_bytes()].concat();
        [centre, vec![0x3e; 12], vec![9; 8], vec![7; 32]].concat()
    };
    let x = [0x1f, 0x8b, 0x08, 0x40];
    let (gaussians, import) = parse(&rows(x), Path::new("f.splat")).unwrap();
    assert_eq!((import.format, gaussians.len()), (Format::Splat, 2));
    assert_eq!(gaussians.parts().means[0].map(f32::to_le_bytes), [x, 2f32.to_le_bytes(), 3f32.to_le_bytes()]);
    assert!(error_of(&rows(x), "f.spz").contains("SPZ header"));
    assert!(error_of(&rows([0x1f, 0x8b, 8, 0]), "f.splat").contains("SPZ header"));
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/files/version2.spz");
    let import = parse(&std::fs::read(path).unwrap(), Path::new("f.splat")).unwrap().1;
    assert_eq!(import.format, Format::Spz(2), "whatever it is called");
}

/// What reading a PLY file of these two rows finds.
fn imported(rows: &[String; 2]) -> ImportReport {
    parse((ply_header("ascii") + &rows.concat()).as_bytes(), Path::new("f.ply")).unwrap().1
}

/// Opacities written by pixelSplat look like logits of opacities between 0.5 and 0.73.
#[test]
fn detects_opacities_that_may_not_be_logits() {
    let row = |opacity: &str| format!("0 1 2 1 0 0 0 -1 -2 -3 {opacity} 0.5 0.5 0.5\n");
    let suspected = |first: &str, second: &str| imported(&[row(first), row(second)]).opacities_look_linear;
    assert!(suspected("0.25", "1"));
    assert!(!suspected("0.25", "1.5"));
    assert!(!suspected("-0.25", "0.5"));
}

/// As coefficients, colours are never darker than middle grey.
#[test]
fn detects_colours_that_may_not_be_coefficients() {
    let row = |colour: &str| format!("0 1 2 1 0 0 0 -1 -2 -3 2 {colour}\n");
    let suspicions = |first: &str, second: &str| imported(&[row(first), row(second)]).suspicions().concat();
    let suspected = suspicions("0.25 0 1", "0.5 0.75 0.1");
    assert!(suspected.starts_with("every coefficient of the file lies in [0, 1], without view"), "{suspected}");
    assert_eq!(suspicions("0.25 0 1", "0.5 -0.75 0.1"), "");
    assert_eq!(suspicions("0.25 0 1.5", "0.5 0.75 0.1"), "");
    assert_eq!(suspicions("0.5 0.5 0.5", "0.5 0.5 0.5"), "", "one grey");
}

/// An infinite logit is written as ±20 in any format; SPZ rejects what it cannot store, with a precise error.
#[test]
fn writes_extreme_values_within_the_format() {
    let parts = GaussianParts {
        means: vec![[100_000.0, 0.0, -3.0]],
        quaternions: vec![[1.0, 0.0, 0.0, 0.0]],
        log_scales: vec![[f32::NEG_INFINITY, 0.0, 50.0]],
        opacity_logits: vec![f32::INFINITY],
        sh: vec![[0.0; 3]],
        ..GaussianParts::default()
    };
    let one = Gaussians::new(parts.clone()).unwrap();
    for encoding in ENCODINGS {
        assert_eq!(round_trip(&one, Output::Ply(encoding)).parts().opacity_logits, [20.0]);
    }
    let back = round_trip(&one, Output::Spz3 { antialiased: false }).into_parts();
    assert_eq!(back.means, [[100_000.0, 0.0, -3.0]], "fewer fractional bits");
    assert_eq!(back.log_scales, [[-10.0, 0.0, 5.9375]]);
    assert_eq!(back.opacity_logits, [20.0]);

    let folder = tempfile::tempdir().unwrap();
    let rejected = |change: &dyn Fn(&mut GaussianParts)| {
        let mut parts = parts.clone();
        change(&mut parts);
        let error =
            write(&folder.path().join("f.spz"), &Gaussians::new(parts).unwrap(), Output::Spz2 { antialiased: false })
                .unwrap_err();
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "nothing is written");
        error.to_string()
    };
    for (expected, error) in [
        ("no filter_3d", rejected(&|parts| parts.filter_3d = Some(vec![0.1]))),
        ("no scalars", rejected(&|parts| parts.scalars = Some(vec![0.1]))),
        ("finite centre", rejected(&|parts| parts.means[0][1] = f32::NAN)),
        ("a quaternion that is not zero", rejected(&|parts| parts.quaternions[0] = [0.0; 4])),
        ("centres within ±8388607", rejected(&|parts| parts.means[0][1] = 1e7)),
    ] {
        assert!(error.contains(expected), "{error}");
    }
}
