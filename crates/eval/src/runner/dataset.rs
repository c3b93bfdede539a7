//! A protocol on some data, with the index that belongs to both.

use std::path::Path;
use std::sync::Arc;

use atsplat_protocol::trial::{Prefetch, Trial, TrialRecipe, Trials};
use atsplat_protocol::{EvaluationIndex, IndexMismatch, KnownIndex, Preset, SamplingRule};
use atsplat_scene::{SceneSource, Warnings};
use atsplat_splat::RenderOptions;

use super::{Dataset, IndexFolder, PlannedIndex};
use crate::EvalError;
use crate::method::constants_of;
use crate::sources::AlreadyCropped;

/// Which index a protocol is evaluated on.
#[derive(Clone, Copy, Debug)]
pub enum IndexChoice<'a> {
    /// The file next to the data ([`PlannedIndex::next_to`]).
    NextToData,
    /// This file, or the protocol's published index below this folder ([`PlannedIndex::read`]).
    At(&'a Path),
    /// The protocol's published index among the files of this folder, which was searched before ([`PlannedIndex::published`]).
    Below(&'a IndexFolder),
    /// Frames sampled by a rule of this name or path ([`PlannedIndex::sampled`]), and the protocol's split of them, if it has one.
    Sampled(&'a str, &'a SamplingRule),
}

impl Dataset {
    /// A protocol on the scenes of `source`, which was opened from `data`. With `any_size`, images of any size are accepted,
    /// and images of the size that the protocol crops to count as already cropped.
    ///
    /// # Errors
    /// [`EvalError::NoIndex`] without an index next to the data, and the errors of [`PlannedIndex::read`] and
    /// [`PlannedIndex::sampled`].
    pub fn new(
        mut preset: Preset,
        mut source: Arc<dyn SceneSource>,
        data: &Path,
        index: IndexChoice<'_>,
        any_size: bool,
        warnings: &mut Warnings,
    ) -> Result<Self, EvalError> {
        let mut description = data.display().to_string();
        if any_size {
            if let Some((cropped, adapted)) = AlreadyCropped::of(&source, &preset) {
                (source, preset) = (Arc::new(cropped), adapted);
                description.push_str(", images cropped beforehand");
            } else {
                preset.preprocessing.expected_size = None;
            }
        }
        let index = match index {
            IndexChoice::Sampled(name, rule) => {
                let sampled = PlannedIndex::sampled(name, rule, source.as_ref(), warnings)?;
                match preset.index.derivation {
                    Some(derivation) => sampled.split(derivation, source.as_ref(), warnings)?,
                    None => sampled,
                }
            }
            IndexChoice::At(path) => PlannedIndex::read(path, &preset, source.as_ref(), warnings)?,
            IndexChoice::Below(folder) => PlannedIndex::published(folder, &preset, source.as_ref(), warnings)?,
            IndexChoice::NextToData => {
                let accepted = || preset.index.accepted.iter().map(|accepted| accepted.name.clone()).collect();
                let sampler = || preset.index.sampler.clone();
                let none = || EvalError::NoIndex { data: data.to_owned(), accepted: accepted(), sampler: sampler() };
                let path = PlannedIndex::next_to(data, &preset).ok_or_else(none)?;
                PlannedIndex::read(&path, &preset, source.as_ref(), warnings)?
            }
        };
        Ok(Self { name: preset.name.clone(), preset, source, description, index })
    }

    /// The trials of an index, each read when it is needed, with the poses that the protocol gives ATSplat.
    pub fn trials(&self, index: &EvaluationIndex) -> Trials {
        let recipe = TrialRecipe::of(&self.preset, Preset::OWN_METHOD);
        Trials::new(Arc::clone(&self.source), index, recipe, Prefetch::NONE)
    }

    /// Entries of an index, or of a part of it, that do not fit the protocol. In one of its own, or in such a one with fewer context
    /// views, targets and overlaps are as they were published.
    pub fn unfit_entries(&self, index: &EvaluationIndex) -> Vec<IndexMismatch> {
        let mut unfit = self.preset.unfit_entries(index);
        if self.index.name.is_none() && self.index.reduced_from.is_none() {
            unfit.extend(self.preset.misplaced_targets(index));
            let whole = &self.index.index;
            if KnownIndex::by_content(&whole.content_hash()).is_none() {
                unfit.extend(self.preset.foreign_overlaps(index, &whole.overlap_estimators()));
            }
        }
        unfit
    }

    /// How the protocol renders a trial.
    pub fn render_options(&self, trial: &Trial) -> RenderOptions {
        let renderer = self.preset.renderer_for(Preset::OWN_METHOD);
        RenderOptions {
            constants: constants_of(&renderer, trial.near_far()),
            background: renderer.background,
            ..RenderOptions::default()
        }
    }
}
