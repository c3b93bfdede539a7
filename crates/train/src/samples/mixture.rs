use super::{Draw, Sample, Source, mirrored};
use crate::TrainError;
use atsplat_numeric::SplitMix64;

/// Several sources, each with its share of the samples: one source, or all datasets and view counts of a unified model.
#[derive(Debug)]
pub struct Mixture {
    sources: Vec<(f64, Box<dyn Source>)>,
    flips: bool,
    distinct: Option<u64>,
}

impl Mixture {
    /// Of sources and their positive shares. Half of the samples are mirrored where `flips` is set; after `distinct`
    /// samples they repeat.
    ///
    /// # Errors
    /// [`TrainError::Malformed`] where there is no source, or a share is not a positive number.
    pub fn new(sources: Vec<(f64, Box<dyn Source>)>, flips: bool, distinct: Option<u64>) -> Result<Self, TrainError> {
        let malformed = |found: String| {
            TrainError::malformed("training configuration", "data", "one source or more with positive shares", found)
        };
        if sources.is_empty() {
            return Err(malformed("none".to_owned()));
        }
        match sources.iter().find(|(share, _)| !(*share > 0.0 && share.is_finite())) {
            Some((share, _)) => Err(malformed(share.to_string())),
            None => Ok(Self { sources, flips, distinct }),
        }
    }

    /// Which source a sample comes from, and whether it is mirrored.
    fn plan(&self, draw: Draw) -> (Option<&dyn Source>, bool) {
        let mut random = SplitMix64::for_scene(draw.seed, &format!("mixture {}", draw.number));
        let total: f64 = self.sources.iter().map(|(share, _)| share).sum();
        let unit = (random.next_u64() >> 11) as f64 / (1u64 << 53) as f64;
        let mut left = unit * total;
        let chosen = self.sources.iter().find(|(share, _)| {
            left -= share;
            left < 0.0
        });
        let source = chosen.or(self.sources.last()).map(|(_, source)| source.as_ref());
        (source, self.flips && random.next_u64() & 1 == 1)
    }
}

impl Source for Mixture {
    fn name(&self) -> String {
        let names: Vec<String> =
            self.sources.iter().map(|(share, source)| format!("{share} × {}", source.name())).collect();
        names.join(" + ")
    }

    fn sample(&self, draw: Draw) -> Result<Sample, TrainError> {
        let draw = Draw { number: self.distinct.map_or(draw.number, |distinct| draw.number % distinct.max(1)), ..draw };
        let (source, flipped) = self.plan(draw);
        let none = || TrainError::malformed("training configuration", "data", "one source or more", "none");
        let sample = source.ok_or_else(none)?.sample(draw)?;
        Ok(if flipped { mirrored(&sample)? } else { sample })
    }
}
