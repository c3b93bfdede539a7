//! `cameras.txt`, `images.txt`, `points3D.txt`: whitespace-separated columns, `#` comments.

use std::cell::LazyCell;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use atsplat_camera::ImageSize;
use atsplat_files::{quoted, without_byte_order_mark};
use glam::DVec3;

use super::source::UNIT;
use super::{
    ColmapCamera, ColmapCameraModel, ColmapImage, ColmapPoint, by_id, length_of, malformed, pose_or_reason,
    require_new_id,
};
use crate::SceneError;
use crate::number::{Columns, parse_f64, parse_i64, parse_u64};

/// `CAMERA_ID MODEL WIDTH HEIGHT PARAMS…`
///
/// A file that was cut off between two cameras has fewer than its header states.
pub(super) fn cameras(text: &[u8], path: &Path) -> Result<BTreeMap<u32, ColmapCamera>, SceneError> {
    let camera = |(number, line)| {
        let mut row = Row::new(line, number, path);
        let id = row.integer("CAMERA_ID")?;
        let name = row.column("MODEL")?;
        let model = std::str::from_utf8(name).ok().and_then(ColmapCameraModel::from_name);
        let model = model.ok_or_else(|| {
            SceneError::unsupported_model(path, row.location("MODEL"), quoted(name), "COLMAP has no such model")
        })?;
        let size = ImageSize { width: row.length("WIDTH")?, height: row.length("HEIGHT")? };
        let parameters: Vec<f64> = std::iter::from_fn(|| row.next_number("PARAMS")).collect::<Result<_, _>>()?;
        if parameters.len() != model.parameter_count() {
            let expected = format!("{} parameters of {}", model.parameter_count(), model.name());
            return Err(malformed(path, row.location("PARAMS"), expected, parameters.len().to_string()));
        }
        Ok((id, ColmapCamera { model, size, parameters }, row.location("CAMERA_ID")))
    };
    let cameras = by_id(content_lines(text).map(camera), path)?;
    require_stated(text, "cameras", cameras.len(), path)?;
    Ok(cameras)
}

/// Two lines per image: `IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME`, then its keypoints, possibly an empty line.
/// Names may contain spaces.
///
/// Tools that have no keypoints may omit the second line, where COLMAP writes an empty one. Both are accepted: a line of
/// keypoints has only numbers, an image's line ends with a name. One without a name is distinguished from three keypoints by its
/// quaternion, unless the file has keypoints elsewhere.
///
/// A file that was cut off between two images has fewer than its header states.
pub(super) fn images(text: &[u8], path: &Path) -> Result<Vec<ColmapImage>, SceneError> {
    let mut images = Vec::new();
    let mut ids = BTreeSet::new();
    let with_keypoints = LazyCell::new(|| has_keypoints(text));
    let is_second_line = |line: &[u8]| {
        is_keypoints(line) && (!lacks_only_a_name(line) || (has_whole_point_ids(line) && *with_keypoints))
    };
    let mut lines = numbered_lines(text).peekable();
    while let Some((number, line)) = lines.next() {
        if has_content(line) {
            let image = image(line, number, path)?;
            require_new_id(&mut ids, image.id, &format!("line {number}, IMAGE_ID"), path)?;
            images.push(image);
            lines.next_if(|&(_, line)| is_second_line(line));
        }
    }
    require_stated(text, "images", images.len(), path)?;
    Ok(images)
}

/// An error if the comments at the start of a file state another number of items than it has.
fn require_stated(text: &[u8], items: &str, found: usize, path: &Path) -> Result<(), SceneError> {
    let mut comments = numbered_lines(text).take_while(|(_, line)| !has_content(line));
    let stated = comments.find_map(|(number, line)| Some((number, stated_count(line, items)?)));
    match stated {
        Some((number, count)) if count != found as u64 => {
            let (location, expected) = (format!("line {number}"), format!("{count} {items}, as the comment states"));
            Err(malformed(path, location, expected, found.to_string()))
        }
        _ => Ok(()),
    }
}

/// The number of `items` in COLMAP's comment, such as `# Number of images: 12, mean observations per image: 3.8`.
fn stated_count(comment: &[u8], items: &str) -> Option<u64> {
    let rest = comment.trim_ascii().strip_prefix(b"#")?.trim_ascii_start().strip_prefix(b"Number of ")?;
    let rest = rest.strip_prefix(items.as_bytes())?.strip_prefix(b":")?.trim_ascii_start();
    let digits = rest.iter().position(|byte| !byte.is_ascii_digit()).unwrap_or(rest.len());
    parse_u64(rest.get(..digits)?)
}

/// Whether a line is `X Y POINT3D_ID` repeated any number of times.
fn is_keypoints(line: &[u8]) -> bool {
    let mut count = 0;
    let numbers = Columns::of(line).inspect(|_| count += 1).all(|column| parse_f64(column).is_some());
    numbers && count % 3 == 0
}

/// Whether a line of numbers is that of an image except for its name: nine columns with whole ids and a quaternion of
/// length 1. Of three keypoints, the second would be within a pixel of the image's corner.
fn lacks_only_a_name(line: &[u8]) -> bool {
    let columns: Vec<&[u8]> = Columns::of(line).take(10).collect();
    let [id, w, x, y, z, _, _, _, camera_id] = columns.as_slice() else { return false };
    let [Some(w), Some(x), Some(y), Some(z)] = [w, x, y, z].map(|column| parse_f64(column)) else { return false };
    let has_ids = parse_u64(id).is_some() && parse_u64(camera_id).is_some();
    has_ids && UNIT.accepts(length_of([w, x, y, z]), 1.0)
}

