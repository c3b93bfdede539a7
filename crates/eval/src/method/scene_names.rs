use std::collections::{HashMap, HashSet};
use std::path::Path;
use std::sync::Arc;

use atsplat_protocol::EvaluationIndex;
use atsplat_results::file_name;
use atsplat_results::store::PROVENANCE;

/// Names that a scene's files may have in a folder of imported results. The name of a scene never refers to an entry of another
/// one.
#[derive(Clone, Debug, Default)]
pub(super) struct SceneNames {
    /// All scenes of a run, each with the most entries that one of its indices has; empty if they are not known.
    entries: Arc<HashMap<String, usize>>,
    /// Whether the folder is a method's in the images of a store, which always appends the entry's number: there, `room-0` is
    /// the first entry of `room` and never the scene of that name.
    is_of_store: bool,
}

impl SceneNames {
    /// For a folder, with the scenes that are known here.
    pub(super) fn below(&self, folder: &Path) -> Self {
        Self { entries: Arc::clone(&self.entries), is_of_store: is_of_store(folder) }
    }

    /// For the same folder, with all scenes of these indices.
    pub(super) fn among(&self, indices: &[&EvaluationIndex]) -> Self {
        let mut most: HashMap<String, usize> = HashMap::new();
        for (scene, entries) in indices.iter().flat_map(|index| &index.scenes) {
            let of_scene = most.entry(scene.clone()).or_default();
            *of_scene = entries.len().max(*of_scene);
        }
        Self { entries: Arc::new(most), is_of_store: self.is_of_store }
    }

    /// The accepted names of an index entry of a scene: `<scene>` if no index has several entries of it, `<scene>-<entry>`, and the
    /// name under which a store keeps its images. Of several entries, `<scene>` may be any: that of the one that was written last.
    pub(super) fn accepted(&self, scene: &str, entry: usize) -> Vec<String> {
        let (available, _) = self.available_and_taken(scene, entry);
        available
    }

    /// The name that a message about missing files of an entry asks for.
    pub(super) fn expected(&self, scene: &str, entry: usize) -> String {
        let (available, taken) = self.available_and_taken(scene, entry);
        available.into_iter().chain(taken).next().unwrap_or_else(|| scene.to_owned())
    }

    /// How a message asks for an entry's files: what follows is their name.
    pub(super) fn request(&self, scene: &str, entry: usize) -> String {
        match self.entries_of(scene) {
            0 | 1 => "expected".to_owned(),
            several => format!("an index of this run has {several} entries of the scene: entry {entry} needs"),
        }
    }

    /// A scene's name as an example in a message: that of its first entry.
    pub(super) fn example(&self, scene: &str) -> String {
        let name = self.expected(scene, 0);
        match self.entries_of(scene) {
            0 | 1 => name,
            several => {
                format!("{name}, for the first of the {several} entries that an index of this run has of {scene}")
            }
        }
    }

    /// How many entries an index has of a scene, at most; 0 if that is not known.
    pub(super) fn entries_of(&self, scene: &str) -> usize {
        self.entries.get(scene).copied().unwrap_or_default()
    }

    /// What to add to a message about missing files of a scene: which of its names are those of other scenes.
    pub(super) fn note(&self, scene: &str, entry: usize) -> String {
        let (_, taken) = self.available_and_taken(scene, entry);
        let notes = taken.iter().map(|name| format!("; {name} is the scene of that name"));
        notes.collect::<Vec<_>>().concat()
    }

    /// Whether a path below the folder is not that of another scene.
    pub(super) fn may_be_of(&self, scene: &str, path: &str) -> bool {
        self.is_of_store || path == scene || !self.entries.contains_key(path)
    }

    /// What the folder's entries may be called that are of any known scene: up to a slash, for keys with one.
    pub(super) fn all(&self) -> HashSet<String> {
        let of_scene = |(scene, entries): (&String, &usize)| -> Vec<String> {
            let of_entry = |entry: usize| {
                let (available, taken) = self.available_and_taken(scene, entry);
                [available, taken].concat()
            };
            (0..(*entries).max(1)).flat_map(of_entry).chain([scene.clone()]).collect()
        };
        let names = self.entries.iter().flat_map(of_scene);
        names.filter_map(|name| name.split('/').next().map(str::to_owned)).collect()
    }

