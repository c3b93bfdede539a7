//! The image files of a store: their places, and which row each belongs to.

use std::collections::BTreeMap;
use std::fs;
use std::io::{self, Read as _, Seek as _, SeekFrom};
use std::path::{Path, PathBuf};

use atsplat_files::{PARTIAL, Sha256Digest};
use atsplat_pixels::{Image, ImageU8, Rounding, encode_png};

use crate::file_name;
use crate::store::disk;
use crate::{ResultsError, Store, TargetRow, TrialKey};

/// The method name under which ground-truth images are stored.
pub const TRUTH: &str = "truth";
/// The method name under which context images are stored.
pub const CONTEXT: &str = "context";

/// Folder of a store.
pub(super) const FOLDER: &str = "images";
const SIGNATURE: &[u8] = b"\x89PNG\r\n\x1a\n";
/// Bytes of a PNG file before its first chunk after the header.
const HEADER: usize = 33;
/// The last chunk of every PNG file, 12 bytes: its length, name and checksum.
const END: &[u8; 12] = b"\0\0\0\0IEND\xae\x42\x60\x82";
/// The keyword of a PNG text with the hash of an image's samples.
const KEYWORD: &[u8] = b"atsplat-samples\0";

/// The hash that identifies an 8-bit image in rows.
pub fn hash_of_bytes(image: &ImageU8) -> String {
    Sha256Digest::of(image.samples()).to_string()
}

/// Path of an image in a store: `images/<preset>/<method>/<scene>-<entry>/<frame>.png`, with `truth` or `context` instead of the
/// method for ground-truth and context images. Names that are invalid as file names or differ only in case are changed, so that
/// no two keys share a path.
pub fn image_path(store: &Path, key: &TrialKey, frame: u64) -> PathBuf {
    folder(store, key).join(format!("{frame:06}.png"))
}

/// Whether a store's PNG file is the image of a row with this hash: [`TargetRow::render_hash`], [`TargetRow::truth_hash`] or
/// one of [`crate::TrialRow::context_hashes`]. Files say which hash they belong to, because in object storage a writer that is
/// killed between two uploads leaves old images next to new rows. Files of older versions do not say it and are accepted.
pub fn is_image_of(png: &[u8], hash: Option<&str>) -> bool {
    stated_hash(png).is_none_or(|stated| hash.map(str::as_bytes) == Some(stated))
}

fn stated_hash(png: &[u8]) -> Option<&[u8]> {
    let (length, chunk) = png.get(HEADER..)?.split_first_chunk::<4>()?;
    let text = chunk.strip_prefix(b"tEXt")?.get(..u32::from_be_bytes(*length) as usize)?;
    text.strip_prefix(KEYWORD)
}

/// Whether a store has the whole image of a row with this hash.
///
/// # Errors
/// [`ResultsError::Io`] for a file that cannot be read: it may be the image.
pub fn is_stored(store: &Path, key: &TrialKey, frame: u64, hash: Option<&str>) -> Result<bool, ResultsError> {
    is_whole_image_of(&image_path(store, key, frame), hash)
}

/// Whether a file is the whole image of a row with this hash.
fn is_whole_image_of(path: &Path, hash: Option<&str>) -> Result<bool, ResultsError> {
    let start = start_of_whole(path).map_err(ResultsError::io("reading an image", path))?;
    Ok(start.is_some_and(|start| is_image_of(&start, hash)))
}

/// The first bytes of an image's file, with the hash that it states. `None` if there is no such file, or one without an image's
/// beginning or end: images are not waited for, so that a power failure may leave a file that is empty or cut.
fn start_of_whole(path: &Path) -> io::Result<Option<Vec<u8>>> {
    const BEGINNING: u64 = 256;
    let mut file = match atsplat_files::open(path) {
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(None),
        opened => opened?,
    };
    let (mut start, mut end) = (Vec::new(), Vec::new());
    file.by_ref().take(BEGINNING).read_to_end(&mut start)?;
    if start.len() < END.len() {
        return Ok(None);
    }
    file.seek(SeekFrom::End(-12))?;
    file.read_to_end(&mut end)?;
    Ok((start.starts_with(SIGNATURE) && end == END).then_some(start))
}

