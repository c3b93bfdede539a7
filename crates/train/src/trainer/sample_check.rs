//! Whether the samples of a resumed run are still those in its logs.
//!
//! The logs contain a hash of the images, cameras and distances of every step's samples. To hash a whole dataset at each start would
//! mean reading all of it, and sizes or headers of files would not reveal other pixels of the same size. So a resumed run draws the
//! samples of its latest steps again: that costs no more than a few steps, needs nothing from a dataset's format, and notices whatever
//! reaches the network, a simulator or decoder that has changed included. A change to scenes that none of these samples shows is not
//! noticed. Of data at another path, nothing else says that they are the same: at least one step with a sample of theirs is drawn again.

use std::collections::BTreeMap;
use std::path::Path;

use atsplat_files::Sha256Digest;
use rayon::prelude::*;

use super::step::numbers;
use super::{EVALUATIONS, STEPS};
use crate::checkpoint::MovedData;
use crate::error::Purpose;
use crate::evaluation::Evaluation;
use crate::logs::{self, EvaluationRecord, StepRecord};
use crate::samples::{SampleId, Source, digest_of_all};
use crate::{TrainConfig, TrainError};

/// Number of samples that are drawn again, in whole steps, at least one.
const SAMPLES: usize = 16;

/// The logs of a run that goes on.
#[derive(Clone, Copy, Debug)]
pub(super) struct RunLogs<'a> {
    /// Their folder.
    pub(super) folder: &'a Path,
    /// Number of steps done.
    pub(super) done: u64,
    /// Whether the run was on another type of processor, where the last bits of images and cameras may have been others.
    pub(super) processor_changed: bool,
    /// Which data are read from another path than in the run so far.
    pub(super) moved: &'a MovedData,
}

impl RunLogs<'_> {
    /// Draws the samples of the latest steps again. Returns a notice if the log is gone or has no hashes of them, or if samples
    /// differ after a change of processor.
    ///
    /// # Errors
    /// [`TrainError::Malformed`] if samples differ or can no longer be drawn, or if there are none to compare with those at another path;
    /// errors of reading the log.
    pub(super) fn check_training(
        &self,
        config: &TrainConfig,
        source: &dyn Source,
    ) -> Result<Option<String>, TrainError> {
        let logged = self.logged::<StepRecord>(STEPS)?;
        let known = logged.iter().rev().filter_map(|record| Some((record.step, record.samples_sha256?)));
        let known: Vec<(u64, Sha256Digest)> = known.collect();
        if known.is_empty() {
            return self.unchecked(STEPS, Purpose::Training, logged.len());
        }
        let latest = known.iter().copied().take((SAMPLES / config.batch.get()).max(1));
        let mut again: BTreeMap<u64, Sha256Digest> = latest.collect();
        again.extend(self.steps_of_moved(config, source, &known)?);
        for (step, recorded) in again.into_iter().rev() {
            let sample = |number| source.sample(SampleId { seed: config.seed, number, step });
            let drawn = numbers(config, step).into_par_iter().map(|number| Ok(sample(number)?.digest()));
            let drawn: Result<Vec<Sha256Digest>, TrainError> = drawn.collect();
            let found = match drawn {
                Ok(digests) if digest_of_all(&digests) == recorded => continue,
                Ok(_) => "others".to_owned(),
                Err(error) => error.to_string(),
            };
            return self.differ(Purpose::Training, &format!("samples of step {step}"), STEPS, &found);
        }
        Ok(None)
    }

    /// Of each source at another path, the latest of these steps with a sample of it.
    fn steps_of_moved(
        &self,
        config: &TrainConfig,
        source: &dyn Source,
        known: &[(u64, Sha256Digest)],
    ) -> Result<Vec<(u64, Sha256Digest)>, TrainError> {
        let mut steps = Vec::new();
        for at in &self.moved.training {
            let is_of = |step: u64| {
                let id = |number| SampleId { seed: config.seed, number, step };
                numbers(config, step).any(|number| source.source_of(id(number)) == *at)
            };
            let Some(latest) = known.iter().find(|(step, _)| is_of(*step)) else {
                let expected = format!(
                    "samples in {STEPS} to compare the data at another path with, or the path of the run so far"
                );
                let field = format!("data[{at}].source.dataset");
                return Err(TrainError::malformed(Purpose::Training.data(), field, expected, "none"));
            };
            steps.push(*latest);
        }
        Ok(steps)
    }

    /// Compares the evaluation's samples with those of the last evaluation. Returns a notice as [`Self::check_training`].
    ///
    /// # Errors
    /// As [`Self::check_training`].
    pub(super) fn check_evaluation(&self, evaluation: Option<&Evaluation>) -> Result<Option<String>, TrainError> {
        let Some(evaluation) = evaluation else { return Ok(None) };
        let mut logged = self.logged::<EvaluationRecord>(EVALUATIONS)?;
        let count = logged.len();
        let Some(last) = logged.pop() else {
            return self.unchecked(EVALUATIONS, Purpose::Evaluation, count);
        };
        match last.samples_sha256 {
            None => self.unchecked(EVALUATIONS, Purpose::Evaluation, count),
            Some(recorded) if recorded == evaluation.digest() => Ok(None),
            Some(_) => {
                let which = format!("samples after step {}", last.step);
                self.differ(Purpose::Evaluation, &which, EVALUATIONS, "others")
            }
        }
    }

    /// The records of a log that the run keeps.
    fn logged<R: logs::Record>(&self, log: &str) -> Result<Vec<R>, TrainError> {
        let mut records: Vec<R> = logs::read(&self.folder.join(log))?;
        records.retain(|record| record.is_within(self.done));
        Ok(records)
    }

    fn differ(&self, purpose: Purpose, which: &str, log: &str, found: &str) -> Result<Option<String>, TrainError> {
        let data = purpose.data();
        // At another path, nothing else says that they are the same data.
        if self.processor_changed && !self.moved.contains(purpose) {
            return Ok(Some(format!(
                "{data}: {which}: not those that {log} records, to the bit ({found}): another processor may have decoded or \
                 simulated them, or the data have changed"
            )));
        }
        let expected = format!(
            "those that {log} records, so put the data back as they were, or start a new run from the weights in another folder \
             (`--init`)"
        );
        let found =
            format!("{found}: images, cameras or lengths of clips have changed, or this version makes other samples");
        Err(TrainError::malformed(data, which, expected, found))
    }

    /// That a log with this many records of the run has no hashes to compare, and why; an error if the data are at another path.
    fn unchecked(&self, log: &str, purpose: Purpose, records: usize) -> Result<Option<String>, TrainError> {
        if self.done == 0 {
            return Ok(None);
        }
        let why = match (records, purpose) {
            (0, _) if !self.folder.join(log).exists() => "the file is gone",
            (0, _) => "no records of the run so far",
            (_, Purpose::Training) => {
                "no hashes of samples (a log of an earlier version, or all samples so far could not be used)"
            }
            (_, Purpose::Evaluation) => "no hashes of samples, which earlier versions did not write",
        };
        let data = purpose.data();
        if self.moved.contains(purpose) {
            let expected = "hashes to compare the data at another path with, or the path of the run so far";
            return Err(TrainError::malformed(data, log, expected, why));
        }
        Ok(Some(format!("{log}: {why}: whether the {data} have changed was not checked")))
    }
}
