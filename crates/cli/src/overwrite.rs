//! Outputs that would overwrite what a command reads.

use std::collections::BTreeMap;
use std::ffi::OsStr;
use std::io::Result as IoResult;
use std::path::{Component, Path, PathBuf, absolute};
use std::sync::{Mutex, PoisonError};

use anyhow::{Context as _, bail, ensure};
use atsplat_eval::rendering::RENDER_RECORD;
use atsplat_files::{canonical_path, is_at, is_toml_path};
use atsplat_scene::{Format, Frame, Scene, SceneError, SceneSource, Warnings, is_image_name};

/// What a command reads, for [`check_output`].
#[derive(Clone, Copy, Debug)]
pub(crate) enum Input<'a> {
    /// What it is, such as "index", and its path. Without a file there, it is the name of something embedded, or reading it
    /// will fail.
    File(&'static str, &'a Path),
    /// What it is, and a name or a path that ends in `.toml`.
    Toml(&'static str, &'a str),
    /// A dataset, a file or a folder, or a folder of depth maps or points.
    Dataset(&'a Path),
}

/// Rejects an output that would overwrite an input, or be read as a file of an input dataset. `option` names the argument for
/// the message.
pub(crate) fn check_output(option: &str, out: &Path, inputs: &[Input<'_>]) -> anyhow::Result<()> {
    let shown = out.display();
    let places = places(out).with_context(|| format!("{option} {shown}"))?;
    let overwrites = |what: &str| format!("would overwrite the input {what}; choose another file");
    for input in inputs {
        let fault = match *input {
            Input::File(what, path) if is_at(out, path) => overwrites(what),
            Input::Toml(what, name) if is_toml_path(name) && is_at(out, Path::new(name)) => overwrites(what),
            Input::Dataset(data) if is_read_with(data, &places) => {
                format!("would be read as part of the dataset {}; choose a path outside it", data.display())
            }
            _ => continue,
        };
        bail!("{option}: {shown} {fault}");
    }
    Ok(())
}

/// Rejects the dataset's own folder as that of results: their files would be read as those of scenes, or lie among photos.
pub(crate) fn check_results_folder(out: &Path, data: &Path) -> anyhow::Result<()> {
    let is_data = if atsplat_objects::url(data).is_some() { data == out } else { data.is_dir() && is_at(out, data) };
    ensure!(!is_data, "--out: {} is the folder of the dataset; choose another one for the results", out.display());
    Ok(())
}

/// Where a file is: its canonical path, and those that a link in a dataset has, as a file and as a folder.
fn places(file: &Path) -> IoResult<[PathBuf; 3]> {
    let canonical = canonical_path(file)?;
    let Some((folder, name)) = file.parent().zip(file.file_name()) else {
        return Ok([canonical.clone(), canonical.clone(), canonical]);
    };
    let (link, absolute) = (canonical_path(folder)?.join(name), absolute(file)?);
    let goes_up = absolute.components().any(|part| part == Component::ParentDir);
    let as_given = if goes_up { canonical.clone() } else { absolute };
    Ok([canonical, link, as_given])
}

/// Whether the file at these places is the dataset, or would be read with it. A dataset may be elsewhere, or missing.
fn is_read_with(data: &Path, places: &[PathBuf]) -> bool {
    let Ok(canonical) = data.canonicalize() else { return false };
    let mut named = places.iter().filter(|place| is_name_of_dataset(place));
    if data.is_dir() {
        let as_given = absolute(data).unwrap_or_else(|_unknown| canonical.clone());
        return named.any(|place| place.starts_with(&canonical) || place.starts_with(&as_given));
    }
    places.contains(&canonical) || named.any(|place| place.parent() == canonical.parent())
}

/// Whether a format of datasets reads files of this name: cameras and points by their names alone, images and depth maps if
/// they exist.
fn is_name_of_dataset(place: &Path) -> bool {
    let name = place.file_name().map(OsStr::to_string_lossy).unwrap_or_default();
    let is_depth_map = || place.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("exr"));
    name == RENDER_RECORD
        || Format::ALL.into_iter().any(|format| format.reads_file(place))
        || ((is_image_name(&name) || is_depth_map()) && place.is_file())
}

/// An input file, and what it is, such as "photo".
pub(crate) type InputFile<'a> = (&'static str, &'a Path);

