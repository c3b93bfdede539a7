use std::io::{self, Write};
use std::path::Path;

use atsplat_camera::{Camera, CameraError, CameraFromWorld, NormalizedIntrinsics};
use atsplat_files::{quoted, without_byte_order_mark};

use crate::files::read_file;
use crate::number::{Columns, parse_f64, parse_i64};
use crate::{Frame, FrameImage, Scene, SceneError};

const FORMAT: &str = "RE10K trajectory";

/// Names of the 19 columns, for messages.
#[rustfmt::skip]
const COLUMNS: [&str; 19] = [
    "timestamp", "fx", "fy", "cx", "cy", "k1", "k2",
    "r00", "r01", "r02", "tx", "r10", "r11", "r12", "ty", "r20", "r21", "r22", "tz",
];

/// One RE10K trajectory file: the camera path of one video clip.
#[derive(Clone, Debug, PartialEq)]
pub struct Trajectory {
    /// The first line, if it is not a row: the video's URL in official files, a `#` comment in others.
    pub header: Option<String>,
    /// Rows in the file's order, which evaluation indices refer to.
    pub rows: Vec<TrajectoryRow>,
}

/// One row of a trajectory.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrajectoryRow {
    /// Presentation time in the video, in microseconds.
    pub timestamp_micros: i64,
    /// Intrinsics in units of the image's width and height.
    pub intrinsics: NormalizedIntrinsics,
    /// Columns 6 and 7, reserved for radial distortion: zero in RE10K and not read by any loader of the field.
    pub radial: [f64; 2],
    /// World-to-camera transform with OpenCV axes, exactly as in the file.
    pub camera_from_world: CameraFromWorld,
}

/// Reads and parses one trajectory file.
///
/// # Errors
/// [`SceneError::Io`], and those of [`parse_trajectory`].
pub fn read_trajectory(path: &Path) -> Result<Trajectory, SceneError> {
    parse_trajectory(&read_file("reading a trajectory", path)?, path)
}

/// A trajectory, and the positions of rows whose pose is unusable, with the reason: theirs is unknown.
pub(super) type PartlyPosed = (Trajectory, Vec<(usize, SceneError)>);

/// [`read_trajectory`] for a scene, of which frames may have no pose.
pub(super) fn read_partly_posed(path: &Path) -> Result<PartlyPosed, SceneError> {
    parse_partly_posed(&read_file("reading a trajectory", path)?, path)
}

/// Parses the text of an RE10K trajectory; `path` is for messages only.
///
/// An optional first line (the video's URL, or a comment), then rows of 19 whitespace-separated columns:
/// `timestamp` in microseconds, `fx fy cx cy` normalised, two unused slots, and the row-major 3×4
/// world-to-camera matrix with OpenCV axes (`real_estate_10k_tools` `src/convert.py:76-97`; pixelSplat
/// `src/dataset/dataset_re10k.py:179-197`).
///
/// A byte order mark, carriage returns, blank lines and trailing blanks are accepted. The first line is a header if it
/// starts with `#`, contains `://`, or is a single word that is not a number; pixelSplat's converter always skips the
/// first line, so it loses a row of a file without a header. Numbers are parsed exactly like `str::parse::<f64>`. A
/// last number without a line end that has fewer decimals than every other of its row was cut off, which is an error.
///
/// # Errors
/// [`SceneError::Malformed`] with line and column, [`SceneError::Camera`] for a row with an invalid camera.
pub fn parse_trajectory(text: &[u8], path: &Path) -> Result<Trajectory, SceneError> {
    let (trajectory, unposed) = parse_partly_posed(text, path)?;
    unposed.into_iter().next().map_or(Ok(trajectory), |(_, error)| Err(error))
}

fn parse_partly_posed(text: &[u8], path: &Path) -> Result<PartlyPosed, SceneError> {
    let text = without_byte_order_mark(text);
    let (mut trajectory, mut unposed) = (Trajectory { header: None, rows: Vec::new() }, Vec::new());
    for (index, line) in text.split(|byte| *byte == b'\n').enumerate() {
        if index == 0 && is_header(line) {
            trajectory.header = Some(String::from_utf8_lossy(line.trim_ascii()).into_owned());
            continue;
        }
        if !line.trim_ascii().is_empty() {
            let (row, of_pose) = parse_row(line).map_err(|problem| problem.at(index + 1, path))?;
            let located = |source| RowProblem::Camera(source).at(index + 1, path);
            unposed.extend(of_pose.map(|source| (trajectory.rows.len(), located(source))));
            trajectory.rows.push(row);
        }
    }
    if trajectory.rows.is_empty() {
        let found = format!("none in {} bytes", text.len());
        return Err(SceneError::malformed(FORMAT, path, "whole file", "at least one row of 19 columns", found));
    }
    if let Some(number) = cut_off_number(text) {
        let location = format!("line {}, column 19 (tz)", text.split(|byte| *byte == b'\n').count());
        let found = format!("{} at the end of the file: is it cut off?", quoted(number));
        return Err(SceneError::malformed(FORMAT, path, location, "as many decimals as in the columns before", found));
    }
    Ok((trajectory, unposed))
}

