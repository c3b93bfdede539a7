use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use atsplat_pixels::{DecodeLimits, Image, PixelError, decode_render, exr, npy};
use atsplat_protocol::EvaluationIndex;
use atsplat_protocol::trial::Trial;
use atsplat_results::{MethodRecord, StatedCost};

use super::frame_files::FrameFiles;
use super::range::{check_bytes, check_range};
use super::scene_names::SceneNames;
use super::splatting::parameters;
use super::{
    FoundFiles, Layout, Method, MethodError, Prediction, Rendered, RequestedScene, Timed, TrialInput, below,
    folder_name, render_each,
};
use crate::EvalError;

/// Images rendered by another program, found by scene and frame.
///
/// For frame 29 of a scene, with `<scene>` its key in the dataset, these layouts are known:
///
/// | layout | written by |
/// |---|---|
/// | `<scene>/color/000029.png` | pixelSplat, MVSplat, NoPoSplat; DepthSplat below `images`: `test.save_image`, `src/model/model_wrapper.py` |
/// | `<scene>/000029.png` | `atsplat run --keep-images all`, most others |
/// | `<scene>/29.png` | programs that pad to fewer digits: one to five |
///
/// A frame's number is its position in the scene, as in the evaluation index. `.exr` files contain floats (channels R, G, B)
/// and take precedence over `.png` files of the same name, which avoids rounding to 8 bits. They are assumed to be
/// display-referred and rejected if their header says otherwise, or if many of their samples are far outside [0, 1]. So are
/// NumPy's arrays of floats ([`npy::read_render`]), which are read as `.npy` where a scene has no images in other formats. If an
/// index has several entries of a scene (latentSplat's), the folder of the first is `<scene>-0`, that of the second `<scene>-1`,
/// and so on; that of an only entry is `<scene>` or `<scene>-0`. Folders that `--keep-images` names otherwise
/// ([`atsplat_results::file_name()`]) are known too. A folder with the name of a scene of the index is that scene's alone, except
/// among the images of a store, where all names end with the entry.
///
/// A file that is missing, damaged, transparent or of the wrong size is a failed target; it is never resized, composited
/// over a background or skipped. So are a file whose stored samples are not the image (16 bits in a PNG, linear light, a
/// rotation: [`decode_render`], [`exr::read_render`]), and a frame with two files, in whichever of the scene's folders:
/// either may be the right one. An image whose name is the frame's number in another spelling (`000029.PNG`, seven digits)
/// or format (`.jpg`) is such a second file, and alone it is not read. All frames of a scene fail whose files are numbered
/// from 1, each one more than a target, and those of a scene with a folder that cannot be listed.
#[derive(Clone, Debug)]
pub struct Renders {
    folder: PathBuf,
    name: String,
    title: Option<String>,
    names: SceneNames,
    deterministic: bool,
    stated: Option<StatedCost>,
}

impl Renders {
    /// The images below a folder; `name` is the method's name in the rows, by default the folder's.
    ///
    /// # Errors
    /// [`EvalError::Io`] if the folder cannot be read.
    pub fn new(folder: &Path, name: Option<&str>) -> Result<Self, EvalError> {
        fs::read_dir(folder).map_err(EvalError::io("reading the folder of renders", folder))?;
        let name = name.map_or_else(|| folder_name(folder), str::to_owned);
        let names = SceneNames::default().below(folder);
        Ok(Self { folder: folder.to_owned(), name, title: None, names, deterministic: false, stated: None })
    }

    /// Declares that whatever rendered the images gives the same bits every time. Nobody can tell that from files.
    #[must_use]
    pub fn deterministic(self, deterministic: bool) -> Self {
        Self { deterministic, ..self }
    }

    /// Its title in tables and plots; by default its name.
    #[must_use]
    pub fn titled(self, title: Option<&str>) -> Self {
        Self { title: title.map(str::to_owned), ..self }
    }

    /// States what the images cost.
    #[must_use]
    pub fn at_cost(self, stated: Option<StatedCost>) -> Self {
        Self { stated, ..self }
    }

    /// The files of a trial in all folders that its scene may have: one of them may be left from another run.
    fn files_of(&self, trial: &Trial) -> FrameFiles {
        let names = self.names.accepted(trial.scene(), trial.entry_number()).into_iter();
        let folders = names.flat_map(|name| folders(&self.folder, &name, trial.scene(), &self.names));
        FrameFiles::of(folders, trial.targets().iter().map(|target| target.frame))
    }

