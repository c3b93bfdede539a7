//! The files of a scene's frames in folders that another program wrote.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::{fs, io};

use super::{is_absent, is_file};

/// The image files of one scene, in all folders that may contain them. Each folder is listed once. NumPy's arrays are images only if
/// no folder has others: beside images, programs store depths and opacities in them.
#[derive(Debug)]
pub(super) struct FrameFiles {
    folders: Vec<Listed>,
    /// A frame's `.png` without an `.exr` next to it.
    png_alone: Option<PathBuf>,
    /// The frames that have files, if they are exactly those after the frames that are looked for.
    one_higher: Option<Vec<usize>>,
}

/// Extensions of image files other than [`ARRAY`], in lower case. Only `.exr` and `.png` are read.
const IMAGES: [&str; 12] = ["exr", "png", "jpg", "jpeg", "webp", "bmp", "gif", "tif", "tiff", "tga", "ppm", "avif"];

/// The extension of NumPy's arrays.
const ARRAY: &str = "npy";

/// The names of files by the frame whose number they are, in any spelling.
type Names = BTreeMap<usize, Vec<String>>;

/// A folder and the names of its images.
#[derive(Debug, Default)]
struct Listed {
    folder: PathBuf,
    names: Names,
    /// Arrays that are not images.
    arrays: Names,
    /// Why it could not be listed: any file may be in it.
    unreadable: Option<String>,
}

impl FrameFiles {
    /// Lists folders for these frames; one that does not exist is empty.
    pub(super) fn of(folders: impl IntoIterator<Item = PathBuf>, frames: impl IntoIterator<Item = usize>) -> Self {
        let mut folders: Vec<Listed> = folders.into_iter().map(Listed::of).collect();
        if folders.iter().all(|listed| listed.names.is_empty()) {
            for listed in &mut folders {
                listed.names = std::mem::take(&mut listed.arrays);
            }
        }
        let mut files = Self { folders, png_alone: None, one_higher: None };
        let frames: Vec<usize> = frames.into_iter().collect();
        files.one_higher = files.numbers_if_one_higher(&frames);
        let alone = |found: Vec<PathBuf>| found.into_iter().next().filter(|first| !is_exr(first));
        files.png_alone = frames.into_iter().find_map(|frame| alone(files.all_of(frame)));
        files
    }

    /// The file of a frame; `None` if there is none.
    ///
    /// # Errors
    /// A folder that cannot be listed. Two files, either of which may be the right one: with different numbers of digits, in two
    /// folders, in a spelling or a format that is not read, or an `.exr` and a `.png` where another frame has no `.exr`. Files that are
    /// numbered from 1: the file of a frame would show the one before it.
    pub(super) fn file_of(&self, frame: usize) -> Result<Option<PathBuf>, String> {
        if let Some(error) = self.unreadable() {
            return Err(error.to_owned());
        }
        if let Some(numbers) = &self.one_higher {
            let numbers = super::layout::listed(numbers.iter().map(ToString::to_string).collect());
            return Err(format!(
                "the scene's files are numbered {numbers}, each one more than the frame of a target: frames are numbered from 0 \
                 (frame {frame})"
            ));
        }
        let found = self.all_of(frame);
        let Some((first, others)) = found.split_first() else { return Ok(None) };
        let both = |other: &Path| format!("two files for frame {frame}: {} and {}", first.display(), other.display());
        if let Some(other) = others.iter().find(|other| other.with_extension("") != first.with_extension("")) {
            return Err(both(other));
        }
        if let Some(other) = self.unread_of(frame).first() {
            return Err(both(other));
        }
        if let (Some(other), Some(alone)) = (others.first(), &self.png_alone) {
            return Err(format!("{}, but only the .png of another frame: {}", both(other), alone.display()));
        }
        Ok(Some(first.clone()))
    }

    /// The frames with files, if those are exactly the ones after `frames`.
    fn numbers_if_one_higher(&self, frames: &[usize]) -> Option<Vec<usize>> {
        let found: BTreeSet<usize> = self.folders.iter().flat_map(|listed| listed.names.keys().copied()).collect();
        let expected: BTreeSet<usize> = frames.iter().map(|frame| frame + 1).collect();
        (!found.is_empty() && found == expected).then(|| found.into_iter().collect())
    }

