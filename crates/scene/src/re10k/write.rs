use std::io::{self, Write};

use super::{Trajectory, TrajectoryRow, trajectory::is_header};

/// Writes a trajectory so that [`super::parse_trajectory`] gives back the same bits.
///
/// Numbers that nine decimals hold are printed with nine, so that an official file comes out byte for
/// byte; others get the shortest text that reads back the same.
///
/// # Errors
/// What `out` says, and [`io::ErrorKind::InvalidInput`] for a header that would not read back as one.
pub fn write_trajectory(trajectory: &Trajectory, out: &mut impl Write) -> io::Result<()> {
    if let Some(header) = &trajectory.header {
        if header.contains(['\n', '\r']) || header.trim_ascii() != header || !is_header(header.as_bytes()) {
            let reason = format!("a trajectory's header is one URL or one # comment, not {header:?}");
            return Err(io::Error::new(io::ErrorKind::InvalidInput, reason));
        }
        writeln!(out, "{header}")?;
    }
    trajectory.rows.iter().try_for_each(|row| write_row(row, out))
}

fn write_row(row: &TrajectoryRow, out: &mut impl Write) -> io::Result<()> {
    let k = row.intrinsics;
    write!(out, "{}", row.timestamp_micros)?;
    let numbers = [k.fx, k.fy, k.cx, k.cy].into_iter().chain(row.radial).chain(row.camera_from_world.to_rows());
    for number in numbers {
        let nine_decimals = format!("{number:.9}");
        if nine_decimals.parse::<f64>().is_ok_and(|back| back.to_bits() == number.to_bits()) {
            write!(out, " {nine_decimals}")?;
        } else {
            write!(out, " {number:?}")?;
        }
    }
    writeln!(out)
}
