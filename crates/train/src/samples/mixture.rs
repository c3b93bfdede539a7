use atsplat_files::Sha256Digest;
use atsplat_model::weights::training_data;
use atsplat_numeric::SplitMix64;

use super::{DataWarnings, ReplacedDraws, Sample, SampleId, Source, UnstablePoses, mirrored};
use crate::TrainError;
use crate::config::WHAT;

/// One or more sources, each with its share of the samples, e.g. all datasets and view counts of a unified model.
#[derive(Debug)]
pub struct Mixture {
    sources: Vec<(f64, Box<dyn Source>)>,
    flips: bool,
    distinct: Option<u64>,
}

impl Mixture {
    /// A mixture of sources with their positive shares. If `flips`, half of the samples are mirrored; after `distinct`
    /// samples they repeat.
    ///
    /// # Errors
    /// [`TrainError::Malformed`] if there is no source, or a share is not a positive number.
    pub fn new(sources: Vec<(f64, Box<dyn Source>)>, flips: bool, distinct: Option<u64>) -> Result<Self, TrainError> {
        let malformed =
            |found: String| TrainError::malformed(WHAT, "data", "one or more sources with positive shares", found);
        if sources.is_empty() {
            return Err(malformed("none".to_owned()));
        }
        match sources.iter().find(|(share, _)| !(*share > 0.0 && share.is_finite())) {
            Some((share, _)) => Err(malformed(share.to_string())),
            None => Ok(Self { sources, flips, distinct }),
        }
    }

    /// The sample that is drawn for an identity: that of an earlier one if samples repeat.
    fn drawn(&self, id: SampleId) -> SampleId {
        SampleId { number: self.distinct.map_or(id.number, |distinct| id.number % distinct.max(1)), ..id }
    }

    /// The source of a sample that is drawn, with its position, and whether the sample is mirrored.
    fn plan(&self, id: SampleId) -> (usize, &dyn Source, bool) {
        let mut random = SplitMix64::for_scene(id.seed, &format!("mixture {}", id.number));
        let total: f64 = self.sources.iter().map(|(share, _)| share).sum();
        let mut remaining = random.unit() * total;
        let chosen = self.sources.iter().enumerate().find(|(_, (share, _))| {
            remaining -= share;
            remaining < 0.0
        });
        // Rounding can leave a remainder of 0.
        #[expect(clippy::expect_used, reason = "a mixture has at least one source")]
        let (at, (_, source)) = chosen.or(self.sources.iter().enumerate().next_back()).expect("at least one source");
        (at, source.as_ref(), self.flips && random.next_u64() & 1 == 1)
    }
}

/// The description of a mixture, from the shares and descriptions of its sources.
pub(crate) fn description_of(sources: impl Iterator<Item = (f64, String)>) -> String {
    training_data::of_sources(sources.map(|(share, source)| format!("{share} × {source}")))
}

impl Source for Mixture {
    fn name(&self) -> String {
        description_of(self.sources.iter().map(|(share, source)| (*share, source.name())))
    }

    fn sample(&self, id: SampleId) -> Result<Sample, TrainError> {
        let id = self.drawn(id);
        let (_, source, flipped) = self.plan(id);
        let sample = source.sample(id)?;
        Ok(if flipped { mirrored(&sample)? } else { sample })
    }

    fn source_of(&self, id: SampleId) -> usize {
        let (at, ..) = self.plan(self.drawn(id));
        at
    }

    fn data_warnings(&self) -> DataWarnings {
        let mut warnings = DataWarnings::default();
        self.sources.iter().for_each(|(_, source)| warnings.merge(source.data_warnings()));
        warnings
    }

    fn replaced(&self) -> ReplacedDraws {
        let mut replaced = ReplacedDraws::default();
        for (_, source) in &self.sources {
            replaced.merge(source.replaced());
        }
        replaced
    }

    fn replaced_count(&self) -> u64 {
        self.sources.iter().map(|(_, source)| source.replaced_count()).sum()
    }

    fn unstable_poses(&self) -> UnstablePoses {
        let mut unstable = UnstablePoses::default();
        for (_, source) in &self.sources {
            unstable.merge(source.unstable_poses());
        }
        unstable
    }

    fn scene_lists(&self) -> Vec<(String, Sha256Digest)> {
        let mut all = Vec::new();
        for (at, (_, source)) in self.sources.iter().enumerate() {
            let named = source.scene_lists().into_iter();
            all.extend(named.map(|(field, sha256)| (format!("data[{at}].source.{field}"), sha256)));
        }
        all
    }

    fn notices(&self) -> Vec<String> {
        self.sources.iter().flat_map(|(_, source)| source.notices()).collect()
    }
}