    /// What the numbers of files that are not those of the frames may count instead; empty if nothing is known.
    pub(super) fn numbering_hint(&self, frames: &[usize]) -> &'static str {
        let found = self.folders.iter().flat_map(|listed| listed.names.keys());
        if self.one_higher.is_some() {
            ": the files' numbers are each one more, and frames are numbered from 0"
        } else if !frames.is_empty() && found.copied().eq(0..frames.len()) {
            ": the files are numbered by the position among the targets, and expected by frame"
        } else {
            ""
        }
    }

    /// The name of one of the frames' files, and the position of its folder; `None` if there is none.
    ///
    /// # Errors
    /// A folder that cannot be listed.
    pub(super) fn any_of(&self, frames: &[usize]) -> Result<Option<(usize, String)>, String> {
        if let Some(error) = self.unreadable() {
            return Err(error.to_owned());
        }
        let in_folder = |listed: &Listed| listed.of_frames(frames).next();
        Ok(self.folders.iter().enumerate().find_map(|(at, listed)| Some((at, in_folder(listed)?))))
    }

    /// Why the first folder that cannot be listed cannot be.
    fn unreadable(&self) -> Option<&str> {
        self.folders.iter().find_map(|listed| listed.unreadable.as_deref())
    }

    /// Images whose name is the frame's number in a spelling or a format that is not read.
    pub(super) fn unread_of(&self, frame: usize) -> Vec<PathBuf> {
        let unread = |listed: &Listed| {
            let accepted: Vec<String> = names(frame).collect();
            let names = listed.images_of(frame).filter(|name| !accepted.contains(name));
            let paths = names.map(|name| listed.folder.join(name)).filter(|path| may_be_file(path));
            paths.collect::<Vec<_>>()
        };
        self.folders.iter().flat_map(unread).collect()
    }

    /// An array of the frame that is not read, because other images are there.
    pub(super) fn array_beside_images(&self, frame: usize) -> Option<PathBuf> {
        self.folders.iter().find_map(|listed| Some(listed.folder.join(listed.arrays.get(&frame)?.first()?)))
    }

    fn all_of(&self, frame: usize) -> Vec<PathBuf> {
        let paths =
            |listed: &Listed| listed.of_frames(&[frame]).map(|name| listed.folder.join(name)).collect::<Vec<_>>();
        self.folders.iter().flat_map(paths).collect()
    }
}

impl Listed {
    fn of(folder: PathBuf) -> Self {
        match images_in(&folder) {
            Ok((names, arrays)) => Self { folder, names, arrays, unreadable: None },
            Err(error) => {
                let unreadable = Some(format!("{error} ({})", folder.display()));
                Self { folder, unreadable, ..Self::default() }
            }
        }
    }

    fn images_of(&self, frame: usize) -> impl Iterator<Item = &String> {
        self.names.get(&frame).into_iter().flatten()
    }

    fn of_frames<'a>(&'a self, frames: &'a [usize]) -> impl Iterator<Item = String> + 'a {
        let is_listed = |frame: usize, name: &String| self.images_of(frame).any(|listed| listed == name);
        let names = frames.iter().flat_map(move |frame| names(*frame).filter(move |name| is_listed(*frame, name)));
        names.filter(|name| may_be_file(&self.folder.join(name)))
    }
}

/// The names of a folder's images and of its arrays, each frame's sorted; none if there is no such folder.
fn images_in(folder: &Path) -> io::Result<(Names, Names)> {
    let (mut images, mut arrays) = (Names::new(), Names::new());
    let entries = match fs::read_dir(folder) {
        Err(error) if is_absent(&error) => return Ok((images, arrays)),
        entries => entries?,
    };
    for entry in entries {
        let Ok(name) = entry?.file_name().into_string() else { continue };
        if let Some((frame, is_array)) = frame_of(&name) {
            let names = if is_array { &mut arrays } else { &mut images };
            names.entry(frame).or_default().push(name);
        }
    }
    for of_frame in images.values_mut().chain(arrays.values_mut()) {
        of_frame.sort();
    }
    Ok((images, arrays))
}

/// Whether a listed entry is a file, or may be one because the system cannot tell.
fn may_be_file(path: &Path) -> bool {
    is_file(path).unwrap_or(true)
}

/// The frame whose number an image's or array's name is, with any padding and in any format or case; and whether it is an array's.
fn frame_of(name: &str) -> Option<(usize, bool)> {
    let (stem, extension) = name.rsplit_once('.')?;
    let is_array = extension.eq_ignore_ascii_case(ARRAY);
    let is_image = is_array || IMAGES.iter().any(|known| extension.eq_ignore_ascii_case(known));
    let is_number = stem.bytes().all(|byte| byte.is_ascii_digit());
    if is_image && is_number { stem.parse().ok().map(|frame| (frame, is_array)) } else { None }
}

/// Accepted file names of a frame, floats first.
fn names(frame: usize) -> impl Iterator<Item = String> {
    let mut stems: Vec<String> = [6, 5, 4, 3, 2, 1].map(|digits| format!("{frame:0digits$}")).to_vec();
    stems.dedup();
    stems.into_iter().flat_map(|stem| ["exr", "png", ARRAY].map(|extension| format!("{stem}.{extension}")))
}

