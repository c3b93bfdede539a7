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
use std::time::Instant;

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

    /// Looks at the context.
    ///
    /// # Errors
    /// [`Refusal`], why there will be no pictures.
    fn begin<'a>(&'a self, question: Question<'a>) -> Result<Box<dyn Answer + 'a>, Refusal>;
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
    /// How often work is repeated to time it.
    pub repetitions: Repetitions,
}

/// How often work is repeated to time it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Repetitions {
    /// Before those that count.
    pub warm_up: u32,
    /// Those that count; 0 is taken for 1.
    pub counted: u32,
}

impl Repetitions {
    /// One call, timed.
    pub const ONCE: Self = Self { warm_up: 0, counted: 1 };

    /// Whether work is done once and its time is not what it is done for.
    pub(crate) const fn is_once(self) -> bool {
        self.warm_up == 0 && self.counted <= 1
    }

    /// What the work makes, the last time, and the seconds of every time that counts.
    ///
    /// # Errors
    /// The work's.
    pub fn of<T, E>(self, mut work: impl FnMut() -> Result<T, E>) -> Result<(T, Vec<f64>), E> {
        for _ in 0..self.warm_up {
            work()?;
        }
        let mut samples = Vec::new();
        loop {
            let start = Instant::now();
            let made = work()?;
            samples.push(start.elapsed().as_secs_f64());
            if samples.len() >= self.counted as usize {
                return Ok((made, samples));
            }
        }
    }
}

/// What a method made of a context.
pub trait Answer: Send + Sync {
    /// What it took.
    fn cost(&self) -> &Cost;

    /// Pictures of these targets, by position in [`Trial::targets`], or why there is none.
    fn render(&self, targets: &[usize]) -> Vec<Result<Rendered, String>>;
}

/// What an answer took before anything was rendered.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Cost {
    /// Tokens before expansion.
    pub initial_tokens: Option<u64>,
    /// Tokens that became Gaussians.
    pub final_tokens: Option<u64>,
    /// Gaussians, all of them.
    pub gaussians: Option<u64>,
    /// Seconds from pictures to whatever is rendered, one a repetition.
    pub encode_samples: Vec<f64>,
    /// Seconds of the parts of the last repetition.
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
    /// Seconds, one a repetition; none for a picture that was there before.
    pub secs: Vec<f64>,
    /// Gaussians that reached the picture.
    pub drawn: Option<u64>,
    /// Effects that the renderer ran.
    pub effects: Vec<&'static str>,
}

impl Rendered {
    pub(crate) const fn untimed(image: Image) -> Self {
        Self { image, secs: Vec::new(), drawn: None, effects: Vec::new() }
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
