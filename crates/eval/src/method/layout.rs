use std::collections::BTreeMap;
use std::fmt;
use std::fs;
use std::path::{Path, PathBuf};

use crate::EvalError;

/// Folders beside the one that was given, in which scenes are looked for.
const MOST_NEIGHBOURS: usize = 64;
/// Names of what a folder holds that are told.
const TOLD: usize = 6;

/// A scene, and the frames whose files are looked for.
#[derive(Clone, Copy, Debug)]
pub struct Asked<'a> {
    /// Its key.
    pub scene: &'a str,
    /// Positions of frames.
    pub frames: &'a [usize],
}

/// Where the files of a scene lie below a folder, as `SCENE/color/000029.png`.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Layout(pub String);

/// Layouts of the scenes that were found below a folder.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
struct Found(BTreeMap<Layout, usize>);

/// What a folder of imported results holds of the scenes that are asked for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Survey {
    what: &'static str,
    folder: PathBuf,
    expected: &'static str,
    asked: usize,
    first: String,
    here: Found,
    /// A folder up or down that holds more of them.
    elsewhere: Option<(PathBuf, Found)>,
}

impl Survey {
    /// Looks for scenes below a folder, and where none is, one folder up and down. `layout` tells how a scene's files
    /// lie below a folder, if they do.
    pub(super) fn of(
        (what, expected): (&'static str, &'static str),
        folder: &Path,
        asked: &[Asked<'_>],
        layout: impl Fn(&Path, &Asked<'_>) -> Option<Layout>,
    ) -> Self {
        let found = |folder: &Path| {
            let mut found = Found::default();
            for layout in asked.iter().filter_map(|asked| layout(folder, asked)) {
                *found.0.entry(layout).or_default() += 1;
            }
            found
        };
        let here = found(folder);
        let others = || neighbours(folder).into_iter().map(|other| (found(&other), other));
        let elsewhere = if here.scenes() == 0 {
            let most = others().filter(|(found, _)| found.scenes() > 0).max_by_key(|(found, _)| found.scenes());
            most.map(|(found, other)| (other, found))
        } else {
            None
        };
        let first = asked.first().map(|asked| asked.scene.to_owned()).unwrap_or_default();
        Self { what, folder: folder.to_owned(), expected, asked: asked.len(), first, here, elsewhere }
    }

    /// How many scenes are there.
    pub fn scenes(&self) -> usize {
        self.here.scenes()
    }

    /// Why nothing can come of this folder; nothing where a scene is there, or none was asked for.
    ///
    /// # Errors
    /// [`EvalError::Settings`] with what was looked for, what is there, and where it is instead.
    pub fn check(&self) -> Result<(), EvalError> {
        if self.scenes() > 0 || self.asked == 0 {
            return Ok(());
        }
        let (folder, asked) = (self.folder.display(), self.asked);
        let found = match &self.elsewhere {
            Some((other, found)) => format!(
                "none of {asked} scenes there, but {} of them below {}, as {found}: give that folder",
                found.scenes(),
                other.display()
            ),
            None => format!("none of {asked} scenes there; the folder holds {}", content(&self.folder)),
        };
        let expected = format!("{} below {folder}, SCENE as {}", self.expected, self.first);
        Err(EvalError::Settings { what: self.what, expected, found })
    }
}

impl fmt::Display for Survey {
    /// `folder of renders out: SCENE/color/000029.png in 12 of 12 scenes`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (what, folder) = (self.what, self.folder.display());
        match (self.scenes(), self.asked) {
            (0, _) => write!(f, "{what} {folder}: no scene of those asked for"),
            (found, all) if found == all => write!(f, "{what} {folder}: {}", self.here),
            (found, all) => write!(f, "{what} {folder}: {}; {} of {all} scenes are missing", self.here, all - found),
        }
    }
}

impl Found {
    fn scenes(&self) -> usize {
        self.0.values().sum()
    }
}

impl fmt::Display for Found {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let told: Vec<String> = self.0.iter().map(|(Layout(name), count)| format!("{name} ({count})")).collect();
        f.write_str(&told.join(", "))
    }
}

/// One folder down, one up, two up.
fn neighbours(folder: &Path) -> Vec<PathBuf> {
    let mut below = folders(folder);
    below.truncate(MOST_NEIGHBOURS);
    let whole = folder.canonicalize().unwrap_or_else(|_unreadable| folder.to_owned());
    below.extend(whole.ancestors().skip(1).take(2).map(Path::to_owned));
    below
}

fn folders(folder: &Path) -> Vec<PathBuf> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut folders: Vec<PathBuf> = entries.map(|entry| entry.path()).filter(|path| path.is_dir()).collect();
    folders.sort();
    folders
}

/// The first names in a folder.
fn content(folder: &Path) -> String {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut names: Vec<String> = entries.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    let more = if names.len() > TOLD { format!(" and {} more", names.len() - TOLD) } else { String::new() };
    names.truncate(TOLD);
    if names.is_empty() { "nothing".to_owned() } else { format!("{}{more}", names.join(", ")) }
}
