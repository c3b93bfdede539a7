use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::{fmt, fs, io};

use atsplat_results::store::images::{CONTEXT, TRUTH};

use super::frame_files::FrameFiles;
use super::scene_names::SceneNames;
use super::{below, is_absent};
use crate::EvalError;

/// Limit on the subfolders searched if the given folder contains no scene.
const MAX_SUBFOLDERS: usize = 64;
/// Limit on the scenes that are looked for in each of them.
const MAX_SCENES: usize = 256;
/// Number of folder entries, and of frames, listed in a message.
const MAX_LISTED: usize = 6;

/// A scene with the frames whose files are looked for.
#[derive(Clone, Copy, Debug)]
pub struct RequestedScene<'a> {
    /// Its key.
    pub scene: &'a str,
    /// Positions of frames.
    pub frames: &'a [usize],
}

/// Where the files of a scene are below a folder, such as `SCENE/color/000029.png`.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Layout(pub String);

/// Number of scenes found below a folder in each layout.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct LayoutCounts(BTreeMap<Layout, usize>);

/// How many of the requested scenes a folder of imported results contains, and in which layout.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FoundFiles {
    what: &'static str,
    folder: PathBuf,
    expected: &'static str,
    requested: usize,
    /// The name of a requested scene.
    example: String,
    found: Found,
}

/// What a folder of imported results contains, or what may explain that it contains none of the requested scenes.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Found {
    Scenes {
        layouts: LayoutCounts,
        /// Why the files of another scene cannot be looked for.
        unreadable: Option<String>,
        /// Folders next to them that are of no scene, if scenes are missing: their names may be misspelt.
        others: Vec<String>,
    },
    /// No scene, and why the files of one cannot be looked for.
    Unreadable(String),
    /// A parent or subfolder contains scenes.
    Elsewhere(PathBuf, LayoutCounts),
    /// The first folder of a scene, which has none of the files that are looked for, and the scene's frames.
    WithoutFiles(PathBuf, Vec<usize>),
    Nothing,
}

