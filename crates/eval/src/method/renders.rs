use std::fs;
use std::path::{Path, PathBuf};

use atsplat_pixels::{DecodeLimits, Image, decode_opaque, exr};
use atsplat_protocol::trial::Trial;

use super::splatting::parameters;
use super::{
    Layout, Method, MethodError, Prediction, Rendered, RequestedScene, Survey, Timed, TrialInput, below, last_of,
    names_of, render_each,
};
use crate::{EvalError, MethodRecord};

/// Pictures rendered by another program, found by scene and frame.
///
/// For frame 29 of a scene, with `<scene>` its key in the dataset, the first of these layouts that exists is used:
///
/// | layout | written by |
/// |---|---|
/// | `<scene>/color/000029.png` | pixelSplat, MVSplat, DepthSplat, NoPoSplat: `test.save_image`, `src/model/model_wrapper.py` |
/// | `<scene>/000029.png` | `atsplat run --keep-pictures all`, most others |
/// | `<scene>/29.png` | programs that pad to fewer digits: one to five |
///
/// A frame's number is its position in the scene, as in the evaluation index. `.exr` files hold floats (channels R, G, B)
/// and take precedence over `.png` files of the same name, which avoids rounding to 8 bits. They are assumed to be
/// display-referred and rejected if their header says otherwise. If an index has several entries for a scene
/// (latentSplat's), the folder of the second is `<scene>-1`, and so on; that of the first may be `<scene>-0`.
///
/// A file that is missing, damaged, transparent or of the wrong size is a failed target; it is never resized, composited
/// over a background or skipped.
#[derive(Clone, Debug)]
pub struct Renders {
    folder: PathBuf,
    name: String,
}

impl Renders {
    /// The pictures below a folder; `name` is the method's name in the rows, by default the folder's.
    ///
    /// # Errors
    /// [`EvalError::Io`] if the folder cannot be read.
    pub fn new(folder: &Path, name: Option<&str>) -> Result<Self, EvalError> {
        fs::read_dir(folder).map_err(EvalError::io("reading the folder of renders", folder))?;
        let name = name.map_or_else(|| last_of(folder), str::to_owned);
        Ok(Self { folder: folder.to_owned(), name })
    }

    fn find(&self, trial: &Trial, frame: usize) -> Result<PathBuf, String> {
        for scene in names_of(trial) {
            let folder = below(&self.folder, &scene).ok_or_else(|| format!("{scene:?} is not a valid folder name"))?;
            for folder in [folder.join("color"), folder] {
                if let Some(path) = file_of(&folder, frame)? {
                    return Ok(path);
                }
            }
        }
        let scene = trial.scene();
        Err(format!(
            "no file for frame {frame} of scene {scene}: expected {scene}/{frame:06}.png or .exr below {}",
            self.folder.display()
        ))
    }
}

/// The picture of a frame in a scene's folder; `None` if there is none.
pub(super) fn file_of(folder: &Path, frame: usize) -> Result<Option<PathBuf>, String> {
    let found: Vec<PathBuf> = names(frame).map(|name| folder.join(name)).filter(|path| path.is_file()).collect();
    let stem = |path: &PathBuf| path.file_stem().map(std::ffi::OsStr::to_owned);
    match found.as_slice() {
        [] => Ok(None),
        [first, others @ ..] if others.iter().all(|other| stem(other) == stem(first)) => Ok(Some(first.clone())),
        [first, others @ ..] => {
            let last = others.last().unwrap_or(first);
            Err(format!("two files for frame {frame}: {} and {}", first.display(), last.display()))
        }
    }
}

/// How a scene's pictures are laid out below a folder.
fn layout(folder: &Path, requested: &RequestedScene<'_>) -> Option<Layout> {
    let scene = requested.scene;
    [scene.to_owned(), format!("{scene}-0")].into_iter().find_map(|name| {
        let below = below(folder, &name)?;
        let suffix = &name[scene.len()..];
        [("color/", below.join("color")), ("", below)].into_iter().find_map(|(part, folder)| {
            let frames = || requested.frames.iter().flat_map(|frame| names(*frame));
            let file = frames().find(|name| folder.join(name).is_file())?;
            Some(Layout(format!("SCENE{suffix}/{part}{}", frame_as_example(&file))))
        })
    })
}

/// Rewrites `000007.png` as `000029.png`: layouts differ only in their number of digits.
fn frame_as_example(file: &str) -> String {
    let (stem, extension) = file.split_once('.').unwrap_or((file, ""));
    format!("{:0>width$}.{extension}", 29, width = if stem.starts_with('0') { stem.len() } else { 1 })
}

/// Accepted file names of a frame, floats first.
fn names(frame: usize) -> impl Iterator<Item = String> {
    let mut stems: Vec<String> = [6, 5, 4, 3, 2, 1].map(|digits| format!("{frame:0digits$}")).to_vec();
    stems.dedup();
    stems.into_iter().flat_map(|stem| [format!("{stem}.exr"), format!("{stem}.png")])
}

impl Method for Renders {
    fn record(&self) -> MethodRecord {
        MethodRecord {
            name: self.name.clone(),
            kind: "renders".to_owned(),
            title: self.name.clone(),
            parameters: parameters([("folder", self.folder.display().to_string().into())]),
            deterministic: true,
            ..MethodRecord::default()
        }
    }

    fn files(&self, trial: &Trial) -> Vec<Option<PathBuf>> {
        trial.targets().iter().map(|target| self.find(trial, target.frame).ok()).collect()
    }

    fn survey(&self, requested: &[RequestedScene<'_>]) -> Option<Survey> {
        const EXPECTED: &str = "SCENE/color/000029.png, SCENE/000029.png or SCENE/29.png, or .exr,";
        Some(Survey::of(("folder of renders", EXPECTED), &self.folder, requested, layout))
    }

    fn timed(&self) -> Timed {
        Timed::NOTHING
    }

    fn predict<'a>(&'a self, input: TrialInput<'a>) -> Result<Box<dyn Prediction + 'a>, MethodError> {
        Ok(Box::new(Imported { renders: self, trial: input.trial }))
    }
}

struct Imported<'a> {
    renders: &'a Renders,
    trial: &'a Trial,
}

impl Prediction for Imported<'_> {
    fn render(&self, targets: &[usize]) -> Vec<Result<Rendered, String>> {
        render_each(self.trial, targets, |target| {
            let path = self.renders.find(self.trial, target.frame)?;
            read(&path).map_err(|error| format!("{error} ({})", path.display()))
        })
    }
}

pub(super) fn read(path: &Path) -> Result<Image, String> {
    let bytes = fs::read(path).map_err(|error| error.to_string())?;
    let limits = DecodeLimits::default();
    if path.extension().is_some_and(|extension| extension == "exr") {
        return match exr::read_opaque_rgb(&bytes, &limits).map_err(|error| error.to_string())? {
            (_, exr::Values::Linear) => Err("expected display-referred values, found linear light".to_owned()),
            (_, exr::Values::Depth) => Err("expected a picture, found depths".to_owned()),
            (image, _) => Ok(image),
        };
    }
    Ok(Image::from_u8(&decode_opaque(&bytes, &limits).map_err(|error| error.to_string())?))
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

    #[test]
    fn rejects_names_that_leave_the_folder() {
        for name in ["../other", "/etc", "a/../../b", "."] {
            assert_eq!(below(Path::new("renders"), name), None, "{name}");
        }
        assert_eq!(below(Path::new("renders"), "a/b"), Some("renders/a/b".into()));
    }
}
