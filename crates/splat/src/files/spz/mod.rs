//! SPZ, Niantic's quantised format (nianticlabs/spz `src/cc/load-spz.cc`, `README.md`).
//!
//! Versions 1 to 3 are one gzip stream: a header of 16 bytes, then all centres, all opacities, and so on.
//! Version 4 has a header of 32 bytes and one Zstandard stream per attribute. Stored axes are +x right, +y up,
//! +z back unless an extension names others.

mod axes;
mod container;
mod decode;
mod encode;
mod header;
mod quaternions;

pub(super) use container::{GZIP_MAGIC, compress, is_gzip};
pub(super) use encode::encode;
pub(super) use header::MAGIC;

use super::{ExportReport, Format, Malformed, Stored};
use axes::Axes;
use container::Container;

/// Colours are stored as `0.5 + COLOUR_SCALE · sh[0]`, which leaves room beyond [0, 1].
const COLOUR_SCALE: f64 = 0.15;

pub(super) fn read(bytes: &[u8]) -> Result<Stored, Malformed> {
    let Container { header, attributes, extensions, mut unused } = Container::open(bytes)?;
    let axes = Axes::from_extensions(&extensions, &mut unused)?;
    if header.unknown_flags != 0 {
        unused.push(format!("flags 0x{:02x}", header.unknown_flags));
    }
    let mut parts = decode::decode(&header, &attributes);
    axes.ply_from_stored(&mut parts);
    let (format, antialiased) = (Format::Spz(header.version), Some(header.antialiased));
    Ok(Stored { parts, format, unused, integers: Vec::new(), antialiased })
}
