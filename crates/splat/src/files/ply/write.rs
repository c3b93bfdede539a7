use std::io::{self, Write};

use super::Encoding;
use super::gaussians::{FILTER, UNCERTAINTY};
use crate::{GaussianParts, LOGIT_OF_INFINITY, sh_coefficients};

/// Bytes that are written at once: a writer may lock on each call.
const BLOCK: usize = 1 << 16;

/// Writes 3DGS' properties in 3DGS' order with zero normals, as every viewer expects them, then the optional ones.
///
/// An infinite opacity logit becomes ±20, because graphdeco's viewer and others turn it into NaN.
pub(in super::super) fn write(parts: &GaussianParts, encoding: Encoding, out: &mut impl Write) -> io::Result<()> {
    let name = match encoding {
        Encoding::Ascii => "ascii",
        Encoding::BinaryLittleEndian => "binary_little_endian",
        Encoding::BinaryBigEndian => "binary_big_endian",
    };
    let mut bytes = Vec::with_capacity(2 * BLOCK);
    write!(bytes, "ply\nformat {name} 1.0\nelement vertex {}\n", parts.means.len())?;
    for property in properties(parts) {
        writeln!(bytes, "property float {property}")?;
    }
    bytes.extend(b"end_header\n");

    let coefficients = sh_coefficients(parts.sh_degree);
    let shapes = parts.quaternions.iter().zip(&parts.log_scales).zip(&parts.opacity_logits);
    let mut optional: Vec<_> = [&parts.filter_3d, &parts.scalars].into_iter().flatten().map(|of| of.iter()).collect();
    let mut row = Vec::new();
    for ((mean, sh), ((quaternion, log_scales), logit)) in
        parts.means.iter().zip(parts.sh.chunks_exact(coefficients)).zip(shapes)
    {
        row.clear();
        row.extend(mean);
        row.extend([0.0; 3]);
        row.extend(sh.iter().take(1).flatten());
        for channel in 0..3 {
            row.extend(sh.iter().skip(1).filter_map(|rgb| rgb.get(channel)));
        }
        row.push(if logit.is_infinite() { LOGIT_OF_INFINITY.copysign(*logit) } else { *logit });
        row.extend(log_scales);
        row.extend(quaternion);
        row.extend(optional.iter_mut().filter_map(Iterator::next));
        append_row(&row, encoding, &mut bytes)?;
        if bytes.len() >= BLOCK {
            out.write_all(&bytes)?;
            bytes.clear();
        }
    }
    out.write_all(&bytes)
}

fn properties(parts: &GaussianParts) -> impl Iterator<Item = String> {
    let rest = 3 * (sh_coefficients(parts.sh_degree) - 1);
    let fixed = |names: &'static str| names.split(' ').map(str::to_owned);
    let optional = [(FILTER, parts.filter_3d.is_some()), (UNCERTAINTY, parts.scalars.is_some())];
    fixed("x y z nx ny nz f_dc_0 f_dc_1 f_dc_2")
        .chain((0..rest).map(|k| format!("f_rest_{k}")))
        .chain(fixed("opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3"))
        .chain(optional.into_iter().filter(|(_, is_present)| *is_present).map(|(name, _)| name.to_owned()))
}

fn append_row(row: &[f32], encoding: Encoding, bytes: &mut Vec<u8>) -> io::Result<()> {
    match encoding {
        Encoding::BinaryLittleEndian => bytes.extend(row.iter().flat_map(|value| value.to_le_bytes())),
        Encoding::BinaryBigEndian => bytes.extend(row.iter().flat_map(|value| value.to_be_bytes())),
        Encoding::Ascii => {
            // The shortest decimals that read back as the same f32.
            for (at, value) in row.iter().enumerate() {
                let blank = if at == 0 { "" } else { " " };
                write!(bytes, "{blank}{value:?}")?;
            }
            bytes.push(b'\n');
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Default)]
    struct Counting {
        bytes: Vec<u8>,
        calls: usize,
    }

    impl Write for Counting {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            self.calls += 1;
            self.bytes.write(bytes)
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn rows_are_written_in_blocks() {
        const COUNT: u16 = 3000;
        let parts = GaussianParts {
            means: (0..COUNT).map(|at| [f32::from(at), 0.5, -2.0]).collect(),
            quaternions: vec![[1.0, 0.0, 0.0, 0.25]; COUNT.into()],
            log_scales: vec![[-1.0, -2.0, -3.0]; COUNT.into()],
            opacity_logits: vec![1.5; COUNT.into()],
            sh_degree: 0,
            sh: vec![[0.1, 0.2, 0.3]; COUNT.into()],
            scalars: None,
            filter_3d: None,
        };
        for (encoding, last) in [
            (Encoding::BinaryLittleEndian, 0.25f32.to_le_bytes().to_vec()),
            (Encoding::BinaryBigEndian, 0.25f32.to_be_bytes().to_vec()),
            (Encoding::Ascii, b" 0.25\n".to_vec()),
        ] {
            let mut out = Counting::default();
            write(&parts, encoding, &mut out).unwrap();
            assert!(out.bytes.starts_with(b"ply\n") && out.bytes.ends_with(&last), "{encoding:?}");
            assert!(out.calls <= 1 + out.bytes.len() / BLOCK, "{encoding:?}: {} calls", out.calls);
            if encoding != Encoding::Ascii {
                let header = out.bytes.windows(11).position(|bytes| bytes == b"end_header\n").unwrap() + 11;
                assert_eq!(out.bytes.len() - header, 4 * 17 * usize::from(COUNT), "{encoding:?}");
            }
        }
    }
}
