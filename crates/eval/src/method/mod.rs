//! Methods turn a trial's context views into images of its targets; one file per method.

mod atsplat;
mod constants;
mod exec;
mod frame_files;
mod layout;
mod nearest_view;
mod optimised;
mod ply;
mod range;
mod renders;
mod scene_names;
mod shared_encoding;
mod spec;
mod splatting;
mod trained_under;
mod warp;

use std::collections::BTreeMap;
use std::fmt::Debug;
use std::io::{self, ErrorKind};
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

use atsplat_files::FileError;
use atsplat_numeric::SplitMix64;
use atsplat_pixels::{Image, ImageU8};
use atsplat_protocol::trial::{TargetView, Trial};
use atsplat_protocol::{EvaluationIndex, Preset};
use atsplat_results::{MethodRecord, StatedCost};
use thiserror::Error;

pub use atsplat::{AtSplat, WeightsSource};
pub use constants::{ChangedConstants, ConstantsChoice, constants_of};
pub use exec::{Exec, ExecSettings};
pub use layout::{FoundFiles, Layout, RequestedScene};
pub use nearest_view::NearestView;
pub use optimised::{MAX_GAUSSIANS, Optimised, START_POINTS};
pub use ply::Ply;
pub use range::check_range;
pub use renders::Renders;
pub(crate) use shared_encoding::SharedEncoding;
pub use spec::{InvalidMethod, MethodKind, MethodSpec};
pub use splatting::{Backend, Splatting};
pub use trained_under::TrainedUnder;
pub use warp::Warp;

/// A novel-view-synthesis method under evaluation.
pub trait Method: Debug + Send + Sync {
    /// The method's identity and every parameter that affects its images.
    fn record(&self) -> MethodRecord;

    /// What its images cost under each protocol of a run, as their user states it; `None` if that is counted and timed.
    fn stated_cost(&self) -> Option<StatedCost> {
        None
    }

    /// The method whose published pose normalisation, near/far planes and renderer it uses if a preset lists several
    /// ([`Preset::setting_for`], [`Preset::renderer_for`]).
    fn setting(&self) -> &str {
        Preset::OWN_METHOD
    }

    /// Whether [`Self::setting`] is the preset's own only because the user chose no other, although the results may come from any
    /// method: a name that the preset lists is then probably the method's.
    fn has_no_chosen_setting(&self) -> bool {
        false
    }

    /// Whether one trial needs so much memory that trials must run one at a time.
    fn runs_alone(&self) -> bool {
        false
    }

    /// For an imported method, the files with its results for a trial, `None` for each missing file. Rows are recomputed when
    /// one of them changes.
    fn files(&self, _trial: &Trial) -> Vec<Option<PathBuf>> {
        Vec::new()
    }

    /// For an imported method, itself with the names of all scenes of a run, so that it never takes the files of one scene for
    /// those of another; `None` for all others. A run binds its methods to its indices.
    fn for_scenes_of(&self, _indices: &[&EvaluationIndex]) -> Option<Arc<dyn Method>> {
        None
    }

    /// Where an imported method's files for these scenes are; `None` for a method that runs in this process.
    fn find_files(&self, _scenes: &[RequestedScene<'_>]) -> Option<FoundFiles> {
        None
    }

    /// Processor time in seconds that the method's processes have used so far; `None` for a method that runs in this process,
    /// and where the system does not report it.
    fn process_secs(&self) -> Option<f64> {
        None
    }

    /// Which parts a timing pass measures: the method's work, not reading another program's output.
    fn timed(&self) -> Timed {
        Timed { encoding: true, rendering: true }
    }

    /// Processes the context views; [`Prediction::render`] then renders targets.
    ///
    /// # Errors
    /// [`MethodError`] if the method cannot produce images for this trial.
    fn predict<'a>(&'a self, input: TrialInput<'a>) -> Result<Box<dyn Prediction + 'a>, MethodError>;
}

/// Which parts of a method are timed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Timed {
    /// From context images to a renderable scene: [`Method::predict`].
    pub encoding: bool,
    /// From the scene to an image: [`Prediction::render`].
    pub rendering: bool,
}

impl Timed {
    /// For methods that do no work on the context before rendering.
    pub const RENDERING: Self = Self { encoding: false, rendering: true };
    /// For methods that import finished images.
    pub const NOTHING: Self = Self { encoding: false, rendering: false };
}

