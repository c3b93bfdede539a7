use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use atsplat_files::{FileError, Sha256Digest};
use atsplat_protocol::extrapolation::{Extrapolation, scene_frames, scene_lengths};
use atsplat_protocol::{Derivation, EvaluationIndex, IndexFile, IndexLayout, IndexMatch, Preset, SamplingRule};
use atsplat_results::SAMPLED_BY;
use atsplat_scene::{SceneSource, WarningKind, Warnings};

use super::IndexFolder;
use super::index_notices::{self, IndexNotice};
use crate::EvalError;

/// An evaluation index and its origin.
#[derive(Clone, Debug, PartialEq)]
pub struct PlannedIndex {
    /// The index.
    pub index: EvaluationIndex,
    /// Its file, or how it was generated.
    pub description: String,
    /// Hash of the published file's bytes if this is its content, whatever its format; otherwise of the entries as pixelSplat's
    /// files are formatted, so that a copy in another format is the same index.
    pub sha256: Sha256Digest,
    /// The published index that it equals or was derived from.
    pub name: Option<String>,
    /// The published index from which it differs only in context views that its entries leave out.
    pub reduced_from: Option<String>,
    /// Entries of the file that `index` leaves out, because a suite takes the first scenes only.
    pub left_out: u64,
    /// What readers of results must know about the index, by kind: irregularities of an unpublished file, and what a generated
    /// index leaves out.
    pub notices: BTreeMap<String, IndexNotice>,
}

impl PlannedIndex {
    /// Reads an index file, or finds the preset's index in a folder by its hash ([`Self::published`]). If the preset's split has
    /// to be derived from a published index, the split is computed with the scene lengths of the dataset.
    ///
    /// # Errors
    /// [`EvalError::Protocol`] for a file that is not an index or has conflicting entries for a scene, [`EvalError::Io`],
    /// [`EvalError::NoPublishedIndex`] for a folder without the preset's index.
    pub fn read(
        path: &Path,
        preset: &Preset,
        source: &dyn SceneSource,
        warnings: &mut Warnings,
    ) -> Result<Self, EvalError> {
        if path.is_dir() {
            return Self::published(&IndexFolder::search(path)?, preset, source, warnings);
        }
        let file = IndexFile::read(path)?;
        let matched = preset.index.recognise(&file);
        let sha256 = identity(&file, matched, preset);
        let name = match matched {
            IndexMatch::Default { name }
            | IndexMatch::Alternative { name, .. }
            | IndexMatch::Derived { name }
            | IndexMatch::Underived { name } => Some(name.to_owned()),
            IndexMatch::DerivedFromOther { .. } | IndexMatch::Unpublished => None,
        };
        let notices = if name.is_some() { BTreeMap::new() } else { index_notices::of_file(&file, preset) };
        let underived = matches!(matched, IndexMatch::Underived { .. });
        let index = file.into_unambiguous().map_err(|error| error.in_file(path))?;
        let description = path.display().to_string();
        let read = Self { index, description, sha256, name, reduced_from: None, left_out: 0, notices };
        match preset.index.derivation.filter(|_| underived) {
            None => Ok(read),
            Some(derivation) => Ok(read.split(derivation, source, warnings)?),
        }
    }

    /// Reads the preset's index among the files of a folder, as [`Self::read`] does.
    ///
    /// # Errors
    /// Those of [`Self::read`] and [`IndexFolder::published`].
    pub fn published(
        folder: &IndexFolder,
        preset: &Preset,
        source: &dyn SceneSource,
        warnings: &mut Warnings,
    ) -> Result<Self, EvalError> {
        Self::read(folder.published(preset)?, preset, source, warnings)
    }

    /// The split that a preset derives from this index, for the scenes of a dataset; from a sampled one, among the frames that have an
    /// image. Entries that it drops are noticed.
    ///
    /// # Errors
    /// Why a scene could not be fetched: it would count as missing.
    pub(crate) fn split(
        self,
        derivation: Derivation,
        source: &dyn SceneSource,
        warnings: &mut Warnings,
    ) -> Result<Self, FileError> {
        let keys: BTreeSet<&String> = source.keys().iter().collect();
        let present = self.index.scenes.iter().filter(|(key, _)| keys.contains(key));
        let present = EvaluationIndex { scenes: present.map(|(k, e)| (k.clone(), e.clone())).collect() };
        let rule = Extrapolation::from(derivation);
        let split = if self.name.is_some() {
            rule.split(&self.index, &scene_lengths(&present, source, &|| (), warnings))
        } else {
            // Sampling has warned of these scenes, and has taken only frames with an image.
            let frames = scene_frames(&present, source, &|| (), &mut Warnings::new());
            rule.split_among(&self.index, &frames)
        };
        source.check_fetched()?;
        let mut notices = self.notices;
        notices.extend(index_notices::of_split(&split, self.name.is_some()));
        let description = format!("{}, its windows with frames before and after them", self.description);
        Ok(Self { notices, ..Self::generated(split.index, description, self.name) })
    }

