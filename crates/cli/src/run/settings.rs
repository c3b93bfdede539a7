//! Settings of a run.

use std::path::{Path, PathBuf};
use std::time::Duration;

use atsplat_eval::EvalError;
use atsplat_eval::runner::{Dataset, KeepImages, Selection, suite};
use atsplat_eval::timing::TimingPlan;
use atsplat_metrics::Suite;
use atsplat_protocol::trial::Prefetch;
use atsplat_results::{Provenance, ResultsError, Shard, Store};

use crate::parse::{self, named, usage_error};
use crate::requirements::{Requirement, check_all};

#[derive(Debug, clap::Args)]
pub(crate) struct SettingArgs {
    /// Folder of the results, or a URL (s3://, gs://, az://); an unfinished run in it is resumed, and methods, protocols and
    /// metrics are added.
    #[arg(long, short, value_name = "STORE")]
    out: PathBuf,

    /// Only the K-th of N parts of the scenes, such as 2/8; env takes it from the environment variables of a Slurm
    /// array, an indexed Kubernetes job (with `ATSPLAT_SHARDS`), torchrun or MPI. `atsplat merge` merges the parts.
    #[arg(long, value_name = "K/N|env")]
    shard: Option<Shard>,

    /// Only N scenes of each dataset, spread evenly over the index. A later run without it, or with a multiple, adds the others.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    limit: Option<u64>,

    /// Metrics in addition to the protocols' own, by id, or all.
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = parse::metric_or_all)]
    metrics: Vec<String>,

    #[command(flatten)]
    evaluation: EvaluationArgs,

    /// Images kept with the results: none, those of each method's worst, typical and best trials by PSNR (6, 2, 2), or all.
    #[arg(long, value_name = "WHICH", default_value = "none", value_parser = named(KEPT))]
    pub(crate) keep_images: KeepImages,

    /// Print JSON.
    #[arg(long)]
    pub(crate) json: bool,
}

/// What every command needs that evaluates methods into a store.
#[derive(Debug, clap::Args)]
pub(crate) struct EvaluationArgs {
    /// Folder with the weights of LPIPS and ST-LPIPS, searched before torch's cache.
    #[arg(long, value_name = "DIR", value_parser = parse::folder)]
    metric_weights: Option<PathBuf>,

    /// Read every image again to detect changes since its results were made; otherwise images with the same size, times and inode
    /// count as unchanged.
    #[arg(long)]
    verify: bool,

    /// Evaluate again the trials that failed, wholly or in part, as after a time-out or without memory. Where fewer of a trial's targets
    /// have scores then, its earlier result stays.
    #[arg(long)]
    retry_failed: bool,
}

impl EvaluationArgs {
    /// Opens the store in a folder: resumed or new.
    pub(crate) fn store(&self, folder: &Path, provenance: Provenance) -> Result<Store, ResultsError> {
        let store = Store::resume(folder, provenance)?;
        let store = if self.retry_failed { store.retry_failed() } else { store };
        if self.verify { store.reread_images() } else { Ok(store) }
    }

    /// The metrics of the protocols and those in `more`.
    pub(crate) fn suite(&self, datasets: &[Dataset], more: &[String]) -> Result<Suite, EvalError> {
        suite(datasets, more, self.metric_weights.as_deref())
    }
}

/// Repetitions of a timing pass.
#[derive(Clone, Copy, Debug, clap::Args)]
pub(crate) struct RepetitionArgs {
    /// Minimum number of repetitions of encoding and rendering per timed trial: by default 5, and 2 for work of a second or
    /// more.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(5..=10_000))]
    repetitions: Option<u32>,

    /// Warm-up repetitions, which are not counted; by default 1, and none for work of a second or more.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1000))]
    warm_up: Option<u32>,
}

/// Whether a run is timed.
#[derive(Clone, Copy, Debug, clap::Args)]
pub(super) struct TimingArgs {
    /// Run a timing pass after the evaluation: three trials of each protocol under each method, one at a time with nothing
    /// else running, after a warm-up. Without it, the results contain no times.
    #[arg(long)]
    timing: bool,

    #[command(flatten)]
    repetitions: RepetitionArgs,
}

impl RepetitionArgs {
    pub(crate) fn plan(self) -> TimingPlan {
        let TimingPlan { trials, warm_up, warm_up_until, repetitions, long } = TimingPlan::default();
        TimingPlan {
            trials,
            warm_up: self.warm_up.unwrap_or(warm_up),
            warm_up_until: if self.warm_up.is_some() { Duration::MAX } else { warm_up_until },
            repetitions: self.repetitions.unwrap_or(repetitions),
            long: if self.repetitions.is_some() { Duration::MAX } else { long },
        }
    }
}

impl TimingArgs {
    pub(super) fn plan(self) -> anyhow::Result<Option<TimingPlan>> {
        let RepetitionArgs { repetitions, warm_up } = self.repetitions;
        let checked = check_all(&[Requirement {
            options: &[("--repetitions", repetitions.is_some()), ("--warm-up", warm_up.is_some())],
            requires: "--timing",
            satisfied: self.timing,
        }]);
        checked.map_err(usage_error)?;
        Ok(self.timing.then(|| self.repetitions.plan()))
    }
}

const KEPT: [(&str, KeepImages); 3] =
    [("none", KeepImages::Nothing), ("worst", KeepImages::Worst), ("all", KeepImages::All)];

impl SettingArgs {
    pub(crate) fn out(&self) -> &Path {
        &self.out
    }

    /// Opens the store in the folder of [`Self::out`], or in that of its copy.
    pub(crate) fn store(&self, folder: &Path, provenance: Provenance) -> Result<Store, ResultsError> {
        self.evaluation.store(folder, provenance)
    }

    pub(crate) fn selection(&self) -> Selection {
        Selection { limit: self.limit, shard: self.shard }
    }

    pub(crate) fn prefetch() -> Prefetch {
        Prefetch { trials: 2 * rayon::current_num_threads(), ..Prefetch::default() }
    }

    /// The metrics of the protocols and the requested ones.
    pub(crate) fn suite(&self, datasets: &[Dataset]) -> Result<Suite, EvalError> {
        self.evaluation.suite(datasets, &self.metrics)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn repetitions_need_a_timing_pass() {
        let timing_args =
            |timing, repetitions| TimingArgs { timing, repetitions: RepetitionArgs { repetitions, warm_up: None } };
        assert_eq!(timing_args(false, None).plan().unwrap(), None);
        assert_eq!(timing_args(true, None).plan().unwrap(), Some(TimingPlan::default()));
        let asked = timing_args(true, Some(9)).plan().unwrap().unwrap();
        assert_eq!((asked.repetitions, asked.long), (9, Duration::MAX), "also of long work");
        let error = timing_args(false, Some(9)).plan().unwrap_err().to_string();
        assert!(error.contains("--repetitions requires --timing"), "{error}");
    }
}
