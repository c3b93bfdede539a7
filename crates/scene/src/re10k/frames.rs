use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use super::naming::Naming;
use crate::files::{ImageListing, last_name};
use crate::{Frame, FrameImage, Scene, SceneError, WarningKind, Warnings};

/// Assigns each frame its image from the first of `folders` that contains images with a number in their name.
///
/// If no folder exists, the frames stay [`FrameImage::Absent`], unless images are `expected`, which is asked only then.
/// Otherwise a frame without a file becomes [`FrameImage::Missing`], with a warning; one with several files, of which none has the
/// extension that the frames with one file share, becomes [`FrameImage::Ambiguous`], with the same warning. Images with a number that
/// no row has are counted too: deleted rows leave them, and shift the position of every later frame. Others, such as `cover.jpg`,
/// cannot belong to a row.
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
    let stems = stems_by_number(&listing, &scene.key, warnings);
    let naming = Naming::of(&scene.frames, listing.folder(), &stems)?;
    let assigned = AssignedImages::of(&scene.frames, naming, &listing, &stems);
    assigned.report(&scene.key, &listing, warnings);
    for (frame, image) in scene.frames.iter_mut().zip(assigned.images) {
        frame.image = image;
    }
    Ok(())
}

/// The images of a scene's frames, and what is odd about them.
struct AssignedImages {
    /// Of each frame: a file, a missing one, or an ambiguous one.
    images: Vec<FrameImage>,
    /// What is used of several files, for each frame with an image that has several.
    choices: Vec<String>,
    /// Images with a number that belongs to no frame.
    unlisted: Vec<PathBuf>,
    /// Whether no image has a number.
    is_without_numbers: bool,
}

impl AssignedImages {
    /// `stems` are the names without extension of the images in `listing` that may belong to frames, by their numbers.
    fn of(frames: &[Frame], naming: Naming, listing: &ImageListing, stems: &BTreeMap<i64, &str>) -> Self {
        let numbers: Vec<Option<i64>> =
            frames.iter().enumerate().map(|(row, frame)| naming.number(row, frame)).collect();
        let names_of = |number: i64| stems.get(&number).map(|stem| listing.names(stem));
        let names: Vec<Vec<&str>> =
            numbers.iter().map(|number| number.and_then(names_of).unwrap_or_default()).collect();
        let shared = shared_extension(&names);
        let (mut images, mut choices) = (Vec::with_capacity(frames.len()), Vec::new());
        for (row, (frame, names)) in frames.iter().zip(&names).enumerate() {
            let image = if let Some(used) = choice(names, shared) {
                let unused: Vec<&str> = names.iter().copied().filter(|name| *name != used).collect();
                if !unused.is_empty() {
                    choices.push(format!("{used} is used, not {}", unused.join(", ")));
                }
                FrameImage::File(listing.folder().join(used))
            } else if names.is_empty() {
                FrameImage::Missing(listing.expected(&naming.expected_stem(row, frame)))
            } else {
                FrameImage::Ambiguous(names.iter().map(|name| listing.folder().join(name)).collect())
            };
            images.push(image);
        }
        let of_frames: BTreeSet<i64> = numbers.into_iter().flatten().collect();
        let others = stems.iter().filter(|(number, _)| !of_frames.contains(*number));
        let unlisted = others.filter_map(|(_, stem)| listing.by_stem(stem)).collect();
        Self { images, choices, unlisted, is_without_numbers: stems.is_empty() }
    }

    fn report(&self, key: &str, listing: &ImageListing, warnings: &mut Warnings) {
        let others = if self.is_without_numbers { images_without_numbers(listing) } else { String::new() };
        for (row, image) in self.images.iter().enumerate() {
            let problem = match image {
                FrameImage::Missing(path) => format!("no {}{others}", path.display()),
                FrameImage::Ambiguous(paths) => {
                    let found: Vec<String> = paths.iter().map(|path| last_name(path)).collect();
                    let (found, folder) = (found.join(" and "), listing.folder().display());
                    format!("expected one image, found {found} ({folder})")
                }
                _ => continue,
            };
            warnings.push(WarningKind::MissingImage, key, format!("frame {row}: {problem}"));
        }
        if let Some(first) = self.choices.first() {
            let (count, folder) = (self.choices.len(), listing.folder().display());
            let detail = format!("{count} rows fit several images in {folder}, first: {first}");
            warnings.push(WarningKind::AmbiguousNumbering, key, detail);
        }
        for path in &self.unlisted {
            let detail = format!("no row of the trajectory belongs to {}: is a row missing?", path.display());
            warnings.push(WarningKind::UnlistedImage, key, detail);
        }
    }
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

#[cfg(test)]
mod tests;
