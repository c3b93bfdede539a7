//! What turns a trial into pictures: one file per method.

mod atsplat;
mod constants;
mod layout;
mod nearest_view;
mod ply;
mod renders;
mod splatting;
mod warp;

use std::collections::BTreeMap;
use std::fmt::Debug;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

use atsplat_pixels::{Image, ImageU8};
use atsplat_protocol::Preset;
use atsplat_protocol::trial::Trial;
use thiserror::Error;

pub use atsplat::{AtSplat, HIGH_RESOLUTION, WeightsOf};
pub use constants::{ChangedConstants, ConstantsChoice, constants_of};
pub use layout::{Asked, Layout, Survey};
pub use nearest_view::NearestView;
pub use ply::{GaussianFrame, Ply};
pub use renders::Renders;
pub use splatting::{Backend, Splatting};
pub use warp::Warp;

use crate::MethodRecord;
use crate::file_name::file_name;

/// A way to answer trials.
pub trait Method: Debug + Send + Sync {
    /// What it is, with everything that decides its pictures.
    fn record(&self) -> MethodRecord;

    /// Whose published pose normalisation and planes it takes where a preset lists several
    /// ([`Preset::setting_of`]).
    fn setting(&self) -> &'static str {
        "ATSplat"
    }

    /// Whether one trial takes so much memory that it wants to be the only one.
    fn is_heavy(&self) -> bool {
        false
    }

    /// The files that answer a trial where a method brings its answers along, `None` for each that is missing: rows are
    /// made again when one of them changes.
    fn files(&self, _trial: &Trial) -> Vec<Option<PathBuf>> {
        Vec::new()
    }

    /// Where its files lie for these scenes; `None` for a method that makes its pictures here.
    fn survey(&self, _asked: &[Asked<'_>]) -> Option<Survey> {
        None
    }

    /// Which of its work a timing pass measures: its own, and not the reading of what another program wrote.
    fn timed(&self) -> Timed {
        Timed { encoding: true, rendering: true }
    }

    /// Looks at the context.
    ///
    /// # Errors
    /// [`Refusal`], why there will be no pictures.
    fn begin<'a>(&'a self, question: Question<'a>) -> Result<Box<dyn Answer + 'a>, Refusal>;
}

/// Work that is worth a time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Timed {
    /// From context pictures to whatever is rendered: [`Method::begin`].
    pub encoding: bool,
    /// From there to a picture: [`Answer::render`].
    pub rendering: bool,
}

impl Timed {
    /// What methods do that make nothing of the context before they render.
    pub const RENDERING: Self = Self { encoding: false, rendering: true };
    /// What methods do that bring finished pictures.
    pub const NOTHING: Self = Self { encoding: false, rendering: false };
}

/// All that a method may see of a trial.
#[derive(Clone, Copy, Debug)]
pub struct Question<'a> {
    /// The protocol.
    pub preset: &'a Preset,
    /// Cameras and sizes.
    pub trial: &'a Trial,
    /// The context pictures, in the trial's order.
    pub pictures: &'a [Arc<ImageU8>],
}

/// What a method made of a context.
pub trait Answer: Send + Sync {
    /// What it is made of.
    fn cost(&self) -> &Cost;

    /// Pictures of these targets, by position in [`Trial::targets`], or why there is none.
    fn render(&self, targets: &[usize]) -> Vec<Result<Rendered, String>>;
}

/// What an answer is made of, before anything is rendered.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cost {
    /// Tokens before expansion.
    pub initial_tokens: Option<u64>,
    /// Tokens that became Gaussians.
    pub final_tokens: Option<u64>,
    /// Gaussians, all of them.
    pub gaussians: Option<u64>,
    /// Seconds of the encoding's parts by their own clocks; true where nothing else runs, as in a timing pass.
    pub stages: BTreeMap<String, f64>,
    /// Estimated peak of memory in bytes.
    pub peak_bytes: Option<u64>,
    /// What a reader must know.
    pub notes: Vec<String>,
}

/// A picture of a target.
#[derive(Clone, Debug, PartialEq)]
pub struct Rendered {
    /// The picture.
    pub image: Image,
    /// Gaussians that reached the picture.
    pub drawn: Option<u64>,
    /// Effects that the renderer ran.
    pub effects: Vec<&'static str>,
}

impl Rendered {
    pub(crate) const fn plain(image: Image) -> Self {
        Self { image, drawn: None, effects: Vec::new() }
    }
}

/// Why a method makes nothing of a trial.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum Refusal {
    /// It is not made for such trials.
    #[error("not applicable: {0}")]
    NotApplicable(String),
    /// It should have.
    #[error("{0}")]
    Failed(String),
}

/// The file names of a scene: those of this entry, for the first entry those without its number, and the one that a store
/// keeps pictures under.
pub(crate) fn names_of(trial: &Trial) -> Vec<String> {
    let (scene, entry) = (trial.scene(), trial.entry_number());
    let bare = (entry == 0).then(|| scene.to_owned());
    let mut names: Vec<String> = bare.into_iter().chain([format!("{scene}-{entry}")]).collect();
    let kept = format!("{}-{entry}", file_name(scene));
    if !names.contains(&kept) {
        names.push(kept);
    }
    names
}

/// A path below a folder; `None` for one that leads out of it.
pub(crate) fn below(folder: &Path, name: &str) -> Option<PathBuf> {
    let inside = |component| matches!(component, Component::Normal(_));
    Path::new(name).components().all(inside).then(|| folder.join(name))
}

/// The last part of a path, for names of methods.
pub(crate) fn last_of(folder: &Path) -> String {
    let name = folder.canonicalize().ok().and_then(|path| Some(path.file_name()?.to_string_lossy().into_owned()));
    name.unwrap_or_else(|| folder.display().to_string())
}