    /// With entries that leave context views out, which is not the published index any more; the same if none leaves any out.
    #[must_use]
    pub(crate) fn reduced_to(self, index: EvaluationIndex) -> Self {
        if index == self.index {
            return self;
        }
        let description = format!("{}, fewer context views", self.description);
        let Self { name, reduced_from, left_out, notices, .. } = self;
        Self { reduced_from: name.or(reduced_from), left_out, notices, ..Self::generated(index, description, None) }
    }

    /// Entries of the file, whichever of them `index` has.
    pub fn entries_of_file(&self) -> u64 {
        self.index.entries().count() as u64 + self.left_out
    }

    /// Samples an index, as `protocol build` does, by the rule of this name or path.
    ///
    /// # Errors
    /// Why a scene could not be fetched: it would count as unreadable.
    pub fn sampled(
        name: &str,
        rule: &SamplingRule,
        source: &dyn SceneSource,
        warnings: &mut Warnings,
    ) -> Result<Self, FileError> {
        let mut found = Warnings::new();
        let built = rule.build(source, &|| (), &mut found);
        source.check_fetched()?;
        let unreadable = found.count(WarningKind::UnreadableImage);
        warnings.merge(found);
        let mut description = format!("{SAMPLED_BY}{name}");
        if built.entries == 0 && !built.nulls.is_empty() {
            description = format!("{description}; scenes without an entry: {}", index_notices::reasons(&built));
        }
        let notices = index_notices::of_sampling(&built, unreadable, name);
        Ok(Self { notices, ..Self::generated(built.index, description, None) })
    }

    /// Notes the scenes of a sampled index's data that were not read when the data were opened, by the warnings of opening: the
    /// sampler did not see them.
    pub fn note_unread(&mut self, opening: &Warnings) {
        self.notices.extend(index_notices::of_unread(opening));
    }

    /// The index next to a dataset: `<preset>.json`, `evaluation_index_<dataset>.json` or `evaluation_index.json` in its
    /// folder.
    pub fn next_to(data: &Path, preset: &Preset) -> Option<PathBuf> {
        let names = [
            format!("{}.json", preset.name),
            format!("evaluation_index_{}.json", preset.dataset),
            "evaluation_index.json".to_owned(),
        ];
        let folder = if data.is_dir() { data } else { data.parent()? };
        names.into_iter().map(|name| folder.join(name)).find(|path| path.is_file())
    }

    fn generated(index: EvaluationIndex, description: String, name: Option<String>) -> Self {
        let sha256 = hash_of_entries(&index);
        Self { index, description, sha256, name, reduced_from: None, left_out: 0, notices: BTreeMap::new() }
    }
}

/// [`PlannedIndex::sha256`] of a file that a preset matched in this way.
fn identity(file: &IndexFile, matched: IndexMatch<'_>, preset: &Preset) -> Sha256Digest {
    let published = match matched {
        IndexMatch::Default { name } | IndexMatch::Alternative { name, .. } | IndexMatch::Underived { name } => {
            let accepted = preset.index.accepted.iter().find(|accepted| accepted.name == name);
            accepted.map(|accepted| accepted.sha256)
        }
        IndexMatch::Derived { .. } | IndexMatch::DerivedFromOther { .. } | IndexMatch::Unpublished => {
            file.recognised().map(|known| known.sha256)
        }
    };
    published.unwrap_or_else(|| hash_of_entries(&file.index))
}

fn hash_of_entries(index: &EvaluationIndex) -> Sha256Digest {
    Sha256Digest::of(index.to_json(&IndexLayout::PIXELSPLAT).as_bytes())
}

#[cfg(test)]
mod tests {
    use atsplat_camera::{Camera, CameraFromWorld, NormalizedIntrinsics};
    use atsplat_protocol::IndexEntry;
    use atsplat_protocol::extrapolation::Margin;
    use atsplat_results::RunWarning;
    use atsplat_scene::{Frame, FrameImage, Scene, SceneError};
    use glam::{DMat3, DVec3};

    use super::*;
    use crate::runner::Missing;

    /// Scenes of cameras in a row, by their numbers of frames; the first frame of the first scene has lost its image.
    struct Lengths {
        keys: Vec<String>,
        frames: Vec<usize>,
    }

