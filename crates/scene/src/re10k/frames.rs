use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use crate::files::ImageListing;
use crate::{Frame, FrameImage, Scene, SceneError, WarningKind, Warnings};

/// The naming scheme of a clip's images.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Naming {
    /// `<timestamp>.jpg`, as written by `real_estate_10k_tools` (`src/convert.py:69-73`).
    Timestamp,
    /// Row `i` is image `first + i`.
    Numbered { first: i64 },
}

impl Naming {
    /// The number in the name of a row's image.
    fn number(self, row: usize, frame: &Frame) -> Option<i64> {
        match self {
            Self::Timestamp => frame.timestamp_micros,
            Self::Numbered { first } => i64::try_from(row).ok().map(|row| row.saturating_add(first)),
        }
    }

    /// The name, without extension, that a missing image would have.
    fn expected_stem(self, row: usize, frame: &Frame) -> String {
        match self {
            Self::Timestamp => frame.name.clone(),
            Self::Numbered { first } => format!("{:05}", first.saturating_add_unsigned(row as u64)),
        }
    }
}

/// Assigns each frame its image from the first of `folders` that contains images with a number in their name.
///
/// If no folder exists, the frames stay [`FrameImage::Absent`], unless images are `expected`, which is asked only then.
/// Otherwise a frame without a file becomes [`FrameImage::Missing`], with a warning. Images with a number that no row has are
/// counted too: deleted rows leave them, and shift the position of every later frame. Others, such as `cover.jpg`, cannot belong
/// to a row.
pub(super) fn attach_images(
    scene: &mut Scene,
    folders: &[PathBuf],
    expected: impl FnOnce() -> bool,
    warnings: &mut Warnings,
) -> Result<(), SceneError> {
    let listing = match (first_with_numbers(folders)?, folders.first()) {
        (Some(listing), _) => listing,
        (None, Some(folder)) if expected() => ImageListing::empty(folder.clone()),
        (None, _) => return Ok(()),
    };
    let numbers = stems_by_number(&listing, &scene.key, warnings);
    let naming = naming(scene, &numbers, warnings);
    let mut choices = Vec::new();
    let mut unlisted: BTreeSet<i64> = numbers.keys().copied().collect();
    for (row, frame) in scene.frames.iter_mut().enumerate() {
        let number = naming.number(row, frame);
        if let Some(number) = number {
            unlisted.remove(&number);
        }
        let stem = number.and_then(|number| numbers.get(&number));
        choices.extend(stem.and_then(|stem| listing.choice_of_stem(stem)));
        frame.image = if let Some(path) = stem.and_then(|stem| listing.by_stem(stem)) {
            FrameImage::File(path)
        } else {
            let path = listing.expected(&naming.expected_stem(row, frame));
            warnings.push(WarningKind::MissingImage, &scene.key, format!("frame {row}: no {}", path.display()));
            FrameImage::Missing(path)
        };
    }
    if let Some(first) = choices.first() {
        let (count, folder) = (choices.len(), listing.folder().display());
        let detail = format!("{count} rows fit several images in {folder}, first: {first}");
        warnings.push(WarningKind::AmbiguousNumbering, &scene.key, detail);
    }
    for path in unlisted.iter().filter_map(|number| listing.by_stem(numbers.get(number)?)) {
        let detail = format!("no row of the trajectory belongs to {}: is a row missing?", path.display());
        warnings.push(WarningKind::UnlistedImage, &scene.key, detail);
    }
    Ok(())
}

/// The images with a number in their name. Of several with one number the one named as documented is used, with a warning, because
/// others may be masks or depth maps.
fn stems_by_number<'a>(listing: &'a ImageListing, key: &str, warnings: &mut Warnings) -> BTreeMap<i64, &'a str> {
    let mut stems: BTreeMap<i64, &str> = BTreeMap::new();
    let mut repeated = Vec::new();
    for (number, stem) in listing.stems().filter_map(|stem| Some((number_of(stem)?, stem))) {
        if let Some(other) = stems.insert(number, stem) {
            let (used, unused) = if rank(other) < rank(stem) { (other, stem) } else { (stem, other) };
            stems.insert(number, used);
            repeated.push(format!("{used} is used, not {unused}"));
        }
    }
    if let Some(first) = repeated.first() {
        let (count, folder) = (repeated.len(), listing.folder().display());
        let detail = format!("{count} images have the same number as another image in {folder}, first: {first}");
        warnings.push(WarningKind::AmbiguousNumbering, key, detail);
    }
    stems
}