/// Folder of a trial's images.
pub fn folder(store: &Path, key: &TrialKey) -> PathBuf {
    folder_of_method(store, &key.preset, &key.method).join(format!("{}-{}", file_name(&key.scene), key.entry))
}

/// Folder of a method's images.
pub fn folder_of_method(store: &Path, preset: &str, method: &str) -> PathBuf {
    store.join(FOLDER).join(file_name(preset)).join(file_name(method))
}

/// Stores the render of a row, rounded to 8 bits, under a temporary name until [`publish`]; a render with non-finite samples
/// is not stored.
///
/// # Errors
/// [`ResultsError::Io`].
pub fn write_render(store: &Path, row: &TargetRow, render: &Image) -> Result<(), ResultsError> {
    let path = image_path(store, &row.key, row.frame).with_extension(format!("png.{PARTIAL}"));
    match render.to_u8(Rounding::Nearest) {
        Ok(image) => write(&path, &image, row.render_hash.as_deref()),
        Err(_non_finite) => Ok(()),
    }
}

/// Gives the renders of a trial their names, after its rows were stored: a run that is killed before leaves no image next to the
/// rows of an earlier one.
///
/// # Errors
/// [`ResultsError::Io`].
pub fn publish(store: &Path, key: &TrialKey) -> Result<(), ResultsError> {
    for path in disk::files(&folder(store, key))? {
        if path.extension().is_some_and(|extension| extension == PARTIAL) {
            fs::rename(&path, path.with_extension("")).map_err(ResultsError::io("storing an image", &path))?;
        }
    }
    Ok(())
}

/// Removes the renders of a trial that have no names yet, because its rows are not stored.
///
/// # Errors
/// [`ResultsError::Io`].
pub fn discard(store: &Path, key: &TrialKey) -> Result<(), ResultsError> {
    let files = disk::files(&folder(store, key))?.into_iter();
    let mut unnamed = files.filter(|path| path.extension().is_some_and(|extension| extension == PARTIAL));
    unnamed.try_for_each(|path| disk::remove(&path))
}

/// Whether a store has an image of a trial.
///
/// # Errors
/// [`ResultsError::Io`].
pub fn has_images(store: &Path, key: &TrialKey) -> Result<bool, ResultsError> {
    Ok(disk::files(&folder(store, key))?.iter().any(|path| is_named(path)))
}

/// Whether a file has the name of an image, not a temporary one.
fn is_named(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension == "png")
}

/// Names the renders of results that a process stored and was killed before it named them, and removes what else it left
/// unfinished.
///
/// # Errors
/// [`ResultsError::Io`].
pub fn settle(store: &Store) -> Result<(), ResultsError> {
    let unfinished = unfinished(store.folder())?;
    if unfinished.is_empty() {
        return Ok(());
    }
    let images = store.images_of_results()?.into_values().flatten();
    let hash_by_path: BTreeMap<PathBuf, Option<String>> =
        images.map(|image| (image_path(store.folder(), &image.key, image.frame), image.hash)).collect();
    for path in unfinished {
        let name = path.with_extension("");
        let hash = hash_by_path.get(&name).and_then(Option::as_deref);
        if hash.is_some() && is_whole_image_of(&path, hash)? {
            fs::rename(&path, &name).map_err(ResultsError::io("storing an image", &path))?;
        } else {
            fs::remove_file(&path).map_err(ResultsError::io("removing an unfinished image", &path))?;
        }
    }
    Ok(())
}

/// The unfinished files in the folders of all trials, which nobody else writes while the store is locked.
fn unfinished(store: &Path) -> Result<Vec<PathBuf>, ResultsError> {
    let mut paths = files(store)?;
    paths.retain(|path| path.extension().is_some_and(|extension| extension == PARTIAL));
    Ok(paths)
}