impl FoundFiles {
    /// Looks for scenes below a folder and, if there are none, in its parents and subfolders. `layout` returns how a
    /// scene's files are laid out below a folder, if they are there under one of the names that scenes have in it, or the
    /// system's error if it cannot find out.
    pub(super) fn of(
        (what, expected): (&'static str, &'static str),
        folder: &Path,
        names: &SceneNames,
        requested: &[RequestedScene<'_>],
        layout: impl Fn(&Path, &RequestedScene<'_>, &SceneNames) -> Result<Option<Layout>, String>,
    ) -> Self {
        let (layouts, unreadable) = count_layouts(folder, names, requested, &layout);
        let found = if layouts.scenes() > 0 {
            let is_whole = layouts.scenes() == requested.len();
            let others = if is_whole { Vec::new() } else { folders_of_no_scene(folder, names) };
            Found::Scenes { layouts, unreadable, others }
        } else if let Some(error) = unreadable {
            Found::Unreadable(error)
        } else if let Some((neighbour, layouts)) = most_scenes_elsewhere(folder, names, requested, &layout) {
            Found::Elsewhere(neighbour, layouts)
        } else if let Some((scene, frames)) = first_folder_of_a_scene(folder, names, requested) {
            Found::WithoutFiles(scene, frames)
        } else {
            Found::Nothing
        };
        let with_several_entries = requested.iter().find(|requested| names.entries_of(requested.scene) > 1);
        let example = with_several_entries.or_else(|| requested.first());
        let example = example.map_or_else(String::new, |requested| names.example(requested.scene));
        Self { what, folder: folder.to_owned(), expected, requested: requested.len(), example, found }
    }

    /// How many scenes were found.
    pub fn scenes(&self) -> usize {
        match &self.found {
            Found::Scenes { layouts, .. } => layouts.scenes(),
            Found::Unreadable(_) | Found::Elsewhere(..) | Found::WithoutFiles(..) | Found::Nothing => 0,
        }
    }

    /// # Errors
    /// [`EvalError::Settings`] if scenes were requested and none was found: what was expected, what the folder contains or why it
    /// cannot be read, and where the scenes are instead.
    pub fn check(&self) -> Result<(), EvalError> {
        let (folder, requested) = (self.folder.display(), self.requested);
        if requested == 0 {
            return Ok(());
        }
        let found = match &self.found {
            Found::Scenes { .. } => return Ok(()),
            Found::Unreadable(error) => format!("none of {requested} scenes there that can be read: {error}"),
            Found::Elsewhere(other, layouts) => format!(
                "none of {requested} scenes there, but {}{} of them below {}, in the layout {layouts}: use that folder",
                if requested > MAX_SCENES { "at least " } else { "" },
                layouts.scenes(),
                other.display()
            ),
            Found::WithoutFiles(scene, frames) => {
                let colour = scene.join("color");
                let listed = if colour.is_dir() { &colour } else { scene };
                let hint = FrameFiles::of([listed.clone()], frames.iter().copied()).numbering_hint(frames);
                let (folder, content, frames) = (listed.display(), content(listed), frames_as_text(frames));
                format!("no such file in the folder of a scene: {folder} {content}{frames}{hint}")
            }
            Found::Nothing => format!("none of {requested} scenes there; the folder {}", content(&self.folder)),
        };
        let expected = format!("{} below {folder}, where SCENE is, for example, {}", self.expected, self.example);
        Err(EvalError::Settings { what: self.what, expected, found })
    }
}

impl fmt::Display for FoundFiles {
    /// `folder of renders out: SCENE/color/000029.png in 12 of 12 scenes`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (what, folder) = (self.what, self.folder.display());
        let Found::Scenes { layouts, unreadable, others } = &self.found else {
            return write!(f, "{what} {folder}: none of the requested scenes");
        };
        write!(f, "{what} {folder}: {layouts}")?;
        if layouts.scenes() < self.requested {
            let (missing, all) = (self.requested - layouts.scenes(), self.requested);
            write!(f, "; {missing} of {all} scenes are missing")?;
            unreadable.iter().try_for_each(|error| write!(f, " or cannot be read: {error}"))?;
        }
        if !others.is_empty() {
            write!(f, "; of no scene: {}", listed(others.clone()))?;
        }
        Ok(())
    }
}

/// The layouts of scenes below a folder, and why the files of the first other one cannot be looked for.
fn count_layouts(
    folder: &Path,
    names: &SceneNames,
    requested: &[RequestedScene<'_>],
    layout: &impl Fn(&Path, &RequestedScene<'_>, &SceneNames) -> Result<Option<Layout>, String>,
) -> (LayoutCounts, Option<String>) {
    let (mut layouts, mut unreadable, names) = (LayoutCounts::default(), None, names.below(folder));
    for scene in requested {
        match layout(folder, scene, &names) {
            Ok(Some(layout)) => *layouts.0.entry(layout).or_default() += 1,
            Ok(None) => {}
            Err(error) => unreadable = unreadable.or(Some(error)),
        }
    }
    (layouts, unreadable)
}

/// The parent or subfolder of a folder that contains most of some scenes, with their layouts.
fn most_scenes_elsewhere(
    folder: &Path,
    names: &SceneNames,
    requested: &[RequestedScene<'_>],
    layout: &impl Fn(&Path, &RequestedScene<'_>, &SceneNames) -> Result<Option<Layout>, String>,
) -> Option<(PathBuf, LayoutCounts)> {
    let step = requested.len().div_ceil(MAX_SCENES).max(1);
    let some: Vec<RequestedScene<'_>> = requested.iter().step_by(step).copied().collect();
    let layouts = |neighbour: PathBuf| {
        let (layouts, _) = count_layouts(&neighbour, names, &some, layout);
        (layouts.scenes() > 0).then_some((neighbour, layouts))
    };
    neighbours(folder).into_iter().filter_map(layouts).max_by_key(|(_, layouts)| layouts.scenes())
}

/// The first folder of a requested scene, and the scene's frames.
fn first_folder_of_a_scene(
    folder: &Path,
    names: &SceneNames,
    requested: &[RequestedScene<'_>],
) -> Option<(PathBuf, Vec<usize>)> {
    requested.iter().find_map(|RequestedScene { scene, frames }| {
        let mut folders = names.accepted(scene, 0).into_iter().filter_map(|name| below(folder, &name));
        Some((folders.find(|folder| folder.is_dir())?, frames.to_vec()))
    })
}

/// The folders below a folder whose names are those of no scene; none if the scenes are not known.
fn folders_of_no_scene(folder: &Path, names: &SceneNames) -> Vec<String> {
    let of_scenes = names.below(folder).all();
    if of_scenes.is_empty() {
        return Vec::new();
    }
    let found = folders(folder).into_iter().map(|path| atsplat_files::name_of(&path));
    found.filter(|name| !of_scenes.contains(name)).collect()
}

impl LayoutCounts {
    fn scenes(&self) -> usize {
        self.0.values().sum()
    }
}

impl fmt::Display for LayoutCounts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let layouts: Vec<String> = self.0.iter().map(|(Layout(name), count)| format!("{name} ({count})")).collect();
        f.write_str(&layouts.join(", "))
    }
}

/// Subfolders, those of the methods in a store of results, the parent and its parent; without those of a store's ground truth and
/// context images, which no method rendered.
fn neighbours(folder: &Path) -> Vec<PathBuf> {
    let of_methods = folders(&folder.join("images")).into_iter().flat_map(|preset| folders(&preset));
    let mut found: Vec<PathBuf> = folders(folder).into_iter().chain(of_methods).take(MAX_SUBFOLDERS).collect();
    let absolute = folder.canonicalize().unwrap_or_else(|_unreadable| folder.to_owned());
    found.extend(absolute.ancestors().skip(1).take(2).map(Path::to_owned));
    found.retain(|path| ![TRUTH, CONTEXT].contains(&atsplat_files::name_of(path).as_str()));
    found
}

/// Those that can be listed: they are only suggestions.
fn folders(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut folders: Vec<PathBuf> = entries.map(|entry| entry.path()).filter(|path| path.is_dir()).collect();
    folders.sort();
    folders
}

/// What a message says that a folder contains: its first entries. One that is called as a file and is none says so.
fn content(folder: &Path) -> String {
    let name = |entry: io::Result<fs::DirEntry>| {
        let path = entry?.path();
        let kind = match path.metadata() {
            Err(error) if is_absent(&error) => " (a link to nothing)",
            Ok(found) if found.is_dir() && path.extension().is_some() => " (a folder)",
            _ => "",
        };
        Ok(atsplat_files::name_of(&path) + kind)
    };
    let names = fs::read_dir(folder).and_then(|entries| entries.map(name).collect::<io::Result<Vec<String>>>());
    match names {
        Ok(names) if names.is_empty() => "contains nothing".to_owned(),
        Ok(mut names) => {
            names.sort();
            format!("contains {}", listed(names))
        }
        Err(error) => format!("cannot be listed: {error}"),
    }
}

/// Which frames are looked for; empty for a file with a whole scene.
fn frames_as_text(frames: &[usize]) -> String {
    let numbers: Vec<String> = frames.iter().map(ToString::to_string).collect();
    if numbers.is_empty() { String::new() } else { format!(", and the frames are {}", listed(numbers)) }
}

/// The first names, and how many more there are.
pub(super) fn listed(mut names: Vec<String>) -> String {
    let more = if names.len() > MAX_LISTED { format!(" and {} more", names.len() - MAX_LISTED) } else { String::new() };
    names.truncate(MAX_LISTED);
    format!("{}{more}", names.join(", "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_that_a_scenes_folder_lacks_are_named() {
        let folder = tempfile::tempdir().unwrap();
        for file in ["b-0/2.png", "b-0/0.png", "c/color/000028.jpg", "d/0.png", "d/1.png", "e/29.png", "e/66.png"] {
            atsplat_tests::write_file(&folder.path().join(file), "");
        }
        let why = |scenes: &[&str], frames: &[usize]| {
            let requested: Vec<_> = scenes.iter().map(|&scene| RequestedScene { scene, frames }).collect();
            let (what, names) = (("folder of renders", "SCENE/29.png"), SceneNames::default());
            let found = FoundFiles::of(what, folder.path(), &names, &requested, |_, _, _| Ok(None));
            let why = found.check().unwrap_err().to_string();
            let (_, found) = why.split_once(", found ").unwrap();
            found.replace(&format!("{}/", folder.path().display()), "")
        };
        let said = "no such file in the folder of a scene: ";
        let many = [28, 65, 83, 90, 91, 92, 93, 94];
        assert_eq!(why(&["a", "b"], &[28, 65]), format!("{said}b-0 contains 0.png, 2.png, and the frames are 28, 65"));
        let jpegs = format!("{said}c/color contains 000028.jpg, and the frames are 28, 65, 83, 90, 91, 92 and 2 more");
        assert_eq!(why(&["c"], &many), jpegs);
        assert_eq!(why(&["b"], &[]), format!("{said}b-0 contains 0.png, 2.png"));
        assert_eq!(why(&["a"], &[28]), "none of 1 scenes there; the folder contains b-0, c, d, e");
        let one_higher = ": the files' numbers are each one more, and frames are numbered from 0";
        assert_eq!(
            why(&["e"], &[65, 28]),
            format!("{said}e contains 29.png, 66.png, and the frames are 65, 28{one_higher}")
        );
        let counted = ": the files are numbered by the position among the targets, and expected by frame";
        assert_eq!(
            why(&["d"], &[28, 65]),
            format!("{said}d contains 0.png, 1.png, and the frames are 28, 65{counted}")
        );
    }

    /// The ground truth has a file for every frame, and is no method's.
    #[test]
    fn a_store_in_place_of_a_methods_images_names_those_of_a_method() {
        let folder = tempfile::tempdir().unwrap();
        for method in ["context", "mine", "truth"] {
            fs::create_dir_all(folder.path().join("images/preset").join(method).join("some-scene")).unwrap();
        }
        let requested = [RequestedScene { scene: "some-scene", frames: &[28] }];
        let layout = |folder: &Path, requested: &RequestedScene<'_>, _: &SceneNames| {
            Ok(folder.join(requested.scene).is_dir().then(|| Layout("SCENE/29.png".to_owned())))
        };
        let mine = folder.path().join("images/preset/mine");
        let end = format!(" below {}, in the layout SCENE/29.png (1): use that folder", mine.display());
        for given in ["", "images/preset"] {
            let (what, names) = (("folder of renders", "SCENE/29.png"), SceneNames::default());
            let found = FoundFiles::of(what, &folder.path().join(given), &names, &requested, layout);
            let why = found.check().unwrap_err().to_string();
            assert!(why.ends_with(&end), "{given}: {why}");
        }
    }

    /// Their names alone would be those that are asked for.
    #[cfg(unix)]
    #[test]
    fn entries_that_are_no_files_say_so() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        fs::create_dir_all(path("000028.png")).unwrap();
        fs::create_dir_all(path("color")).unwrap();
        fs::write(path("000030.png"), "").unwrap();
        std::os::unix::fs::symlink("gone.png", path("000029.png")).unwrap();
        std::os::unix::fs::symlink("000030.png", path("000031.png")).unwrap();
        let expected = "contains 000028.png (a folder), 000029.png (a link to nothing), 000030.png, 000031.png, color";
        assert_eq!(content(folder.path()), expected);
    }

    #[test]
    fn what_cannot_be_read_is_not_absent() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        fs::write(&file, "").unwrap();
        let system = fs::read_dir(&file).unwrap_err();
        assert_eq!(content(&file), format!("cannot be listed: {system}"));
        let requested = ["a", "b", "c"].map(|scene| RequestedScene { scene, frames: &[] });
        let (what, names) = (("folder of Gaussians", "SCENE.ply"), SceneNames::default());
        let found = |readable: &str| {
            let layout = |_: &Path, requested: &RequestedScene<'_>, _: &SceneNames| match requested.scene {
                scene if scene == readable => Ok(Some(Layout("SCENE.ply".to_owned()))),
                "a" => Ok(None),
                other => Err(format!("refused ({other})")),
            };
            FoundFiles::of(what, folder.path(), &names, &requested, layout)
        };
        let none = found("").check().unwrap_err().to_string();
        assert!(none.ends_with(", found none of 3 scenes there that can be read: refused (b)"), "{none}");
        let one = found("b");
        assert!(one.check().is_ok());
        let end = ": SCENE.ply (1); 2 of 3 scenes are missing or cannot be read: refused (c)";
        assert!(one.to_string().ends_with(end), "{one}");
    }
}