    /// The names of an entry, and those that it cannot have because they are keys of other scenes.
    fn available_and_taken(&self, scene: &str, entry: usize) -> (Vec<String>, Vec<String>) {
        let stored = format!("{}-{entry}", file_name(scene));
        if self.is_of_store {
            return (vec![stored], Vec::new());
        }
        let without_entry = (entry == 0 && self.entries_of(scene) <= 1).then(|| scene.to_owned());
        let mut names: Vec<String> = without_entry.into_iter().chain([format!("{scene}-{entry}")]).collect();
        if !names.contains(&stored) {
            names.push(stored);
        }
        names.into_iter().partition(|name| self.may_be_of(scene, name))
    }
}

/// Whether a folder is `<store>/images/<preset>/<method>`.
fn is_of_store(folder: &Path) -> bool {
    let folder = folder.canonicalize().unwrap_or_else(|_unreadable| folder.to_owned());
    let is_images = |at: &Path| at.ends_with("images") && at.with_file_name(PROVENANCE).is_file();
    folder.ancestors().nth(2).is_some_and(is_images)
}

#[cfg(test)]
mod tests {
    use atsplat_protocol::IndexEntry;

    use super::*;

    fn names(keys: &[&str]) -> SceneNames {
        let scenes = keys.iter().map(|key| ((*key).to_owned(), Vec::new())).collect();
        SceneNames::default().among(&[&EvaluationIndex { scenes }])
    }

    #[test]
    fn the_name_of_a_scene_is_not_an_entry_of_another() {
        let of = |keys: &[&str], scene, entry| (names(keys).accepted(scene, entry), names(keys).note(scene, entry));
        let no_note = String::new();
        assert_eq!(of(&[], "room", 0), (vec!["room".to_owned(), "room-0".to_owned()], no_note.clone()));
        let both = ["room", "room-0"];
        let taken = "; room-0 is the scene of that name".to_owned();
        assert_eq!(of(&both, "room", 0), (vec!["room".to_owned()], taken));
        assert_eq!(of(&both, "room-0", 0), (vec!["room-0".to_owned(), "room-0-0".to_owned()], no_note.clone()));
        assert_eq!(of(&both, "room", 1), (vec!["room-1".to_owned()], no_note));
        assert!(names(&["a", "a/color"]).may_be_of("a/color", "a/color"));
        assert!(!names(&["a", "a/color"]).may_be_of("a", "a/color"));
    }

    /// Files of both entries under the scene's name alone would be those of the entry that was written last.
    #[test]
    fn names_of_several_entries_end_with_the_entry() {
        let entry = || IndexEntry { context: vec![0], target: vec![1], overlap: None };
        let with = |entries: usize| EvaluationIndex {
            scenes: [("room".to_owned(), vec![entry(); entries]), ("hall".to_owned(), vec![entry()])]
                .into_iter()
                .collect(),
        };
        let of = |indices: &[&EvaluationIndex]| SceneNames::default().among(indices);
        let (one, two) = (with(1), with(2));
        assert_eq!(of(&[&one]).accepted("room", 0), ["room", "room-0"]);
        for several in [of(&[&two]), of(&[&two, &one]), of(&[&one, &two])] {
            assert_eq!([several.accepted("room", 0), several.accepted("room", 1)], [["room-0"], ["room-1"]]);
            assert_eq!(several.accepted("hall", 0), ["hall", "hall-0"]);
            assert_eq!(several.request("room", 1), "an index of this run has 2 entries of the scene: entry 1 needs");
            assert_eq!([several.request("hall", 0), several.example("hall")], ["expected", "hall"]);
            let example = "room-0, for the first of the 2 entries that an index of this run has of room";
            assert_eq!(several.example("room"), example);
        }
    }

    #[test]
    fn names_in_a_store_end_with_the_entry() {
        let root = tempfile::tempdir().unwrap();
        let folder = root.path().join("images/preset/method");
        std::fs::create_dir_all(&folder).unwrap();
        let known = names(&["room", "room-0", "A"]);
        assert_eq!(known.below(&folder).accepted("room", 0), ["room"], "no store");
        std::fs::write(root.path().join(PROVENANCE), "{}").unwrap();
        let stored = known.below(&folder);
        assert_eq!([stored.accepted("room", 0), stored.accepted("room-0", 0)], [["room-0"], ["room-0-0"]]);
        assert!(stored.may_be_of("room", "room-0"));
        assert_eq!(stored.accepted("A", 2), [format!("{}-2", file_name("A"))]);
        assert_eq!(stored.below(&folder.join("..")).accepted("room", 0), ["room"], "the folder above it");
    }
}
