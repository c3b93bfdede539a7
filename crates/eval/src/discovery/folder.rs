//! Finds every dataset in a folder, and every protocol that fits it.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use atsplat_camera::ImageSize;
use atsplat_files::{FileError, name_of};
use atsplat_protocol::{EvaluationIndex, NamedDataset, Preset, SamplingRule};
use atsplat_scene::{
    Format, Frame, ImageFolder, NerfstudioOptions, OpenOptions, SceneError, SceneSource, WarningKind, Warnings,
    open_with,
};
use serde::Serialize;

use super::search::{DatasetOnDisk, Search};
use crate::EvalError;
use crate::runner::{Dataset, IndexFolder, PlannedIndex};
use crate::sources::AlreadyCropped;

/// The datasets found, and what cannot run and why.
#[derive(Default)]
#[expect(missing_debug_implementations, reason = "datasets have none")]
pub struct DiscoveredDatasets {
    /// Datasets with their protocol and index, ready to run.
    pub datasets: Vec<Dataset>,
    /// The folders and files of all datasets that were found, also of those that no protocol fits.
    pub paths: Vec<PathBuf>,
    /// What cannot run.
    pub not_run: Vec<NotRun>,
}

impl DiscoveredDatasets {
    fn is_free(&self, name: &str) -> bool {
        self.datasets.iter().all(|dataset| dataset.name != name)
    }
}

/// A name that no other dataset has, for a protocol on the dataset at a path: with the path's last component, with as many as
/// distinguish it from equally named folders, or with a number.
fn name_at(preset: &str, path: &Path, is_free: impl Fn(&str) -> bool) -> String {
    let components: Vec<_> = path.iter().map(|part| part.to_string_lossy()).filter(|part| part != "/").collect();
    let endings = (0..components.len()).rev().map(|first| components[first..].join("-"));
    let last = name_of(path);
    let numbered = (2_u64..).map(|number| format!("{last}-{number}"));
    let mut names = endings.chain(numbered).map(|place| format!("{preset}@{place}"));
    #[expect(clippy::expect_used, reason = "there are more numbers than datasets")]
    names.find(|name| is_free(name)).expect("a number that no other dataset has")
}

/// A protocol that does not run on a dataset.
#[derive(Clone, Debug, Serialize)]
pub struct NotRun {
    /// Protocol and dataset.
    pub what: String,
    /// Reason as shown to the user.
    pub why: String,
}

/// Searches a folder. Index files of published protocols are found by their hash anywhere in it. Hidden folders and files
/// too large for an index are not searched: warnings name them.
///
/// # Errors
/// [`EvalError::Settings`] if `folder` is not a folder, [`EvalError::Protocol`] for a broken preset, [`EvalError::Io`] if it cannot
/// be searched for indices.
pub fn find_datasets(folder: &Path, warnings: &mut Warnings) -> Result<DiscoveredDatasets, EvalError> {
    if !folder.is_dir() {
        let found = folder.display().to_string();
        return Err(EvalError::Settings { what: "data", expected: "a folder".to_owned(), found });
    }
    let Search { datasets: mut on_disk, not_run } = Search::of(folder);
    let mut found = DiscoveredDatasets { not_run, ..DiscoveredDatasets::default() };
    if on_disk.is_empty() && found.not_run.is_empty() {
        let formats = Format::all_data();
        let why = format!("no images with {formats} in it or below, except for hidden folders");
        found.not_run.push(NotRun { what: folder.display().to_string(), why });
    }
    if on_disk.is_empty() {
        return Ok(found);
    }
    leave_out_found(&mut on_disk);
    found.paths = on_disk.iter().map(|dataset| dataset.path.clone()).collect();
    let indices = IndexFolder::search(folder)?;
    for (path, why) in indices.not_searched() {
        let what = path.display().to_string();
        if found.not_run.iter().all(|not_run| not_run.what != what) {
            warnings.push(WarningKind::NotSearched, what, why);
        }
    }
    for dataset in &on_disk {
        warnings.merge(dataset.opening.clone());
        add_protocols(&indices, dataset, &mut found, warnings)?;
    }
    Ok(found)
}