    impl Lengths {
        fn of(scenes: &[(&str, usize)]) -> Self {
            let (keys, frames) = scenes.iter().map(|(key, frames)| ((*key).to_owned(), *frames)).unzip();
            Self { keys, frames }
        }
    }

    impl SceneSource for Lengths {
        fn keys(&self) -> &[String] {
            &self.keys
        }

        fn load(&self, key: &str, _warnings: &mut Warnings) -> Result<Scene, SceneError> {
            let at = self.keys.iter().position(|known| known == key).unwrap();
            let frame = |number: usize| {
                let pose = CameraFromWorld::new(DMat3::IDENTITY, DVec3::new(-(number as f64), 0.0, 0.0)).unwrap();
                let intrinsics = NormalizedIntrinsics::new(1.0, 1.0, 0.5, 0.5).unwrap();
                let is_lost = (at, number) == (0, 0);
                Frame {
                    name: number.to_string(),
                    timestamp_micros: None,
                    camera: Camera::pinhole(pose, intrinsics),
                    stated_size: None,
                    image: if is_lost { FrameImage::Missing("0.png".into()) } else { FrameImage::Absent },
                }
            };
            Ok(Scene { key: key.to_owned(), url: None, frames: (0..self.frames[at]).map(frame).collect() })
        }
    }

    fn notices_of(index: &PlannedIndex) -> Vec<(&str, u64, &str, Missing)> {
        let notices = index.notices.iter();
        notices.map(|(kind, found)| (kind.as_str(), found.count, found.example.as_str(), found.missing)).collect()
    }

    #[test]
    fn scenes_that_a_sampler_leaves_out_are_counted_by_reason() {
        let rule = SamplingRule::resolve("dl3dv-6v").unwrap();
        let source = Lengths::of(&[("a", 60), ("b", 5), ("c", 70), ("d", 3), ("e", 49)]);
        let mut index = PlannedIndex::sampled("dl3dv-6v", &rule, &source, &mut Warnings::new()).unwrap();
        let mut opening = Warnings::new();
        opening.push(WarningKind::IgnoredScene, "f", "contains images, but no cameras");
        opening.push(WarningKind::SceneNotFound, "g", "index.json lists it in 000001.torch, which is missing");
        opening.push(WarningKind::ImperfectRotation, "a", "frame 3");
        index.note_unread(&opening);
        let expected = [
            ("frames without an image, which are not sampled", 1, "dl3dv-6v", Missing::Data),
            (
                "scenes that are not read, and not sampled: ignored-scene",
                1,
                "f: contains images, but no cameras",
                Missing::Data,
            ),
            (
                "scenes that are not read, and not sampled: scene-not-found",
                1,
                "g: index.json lists it in 000001.torch, which is missing",
                Missing::Data,
            ),
            ("scenes without an entry in the sampled index", 2, "b, …: 2 too-few-frames", Missing::Data),
        ];
        assert!(index.notices.keys().all(|kind| RunWarning::of(kind).is_some()), "results count them as missing");
        assert_eq!(notices_of(&index), expected);
        assert_eq!(index.description, "sampled by dl3dv-6v", "the index itself is named as ever");
    }

    #[test]
    fn entries_that_a_split_drops_are_counted_by_reason() {
        let entry =
            |context: [usize; 2]| vec![IndexEntry { context: context.to_vec(), target: vec![2], overlap: None }];
        let scenes = [("long", [5, 9]), ("short", [0, 5]), ("out", [0, 50]), ("gone", [0, 5]), ("tiny", [0, 3])];
        let scenes = scenes.map(|(key, context)| (key.to_owned(), entry(context)));
        let source = Lengths::of(&[("long", 60), ("out", 40), ("short", 12), ("tiny", 12)]);
        let derived = |name: Option<&str>| {
            let index = EvaluationIndex { scenes: scenes.clone().into_iter().collect() };
            let planned = PlannedIndex::generated(index, "index".to_owned(), name.map(str::to_owned));
            planned.split(Derivation::ShiftedWindow { margin: Margin::TEN }, &source, &mut Warnings::new()).unwrap()
        };
        let published = derived(Some("published"));
        let expected = [("frames outside the scene", 1, "out"), ("scene too short", 2, "short")];
        let kinds = expected.map(|(why, ..)| RunWarning::DroppedBySplit.about(why));
        let skipped: Vec<_> = kinds
            .iter()
            .zip(expected)
            .map(|(kind, (_, count, first))| (kind.as_str(), count, first, Missing::Entries))
            .collect();
        assert_eq!(notices_of(&published), skipped, "a scene that is missing from the data is counted as such");
        assert_eq!(published.index.entries().count(), 2);
        let sampled = derived(None);
        let kinds = expected.map(|(why, ..)| format!("sampled entries that have no place in the split: {why}"));
        let noticed: Vec<_> = kinds
            .iter()
            .zip(expected)
            .map(|(kind, (_, count, first))| (kind.as_str(), count, first, Missing::Nothing))
            .collect();
        assert_eq!(notices_of(&sampled), noticed);
    }