    fn find(&self, files: &FrameFiles, trial: &Trial, frame: usize) -> Result<PathBuf, String> {
        let scene = trial.scene();
        files.file_of(frame)?.ok_or_else(|| {
            let (folder, entry) = (self.folder.display(), trial.entry_number());
            let (request, name) = (self.names.request(scene, entry), self.names.expected(scene, entry));
            let note = self.names.note(scene, entry);
            let unread = match (files.unread_of(frame).first(), files.array_beside_images(frame)) {
                (Some(other), _) => format!(", found {}, whose spelling or format is not read", other.display()),
                (None, Some(array)) => {
                    format!(", found {}, which is read only without other images of the scene", array.display())
                }
                (None, None) => String::new(),
            };
            format!(
                "no file for frame {frame} of scene {scene}: {request} {name}/{frame:06}.png, .exr or .npy below \
                 {folder}{note}{unread}"
            )
        })
    }
}

/// The folders that a name of a scene leads to: with `color` below it, and itself.
fn folders(folder: &Path, name: &str, scene: &str, names: &SceneNames) -> Vec<PathBuf> {
    let both = [format!("{name}/color"), name.to_owned()].into_iter();
    both.filter(|path| names.may_be_of(scene, path)).filter_map(|path| below(folder, &path)).collect()
}

/// How a scene's images are laid out below a folder.
fn layout(folder: &Path, requested: &RequestedScene<'_>, names: &SceneNames) -> Result<Option<Layout>, String> {
    for name in names.accepted(requested.scene, 0) {
        let folders = folders(folder, &name, requested.scene, names);
        let Some((at, file)) = FrameFiles::of(folders.clone(), []).any_of(requested.frames)? else { continue };
        let suffix = if name == requested.scene { "" } else { "-0" };
        let part = if folders.get(at) == below(folder, &name).as_ref() { "" } else { "color/" };
        return Ok(Some(Layout(format!("SCENE{suffix}/{part}{}", frame_as_example(&file)))));
    }
    Ok(None)
}

/// Rewrites `000007.png` as `000029.png`: layouts differ only in their number of digits.
fn frame_as_example(file: &str) -> String {
    let (stem, extension) = file.split_once('.').unwrap_or((file, ""));
    format!("{:0>width$}.{extension}", 29, width = if stem.starts_with('0') { stem.len() } else { 1 })
}

impl Method for Renders {
    fn record(&self) -> MethodRecord {
        MethodRecord {
            name: self.name.clone(),
            kind: "renders".to_owned(),
            title: self.title.as_ref().unwrap_or(&self.name).clone(),
            parameters: parameters([("folder", self.folder.display().to_string().into())]),
            deterministic: self.deterministic,
            ..MethodRecord::default()
        }
    }

    fn stated_cost(&self) -> Option<StatedCost> {
        self.stated.clone()
    }

    fn files(&self, trial: &Trial) -> Vec<Option<PathBuf>> {
        let files = self.files_of(trial);
        trial.targets().iter().map(|target| self.find(&files, trial, target.frame).ok()).collect()
    }

    fn for_scenes_of(&self, indices: &[&EvaluationIndex]) -> Option<Arc<dyn Method>> {
        Some(Arc::new(Self { names: self.names.among(indices), ..self.clone() }))
    }

    fn find_files(&self, requested: &[RequestedScene<'_>]) -> Option<FoundFiles> {
        const EXPECTED: &str = "SCENE/color/000029.png, SCENE/000029.png or SCENE/29.png, or .exr or .npy,";
        Some(FoundFiles::of(("folder of renders", EXPECTED), &self.folder, &self.names, requested, layout))
    }

    fn timed(&self) -> Timed {
        Timed::NOTHING
    }

    fn predict<'a>(&'a self, input: TrialInput<'a>) -> Result<Box<dyn Prediction + 'a>, MethodError> {
        Ok(Box::new(Imported { renders: self, files: self.files_of(input.trial), trial: input.trial }))
    }
}

struct Imported<'a> {
    renders: &'a Renders,
    files: FrameFiles,
    trial: &'a Trial,
}

impl Prediction for Imported<'_> {
    fn render(&self, targets: &[usize]) -> Vec<Result<Rendered, String>> {
        render_each(self.trial, targets, |target| {
            let path = self.renders.find(&self.files, self.trial, target.frame)?;
            read(&path).map_err(|error| format!("{error} ({})", path.display()))
        })
    }
}

/// An image file: 8-bit samples, or floats in [0, 1] with overshoots.
pub(super) fn read(path: &Path) -> Result<Image, String> {
    let bytes = atsplat_files::read(path).map_err(|error| error.to_string())?;
    let limits = DecodeLimits::default();
    match path.extension().and_then(OsStr::to_str) {
        Some("exr") => match exr::read_render(&bytes, &limits).map_err(|error| explained(&error))? {
            (_, exr::Values::Linear) => Err("expected display-referred values, found linear light".to_owned()),
            (_, exr::Values::Depth) => Err("expected an image, found depths".to_owned()),
            (image, _) => check_range(&image).map(|()| image),
        },
        Some("npy") => {
            let (image, stored) = npy::read_render(&bytes, &limits).map_err(|error| error.to_string())?;
            stored.map_or(Ok(()), check_bytes)?;
            check_range(&image).map(|()| image)
        }
        _ => {
            let image = decode_render(&bytes, &limits).map_err(|error| error.to_string())?;
            check_bytes(image.samples())?;
            Ok(Image::from_u8(&image))
        }
    }
}