/// Scenes next to those of a dataset are not ignored if they were found as another dataset.
fn leave_out_found(on_disk: &mut [DatasetOnDisk]) {
    let paths: Vec<PathBuf> = on_disk.iter().map(|dataset| dataset.path.clone()).collect();
    for dataset in on_disk {
        let below: Vec<&Path> = paths.iter().filter_map(|path| path.strip_prefix(&dataset.path).ok()).collect();
        let is_found = |scene: &str| below.iter().any(|path| path.iter().any(|part| part == scene));
        dataset.opening.remove(WarningKind::IgnoredScene, is_found);
    }
}

/// Adds every protocol that fits a dataset: with a published index that names its scenes, else with the protocol's sampling rule.
fn add_protocols(
    indices: &IndexFolder,
    dataset: &DatasetOnDisk,
    found: &mut DiscoveredDatasets,
    warnings: &mut Warnings,
) -> Result<(), EvalError> {
    let before = found.datasets.len();
    for name in Preset::names() {
        let preset = Preset::named(name)?;
        if preset.stands_for.is_some() || !is_compatible(dataset.format, &preset) {
            continue;
        }
        let what = format!("{name} on {}", dataset.path.display());
        let Prepared { source, preset, description } = match prepared(dataset, &preset) {
            Ok(Some(prepared)) => prepared,
            Ok(None) => {
                let size = preset.preprocessing.expected_size.map_or("any".to_owned(), |size| size.to_string());
                found.not_run.push(NotRun { what, why: format!("its images do not have the protocol's size, {size}") });
                continue;
            }
            Err(error) => {
                found.not_run.push(NotRun { what, why: format!("its images cannot be read: {error}") });
                continue;
            }
        };
        match index(indices, dataset, source.as_ref(), &preset, warnings) {
            Ok(index) => {
                let is_free = |name: &str| found.is_free(name);
                let name = if is_free(name) { name.to_owned() } else { name_at(name, &dataset.path, is_free) };
                found.datasets.push(Dataset { name, preset, source, description, index });
            }
            Err(why) => found.not_run.push(NotRun { what, why }),
        }
    }
    if found.datasets.len() == before { add_photos(dataset, found, warnings) } else { Ok(()) }
}

/// A dataset that fits no published protocol is evaluated as any capture is.
fn add_photos(
    dataset: &DatasetOnDisk,
    found: &mut DiscoveredDatasets,
    warnings: &mut Warnings,
) -> Result<(), EvalError> {
    let preset = Preset::named("photos-3v-256")?;
    let source = Arc::clone(&dataset.source);
    let what = format!("{} on {}", preset.name, dataset.path.display());
    match sampled(dataset, source.as_ref(), &preset, warnings) {
        Ok(index) => {
            let description = dataset.path.display().to_string();
            let name = name_at(&preset.name, &dataset.path, |name| found.is_free(name));
            found.datasets.push(Dataset { name, preset, source, description, index });
        }
        Err(why) => found.not_run.push(NotRun { what, why }),
    }
    Ok(())
}

/// Whether the dataset of a preset may have this format.
fn is_compatible(format: Format, preset: &Preset) -> bool {
    NamedDataset::by_id(&preset.dataset).is_some_and(|dataset| dataset.formats.contains(&format))
}

/// A dataset with images in a preset's size.
struct Prepared {
    source: Arc<dyn SceneSource>,
    preset: Preset,
    description: String,
}