/// Rejects outputs that would overwrite input files. `option` names the argument for the message.
pub(crate) fn check_outputs<'a>(
    option: &str,
    outputs: impl IntoIterator<Item = PathBuf>,
    inputs: impl IntoIterator<Item = InputFile<'a>>,
) -> anyhow::Result<()> {
    // Files that do not exist yet overwrite nothing.
    let existing = outputs.into_iter().filter(|file| file.symlink_metadata().is_ok());
    let existing: BTreeMap<PathBuf, PathBuf> = existing.filter_map(|file| Some((entry(&file)?, file))).collect();
    if existing.is_empty() {
        return Ok(());
    }
    for (what, file) in inputs {
        // A link is overwritten, not what it leads to.
        let mut places = [entry(file), file.canonicalize().ok()].into_iter().flatten();
        if let Some(output) = places.find_map(|place| existing.get(&place)) {
            let (output, file) = (output.display(), file.display());
            bail!("{option}: {output} would overwrite the input {what} {file}; choose another folder or name");
        }
    }
    Ok(())
}

/// The image files of these frames, also of those without a usable pose.
pub(crate) fn photos(frames: &[Frame]) -> impl Iterator<Item = InputFile<'_>> {
    frames.iter().filter_map(|frame| Some(("photo", frame.image.in_source().file()?)))
}

/// A dataset that notes whether `--plot` would overwrite a photo of a scene that is loaded.
pub(crate) struct WatchedPhotos<'a> {
    source: &'a dyn SceneSource,
    plot: Option<&'a Path>,
    fault: Mutex<Option<anyhow::Error>>,
}

impl<'a> WatchedPhotos<'a> {
    pub(crate) const fn new(source: &'a dyn SceneSource, plot: Option<&'a Path>) -> Self {
        Self { source, plot, fault: Mutex::new(None) }
    }

    /// Fails if the plot would overwrite a photo of a loaded scene.
    pub(crate) fn check(self) -> anyhow::Result<()> {
        self.fault.into_inner().unwrap_or_else(PoisonError::into_inner).map_or(Ok(()), Err)
    }
}

impl SceneSource for WatchedPhotos<'_> {
    fn keys(&self) -> &[String] {
        self.source.keys()
    }

    fn load(&self, key: &str, warnings: &mut Warnings) -> Result<Scene, SceneError> {
        let scene = self.source.load(key, warnings)?;
        if let Err(error) = check_outputs("--plot", self.plot.map(Path::to_owned), photos(&scene.frames)) {
            self.fault.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
        }
        Ok(scene)
    }

    fn inner(&self) -> Option<&dyn SceneSource> {
        Some(self.source)
    }
}

/// Where a file has its name, also if that is a link.
fn entry(file: &Path) -> Option<PathBuf> {
    let folder = file.parent().unwrap_or(Path::new(""));
    Some(canonical_path(folder).ok()?.join(file.file_name()?))
}

#[cfg(test)]
mod tests {
    use std::fs;

    use atsplat_camera::{Camera, CameraFromWorld, NormalizedIntrinsics};
    use atsplat_scene::FrameImage;

    use super::*;

    /// A dataset in `data`, and what is allowed and rejected next to its files.
    #[test]
    fn outputs_that_overwrite_inputs_are_errors() {
        let root = tempfile::tempdir().unwrap();
        let at = |path: &str| root.path().join(path);
        fs::create_dir_all(at("data/test")).unwrap();
        for file in
            ["data/transforms.json", "data/0.PNG", "data/0.exr", "data/test/000.torch", "index", "map.toml", "map"]
        {
            fs::write(at(file), "").unwrap();
        }
        let (data, index, map) = (at("data"), at("index"), at("map.toml"));
        let name = map.to_string_lossy().into_owned();
        let inputs = [Input::File("index", &index), Input::Toml("key map", &name), Input::Dataset(&data)];
        let check = |path: &str| check_output("--out", &at(path), &inputs).map_err(|error| error.to_string());
        for (path, expected) in [
            ("index", "index would overwrite the input index; choose another file"),
            ("data/../index", "would overwrite the input index"),
            ("new/../index", "would overwrite the input index"),
            ("map.toml", "map.toml would overwrite the input key map; choose another file"),
            ("data/transforms.json", "transforms.json would be read as part of the dataset "),
            ("data/new/../sparse/0/cameras.bin", "part of the dataset "),
            ("data/scene.txt", "part of the dataset "),
            ("data/0.PNG", "part of the dataset "),
            ("data/0.exr", "part of the dataset "),
            ("data/render.json", "part of the dataset "),
            ("data/test/index.json", "part of the dataset "),
        ] {
            let error = check(path).unwrap_err();
            assert!(error.starts_with("--out: ") && error.contains(expected), "{path}: {error}");
        }
        for path in
            ["index.json", "map", "data/index.json", "data/1.PNG", "data/fitted.ply", "transforms.json", "data2/a.txt"]
        {
            assert_eq!(check(path), Ok(()), "{path}");
        }
        let file = at("data/transforms.json");
        let of_file = |path: &str| check_output("--out", &at(path), &[Input::Dataset(&file)]).is_ok();
        assert!(!of_file("data/transforms.json") && !of_file("data/images.txt") && of_file("data/test/images.txt"));
        assert_eq!(check_output("--out", &at("new"), &[Input::File("weights", Path::new("micro"))]).ok(), Some(()));
    }

