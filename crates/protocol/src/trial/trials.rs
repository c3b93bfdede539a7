use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;

use atsplat_scene::{Scene, SceneSource, Warnings};

use super::images::LazyImage;
use super::lazy::LazyValue;
use super::prefetch::{Budget, DecodeAhead, OrderedJobs, Prefetch};
use super::prepare::prepare;
use super::{Rejection, SkipReason, SkipReport, Skipped, TargetImages, Trial, TrialRecipe};
use crate::{EvaluationIndex, IndexEntry};

/// Iterates over an evaluation index on a dataset: for each entry, in index order, a trial and its target images, or
/// why there is none.
///
/// Scenes are loaded, and images decoded, ahead of the caller on rayon's threads within the bounds of
/// [`Prefetch`]; the items are the same for any bounds and any number of threads. `null` scenes are counted in the
/// report and yield nothing. A damaged image does not prevent its trial: only requesting that image is an error, the
/// same every time.
pub struct Trials {
    source: Arc<dyn SceneSource>,
    recipe: Arc<TrialRecipe>,
    prefetch: Prefetch,
    budget: Arc<Budget>,
    pending: VecDeque<PendingEntry>,
    ahead: OrderedJobs<PreparedEntry>,
    report: SkipReport,
    warnings: Warnings,
}

/// An index entry that is not in preparation yet.
struct PendingEntry {
    scene: Arc<SharedScene>,
    position: usize,
    entry_number: usize,
    entry: IndexEntry,
    requires_targets: bool,
}

/// A scene shared by its entries and loaded by the first that needs it; those prepared at the same moment each load it.
struct SharedScene {
    key: String,
    loaded: LazyValue<(Result<Arc<Scene>, Rejection>, Warnings)>,
}

struct PreparedEntry {
    trial: Result<(Trial, TargetImages), Skipped>,
    warnings: Warnings,
}

impl Trials {
    /// Iterates over all entries of `index`. Nothing is read before the first call of `next`.
    pub fn new(source: Arc<dyn SceneSource>, index: &EvaluationIndex, recipe: TrialRecipe, prefetch: Prefetch) -> Self {
        let mut pending = VecDeque::new();
        let mut report = SkipReport::default();
        for (key, entries) in &index.scenes {
            if entries.is_empty() {
                let detail = "the index has no entry for the scene".to_owned();
                let reason = SkipReason::NullEntry;
                report.skipped.push(Skipped { scene: key.clone(), entry_number: 0, reason, detail, frame: None });
            }
            let scene = Arc::new(SharedScene { key: key.clone(), loaded: LazyValue::new() });
            let first = pending.len();
            pending.extend(entries.iter().cloned().enumerate().map(|(entry_number, entry)| PendingEntry {
                scene: Arc::clone(&scene),
                position: first + entry_number,
                entry_number,
                entry,
                requires_targets: false,
            }));
        }
        Self {
            source,
            recipe: Arc::new(recipe),
            prefetch,
            budget: Budget::new(prefetch.max_bytes),
            pending,
            ahead: OrderedJobs::new(),
            report,
            warnings: Warnings::new(),
        }
    }

    /// The same trials at the positions that they have in a larger index, given that of the first entry of each scene
    /// ([`EvaluationIndex::first_positions`]): their index is a part of it.
    #[must_use]
    pub fn at_positions(mut self, first: &BTreeMap<&str, usize>) -> Self {
        for pending in &mut self.pending {
            if let Some(first) = first.get(pending.scene.key.as_str()) {
                pending.position = first + pending.entry_number;
            }
        }
        self
    }

    /// Skips entries without targets, of which an evaluation has no number.
    #[must_use]
    pub fn requiring_targets(mut self) -> Self {
        self.pending.iter_mut().for_each(|pending| pending.requires_targets = true);
        self
    }

    /// The outcome of the entries so far; complete once the iterator has ended.
    pub const fn report(&self) -> &SkipReport {
        &self.report
    }

    /// Warnings of the scenes so far.
    pub const fn warnings(&self) -> &Warnings {
        &self.warnings
    }

    /// Takes the warnings collected since the last call.
    pub fn take_warnings(&mut self) -> Warnings {
        std::mem::take(&mut self.warnings)
    }