    /// Scenes of which some could not be fetched.
    struct Unfetched(Lengths);

    impl SceneSource for Unfetched {
        fn keys(&self) -> &[String] {
            self.0.keys()
        }

        fn load(&self, key: &str, warnings: &mut Warnings) -> Result<Scene, SceneError> {
            self.0.load(key, warnings)
        }

        fn check_fetched(&self) -> Result<(), FileError> {
            Err(FileError::during("fetching a scene", "data")(std::io::ErrorKind::TimedOut.into()))
        }
    }

    #[test]
    fn scenes_that_could_not_be_fetched_are_not_left_out() {
        let source = Unfetched(Lengths::of(&[("a", 60), ("b", 5)]));
        let rule = SamplingRule::resolve("dl3dv-6v").unwrap();
        let error = PlannedIndex::sampled("dl3dv-6v", &rule, &source, &mut Warnings::new()).unwrap_err();
        assert!(error.to_string().starts_with("fetching a scene: "), "{error}");
        let sampled = PlannedIndex::sampled("dl3dv-6v", &rule, &source.0, &mut Warnings::new()).unwrap();
        let derivation = Derivation::ShiftedWindow { margin: Margin::TEN };
        assert!(sampled.clone().split(derivation, &source, &mut Warnings::new()).is_err());
        assert!(sampled.split(derivation, &source.0, &mut Warnings::new()).is_ok());
    }

    #[test]
    fn a_reformatted_index_is_the_same() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("index.json");
        let preset = Preset::named("rooms-2v-64").unwrap();
        let read = |index: &EvaluationIndex, layout: &IndexLayout| {
            std::fs::write(&path, index.to_json(layout)).unwrap();
            let read = PlannedIndex::read(&path, &preset, &Lengths::of(&[]), &mut Warnings::new()).unwrap();
            (read.sha256, read.name)
        };
        let layouts = [IndexLayout::NOPOSPLAT, IndexLayout::PIXELSPLAT, IndexLayout::LATENTSPLAT];
        let mut index = IndexFile::embedded("rooms-2v-200").unwrap().unwrap().index;
        let published = preset.index.accepted.iter().find(|accepted| accepted.name == "rooms-2v-200").unwrap();
        let expected = (published.sha256, Some(published.name.clone()));
        assert_eq!(layouts.map(|layout| read(&index, &layout)), [(); 3].map(|()| expected.clone()));
        // A part of it is no published index.
        index.scenes.truncate(6);
        let expected = (hash_of_entries(&index), None);
        assert_eq!(layouts.map(|layout| read(&index, &layout)), [(); 3].map(|()| expected.clone()));
        index.scenes[0][0].target[0] += 1;
        let other = read(&index, &IndexLayout::NOPOSPLAT).0;
        assert!(other != expected.0 && other != published.sha256);
    }

    #[test]
    fn irregularities_of_a_file_are_kept() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("index.json");
        let entry = |(target, more): (&str, &str)| format!(r#"{{"context": [0, 9], "target": [{target}], {more}}}"#);
        let [word, other, field] =
            [("3, 4, 5", r#""overlap": "ignore""#), ("3, 4, 5", r#""overlap": "large""#), ("3", r#""overlapp": 1"#)]
                .map(entry);
        std::fs::write(&path, format!(r#"{{"a": {word}, "b": {other}, "c": {field}}}"#)).unwrap();
        let preset = Preset::named("re10k-overlap").unwrap();
        let index = PlannedIndex::read(&path, &preset, &Lengths::of(&[]), &mut Warnings::new()).unwrap();
        let expected = [
            (
                "entries without the preset's 3 targets",
                1,
                "scene c, entry 0, field target: expected 3 frames, found 1",
                Missing::Nothing,
            ),
            ("fields that the index format does not define", 1, "overlapp, 1 times", Missing::Nothing),
            (
                "overlaps given as words, replaced by the numbers that NoPoSplat uses for them",
                2,
                "the first is \"ignore\", read as 0.25",
                Missing::Nothing,
            ),
        ];
        assert_eq!(notices_of(&index), expected);
    }
}