/// The first folder with images that have a number in their name; otherwise the first that exists.
fn first_with_numbers(folders: &[PathBuf]) -> Result<Option<ImageListing>, SceneError> {
    let mut other = None;
    for folder in folders {
        match ImageListing::read(folder)? {
            Some(listing) if has_numbers(&listing) => return Ok(Some(listing)),
            Some(listing) => other = other.or(Some(listing)),
            None => {}
        }
    }
    Ok(other)
}

/// Whether one of `folders` contains images that can belong to rows.
pub(super) fn have_numbers(folders: &[PathBuf]) -> bool {
    first_with_numbers(folders).ok().flatten().is_some_and(|listing| has_numbers(&listing))
}

fn has_numbers(listing: &ImageListing) -> bool {
    listing.stems().any(|stem| number_of(stem).is_some())
}

/// The number at the end of a stem, after the last underscore: `00012`, `frame_00012`, `45979267`.
fn number_of(stem: &str) -> Option<i64> {
    let digits = stem.rsplit('_').next()?;
    is_number(digits).then(|| digits.parse().ok())?
}

/// How far a stem is from the documented names: a number alone, then `frame_` and a number.
fn rank(stem: &str) -> usize {
    ["", "frame_"].iter().position(|prefix| stem.strip_prefix(*prefix).is_some_and(is_number)).unwrap_or(2)
}

fn is_number(digits: &str) -> bool {
    digits.bytes().all(|byte| byte.is_ascii_digit())
}