fn explained(error: &PixelError) -> String {
    match error {
        PixelError::MissingChannel { expected, found } => match found.split_last() {
            Some((last, others)) if !others.is_empty() => {
                format!("expected the channels R, G and B, found {} and {last}, without {expected}", others.join(", "))
            }
            _ => format!("expected the channels R, G and B, found {}", found.concat()),
        },
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each would be compared as other samples than those that its writer meant.
    #[test]
    fn rejects_files_that_are_not_the_image_as_stored() {
        const FIXTURES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../pixels/tests/fixtures");
        let folder = tempfile::tempdir().unwrap();
        let read_as = |file: &str, name: &str| {
            let path = folder.path().join(name);
            fs::write(&path, fs::read(Path::new(FIXTURES).join(file)).unwrap()).unwrap();
            read(&path)
        };
        for (file, name, found) in [
            ("images/colour2_16.png", "29.png", "16-bit samples"),
            ("images/gamma_is_ignored.png", "29.png", "the exponent 1.000"),
            ("images/rgb.jpg", "29.png", "a JPEG"),
            ("exr/shifted.exr", "29.exr", "5×4 at column 2, row 1 "),
            ("exr/two_parts.exr", "29.exr", "2: "),
        ] {
            let error = read_as(file, name).unwrap_err();
            assert!(error.contains(&format!(", found {found}")), "{file}: {error}");
        }
        assert!(read_as("images/colour2_8.png", "29.png").is_ok());
    }

    /// The decoded samples of `numpy.uint8(image)` of an image in [0, 1].
    #[test]
    fn floats_that_were_cast_to_bytes_are_rejected_and_black_stays() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("29.png");
        let read_of = |samples: [u8; 6]| {
            let image = atsplat_pixels::ImageU8::new(2, 1, samples.to_vec()).unwrap();
            fs::write(&path, atsplat_pixels::encode_png(&image).unwrap()).unwrap();
            read(&path)
        };
        let cast = read_of([0, 1, 0, 0, 0, 1]).unwrap_err();
        assert!(cast.starts_with("expected uint8 from 0 to 255, found only 0 and 1, as floats that were "), "{cast}");
        assert!(read_of([0; 6]).is_ok(), "black");
        assert!(read_of([0, 2, 0, 0, 0, 1]).is_ok(), "dark");
    }

    /// As an EXR of the same floats and a PNG of the same bytes.
    #[test]
    fn arrays_are_read_with_the_checks_of_other_formats() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("29.npy");
        let read_of = |descr: &str, data: &[u8]| {
            let header = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': (3, 1, 2), }}\n");
            let length = u16::try_from(header.len()).unwrap().to_le_bytes();
            fs::write(&path, [&b"\x93NUMPY\x01\x00"[..], &length, header.as_bytes(), data].concat()).unwrap();
            read(&path)
        };
        let floats = |scale: f32| {
            let samples = (0..6u8).flat_map(|at| (scale * f32::from(at) / 5.0).to_le_bytes());
            read_of("<f4", &samples.collect::<Vec<u8>>())
        };
        let image = floats(1.2).unwrap();
        let expected = [0.0, 2.0, 4.0, 1.0, 3.0, 5.0].map(|at: f32| 1.2 * at / 5.0);
        assert_eq!((image.width(), image.height(), image.samples()), (2, 1, &expected[..]), "1.2 stays");
        assert!(floats(255.0).unwrap_err().contains("seems to be 0…255"));
        assert!(read_of("<f4", &f32::NAN.to_le_bytes().repeat(6)).is_ok_and(|image| image.samples()[5].is_nan()));
        assert_eq!(
            read_of("|u1", &[0, 1, 2, 3, 4, 255]).unwrap().pixel(1, 0),
            Some([1, 3, 255].map(|at: u8| f32::from(at) / 255.0))
        );
        assert!(read_of("|u1", &[0, 1, 0, 0, 0, 1]).unwrap_err().contains("found only 0 and 1"));
        assert!(read_of("<i4", &[0; 24]).unwrap_err().ends_with("found '<i4'"));
    }

    #[test]
    fn rejects_names_that_leave_the_folder() {
        for name in ["../other", "/etc", "a/../../b", "."] {
            assert_eq!(below(Path::new("renders"), name), None, "{name}");
        }
        assert_eq!(below(Path::new("renders"), "a/b"), Some("renders/a/b".into()));
    }
}