/// The files in the folders of all trials.
fn files(store: &Path) -> Result<Vec<PathBuf>, ResultsError> {
    /// Presets, methods, trials and their images.
    const LEVELS: usize = 4;
    let mut paths = vec![store.join(FOLDER)];
    for _ in 0..LEVELS {
        let below = paths.iter().filter(|path| path.is_dir()).map(|folder| disk::files(folder));
        paths = below.collect::<Result<Vec<_>, _>>()?.concat();
    }
    Ok(paths)
}

/// Gives a store the images of others that it lacks, or has cut: as links to the same files, which are replaced and never changed, or as
/// copies on another disk. `false` if it has all of them.
pub(super) fn add_those_of(parts: &[PathBuf], store: &Path) -> Result<bool, ResultsError> {
    let mut is_changed = false;
    for part in parts {
        for path in files(part)?.into_iter().filter(|path| is_named(path)) {
            let Ok(name) = path.strip_prefix(part) else { continue };
            is_changed |= add(&path, &store.join(name))?;
        }
    }
    Ok(is_changed)
}

/// Adds an image of a part as `target`, unless that is a whole image.
fn add(path: &Path, target: &Path) -> Result<bool, ResultsError> {
    if start_of_whole(target).map_err(ResultsError::io("reading an image", target))?.is_some() {
        return Ok(false);
    }
    // A copy would be written into the file of the part that it is a link to.
    disk::remove(target)?;
    // A link to a symbolic link would be one too, whose path may be relative to the part.
    let file = path.canonicalize().map_err(ResultsError::io("reading an image of a part", path))?;
    let folder = target.parent().unwrap_or(target);
    fs::create_dir_all(folder).map_err(ResultsError::io("creating a folder for images", folder))?;
    let added = fs::hard_link(&file, target).or_else(|_| fs::copy(&file, target).map(drop));
    added.map_err(ResultsError::io("copying an image of a part", path))?;
    Ok(true)
}

/// Removes a trial's images, if there are any.
///
/// # Errors
/// [`ResultsError::Io`].
pub fn remove(store: &Path, key: &TrialKey) -> Result<(), ResultsError> {
    remove_folder(&folder(store, key))
}

/// Removes all images, if there are any.
pub(super) fn remove_all(store: &Path) -> Result<(), ResultsError> {
    remove_folder(&store.join(FOLDER))
}

fn remove_folder(folder: &Path) -> Result<(), ResultsError> {
    match fs::remove_dir_all(folder) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => {
            Err(ResultsError::io("removing images", folder)(error))
        }
        _ => Ok(()),
    }
}

/// Removes a trial's images that are not the renders of its new rows, which are stored next: those of equal renders stay.
///
/// # Errors
/// [`ResultsError::Io`].
pub fn remove_others(store: &Path, key: &TrialKey, rows: &[TargetRow]) -> Result<(), ResultsError> {
    for path in disk::files(&folder(store, key))?.into_iter().filter(|path| is_named(path)) {
        let mut is_of_row = false;
        for row in rows.iter().filter(|row| image_path(store, key, row.frame) == path) {
            is_of_row |= is_whole_image_of(&path, row.render_hash.as_deref())?;
        }
        if !is_of_row {
            disk::remove(&path)?;
        }
    }
    Ok(())
}

/// Stores an 8-bit image, unless the store has a file that says to be this image: all methods share a trial's ground truth and
/// context, and each one asks for them. A file that cannot be read is replaced.
///
/// # Errors
/// [`ResultsError::Io`].
pub fn write_image(store: &Path, key: &TrialKey, frame: u64, image: &ImageU8) -> Result<(), ResultsError> {
    let (path, hash) = (image_path(store, key, frame), hash_of_bytes(image));
    let stored = start_of_whole(&path).ok().flatten();
    if stored.is_some_and(|start| stated_hash(&start) == Some(hash.as_bytes())) {
        return Ok(());
    }
    write(&path, image, Some(&hash))
}

