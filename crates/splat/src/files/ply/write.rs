use std::io::{self, Write};

use super::Encoding;
use super::gaussians::{FILTER, UNCERTAINTY};
use crate::{GaussianParts, LOGIT_OF_INFINITY, sh_coefficients};

/// Writes 3DGS' properties in 3DGS' order with zero normals, as every viewer expects them, then the optional ones.
///
/// An infinite opacity logit becomes ±20, because graphdeco's viewer and others turn it into NaN.
pub(in super::super) fn write(parts: &GaussianParts, encoding: Encoding, out: &mut impl Write) -> io::Result<()> {
    let name = match encoding {
        Encoding::Ascii => "ascii",
        Encoding::BinaryLittleEndian => "binary_little_endian",
        Encoding::BinaryBigEndian => "binary_big_endian",
    };
    write!(out, "ply\nformat {name} 1.0\nelement vertex {}\n", parts.means.len())?;
    for property in properties(parts) {
        writeln!(out, "property float {property}")?;
    }
    out.write_all(b"end_header\n")?;

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
        write_row(&row, encoding, out)?;
    }
    Ok(())
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

fn write_row(row: &[f32], encoding: Encoding, out: &mut impl Write) -> io::Result<()> {
    match encoding {
        Encoding::BinaryLittleEndian => row.iter().try_for_each(|value| out.write_all(&value.to_le_bytes())),
        Encoding::BinaryBigEndian => row.iter().try_for_each(|value| out.write_all(&value.to_be_bytes())),
        Encoding::Ascii => {
            // The shortest decimals that read back as the same f32.
            for (at, value) in row.iter().enumerate() {
                let blank = if at == 0 { "" } else { " " };
                write!(out, "{blank}{value:?}")?;
            }
            out.write_all(b"\n")
        }
    }
}
