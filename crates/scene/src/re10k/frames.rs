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
/// Otherwise a frame without a file becomes [`FrameImage::Missing`], with a warning; so does one with several files, of which none
/// has the extension that the frames with one file share. Images with a number that no row has are counted too: deleted rows leave
/// them, and shift the position of every later frame. Others, such as `cover.jpg`, cannot belong to a row.
///
/// # Errors
/// [`SceneError::Io`], and [`SceneError::Unrecognized`] for images whose numbers do not say which rows they belong to.
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
    let naming = naming(scene, &listing, &numbers)?;
    let mut unlisted: BTreeSet<i64> = numbers.keys().copied().collect();
    let frames = scene.frames.iter().enumerate();
    let names: Vec<Vec<&str>> = frames
        .map(|(row, frame)| {
            let number = naming.number(row, frame);
            if let Some(number) = number {
                unlisted.remove(&number);
            }
            number.and_then(|number| numbers.get(&number)).map_or_else(Vec::new, |stem| listing.names(stem))
        })
        .collect();
    let shared = shared_extension(&names);
    let others = if numbers.is_empty() { images_without_numbers(&listing) } else { String::new() };
    let mut choices = Vec::new();
    for (row, (frame, names)) in scene.frames.iter_mut().zip(&names).enumerate() {
        frame.image = if let Some(used) = choice(names, shared) {
            let unused: Vec<&str> = names.iter().copied().filter(|name| *name != used).collect();
            if !unused.is_empty() {
                choices.push(format!("{used} is used, not {}", unused.join(", ")));
            }
            FrameImage::File(listing.folder().join(used))
        } else if names.is_empty() {
            let path = listing.expected(&naming.expected_stem(row, frame));
            warnings.push(WarningKind::MissingImage, &scene.key, format!("frame {row}: no {}{others}", path.display()));
            FrameImage::Missing(path)
        } else {
            let (found, folder) = (names.join(" and "), listing.folder().display());
            let detail = format!("frame {row}: expected one image, found {found} ({folder})");
            warnings.push(WarningKind::MissingImage, &scene.key, detail);
            FrameImage::Missing(listing.folder().join(format!("{}?", names.join(" or "))))
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

/// The extension of all frames with one file; `None` if they have several, or there is no such frame.
fn shared_extension<'a>(names: &[Vec<&'a str>]) -> Option<&'a str> {
    let mut alone = names.iter().filter_map(|names| match *names.as_slice() {
        [name] => Some(extension(name)),
        _ => None,
    });
    let first = alone.next()?;
    alone.all(|other| other.eq_ignore_ascii_case(first)).then_some(first)
}

/// The file to use of those with a row's number: the only one, or that with the shared extension.
fn choice<'a>(names: &[&'a str], shared: Option<&str>) -> Option<&'a str> {
    if let &[name] = names {
        return Some(name);
    }
    let shared = shared?;
    names.iter().copied().find(|name| extension(name).eq_ignore_ascii_case(shared))
}

fn extension(name: &str) -> &str {
    name.rsplit_once('.').map_or("", |(_, extension)| extension)
}