    /// The largest number of bytes of images decoded ahead that were alive at once; at most [`Prefetch::max_bytes`].
    pub fn peak_bytes(&self) -> u64 {
        self.budget.peak()
    }

    /// Brings the number of entries in preparation up to the bound.
    fn prepare_ahead(&mut self, most: usize) {
        while self.ahead.len() < most {
            let Some(pending) = self.pending.pop_front() else { break };
            let (source, recipe) = (Arc::clone(&self.source), Arc::clone(&self.recipe));
            let (decode, budget) = (self.prefetch.decode, Arc::clone(&self.budget));
            let job = move || pending.prepare(source.as_ref(), &recipe, decode, &budget);
            self.ahead.push(Box::new(job), self.prefetch.trials > 0);
        }
    }
}

impl Iterator for Trials {
    type Item = Result<(Trial, TargetImages), Skipped>;

    fn next(&mut self) -> Option<Self::Item> {
        self.prepare_ahead(self.prefetch.trials.max(1));
        let outcome = self.ahead.pop()?;
        self.prepare_ahead(self.prefetch.trials);
        self.warnings.merge(outcome.warnings);
        match &outcome.trial {
            Ok(_) => self.report.trials += 1,
            Err(skipped) => self.report.skipped.push(skipped.clone()),
        }
        Some(outcome.trial)
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        let left = self.pending.len() + self.ahead.len();
        (left, Some(left))
    }
}

impl ExactSizeIterator for Trials {}

impl std::fmt::Debug for Trials {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Trials").field("left", &self.len()).field("recipe", &self.recipe).finish_non_exhaustive()
    }
}

impl PendingEntry {
    fn prepare(
        self,
        source: &dyn SceneSource,
        recipe: &TrialRecipe,
        decode: DecodeAhead,
        budget: &Arc<Budget>,
    ) -> PreparedEntry {
        let Self { scene: shared, position, entry_number, entry, requires_targets } = self;
        let (scene, scene_warnings) = shared.loaded.get(|| load(&shared.key, source));
        // The first entry of a scene reports its warnings, whichever entry loaded it.
        let mut warnings = if entry_number == 0 { scene_warnings } else { Warnings::new() };
        let prepared = match scene {
            Ok(_) if requires_targets && entry.target.is_empty() => Err(Rejection::of_no_targets()),
            Ok(scene) => prepare(&scene, entry_number, &entry, recipe, &mut warnings),
            Err(rejection) => Err(rejection),
        };
        let trial = match prepared {
            Ok((trial, images)) => Ok(decode_ahead(Trial { position, ..trial }, images, decode, budget)),
            Err(Rejection { reason, detail, frame }) => {
                Err(Skipped { scene: shared.key.clone(), entry_number, reason, detail, frame })
            }
        };
        PreparedEntry { trial, warnings }
    }
}

fn load(key: &str, source: &dyn SceneSource) -> (Result<Arc<Scene>, Rejection>, Warnings) {
    let mut warnings = Warnings::new();
    let scene = crate::loading::load(source, key, &mut warnings).map(Arc::new).map_err(Rejection::from);
    (scene, warnings)
}

/// Decodes the requested images if they fit into the budget.
fn decode_ahead(
    mut trial: Trial,
    mut targets: TargetImages,
    decode: DecodeAhead,
    budget: &Arc<Budget>,
) -> (Trial, TargetImages) {
    let mut wanted: Vec<&Arc<LazyImage>> = Vec::new();
    if decode != DecodeAhead::Nothing {
        wanted.extend(trial.context.iter().map(|view| &view.image));
    }
    if decode == DecodeAhead::All {
        wanted.extend(&targets.images);
    }
    wanted.sort_unstable_by_key(|image| Arc::as_ptr(image));
    wanted.dedup_by_key(|image| Arc::as_ptr(image));
    let bytes = wanted.iter().try_fold(0u64, |sum, image| sum.checked_add(image.bytes()));
    let Some(reservation) = bytes.filter(|bytes| *bytes > 0).and_then(|bytes| budget.reserve(bytes)) else {
        return (trial, targets);
    };
    for image in wanted {
        // Errors are stored and returned when the image is requested.
        image.get().ok();
    }
    for view in &mut trial.context {
        view.reservation = Some(Arc::clone(&reservation));
    }
    targets.reservation = Some(reservation);
    (trial, targets)
}