/// The last number of a text that does not end with a line end, if it has fewer decimals than the others of its row,
/// which have equally many.
fn cut_off_number(text: &[u8]) -> Option<&[u8]> {
    let row = text.rsplit(|byte| *byte == b'\n').next()?;
    let numbers: Vec<&[u8]> = Columns::of(row).skip(1).collect();
    let (last, others) = numbers.split_last()?;
    let decimals = |number: &[u8]| number.iter().rev().position(|byte| *byte == b'.').unwrap_or(0);
    let expected = decimals(others.first()?);
    let is_cut_off = decimals(last) < expected && others.iter().all(|number| decimals(number) == expected);
    is_cut_off.then_some(*last)
}

impl Trajectory {
    /// The video's URL, if the header has one.
    pub fn url(&self) -> Option<&str> {
        self.header.as_deref().filter(|header| !header.starts_with('#'))
    }

    /// The scene without images, with frames named by timestamp.
    pub fn to_scene(&self, key: &str) -> Scene {
        let frame = |row: &TrajectoryRow| Frame {
            name: row.timestamp_micros.to_string(),
            timestamp_micros: Some(row.timestamp_micros),
            camera: Camera::pinhole(row.camera_from_world, row.intrinsics),
            stated_size: None,
            image: FrameImage::Absent,
        };
        Scene { key: key.to_owned(), url: self.url().map(str::to_owned), frames: self.rows.iter().map(frame).collect() }
    }
}

/// Whether the first or second line that is not blank is a row of 19 numbers.
pub(crate) fn starts_like_a_trajectory(start: &[u8]) -> bool {
    let start = without_byte_order_mark(start);
    let lines = start.split(|byte| *byte == b'\n').filter(|line| !line.trim_ascii().is_empty());
    lines.take(2).any(|line| split_row(line).is_ok_and(|row| row.iter().all(|column| parse_f64(column).is_some())))
}

/// Whether a line is a URL, a comment, or a video name; a malformed row of numbers is not a header.
fn is_header(line: &[u8]) -> bool {
    let line = line.trim_ascii();
    let mut columns = Columns::of(line);
    let only = columns.next().filter(|_| columns.next().is_none());
    line.starts_with(b"#")
        || line.windows(3).any(|window| window == b"://")
        || only.is_some_and(|word| parse_f64(word).is_none())
}

/// An error in a row, before line and file are known.
enum RowProblem {
    Text { location: String, expected: &'static str, found: String },
    Camera(CameraError),
}

impl RowProblem {
    fn at(self, line: usize, path: &Path) -> SceneError {
        match self {
            Self::Text { location, expected, found } => {
                SceneError::malformed(FORMAT, path, format!("line {line}{location}"), expected, found)
            }
            Self::Camera(source) => SceneError::camera(path, format!("line {line}"))(source),
        }
    }
}

/// The row, and what is wrong with its pose.
fn parse_row(line: &[u8]) -> Result<(TrajectoryRow, Option<CameraError>), RowProblem> {
    let [timestamp, numbers @ ..] = split_row(line)?;
    let timestamp_micros = parse_i64(timestamp).ok_or_else(|| bad_column(0, "whole microseconds", timestamp))?;
    let mut values = [0.0; 18];
    for (index, (value, token)) in values.iter_mut().zip(numbers).enumerate() {
        *value = parse_f64(token).ok_or_else(|| bad_column(index + 1, "a number", token))?;
    }
    let [fx, fy, cx, cy, k1, k2, pose @ ..] = values;
    for (index, slot) in [(5, k1), (6, k2)] {
        if !slot.is_finite() {
            return Err(bad_column(index, "a finite number", slot.to_string().as_bytes()));
        }
    }
    let intrinsics = NormalizedIntrinsics::new(fx, fy, cx, cy).map_err(RowProblem::Camera)?;
    let (camera_from_world, problem) = match CameraFromWorld::from_rows(&pose) {
        Ok(pose) => (pose, None),
        Err(problem) => (CameraFromWorld::UNKNOWN, Some(problem)),
    };
    Ok((TrajectoryRow { timestamp_micros, intrinsics, radial: [k1, k2], camera_from_world }, problem))
}

fn split_row(line: &[u8]) -> Result<[&[u8]; 19], RowProblem> {
    let mut row: [&[u8]; 19] = [&[]; 19];
    let mut count = 0;
    for token in Columns::of(line) {
        if let Some(slot) = row.get_mut(count) {
            *slot = token;
        }
        count += 1;
    }
    if count == row.len() {
        return Ok(row);
    }
    let found = format!("{count}: {}", quoted(line.trim_ascii()));
    Err(RowProblem::Text { location: String::new(), expected: "19 columns", found })
}

fn bad_column(index: usize, expected: &'static str, token: &[u8]) -> RowProblem {
    let name = COLUMNS.get(index).unwrap_or_else(|| unreachable!("a row has 19 columns"));
    RowProblem::Text { location: format!(", column {} ({name})", index + 1), expected, found: quoted(token) }
}

/// Writes a trajectory that [`parse_trajectory`] reads back bit for bit.
///
/// Numbers that nine decimals represent exactly are written with nine, so that official files are reproduced byte for
/// byte; others get the shortest text that round-trips.
///
/// # Errors
/// Those of `out`, and [`io::ErrorKind::InvalidInput`] for a header that would not be read back as one.
pub fn write_trajectory(trajectory: &Trajectory, out: &mut impl Write) -> io::Result<()> {
    if let Some(header) = &trajectory.header {
        if header.contains(['\n', '\r']) || header.trim_ascii() != header || !is_header(header.as_bytes()) {
            let reason = format!("expected a URL or a # comment as header, found {header:?}");
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

#[cfg(test)]
mod tests;