fn write(path: &Path, image: &ImageU8, hash: Option<&str>) -> Result<(), ResultsError> {
    let folder = path.parent().unwrap_or(path);
    fs::create_dir_all(folder).map_err(ResultsError::io("creating a folder for images", folder))?;
    let png = encode_png(image);
    let png = png.map_err(|error| ResultsError::malformed(path, "image", "one that PNG can store", error))?;
    match hash {
        Some(hash) => disk::write_unsynced(path, &with_hash(&png, hash)),
        None => disk::write_unsynced(path, &png),
    }
}

/// A PNG file with the hash that it belongs to in a text chunk.
fn with_hash(png: &[u8], hash: &str) -> Vec<u8> {
    let chunk = [&b"tEXt"[..], KEYWORD, hash.as_bytes()].concat();
    #[expect(clippy::cast_possible_truncation, reason = "a keyword and a hash")]
    let length = (KEYWORD.len() + hash.len()) as u32;
    let (header, rest) = png.split_at(HEADER.min(png.len()));
    let (length, checksum) = (length.to_be_bytes(), crc32fast::hash(&chunk).to_be_bytes());
    [header, &length[..], chunk.as_slice(), &checksum[..], rest].concat()
}

#[cfg(test)]
mod tests {
    use atsplat_numeric::SplitMix64;
    use atsplat_pixels::{DecodeLimits, decode};

    use super::*;
    use crate::sample_rows;

    #[test]
    fn an_image_says_which_row_it_belongs_to() {
        let root = tempfile::tempdir().unwrap();
        let key = sample_rows::key("m", "x", 0);
        let image = ImageU8::new(1, 1, vec![10, 20, 30]).unwrap();
        write_image(root.path(), &key, 4, &image).unwrap();
        let png = fs::read(image_path(root.path(), &key, 4)).unwrap();
        assert_eq!(decode(&png, &DecodeLimits::default()).unwrap(), image);
        let stated = hash_of_bytes(&image);
        let is_of = |hash: Option<&str>| (is_image_of(&png, hash), is_stored(root.path(), &key, 4, hash).unwrap());
        assert_eq!(is_of(Some(&stated)), (true, true));
        assert_eq!([Some("another"), None].map(is_of), [(false, false); 2]);
        assert!(!is_stored(root.path(), &key, 5, Some(&stated)).unwrap());
        let older = encode_png(&image).unwrap();
        assert!(is_image_of(&older, Some("another")), "older versions do not say it");
        fs::write(image_path(root.path(), &key, 4), &older).unwrap();
        assert!(is_stored(root.path(), &key, 4, Some("another")).unwrap());
    }

    /// As a power failure leaves it: with the hash, or without.
    #[test]
    fn an_image_that_was_cut_is_not_stored() {
        let root = tempfile::tempdir().unwrap();
        let key = sample_rows::key("m", "x", 0);
        let mut noise = SplitMix64::for_scene(1, "noise");
        let samples = (0..40 * 30 * 3).map(|_| noise.next_u64().to_le_bytes()[0]).collect();
        let image = ImageU8::new(40, 30, samples).unwrap();
        write_image(root.path(), &key, 4, &image).unwrap();
        let (path, hash) = (image_path(root.path(), &key, 4), hash_of_bytes(&image));
        let png = fs::read(&path).unwrap();
        assert!(png.len() > 600, "more than what says the hash");
        for length in [0, 7, 20, HEADER, png.len() / 2, png.len() - 1] {
            fs::write(&path, &png[..length]).unwrap();
            assert!(!is_stored(root.path(), &key, 4, Some(&hash)).unwrap(), "{length}");
        }
        fs::write(&path, [&png[..300], &vec![0; png.len() - 300][..]].concat()).unwrap();
        assert!(!is_stored(root.path(), &key, 4, Some(&hash)).unwrap(), "zeros");
        fs::write(&path, &png).unwrap();
        assert!(is_stored(root.path(), &key, 4, Some(&hash)).unwrap());
    }

