//! PLY (Turk 1994) with the properties of 3DGS or of PlayCanvas' compressed variant.

mod ascii;
mod binary;
mod compressed;
mod gaussians;
mod header;
mod rows;
mod write;

pub(super) use write::write;

use super::{Encoding, Fault, Format, Stored};
use header::Header;
use rows::Body;

pub(super) fn read(bytes: &[u8]) -> Result<Stored, Fault> {
    let header = Header::parse(bytes)?;
    let mut body = Body::of(bytes, &header);
    let stored = if compressed::is_described_by(&header) {
        compressed::read(&header, &mut body)?
    } else {
        gaussians::read(&header, &mut body)?
    };
    body.finish(&header)?;
    Ok(stored)
}