/// The dataset with images in the preset's size: as they are, already cropped, or a downscaled copy. `None` if their sizes are
/// others; an error if none of these fits, and the images or the scenes that list them cannot be read.
fn prepared(dataset: &DatasetOnDisk, preset: &Preset) -> Result<Option<Prepared>, SceneError> {
    let (preset, description) = (preset.clone(), dataset.path.display().to_string());
    let source = Arc::clone(&dataset.source);
    let Some(expected) = preset.preprocessing.expected_size else {
        return Ok(Some(Prepared { source, preset, description }));
    };
    let found_size = image_size(source.as_ref());
    if found_size.as_ref().is_ok_and(|size| *size == Some(expected)) {
        return Ok(Some(Prepared { source, preset, description }));
    }
    if let Some((source, preset)) = AlreadyCropped::of(&source, &preset) {
        let description = format!("{description}, images cropped beforehand");
        return Ok(Some(Prepared { source: Arc::new(source), preset, description }));
    }
    let mut unreadable = found_size.err();
    for factor in ImageFolder::FACTORS.into_iter().rev() {
        let images = ImageFolder::Downscaled(factor);
        let nerfstudio = NerfstudioOptions { images, ..NerfstudioOptions::default() };
        let options = OpenOptions { nerfstudio, ..OpenOptions::default() };
        // Most captures have no copy of this size.
        let Ok(copy) = open_with(&dataset.path, &options, &mut Warnings::new()) else { continue };
        match image_size(&copy) {
            Ok(size) if size == Some(expected) => {
                let description = format!("{description}, images_{factor}");
                return Ok(Some(Prepared { source: Arc::new(copy), preset, description }));
            }
            Ok(_) => {}
            Err(error) => unreadable = unreadable.or(Some(error)),
        }
    }
    unreadable.map_or(Ok(None), Err)
}

/// The published index that names a scene of the dataset, or an index by the preset's sampling rule.
fn index(
    indices: &IndexFolder,
    dataset: &DatasetOnDisk,
    source: &dyn SceneSource,
    preset: &Preset,
    warnings: &mut Warnings,
) -> Result<PlannedIndex, String> {
    match PlannedIndex::published(indices, preset, source, warnings) {
        Ok(index) => {
            let keys: BTreeSet<&String> = source.keys().iter().collect();
            let is_available = |(key, entries): (&String, &Vec<_>)| !entries.is_empty() && keys.contains(key);
            if index.index.scenes.iter().any(is_available) {
                return Ok(index);
            }
        }
        Err(EvalError::NoPublishedIndex { .. }) => {}
        Err(broken) => return Err(broken.to_string()),
    }
    // RE10K's protocols apply only to the official scenes; DL3DV's sampling rule applies to any capture in its layout.
    let named = NamedDataset::by_id(&preset.dataset);
    if named.is_some_and(|named| named.formats_of_any_data.contains(&dataset.format)) {
        return sampled(dataset, source, preset, warnings);
    }
    Err("no published index in the folder names one of its scenes".to_owned())
}

fn sampled(
    dataset: &DatasetOnDisk,
    source: &dyn SceneSource,
    preset: &Preset,
    warnings: &mut Warnings,
) -> Result<PlannedIndex, String> {
    let Some(sampler) = &preset.index.sampler else { return Err("the protocol has no sampling rule".to_owned()) };
    let rule = SamplingRule::resolve(sampler).map_err(|error| error.to_string())?;
    let unfetched = |error: FileError| error.to_string();
    let mut planned = PlannedIndex::sampled(sampler, &rule, source, warnings).map_err(unfetched)?;
    if let Some(derivation) = preset.index.derivation {
        planned = planned.split(derivation, source, warnings).map_err(unfetched)?;
    }
    planned.note_unread(&dataset.opening);
    if is_empty(&planned.index) { Err(format!("{sampler} finds no frames")) } else { Ok(planned) }
}

fn is_empty(index: &EvaluationIndex) -> bool {
    index.entries().next().is_none()
}

/// Size of the first scene's first image; of later scenes if that cannot be read. `None` if there are no images.
fn image_size(source: &dyn SceneSource) -> Result<Option<ImageSize>, SceneError> {
    first_readable(source, Frame::size)
}