/// Everything of a trial that a method may see.
#[derive(Clone, Copy, Debug)]
pub struct TrialInput<'a> {
    /// The protocol, with the renderer that it states for the method's setting ([`Preset::rendered_for`]).
    pub preset: &'a Preset,
    /// Cameras and sizes.
    pub trial: &'a Trial,
    /// The context images, in the trial's order.
    pub images: &'a [Arc<ImageU8>],
}

/// A scene predicted from context views, ready to be rendered.
pub trait Prediction: Send + Sync {
    /// Sizes and timings of the prediction.
    fn cost(&self) -> Cost {
        Cost::default()
    }

    /// Renders the targets at these positions in [`Trial::targets`]; an error message for each that fails.
    fn render(&self, targets: &[usize]) -> Vec<Result<Rendered, String>>;
}

/// Sizes and timings of a prediction, before anything is rendered.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cost {
    /// Tokens before expansion.
    pub initial_tokens: Option<u64>,
    /// Tokens after expansion, which are decoded to Gaussians.
    pub final_tokens: Option<u64>,
    /// All Gaussians.
    pub gaussians: Option<u64>,
    /// Wall-clock seconds of the encoding's stages; meaningful only if nothing else runs, as in a timing pass.
    pub stages: BTreeMap<String, f64>,
    /// Mean PSNR in dB on the context views, of a method that is optimised on them.
    pub context_psnr: Option<f64>,
    /// Estimated peak memory in bytes.
    pub peak_bytes: Option<u64>,
    /// Measured peak of the resident memory of the method's processes since they were started, in bytes; `None` for a method
    /// that runs in this process, and where the system does not report it.
    pub process_peak_bytes: Option<u64>,
    /// Notes for readers of the results.
    pub notes: Vec<String>,
}

/// A rendered target.
#[derive(Clone, Debug, PartialEq)]
pub struct Rendered {
    /// The image.
    pub image: Image,
    /// Gaussians that contributed to the image.
    pub drawn: Option<u64>,
    /// Renderer effects that ran.
    pub effects: Vec<&'static str>,
}

/// Why a method has no prediction for a trial.
#[derive(Debug, Error)]
pub enum MethodError {
    /// The method does not support this kind of trial.
    #[error("not applicable: {0}")]
    NotApplicable(String),
    /// The method supports the trial but failed.
    #[error("{0}")]
    Failed(String),
    /// The method was not asked, because a file for it cannot be written or its process cannot be started. That is no result of the
    /// method: it stops the run.
    #[error(transparent)]
    Io(#[from] FileError),
}

/// Renders targets one by one; a position that the trial does not have is an error.
fn render_each(
    trial: &Trial,
    positions: &[usize],
    render: impl Fn(&TargetView) -> Result<Image, String>,
) -> Vec<Result<Rendered, String>> {
    let one = |&position: &usize| {
        let target = trial.targets().get(position).ok_or_else(|| format!("no target {position}"))?;
        Ok(Rendered { image: render(target)?, drawn: None, effects: Vec::new() })
    };
    positions.iter().map(one).collect()
}

/// The seed of a network's forward pass, or of an optimisation, for one trial: a hash of the configured seed, the scene's key and
/// the entry's number. Random token expansion therefore selects other tokens in every trial, independent of the order of trials
/// and the number of threads.
pub(crate) fn trial_seed(seed: u64, trial: &Trial) -> u64 {
    SplitMix64::for_scene(seed, &format!("{} {}", trial.scene(), trial.entry_number())).next_u64()
}

/// A path below a folder; `None` if it would leave the folder.
pub(crate) fn below(folder: &Path, name: &str) -> Option<PathBuf> {
    let inside = |component| matches!(component, Component::Normal(_));
    Path::new(name).components().all(inside).then(|| folder.join(name))
}

/// Whether there is a file, or a link to one.
///
/// # Errors
/// The system's error if it cannot find out: the file may be the right one.
fn is_file(path: &Path) -> Result<bool, String> {
    match path.metadata() {
        Ok(found) => Ok(found.is_file()),
        Err(error) if is_absent(&error) => Ok(false),
        Err(error) => Err(format!("{error} ({})", path.display())),
    }
}

/// Whether an error says that a path leads nowhere. A scene's key may be too long for a file's name, or have that of a file as its
/// first part.
fn is_absent(error: &io::Error) -> bool {
    matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory | ErrorKind::InvalidFilename)
}

/// The last component of a path, the default name of an imported method.
pub(crate) fn folder_name(folder: &Path) -> String {
    let name = folder.canonicalize().ok().and_then(|path| Some(path.file_name()?.to_string_lossy().into_owned()));
    name.unwrap_or_else(|| folder.display().to_string())
}