/// The naming scheme that finds more images; timestamps in case of a tie.
///
/// Numbers start from 0 if an image 0 exists, else from 1. This is unambiguous if exactly one of image 0 and image
/// `rows` exists; otherwise there is a warning.
fn naming(scene: &Scene, numbers: &BTreeMap<i64, &str>, warnings: &mut Warnings) -> Naming {
    let has = |number: i64| numbers.contains_key(&number);
    let rows = i64::try_from(scene.frames.len()).unwrap_or(i64::MAX);
    let first = i64::from(!has(0));
    let by_time = scene.frames.iter().filter(|frame| frame.timestamp_micros.is_some_and(has)).count();
    let by_number = numbers.range(first..rows.saturating_add(first)).count();
    if by_time >= by_number {
        return Naming::Timestamp;
    }
    if has(0) == has(rows) {
        let (least, most) = (numbers.keys().next(), numbers.keys().next_back());
        let (least, most) = least.zip(most).unwrap_or_else(|| unreachable!("by_number > by_time >= 0"));
        let detail = format!("images {least} to {most} for {rows} rows: assumed to start from {first}");
        warnings.push(WarningKind::AmbiguousNumbering, &scene.key, detail);
    }
    Naming::Numbered { first }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::re10k::parse_trajectory;
    use std::path::Path;

    fn scene() -> Scene {
        let rows: String =
            [0, 33_366, 66_733].map(|t| format!("{t} 0.5 0.9 0.5 0.5 0 0 1 0 0 0 0 1 0 0 0 0 1 0\n")).concat();
        parse_trajectory(rows.as_bytes(), Path::new("clip.txt")).unwrap().to_scene("clip")
    }

    fn attach(names: &[&str]) -> (Scene, Warnings) {
        let folder = tempfile::tempdir().unwrap();
        for name in names {
            std::fs::write(folder.path().join(name), b"").unwrap();
        }
        let (mut scene, mut warnings) = (scene(), Warnings::new());
        attach_images(&mut scene, &[folder.path().to_owned()], || false, &mut warnings).unwrap();
        (scene, warnings)
    }

    fn names(scene: &Scene) -> Vec<String> {
        let name = |path: &Path| path.file_name().unwrap().to_string_lossy().into_owned();
        let shown = |frame: &Frame| match &frame.image {
            FrameImage::File(path) => name(path),
            FrameImage::Missing(path) => format!("no {}", name(path)),
            other => format!("{other:?}"),
        };
        scene.frames.iter().map(shown).collect()
    }

    #[test]
    fn images_are_found_by_timestamp_and_missing_ones_keep_their_position() {
        let (scene, warnings) = attach(&["66733.png", "0.png", "999.png"]);
        assert_eq!(names(&scene), ["0.png", "no 33366.png", "66733.png"]);
        let counts: Vec<_> = warnings.counts().collect();
        assert_eq!(counts, [(WarningKind::MissingImage, 1), (WarningKind::UnlistedImage, 1)]);
        assert!(warnings.kept()[1].detail.contains("999.png"), "{:?}", warnings.kept());
    }

    #[test]
    fn numbers_start_from_zero_or_one() {
        for (files, first) in [(["00000.jpg", "00001.jpg", "00002.jpg"], 0), (["1.jpg", "2.jpg", "3.jpg"], 1)] {
            let (scene, warnings) = attach(&files);
            assert_eq!(names(&scene), files, "from {first}");
            assert_eq!(warnings.total(), 0, "from {first}");
        }
    }

    /// With three rows: four images by time, then by number; a cover belongs to no row, whichever are lost.
    #[test]
    fn images_of_lost_rows_are_counted() {
        let (_, warnings) = attach(&["0.png", "33366.png", "50000.png", "66733.png", "cover.png"]);
        assert_eq!(warnings.counts().collect::<Vec<_>>(), [(WarningKind::UnlistedImage, 1)]);
        assert!(warnings.kept()[0].detail.contains("50000.png"), "{:?}", warnings.kept());
        let (scene, warnings) = attach(&["00001.png", "00002.png", "00003.png", "00004.png", "00005.png"]);
        assert_eq!(names(&scene), ["00001.png", "00002.png", "00003.png"]);
        assert_eq!(warnings.counts().collect::<Vec<_>>(), [(WarningKind::UnlistedImage, 2)]);
        let (_, warnings) = attach(&["0.png", "66733.png"]);
        assert_eq!(warnings.counts().collect::<Vec<_>>(), [(WarningKind::MissingImage, 1)], "a subset of the rows");
    }

    #[test]
    fn ambiguous_numbers_are_reported() {
        let (scene, warnings) = attach(&["frame_1.png", "frame_2.png"]);
        assert_eq!(names(&scene), ["frame_1.png", "frame_2.png", "no 00003.png"]);
        assert_eq!(warnings.count(WarningKind::AmbiguousNumbering), 1);
    }

    #[test]
    fn two_images_with_one_number_are_reported() {
        let (scene, warnings) = attach(&["1.jpg", "frame_00001.jpg", "2.jpg", "3.jpg"]);
        assert_eq!(names(&scene), ["1.jpg", "2.jpg", "3.jpg"]);
        assert_eq!(warnings.counts().collect::<Vec<_>>(), [(WarningKind::AmbiguousNumbering, 1)]);
        assert!(warnings.kept()[0].detail.contains("1 is used, not frame_00001"), "{:?}", warnings.kept());
    }

    /// Before and after the frames in the order of names.
    #[test]
    fn masks_and_depth_maps_are_not_used_as_frames() {
        for frames in [["0.jpg", "33366.jpg", "66733.jpg"], ["frame_1.png", "frame_2.png", "frame_3.png"]] {
            let others = frames.into_iter().flat_map(|frame| {
                let (_, number) = frame.rsplit_once('_').unwrap_or(("", frame));
                ["depth", "mask"].map(|kind| format!("{kind}_{number}"))
            });
            let files: Vec<String> = others.chain(frames.map(str::to_owned)).collect();
            let (scene, warnings) = attach(&files.iter().map(String::as_str).collect::<Vec<_>>());
            assert_eq!(names(&scene), frames);
            let detail = &warnings.kept()[0].detail;
            assert!(warnings.total() == 1 && detail.starts_with("6 images have the same number"), "{detail}");
        }
    }

    /// As masks next to frames.
    #[test]
    fn two_images_that_differ_by_their_extension_are_reported() {
        for [first, second, third] in [["0", "33366", "66733"], ["00000", "00001", "00002"]] {
            let files =
                [(first, "jpg"), (second, "jpg"), (second, "png"), (third, "jpg"), (third, "webp"), ("cover", "png")];
            let files = files.map(|(stem, extension)| format!("{stem}.{extension}"));
            let (scene, warnings) = attach(&files.each_ref().map(String::as_str));
            assert_eq!(names(&scene), [0, 1, 3].map(|at: usize| files[at].as_str()));
            assert_eq!(warnings.counts().collect::<Vec<_>>(), [(WarningKind::AmbiguousNumbering, 1)]);
            let detail = &warnings.kept()[0].detail;
            assert!(detail.starts_with("2 rows fit several images"), "{detail}");
            assert!(detail.ends_with(&format!("first: {second}.jpg is used, not {second}.png")), "{detail}");
        }
    }

    #[test]
    fn images_are_missing_with_an_empty_folder_and_absent_without_one() {
        let (scene, warnings) = attach(&[]);
        assert_eq!(names(&scene), ["no 0.jpg", "no 33366.jpg", "no 66733.jpg"]);
        assert_eq!(warnings.count(WarningKind::MissingImage), 3);
        let (mut alone, mut warnings) = (self::scene(), Warnings::new());
        attach_images(&mut alone, &[PathBuf::from("/nowhere")], || false, &mut warnings).unwrap();
        assert!(alone.frames.iter().all(|frame| matches!(frame.image, FrameImage::Absent)));
        assert_eq!(warnings.total(), 0);
    }
}