/// What is said about images that cannot belong to a row, where no other images are.
fn images_without_numbers(listing: &ImageListing) -> String {
    let mut stems = listing.stems();
    let Some(first) = stems.next().and_then(|stem| listing.names(stem).into_iter().next()) else {
        return String::new();
    };
    format!("; {} images there have names that do not end in a number, such as {first}", 1 + stems.count())
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

/// The first folder with images that have a number in their name; otherwise the first with images, or the first that exists.
fn first_with_numbers(folders: &[PathBuf]) -> Result<Option<ImageListing>, SceneError> {
    let (mut other, mut empty) = (None, None);
    for folder in folders {
        match ImageListing::read(folder)? {
            Some(listing) if has_numbers(&listing) => return Ok(Some(listing)),
            Some(listing) if listing.stems().next().is_some() => other = other.or(Some(listing)),
            Some(listing) => empty = empty.or(Some(listing)),
            None => {}
        }
    }
    Ok(other.or(empty))
}

/// Whether one of `folders` contains images that can belong to rows.
pub(super) fn have_numbers(folders: &[PathBuf]) -> bool {
    first_with_numbers(folders).ok().flatten().is_some_and(|listing| has_numbers(&listing))
}

fn has_numbers(listing: &ImageListing) -> bool {
    listing.stems().any(|stem| number_of(stem).is_some())
}

/// The number at the end of a stem, after the last underscore or hyphen: `00012`, `frame_00012`, `frame-00012`, `45979267`.
fn number_of(stem: &str) -> Option<i64> {
    let digits = stem.rsplit(['_', '-']).next()?;
    is_number(digits).then(|| digits.parse().ok())?
}

/// How far a stem is from the documented names: a number alone, then `frame_` and a number, then `frame-`.
fn rank(stem: &str) -> usize {
    let prefixes = ["", "frame_", "frame-"];
    prefixes.iter().position(|prefix| stem.strip_prefix(*prefix).is_some_and(is_number)).unwrap_or(prefixes.len())
}

fn is_number(digits: &str) -> bool {
    digits.bytes().all(|byte| byte.is_ascii_digit())
}

/// The naming scheme that finds more images; timestamps in case of a tie.
///
/// # Errors
/// [`SceneError::Unrecognized`] if the images fit the rows from several first numbers: with the wrong one, every pose would get
/// another row's image.
fn naming(scene: &Scene, listing: &ImageListing, numbers: &BTreeMap<i64, &str>) -> Result<Naming, SceneError> {
    let (Some((least, _)), Some((most, _))) = (numbers.first_key_value(), numbers.last_key_value()) else {
        return Ok(Naming::Timestamp);
    };
    let rows = i64::try_from(scene.frames.len()).unwrap_or(i64::MAX);
    let has = |number: i64| numbers.contains_key(&number);
    let by_time = scene.frames.iter().filter(|frame| frame.timestamp_micros.is_some_and(has)).count();
    let firsts = first_numbers(numbers, (*least, *most), rows);
    let by_number = firsts.iter().map(|first| numbers.range(*first..rows.saturating_add(*first)).count()).max();
    match firsts.as_slice() {
        _ if by_time >= by_number.unwrap_or_default() => Ok(Naming::Timestamp),
        [first] => Ok(Naming::Numbered { first: *first }),
        several => {
            let readings: Vec<String> = several.iter().map(|first| format!("from {first}")).collect();
            let expected =
                "images named by timestamp, or numbered so that the number of the first row's image is certain";
            let readings = readings.join(" or ");
            let found = format!("images {least} to {most} for {rows} rows, which may be numbered {readings}");
            Err(SceneError::unrecognized(listing.folder(), expected, found))
        }
    }
}

/// The numbers that the image of the first row may have, if images are numbered by row.
///
/// As many images as rows, without a gap, are those of the rows, whatever the least number is. With gaps, images are numbered from
/// 0 or 1: which, an image 0 and an image `rows` tell, if only one of them exists. Images that leave this range are numbered from 1
/// or from another number. If rows lack images and most images are beyond the rows, they are numbered by something else, such as the
/// frames of a video: 0, 30, 60.
fn first_numbers(numbers: &BTreeMap<i64, &str>, (least, most): (i64, i64), rows: i64) -> Vec<i64> {
    let whole = first_of_whole_series(numbers, rows);
    if !whole.is_empty() {
        return whole.into_iter().collect();
    }
    let in_range = numbers.range(..=rows).count();
    let is_longer = most.saturating_sub(least) >= rows;
    let has_gaps = i64::try_from(in_range).is_ok_and(|count| count < rows);
    // An image 0 or 1 is the first row's in any case.
    let telling = if least > 1 { in_range } else { in_range.saturating_sub(1) };
    if is_longer && has_gaps && telling <= numbers.len().saturating_sub(in_range) {
        return Vec::new();
    }
    if least > 1 && most > rows {
        if is_longer {
            return vec![1];
        }
        let mut firsts: Vec<i64> = (in_range > 0).then_some(1).into_iter().collect();
        firsts.extend([most.saturating_sub(rows).saturating_add(1), least]);
        firsts.dedup();
        return firsts;
    }
    match (numbers.contains_key(&0), numbers.contains_key(&rows)) {
        (true, false) => vec![0],
        (false, true) => vec![1],
        _ => vec![0, 1],
    }
}

/// The least number of every series of as many images as rows without a gap: of all images, or of those with one text before the
/// number, next to others such as `cover-1`.
fn first_of_whole_series(numbers: &BTreeMap<i64, &str>, rows: i64) -> BTreeSet<i64> {
    let mut by_prefix: BTreeMap<&str, Vec<i64>> = BTreeMap::new();
    for (number, stem) in numbers {
        by_prefix.entry(stem.trim_end_matches(|c: char| c.is_ascii_digit())).or_default().push(*number);
    }
    let all: Vec<i64> = numbers.keys().copied().collect();
    let first_if_whole = |series: &Vec<i64>| {
        let (first, last) = (series.first()?, series.last()?);
        let is_as_long = i64::try_from(series.len()).is_ok_and(|length| length == rows);
        (is_as_long && last.saturating_sub(*first) == rows.saturating_sub(1)).then_some(*first)
    };
    let several = by_prefix.values().filter(|series| series.len() > 1);
    std::iter::once(&all).chain(several).filter_map(first_if_whole).collect()
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

    fn folder_with(names: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for name in names {
            std::fs::write(folder.path().join(name), b"").unwrap();
        }
        folder
    }

    fn attach(names: &[&str]) -> (Scene, Warnings) {
        let folder = folder_with(names);
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

    /// Three rows. From a wrong first number, every pose would get another row's image.
    #[test]
    fn images_without_a_gap_start_at_their_least_number() {
        for files in [["00005.png", "00006.png", "00007.png"], ["frame-0.png", "frame-1.png", "frame-2.png"]] {
            let (scene, warnings) = attach(&files);
            assert_eq!((names(&scene), warnings.total()), (files.map(str::to_owned).to_vec(), 0));
        }
    }

    /// A series of as many images as rows is certain, whatever else is there.
    #[test]
    fn images_of_another_name_do_not_shift_a_whole_series() {
        for files in [["0.png", "1.png", "2.png", "cover-3.png"], ["4.png", "5.png", "6.png", "cover-1.png"]] {
            let (scene, warnings) = attach(&files);
            assert_eq!(names(&scene), files[..3]);
            assert_eq!(warnings.counts().collect::<Vec<_>>(), [(WarningKind::UnlistedImage, 1)], "{files:?}");
        }
        let folder =
            folder_with(&["left_0.png", "left_1.png", "left_2.png", "right_3.png", "right_4.png", "right_5.png"]);
        let folders = [folder.path().to_owned()];
        let error = attach_images(&mut scene(), &folders, || false, &mut Warnings::new()).unwrap_err().to_string();
        assert!(error.contains("may be numbered from 0 or from 3"), "{error}");
    }

    /// The numbers of a video's frames coincide with some of the rows, but are of others.
    #[test]
    fn images_most_of_which_are_beyond_the_rows_belong_to_none() {
        let (scene, warnings) = attach(&["3.png", "13.png", "23.png", "33.png"]);
        assert_eq!(names(&scene), ["no 0.png", "no 33366.png", "no 66733.png"]);
        let counts = [(WarningKind::MissingImage, 3), (WarningKind::UnlistedImage, 4)];
        assert_eq!(warnings.counts().collect::<Vec<_>>(), counts);
        let (scene, warnings) = attach(&["2.png", "3.png", "40.png"]);
        assert_eq!(names(&scene), ["no 00001.png", "2.png", "3.png"]);
        let counts = [(WarningKind::MissingImage, 1), (WarningKind::UnlistedImage, 1)];
        assert_eq!(warnings.counts().collect::<Vec<_>>(), counts, "most belong to rows");
        for files in [["0.png", "2.png", "4.png", "6.png", "8.png"], ["1.png", "3.png", "5.png", "7.png", "9.png"]] {
            let (scene, warnings) = attach(&files);
            assert_eq!(names(&scene)[1..], ["no 33366.png", "no 66733.png"], "{files:?}");
            assert!(warnings.count(WarningKind::UnlistedImage) >= 4, "{files:?}");
        }
        let (scene, _) = attach(&["0.png", "1.png", "2.png", "4.png", "5.png", "6.png", "7.png"]);
        assert_eq!(names(&scene), ["0.png", "1.png", "2.png"], "no row lacks an image");
    }

    #[test]
    fn gaps_are_allowed_where_the_first_number_is_certain() {
        for (files, expected) in [
            (["0.jpg", "2.jpg"], ["0.jpg", "no 00001.jpg", "2.jpg"]),
            (["1.jpg", "3.jpg"], ["1.jpg", "no 00002.jpg", "3.jpg"]),
            (["2.jpg", "3.jpg"], ["no 00001.jpg", "2.jpg", "3.jpg"]),
            (["70.jpg", "72.jpg"], ["70.jpg", "no 00071.jpg", "72.jpg"]),
        ] {
            let (scene, warnings) = attach(&files);
            assert_eq!(names(&scene), expected);
            assert_eq!(warnings.counts().collect::<Vec<_>>(), [(WarningKind::MissingImage, 1)], "{files:?}");
        }
    }

    #[test]
    fn ambiguous_numbers_are_errors_with_all_readings() {
        for (files, found) in [
            (&["frame_1.png", "frame_2.png"][..], "images 1 to 2 for 3 rows, which may be numbered from 0 or from 1"),
            (
                &["0.png", "1.png", "2.png", "3.png"][..],
                "images 0 to 3 for 3 rows, which may be numbered from 0 or from 1",
            ),
            (&["3.png", "5.png"][..], "images 3 to 5 for 3 rows, which may be numbered from 1 or from 3"),
            (&["70.png", "71.png"][..], "images 70 to 71 for 3 rows, which may be numbered from 69 or from 70"),
        ] {
            let folder = folder_with(files);
            let folders = [folder.path().to_owned()];
            let error = attach_images(&mut scene(), &folders, || false, &mut Warnings::new()).unwrap_err().to_string();
            assert!(error.contains(found), "{files:?}: {error}");
        }
    }

    /// Nor can those of another scene, which are as many, but have other timestamps.
    #[test]
    fn images_that_cannot_belong_to_rows_are_mentioned() {
        let (scene, warnings) = attach(&["left.png", "right.png"]);
        assert_eq!(names(&scene), ["no 0.png", "no 33366.png", "no 66733.png"]);
        let detail = &warnings.kept()[1].detail;
        let expected = "33366.png; 2 images there have names that do not end in a number, such as left.png";
        assert!(detail.ends_with(expected), "{detail}");
        let (scene, warnings) = attach(&["100000.png", "133366.png", "166733.png"]);
        assert_eq!(names(&scene), ["no 0.png", "no 33366.png", "no 66733.png"]);
        let counts = [(WarningKind::MissingImage, 3), (WarningKind::UnlistedImage, 3)];
        assert_eq!(warnings.counts().collect::<Vec<_>>(), counts);
    }

    /// Next to frames in PNG, a preview or mask in JPEG is not the frame.
    #[test]
    fn of_two_images_that_with_the_extension_of_the_others_is_used() {
        let (scene, warnings) = attach(&["0.png", "33366.jpg", "33366.PNG", "66733.png"]);
        assert_eq!(names(&scene), ["0.png", "33366.PNG", "66733.png"]);
        let detail = &warnings.kept()[0].detail;
        assert!(warnings.total() == 1 && detail.ends_with("first: 33366.PNG is used, not 33366.jpg"), "{detail}");
        for files in [&["0.png", "33366.jpg", "33366.png", "66733.jpg"][..], &["33366.jpg", "33366.png"]] {
            let (scene, warnings) = attach(files);
            assert_eq!(names(&scene)[1], "no 33366.jpg or 33366.png?");
            let expected = "frame 1: expected one image, found 33366.jpg and 33366.png (";
            assert!(
                warnings.kept().iter().any(|warning| warning.detail.starts_with(expected)),
                "{:?}",
                warnings.kept()
            );
        }
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