    /// Each method asks for the ground truth; the samples between the stated hash and the end tell whether it was written again.
    #[test]
    fn an_image_is_encoded_once() {
        let root = tempfile::tempdir().unwrap();
        let key = sample_rows::key(TRUTH, "x", 0);
        let [image, other] = [9, 200].map(|sample| ImageU8::new(40, 30, vec![sample; 40 * 30 * 3]).unwrap());
        let path = image_path(root.path(), &key, 4);
        let write_again = |stored: &[u8], image: &ImageU8| {
            fs::write(&path, stored).unwrap();
            write_image(root.path(), &key, 4, image).unwrap();
            fs::read(&path).unwrap()
        };
        write_image(root.path(), &key, 4, &image).unwrap();
        let png = fs::read(&path).unwrap();
        let mut marked = png.clone();
        let at = png.len() - END.len() - 1;
        marked[at] ^= 1;
        assert_eq!(write_again(&marked, &image), marked, "the store has it");
        assert_eq!(write_again(&png[..png.len() - 1], &image), png, "without its end");
        let older = encode_png(&image).unwrap();
        assert_eq!(write_again(&older, &image), png, "without its hash");
        assert_ne!(write_again(&png, &other), png, "another image");
    }

    /// A link to itself cannot be opened, and could be removed.
    #[cfg(unix)]
    #[test]
    fn an_image_that_cannot_be_read_is_an_error_and_stays() {
        let root = tempfile::tempdir().unwrap();
        let row = |frame: u64| TargetRow {
            frame,
            render_hash: Some("render".to_owned()),
            ..sample_rows::target("m", "x", 0, 0, "psnr", 20.0)
        };
        let key = row(7).key;
        let store = Store::create(root.path(), crate::Provenance::default()).unwrap();
        store.append(&sample_rows::trial("m", "x", 0, 1), &[row(7)]).unwrap();
        let named = image_path(root.path(), &key, 7);
        let unnamed = named.with_extension(format!("png.{PARTIAL}"));
        fs::create_dir_all(named.parent().unwrap()).unwrap();
        for path in [&named, &unnamed] {
            std::os::unix::fs::symlink(path, path).unwrap();
        }
        for result in [
            is_stored(root.path(), &key, 7, Some("render")).map(|_| ()),
            remove_others(root.path(), &key, &[row(7)]),
            settle(&store),
        ] {
            assert!(matches!(result, Err(ResultsError::Io(_))), "{result:?}");
        }
        assert!(named.is_symlink() && unnamed.is_symlink());
        remove_others(root.path(), &key, &[row(8)]).unwrap();
        assert!(!named.is_symlink(), "the image of no row");
    }

    /// Killed after the row of scene x was stored, and before that of y.
    #[test]
    fn renders_of_a_killed_run_get_their_names_if_their_row_is_stored() {
        let root = tempfile::tempdir().unwrap();
        let store = Store::create(root.path(), crate::Provenance::default()).unwrap();
        let render = Image::new(1, 1, vec![0.0, 0.5, 1.0]).unwrap();
        let [of_x, of_y] = ["x", "y"].map(|scene| TargetRow {
            frame: 7,
            render_hash: Some(format!("render {scene}")),
            ..sample_rows::target("m", scene, 0, 0, "psnr", 20.0)
        });
        for row in [&of_x, &of_y] {
            write_render(root.path(), row, &render).unwrap();
        }
        let other = image_path(root.path(), &of_x.key.of_method(TRUTH), 7).with_file_name(".AbC123.partial");
        fs::create_dir_all(other.parent().unwrap()).unwrap();
        fs::write(&other, b"half").unwrap();
        store.append(&sample_rows::trial("m", "x", 0, 1), std::slice::from_ref(&of_x)).unwrap();
        assert!(!has_images(root.path(), &of_x.key).unwrap(), "they have no names yet");
        settle(&store).unwrap();
        assert!(is_stored(root.path(), &of_x.key, 7, Some("render x")).unwrap());
        assert!(has_images(root.path(), &of_x.key).unwrap() && !has_images(root.path(), &of_y.key).unwrap());
        assert_eq!(unfinished(root.path()).unwrap(), [] as [PathBuf; 0]);
    }