/// Whether every `POINT3D_ID` of a line of keypoints is whole.
fn has_whole_point_ids(line: &[u8]) -> bool {
    Columns::of(line).skip(2).step_by(3).all(|column| parse_i64(column).is_some())
}

/// Whether a file shows that its images have lines of keypoints: by COLMAP's header, or by a line that can be nothing
/// else.
fn has_keypoints(text: &[u8]) -> bool {
    const HEADER: &[u8] = b"POINTS2D";
    numbered_lines(text).any(|(_, line)| {
        let line = line.trim_ascii();
        match line.first() {
            None => false,
            Some(b'#') => line.windows(HEADER.len()).any(|part| part == HEADER),
            Some(_) => is_keypoints(line) && !lacks_only_a_name(line),
        }
    })
}

fn image(line: &[u8], number: usize, path: &Path) -> Result<ColmapImage, SceneError> {
    let mut row = Row::new(line, number, path);
    let id = row.integer("IMAGE_ID")?;
    let quaternion = [row.number("QW")?, row.number("QX")?, row.number("QY")?, row.number("QZ")?];
    let translation = [row.number("TX")?, row.number("TY")?, row.number("TZ")?];
    let camera_id = row.integer("CAMERA_ID")?;
    let name = row.columns.rest();
    let name = std::str::from_utf8(name).ok().filter(|name| !name.is_empty());
    let name = name.ok_or_else(|| malformed(path, row.location("NAME"), "a UTF-8 name", quoted(row.columns.rest())))?;
    let places = ["QW", "TX"].map(|field| row.location(field));
    let camera_from_world = pose_or_reason(quaternion, translation, path, places);
    let quaternion_length = length_of(quaternion);
    Ok(ColmapImage { id, name: name.to_owned(), camera_id, camera_from_world, quaternion_length })
}

/// `POINT3D_ID X Y Z R G B ERROR TRACK…`, where the track is pairs of `IMAGE_ID POINT2D_IDX`.
///
/// A file that was cut off between two points has fewer than its header states.
pub(super) fn points(text: &[u8], path: &Path) -> Result<Vec<ColmapPoint>, SceneError> {
    let point = |(number, line)| {
        let mut row = Row::new(line, number, path);
        let id = row.integer("POINT3D_ID")?;
        let position = DVec3::new(row.finite("X")?, row.finite("Y")?, row.finite("Z")?);
        let color = [row.integer("R")?, row.integer("G")?, row.integer("B")?];
        let error = row.number("ERROR")?;
        while !row.columns.rest().is_empty() {
            row.integer::<u32>("IMAGE_ID")?;
            row.integer::<u32>("POINT2D_IDX")?;
        }
        Ok(ColmapPoint { id, position, color, error })
    };
    let points: Vec<_> = content_lines(text).map(point).collect::<Result<_, SceneError>>()?;
    require_stated(text, "points", points.len(), path)?;
    Ok(points)
}

/// Lines with their numbers, from 1.
fn numbered_lines(text: &[u8]) -> impl Iterator<Item = (usize, &[u8])> {
    let text = without_byte_order_mark(text);
    text.split(|byte| *byte == b'\n').enumerate().map(|(index, line)| (index + 1, line))
}

fn content_lines(text: &[u8]) -> impl Iterator<Item = (usize, &[u8])> {
    numbered_lines(text).filter(|(_, line)| has_content(line))
}

fn has_content(line: &[u8]) -> bool {
    let line = line.trim_ascii();
    !line.is_empty() && !line.starts_with(b"#")
}

/// One line being read column by column.
struct Row<'a> {
    columns: Columns<'a>,
    line: usize,
    path: &'a Path,
}

impl<'a> Row<'a> {
    const fn new(line: &'a [u8], number: usize, path: &'a Path) -> Self {
        Self { columns: Columns::of(line), line: number, path }
    }

    fn location(&self, field: &str) -> String {
        format!("line {}, {field}", self.line)
    }

    fn column(&mut self, field: &str) -> Result<&'a [u8], SceneError> {
        let column = self.columns.next();
        column.ok_or_else(|| malformed(self.path, self.location(field), "a value", "the end of the line"))
    }

    fn integer<N: TryFrom<u64>>(&mut self, field: &str) -> Result<N, SceneError> {
        let column = self.column(field)?;
        let value = parse_u64(column).and_then(|value| N::try_from(value).ok());
        value.ok_or_else(|| {
            let expected = format!("a whole number of {} bits", 8 * size_of::<N>());
            malformed(self.path, self.location(field), expected, quoted(column))
        })
    }

    fn length(&mut self, field: &str) -> Result<u32, SceneError> {
        match self.integer(field)? {
            0 => Err(malformed(self.path, self.location(field), "a length above 0", "0")),
            length => Ok(length),
        }
    }

    fn number(&mut self, field: &str) -> Result<f64, SceneError> {
        let column = self.column(field)?;
        parse_f64(column).ok_or_else(|| malformed(self.path, self.location(field), "a number", quoted(column)))
    }

    fn next_number(&mut self, field: &str) -> Option<Result<f64, SceneError>> {
        (!self.columns.rest().is_empty()).then(|| self.number(field))
    }

    fn finite(&mut self, field: &str) -> Result<f64, SceneError> {
        let value = self.number(field)?;
        if value.is_finite() {
            return Ok(value);
        }
        Err(malformed(self.path, self.location(field), "a finite number", value.to_string()))
    }
}