fn is_exr(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == "exr")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_file_name_of_a_frame_is_listed_once() {
        let of = |frame| names(frame).filter(|name| name.ends_with("png")).collect::<Vec<_>>();
        assert_eq!(of(29), ["000029.png", "00029.png", "0029.png", "029.png", "29.png"]);
        assert_eq!(of(1_234_567), ["1234567.png"]);
        assert_eq!(names(7).next().as_deref(), Some("000007.exr"));
    }

    type Found = Result<Option<String>, String>;

    /// What is found in `color/` and next to it, for frames 7 and 28.
    fn found(files: &[&str]) -> [Found; 2] {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("color")).unwrap();
        for file in files {
            fs::write(folder.path().join(file), "").unwrap();
        }
        let short = |path: &Path| path.display().to_string().replace(&format!("{}/", folder.path().display()), "");
        let folders = [folder.path().join("color"), folder.path().to_owned()];
        let listed = FrameFiles::of(folders, [7, 28]);
        [7, 28].map(|frame| match listed.file_of(frame) {
            Ok(found) => Ok(found.map(|path| short(&path))),
            Err(why) => Err(short(Path::new(&why))),
        })
    }

    fn is(found: &Found, file: &str) -> bool {
        found.as_ref().is_ok_and(|found| found.as_deref() == Some(file))
    }

    #[test]
    fn two_files_for_a_frame_are_ambiguous_in_any_two_layouts() {
        let [first, second] = found(&["color/000028.png", "000028.png", "000007.png"]);
        assert!(is(&first, "000007.png"), "one file in a folder that is not the other's: {first:?}");
        assert_eq!(second, Err("two files for frame 28: color/000028.png and 000028.png".to_owned()));
        let [first, second] = found(&["28.exr", "000028.png", "000007.png"]);
        assert!(is(&first, "000007.png"), "{first:?}");
        assert_eq!(second, Err("two files for frame 28: 000028.png and 28.exr".to_owned()));
        let [first, second] = found(&["color/7.png"]);
        assert!(is(&first, "color/7.png") && second == Ok(None), "{first:?} {second:?}");
    }

    /// Each of them may be what the method wrote last.
    #[test]
    fn images_in_another_spelling_or_format_are_further_candidates() {
        for other in ["000028.PNG", "000028.EXR", "0000028.png", "28.jpg", "color/000028.webp", "color/00000028.Tiff"] {
            let [first, second] = found(&[other, "000028.png", "000007.png"]);
            assert!(is(&first, "000007.png"), "{other} is not an image of frame 7: {first:?}");
            assert_eq!(second, Err(format!("two files for frame 28: 000028.png and {other}")));
            assert_eq!(found(&[other])[1], Ok(None), "{other} is not read");
        }
        for other in ["000028.txt", "000028.png.bak", "000028-error.png", "x28.png", ".png", "00002.8.png", "28"] {
            let [_, second] = found(&[other, "000028.png"]);
            assert!(is(&second, "000028.png"), "{other} is not an image of frame 28: {second:?}");
        }
    }

    /// Half of them would be scored against the frame after theirs.
    #[test]
    fn files_that_are_numbered_from_1_are_refused() {
        let of = |numbers: &[usize], frames: &[usize]| {
            let folder = tempfile::tempdir().unwrap();
            for number in numbers {
                fs::write(folder.path().join(format!("{number:06}.png")), "").unwrap();
            }
            let files = FrameFiles::of([folder.path().to_owned()], frames.iter().copied());
            files.file_of(frames[0]).map(|path| path.is_some())
        };
        let why = of(&[6, 7, 9], &[5, 6, 8]).unwrap_err();
        assert!(why.starts_with("the scene's files are numbered 6, 7, 9, each one more than "), "{why}");
        assert_eq!(of(&[5, 6, 8], &[5, 6, 8]), Ok(true));
        assert_eq!(of(&[4, 5, 6, 7, 9], &[5, 6, 8]), Ok(true), "among others");
        assert_eq!(of(&[6, 7], &[5, 6, 8]), Ok(false), "some of them");
        assert_eq!(of(&[], &[5]), Ok(false));
    }

    /// The other file of a frame may be in it, and so may the only one.
    #[cfg(unix)]
    #[test]
    fn a_folder_that_cannot_be_listed_is_not_empty() {
        let root = tempfile::tempdir().unwrap();
        let [colour, absent] = ["color", "absent"].map(|name| root.path().join(name));
        fs::write(root.path().join("000028.png"), "").unwrap();
        std::os::unix::fs::symlink("color", &colour).unwrap();
        let of = |folder: &Path| FrameFiles::of([folder.to_owned(), root.path().to_owned()], [7, 28]);
        let system = fs::read_dir(&colour).unwrap_err();
        let why = format!("{system} ({})", colour.display());
        assert_eq!(of(&colour).file_of(28), Err(why.clone()));
        assert_eq!(of(&colour).file_of(7), Err(why.clone()));
        assert_eq!(of(&colour).any_of(&[28]), Err(why));
        let file = root.path().join("000028.png");
        for nowhere in [absent, file.clone(), root.path().join("a".repeat(300))] {
            assert_eq!(of(&nowhere).file_of(28), Ok(Some(file.clone())), "{}", nowhere.display());
            assert_eq!(of(&nowhere).file_of(7), Ok(None));
            assert_eq!(of(&nowhere).any_of(&[28]), Ok(Some((1, "000028.png".to_owned()))));
        }
    }

    /// A link that leads back to itself is neither absent nor a folder.
    #[cfg(unix)]
    #[test]
    fn what_is_listed_and_cannot_be_looked_at_is_a_candidate() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("000028.png"), "").unwrap();
        std::os::unix::fs::symlink("28.png", folder.path().join("28.png")).unwrap();
        std::os::unix::fs::symlink("gone", folder.path().join("028.png")).unwrap();
        let why = FrameFiles::of([folder.path().to_owned()], [28]).file_of(28).unwrap_err();
        assert!(why.starts_with("two files for frame 28: ") && why.ends_with("/28.png"), "{why}");
    }

    #[test]
    fn unread_images_of_a_frame_are_named() {
        let folder = tempfile::tempdir().unwrap();
        for file in ["000028.jpg", "0000007.png", "000007.png"] {
            fs::write(folder.path().join(file), "").unwrap();
        }
        fs::create_dir(folder.path().join("28.bmp")).unwrap();
        let files = FrameFiles::of([folder.path().to_owned()], [7, 28]);
        assert_eq!(files.unread_of(28), [folder.path().join("000028.jpg")], "a folder is not an image");
        assert_eq!(files.unread_of(7), [folder.path().join("0000007.png")]);
        assert!(files.unread_of(0).is_empty());
    }

    /// Beside images, they are depths or opacities, whatever their names are.
    #[test]
    fn arrays_are_read_where_no_other_images_are() {
        let [first, second] = found(&["color/000007.npy", "028.npy"]);
        assert!(is(&first, "color/000007.npy") && is(&second, "028.npy"), "{first:?} {second:?}");
        assert_eq!(
            found(&["28.npy", "000028.npy"])[1],
            Err("two files for frame 28: 000028.npy and 28.npy".to_owned())
        );
        assert_eq!(
            found(&["28.npy", "000028.NPY"])[1],
            Err("two files for frame 28: 28.npy and 000028.NPY".to_owned())
        );
        let other_names = ["000028.npy", "28.npy", "000028.NPY", "color/000028.npy"];
        for array in other_names {
            let [first, second] = found(&["000028.png", "000007.npy", array]);
            assert!(first == Ok(None) && is(&second, "000028.png"), "{array}: {first:?} {second:?}");
        }
        let folder = tempfile::tempdir().unwrap();
        for file in ["000028.npy", "000007.jpg"] {
            fs::write(folder.path().join(file), "").unwrap();
        }
        let files = FrameFiles::of([folder.path().to_owned()], [7, 28]);
        assert_eq!(files.array_beside_images(28), Some(folder.path().join("000028.npy")));
        assert_eq!((files.array_beside_images(7), files.file_of(28)), (None, Ok(None)));
        fs::remove_file(folder.path().join("000007.jpg")).unwrap();
        fs::rename(folder.path().join("000028.npy"), folder.path().join("000029.npy")).unwrap();
        let files = FrameFiles::of([folder.path().to_owned()], [28]);
        assert!(files.file_of(28).is_err_and(|why| why.contains("each one more than")));
    }

    #[test]
    fn floats_take_precedence_where_every_frame_has_them() {
        let both = ["000007.exr", "000007.png", "000028.exr", "000028.png"];
        for files in [&both[..], &both[..3]] {
            let [first, second] = found(files);
            assert!(is(&first, "000007.exr") && is(&second, "000028.exr"), "{files:?}: {first:?} {second:?}");
        }
        let [first, second] = found(&["000007.png", "000028.exr", "000028.png"]);
        assert!(is(&first, "000007.png"), "{first:?}");
        let mixed = "two files for frame 28: 000028.exr and 000028.png, but only the .png of another frame: 000007.png";
        assert_eq!(second, Err(mixed.to_owned()));
    }
}
