use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::{fmt, fs, io};

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
    first: String,
    here: LayoutCounts,
    /// A parent or subfolder that contains scenes if this one contains none.
    elsewhere: Option<(PathBuf, LayoutCounts)>,
    /// The first folder of a scene if none has the files that are looked for, and the scene's frames.
    without_files: Option<(PathBuf, Vec<usize>)>,
    /// Why the files of a scene cannot be looked for.
    unreadable: Option<String>,
}

impl FoundFiles {
    /// Looks for scenes below a folder and, if there are none, in its parents and subfolders. `layout` returns how a
    /// scene's files are laid out below a folder, if they are there under one of the names that scenes have in it, or what the
    /// system says if nobody can tell.
    pub(super) fn of(
        (what, expected): (&'static str, &'static str),
        folder: &Path,
        names: &SceneNames,
        requested: &[RequestedScene<'_>],
        layout: impl Fn(&Path, &RequestedScene<'_>, &SceneNames) -> Result<Option<Layout>, String>,
    ) -> Self {
        let found = |folder: &Path, every: usize| {
            let (mut found, mut unreadable, names) = (LayoutCounts::default(), None, names.below(folder));
            for requested in requested.iter().step_by(every) {
                match layout(folder, requested, &names) {
                    Ok(Some(layout)) => *found.0.entry(layout).or_default() += 1,
                    Ok(None) => {}
                    Err(error) => unreadable = unreadable.or(Some(error)),
                }
            }
            (found, unreadable)
        };
        let (here, unreadable) = found(folder, 1);
        let every = requested.len().div_ceil(MAX_SCENES).max(1);
        let others = || neighbours(folder).into_iter().map(|other| (found(&other, every).0, other));
        let with_scenes = || others().filter(|(found, _)| found.scenes() > 0);
        let elsewhere = if here.scenes() > 0 { None } else { with_scenes().max_by_key(|(found, _)| found.scenes()) };
        let elsewhere = elsewhere.map(|(found, other)| (other, found));
        let with_several = requested.iter().find(|of| names.entries_of(of.scene) > 1);
        let first = with_several.or_else(|| requested.first()).map_or_else(String::new, |of| names.example(of.scene));
        let of_scene = |RequestedScene { scene, frames }: &RequestedScene<'_>| {
            let mut names = names.of(scene, 0).into_iter().filter_map(|name| below(folder, &name));
            Some((names.find(|folder| folder.is_dir())?, frames.to_vec()))
        };
        let without_files = if here.scenes() > 0 { None } else { requested.iter().find_map(of_scene) };
        let (folder, requested) = (folder.to_owned(), requested.len());
        Self { what, folder, expected, requested, first, here, elsewhere, without_files, unreadable }
    }

    /// How many scenes were found.
    pub fn scenes(&self) -> usize {
        self.here.scenes()
    }

    /// # Errors
    /// [`EvalError::Settings`] if scenes were requested and none was found: what was expected, what the folder contains or why nobody
    /// can tell, and where the scenes are instead.
    pub fn check(&self) -> Result<(), EvalError> {
        if self.scenes() > 0 || self.requested == 0 {
            return Ok(());
        }
        let (folder, requested) = (self.folder.display(), self.requested);
        let found = match (&self.unreadable, &self.elsewhere, &self.without_files) {
            (Some(error), ..) => format!("none of {requested} scenes there that can be read: {error}"),
            (None, Some((other, found)), _) => format!(
                "none of {requested} scenes there, but {}{} of them below {}, in the layout {found}: use that folder",
                if requested > MAX_SCENES { "at least " } else { "" },
                found.scenes(),
                other.display()
            ),
            (None, None, Some((scene, frames))) => {
                let colour = scene.join("color");
                let (listed, frames) = (if colour.is_dir() { &colour } else { scene }, frames_as_text(frames));
                let (folder, content) = (listed.display(), content(listed));
                format!("no such file in the folder of a scene: {folder} {content}{frames}")
            }
            (None, None, None) => format!("none of {requested} scenes there; the folder {}", content(&self.folder)),
        };
        let expected = format!("{} below {folder}, where SCENE is, for example, {}", self.expected, self.first);
        Err(EvalError::Settings { what: self.what, expected, found })
    }
}

impl fmt::Display for FoundFiles {
    /// `folder of renders out: SCENE/color/000029.png in 12 of 12 scenes`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (what, folder) = (self.what, self.folder.display());
        match (self.scenes(), self.requested) {
            (0, _) => write!(f, "{what} {folder}: none of the requested scenes"),
            (found, all) if found == all => write!(f, "{what} {folder}: {}", self.here),
            (found, all) => {
                write!(f, "{what} {folder}: {}; {} of {all} scenes are missing", self.here, all - found)?;
                self.unreadable.iter().try_for_each(|error| write!(f, " or cannot be read: {error}"))
            }
        }
    }
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

/// Subfolders, the parent and its parent.
fn neighbours(folder: &Path) -> Vec<PathBuf> {
    let mut below = folders(folder);
    below.truncate(MAX_SUBFOLDERS);
    let absolute = folder.canonicalize().unwrap_or_else(|_unreadable| folder.to_owned());
    below.extend(absolute.ancestors().skip(1).take(2).map(Path::to_owned));
    below
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
        for file in ["b-0/2.png", "b-0/0.png", "c/color/000028.jpg"] {
            let path = folder.path().join(file);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, "").unwrap();
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
        assert_eq!(why(&["a"], &[28]), "none of 1 scenes there; the folder contains b-0, c");
    }

    /// Their names alone would be those that are asked for.
    #[cfg(unix)]
    #[test]
    fn entries_that_are_no_files_say_so() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::create_dir_all(at("000028.png")).unwrap();
        fs::create_dir_all(at("color")).unwrap();
        fs::write(at("000030.png"), "").unwrap();
        std::os::unix::fs::symlink("gone.png", at("000029.png")).unwrap();
        std::os::unix::fs::symlink("000030.png", at("000031.png")).unwrap();
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
        let of = |readable: &str| {
            let layout = |_: &Path, of: &RequestedScene<'_>, _: &SceneNames| match of.scene {
                scene if scene == readable => Ok(Some(Layout("SCENE.ply".to_owned()))),
                "a" => Ok(None),
                other => Err(format!("refused ({other})")),
            };
            FoundFiles::of(what, folder.path(), &names, &requested, layout)
        };
        let none = of("").check().unwrap_err().to_string();
        assert!(none.ends_with(", found none of 3 scenes there that can be read: refused (b)"), "{none}");
        let one = of("b");
        assert!(one.check().is_ok());
        let end = ": SCENE.ply (1); 2 of 3 scenes are missing or cannot be read: refused (c)";
        assert!(one.to_string().ends_with(end), "{one}");
    }
}