    #[cfg(unix)]
    #[test]
    fn files_are_found_behind_links() {
        use std::os::unix::fs::symlink;

        let root = tempfile::tempdir().unwrap();
        let at = |path: &str| root.path().join(path);
        fs::create_dir(at("data")).unwrap();
        symlink(at("data"), at("link")).unwrap();
        check_output("--out", &at("link/transforms.json"), &[Input::Dataset(&at("data"))]).unwrap_err();
        check_output("--out", &at("link/a/b.txt"), &[Input::Dataset(&at("data"))]).unwrap_err();
        check_output("--out", &at("link/a.json"), &[Input::Dataset(&at("data"))]).unwrap();
        // A file and a folder of a dataset that are elsewhere.
        fs::create_dir(at("elsewhere")).unwrap();
        fs::write(at("elsewhere/blob"), "").unwrap();
        symlink(at("elsewhere"), at("data/scene")).unwrap();
        symlink(at("elsewhere/blob"), at("data/transforms.json")).unwrap();
        check_output("--out", &at("data/transforms.json"), &[Input::Dataset(&at("data"))]).unwrap_err();
        check_output("--out", &at("data/scene/transforms.json"), &[Input::Dataset(&at("data"))]).unwrap_err();
        check_output("--out", &at("elsewhere/transforms.json"), &[Input::Dataset(&at("data"))]).unwrap();
    }

    #[test]
    fn inputs_are_not_overwritten_under_any_of_their_names() {
        let root = tempfile::tempdir().unwrap();
        let at = |path: &str| root.path().join(path);
        fs::create_dir(at("data")).unwrap();
        for file in ["data/0.png", "data/1.png"] {
            fs::write(at(file), "").unwrap();
        }
        let check = |output: &str, input: &str| {
            check_outputs("--out", [at(output)], [("photo", at(input).as_path())]).map_err(|error| error.to_string())
        };
        let error = check("data/../data/0.png", "data/0.png").unwrap_err();
        assert!(error.starts_with("--out: ") && error.contains("0.png would overwrite the input photo "), "{error}");
        assert_eq!(check("data/1.png", "data/0.png"), Ok(()));
        assert_eq!(check("data/2.png", "data/2.png"), Ok(()), "neither exists");
        #[cfg(unix)]
        {
            use std::os::unix::fs::symlink;
            symlink(at("data"), at("link")).unwrap();
            symlink(at("data/0.png"), at("data/here.png")).unwrap();
            for (output, input) in
                [("link/0.png", "data/0.png"), ("data/0.png", "data/here.png"), ("data/here.png", "data/here.png")]
            {
                assert!(check(output, input).is_err(), "{output} {input}");
            }
            assert_eq!(check("data/here.png", "data/0.png"), Ok(()), "only the link is overwritten");
        }
    }

    #[test]
    fn photos_of_frames_without_a_pose_are_not_overwritten_either() {
        let root = tempfile::tempdir().unwrap();
        let photo = root.path().join("0.png");
        fs::write(&photo, "").unwrap();
        let intrinsics = NormalizedIntrinsics::new(0.9, 0.9, 0.5, 0.5).unwrap();
        let frames = [Frame {
            name: "0".to_owned(),
            timestamp_micros: None,
            camera: Camera::pinhole(CameraFromWorld::UNKNOWN, intrinsics),
            stated_size: None,
            image: FrameImage::File(photo.clone()).unposed("no rotation"),
        }];
        let error = check_outputs("--out", [photo], photos(&frames)).unwrap_err().to_string();
        assert!(error.contains("0.png would overwrite the input photo "), "{error}");
    }
}