    /// Both parts have the truth; the second was killed while it stored a render.
    #[test]
    fn a_merged_store_has_the_images_of_its_parts() {
        let root = tempfile::tempdir().unwrap();
        let [first, second, merged] = ["first", "second", "merged"].map(|name| root.path().join(name));
        let image = |sample| ImageU8::new(1, 1, vec![sample; 3]).unwrap();
        let key = |method, scene| sample_rows::key(method, scene, 0);
        let [truth, x, y] = [key(TRUTH, "x"), key("m", "x"), key("m", "y")];
        write_image(&first, &truth, 4, &image(9)).unwrap();
        write_image(&first, &x, 4, &image(20)).unwrap();
        write_image(&second, &truth, 4, &image(9)).unwrap();
        write_image(&second, &y, 4, &image(30)).unwrap();
        fs::write(image_path(&second, &y, 5).with_extension(format!("png.{PARTIAL}")), b"half").unwrap();
        let results = crate::Results::default();
        results.write_merged(&merged, &[first, second.clone(), root.path().join("none")]).unwrap();
        let expected = [(&truth, 9), (&x, 20), (&y, 30)];
        for (key, sample) in expected {
            assert!(is_stored(&merged, key, 4, Some(&hash_of_bytes(&image(sample)))).unwrap(), "{key}");
        }
        assert_eq!(files(&merged).unwrap().len(), expected.len());
        remove(&merged, &y).unwrap();
        assert!(has_images(&second, &y).unwrap(), "the part keeps its own");
    }

    /// A trial is evaluated again: one of three renders is the same, one differs, and one failed.
    #[test]
    fn images_of_equal_renders_stay() {
        let root = tempfile::tempdir().unwrap();
        let render = Image::new(1, 1, vec![0.0, 0.5, 1.0]).unwrap();
        let row = |frame: u64, hash: Option<&str>| TargetRow {
            frame,
            render_hash: hash.map(str::to_owned),
            ..sample_rows::target("m", "x", 0, 0, "psnr", 20.0)
        };
        for frame in 4..7 {
            write_render(root.path(), &row(frame, Some("before")), &render).unwrap();
        }
        let key = row(4, None).key;
        publish(root.path(), &key).unwrap();
        write_render(root.path(), &row(5, Some("now")), &render).unwrap();
        remove_others(root.path(), &key, &[row(4, Some("before")), row(5, Some("now")), row(6, None)]).unwrap();
        let stored = || (4..7).map(|frame| image_path(root.path(), &key, frame).exists()).collect::<Vec<_>>();
        assert_eq!(stored(), [true, false, false]);
        publish(root.path(), &key).unwrap();
        assert_eq!(stored(), [true, true, false], "the new one gets its name after its row is stored");
    }

    #[test]
    fn a_render_has_its_name_once_the_rows_are_stored() {
        let root = tempfile::tempdir().unwrap();
        let [key, other] = ["x", "y"].map(|scene| sample_rows::key("m", scene, 0));
        let render = |samples: [f32; 3]| Image::new(1, 1, samples.to_vec()).unwrap();
        let path = image_path(root.path(), &key, 7);
        let row = |frame| TargetRow { frame, ..sample_rows::target("m", "x", 0, 0, "psnr", 20.0) };
        write_render(root.path(), &row(7), &render([0.0, 0.5, 1.0])).unwrap();
        write_render(root.path(), &row(8), &render([f32::NAN; 3])).unwrap();
        assert!(!path.exists());
        publish(root.path(), &other).unwrap();
        assert!(!path.exists(), "another trial's");
        publish(root.path(), &key).unwrap();
        assert_eq!(disk::files(&folder(root.path(), &key)).unwrap(), std::slice::from_ref(&path));
        remove(root.path(), &other).unwrap();
        assert!(path.is_file(), "nothing of the other trial was stored");
        remove(root.path(), &key).unwrap();
        assert!(!folder(root.path(), &key).exists());
    }
}