/// What `read` returns for the first image of the first scene that can be read. `None` if no scene has an image; the first error
/// if none of them can be read.
pub(super) fn first_readable<T>(
    source: &dyn SceneSource,
    read: impl Fn(&Frame, &str, usize) -> Result<T, SceneError>,
) -> Result<Option<T>, SceneError> {
    let mut unreadable = None;
    for key in source.keys() {
        let found = source.load(key, &mut Warnings::new()).and_then(|scene| {
            let first = scene.frames.iter().enumerate().find(|(_, frame)| frame.image.is_available());
            first.map(|(at, frame)| read(frame, key, at)).transpose()
        });
        match found {
            Ok(Some(value)) => return Ok(Some(value)),
            Ok(None) => {}
            Err(error) => unreadable = unreadable.or(Some(error)),
        }
    }
    unreadable.map_or(Ok(None), Err)
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    pub(in super::super) fn capture(folder: &Path) {
        std::fs::create_dir_all(folder).unwrap();
        let image = atsplat_pixels::ImageU8::new(2, 2, vec![9; 12]).unwrap();
        std::fs::write(folder.join("0.png"), atsplat_pixels::encode_png(&image).unwrap()).unwrap();
        let pose = "[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]";
        let frame = format!(r#"{{"file_path":"0.png","transform_matrix":{pose}}}"#);
        let intrinsics = r#""w":2,"h":2,"fl_x":2,"fl_y":2,"cx":1,"cy":1"#;
        std::fs::write(folder.join("transforms.json"), format!(r#"{{{intrinsics},"frames":[{frame}]}}"#)).unwrap();
    }

    #[test]
    fn every_format_is_named_where_nothing_is_found() {
        let root = tempfile::tempdir().unwrap();
        let found = find_datasets(root.path(), &mut Warnings::new()).unwrap();
        let [NotRun { why, .. }] = &found.not_run[..] else { panic!("{:?}", found.not_run) };
        for format in Format::ALL {
            let data = format.data();
            assert!(why.contains(data.strip_prefix("a ").unwrap_or(data)), "{format}: {why}");
        }
    }

    /// Of twelve frames in a row, the second has lost its image: it is not sampled, and the others keep their numbers.
    #[test]
    fn frames_without_an_image_are_counted_and_keep_their_places() {
        let root = tempfile::tempdir().unwrap();
        let frame = |number: usize| {
            let pose = format!("[[1,0,0,{number}],[0,1,0,0],[0,0,1,0],[0,0,0,1]]");
            format!(r#"{{"file_path":"{number}.png","transform_matrix":{pose}}}"#)
        };
        capture(root.path());
        let frames: Vec<String> = (0..12).map(frame).collect();
        let intrinsics = r#""w":2,"h":2,"fl_x":2,"fl_y":2,"cx":1,"cy":1"#;
        let text = format!(r#"{{{intrinsics},"frames":[{}]}}"#, frames.join(","));
        std::fs::write(root.path().join("transforms.json"), text).unwrap();
        for number in 2..12 {
            std::fs::copy(root.path().join("0.png"), root.path().join(format!("{number}.png"))).unwrap();
        }
        let found = find_datasets(root.path(), &mut Warnings::new()).unwrap();
        let photos = found.datasets.iter().find(|dataset| dataset.preset.name == "photos-3v-256").unwrap();
        let entry = photos.index.index.entries().next().unwrap().2;
        assert_eq!((entry.context.first(), entry.context.last()), (Some(&0), Some(&11)), "places in the whole capture");
        assert!(!entry.context.contains(&1) && !entry.target.contains(&1), "{entry:?}");
        let notices = &photos.index.notices;
        let counts: Vec<_> = notices.iter().map(|(kind, notice)| (kind.as_str(), notice.count)).collect();
        assert_eq!(counts, [("frames without an image, which are not sampled", 1)]);
        let key = &photos.source.keys()[0];
        assert_eq!(photos.source.load(key, &mut Warnings::new()).unwrap().frames.len(), 12);
    }

    /// Next to the captures are a folder of images without cameras, which nothing reads, and another dataset, which is read.
    #[test]
    fn what_opening_a_dataset_leaves_out_is_passed_on_unless_it_is_found_by_itself() {
        let root = tempfile::tempdir().unwrap();
        let [captured, lost, clip] = ["a", "lost/images", "clip/clip"].map(|name| root.path().join(name));
        capture(&captured);
        for (folder, image) in [(&lost, "0.png"), (&clip, "0.png")] {
            std::fs::create_dir_all(folder).unwrap();
            std::fs::copy(captured.join("0.png"), folder.join(image)).unwrap();
        }
        let trajectory = "https://example.org\n0 1 1 0.5 0.5 0 0 1 0 0 0 0 1 0 0 0 0 1 0\n";
        std::fs::write(root.path().join("clip/clip.txt"), trajectory).unwrap();
        let mut on_disk = Search::of(root.path()).datasets;
        let ignored = |on_disk: &[DatasetOnDisk]| -> Vec<String> {
            let kept = on_disk.iter().flat_map(|dataset| dataset.opening.kept());
            kept.filter(|warning| warning.kind == WarningKind::IgnoredScene)
                .map(|warning| warning.scene.clone())
                .collect()
        };
        assert_eq!(ignored(&on_disk), ["clip", "lost"]);
        leave_out_found(&mut on_disk);
        assert_eq!(
            ignored(&on_disk),
            ["lost"],
            "{:?}",
            on_disk.iter().map(|dataset| &dataset.path).collect::<Vec<_>>()
        );
        let mut warnings = Warnings::new();
        find_datasets(root.path(), &mut warnings).unwrap();
        assert_eq!(warnings.count(WarningKind::IgnoredScene), 1);
    }

    #[test]
    fn what_is_not_searched_is_warned_about() {
        let root = tempfile::tempdir().unwrap();
        let [captured, hidden, large] = ["a", "sets/.old", "large.json"].map(|name| root.path().join(name));
        capture(&captured);
        capture(&hidden.join("more/b"));
        std::fs::File::create(&large).unwrap().set_len((64 << 20) + 1).unwrap();
        let mut warnings = Warnings::new();
        find_datasets(root.path(), &mut warnings).unwrap();
        let kept = warnings.kept().iter().filter(|warning| warning.kind == WarningKind::NotSearched);
        let named: Vec<(&str, &str)> = kept.map(|warning| (&*warning.scene, &*warning.detail)).collect();
        let [large, hidden] = [large, hidden].map(|path| path.display().to_string());
        assert_eq!(named, [(&*large, "larger than 64 MiB"), (&*hidden, "hidden")]);
    }

    #[test]
    fn a_broken_dataset_is_named_with_its_fault() {
        let root = tempfile::tempdir().unwrap();
        capture(&root.path().join("captures/a"));
        let chunks = root.path().join("re10k");
        std::fs::create_dir(&chunks).unwrap();
        for name in ["index.json", "000000.torch"] {
            std::fs::write(chunks.join(name), "{").unwrap();
        }
        let found = find_datasets(root.path(), &mut Warnings::new()).unwrap();
        let broken = found.not_run.iter().find(|not_run| not_run.what == chunks.display().to_string());
        assert!(broken.is_some_and(|broken| broken.why.contains("index.json")), "{:?}", found.not_run);
    }

    #[test]
    fn unreadable_images_are_not_reported_as_a_wrong_size() {
        let root = tempfile::tempdir().unwrap();
        let broken = root.path().join("broken");
        capture(&broken);
        std::fs::write(broken.join("0.png"), "no image").unwrap();
        let whys = |root: &Path| {
            let found = find_datasets(root, &mut Warnings::new()).unwrap();
            let of_dl3dv = found.not_run.into_iter().filter(|not_run| not_run.what.starts_with("dl3dv-2v-256x448 on "));
            of_dl3dv.map(|not_run| not_run.why).collect::<Vec<_>>()
        };
        let of_broken = whys(root.path());
        assert!(matches!(&of_broken[..], [why] if why.starts_with("its images cannot be read: ")), "{of_broken:?}");
        std::fs::remove_dir_all(&broken).unwrap();
        capture(&root.path().join("small"));
        let of_small = whys(root.path());
        assert!(matches!(&of_small[..], [why] if why.starts_with("its images do not have the")), "{of_small:?}");
    }

    #[test]
    fn equally_named_folders_give_different_names() {
        let mut names: Vec<String> = Vec::new();
        for path in ["/data/one/room", "/data/two/room", "/data/three/room", "/data/two/room", "/data/two/room"] {
            names.push(name_at("photos-3v-256", Path::new(path), |name| !names.iter().any(|other| other == name)));
        }
        let places = ["room", "two-room", "three-room", "data-two-room", "room-2"];
        assert_eq!(names, places.map(|place| format!("photos-3v-256@{place}")));
    }
}
