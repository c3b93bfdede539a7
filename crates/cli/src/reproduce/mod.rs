//! `atsplat reproduce`: runs everything that can run here and writes the full report.

mod expansion;
mod film;
mod summary;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context as _, bail};
use atsplat_eval::discovery::{Found, NotRun, find_datasets, simulated_datasets};
use atsplat_eval::method::Method;
use atsplat_eval::runner::{self, Dataset, KeepPictures, Plan, Selection, Summary, metric_ids, named_metrics};
use atsplat_eval::timing::TimingPlan;
use atsplat_eval::{Results, Store};
use atsplat_metrics::learned::WeightsFolders;
use atsplat_metrics::{Networks, Suite};
use atsplat_protocol::trial::{DecodeAhead, Prefetch};
use atsplat_scene::Warnings;
use clap::ValueEnum;

use crate::embedded;
use crate::output::{print_findings, print_warnings};
use crate::progress::Progress;
use crate::provenance;

/// Presets of the paper's ablations; simulated presets may stand in for them.
const ABLATIONS: [&str; 2] = ["re10k-2v-256", "dl3dv-6v-256x448"];

#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Folder with datasets and evaluation indices, at any depth: RE10K, DL3DV, any posed capture. By default, simulated
    /// scenes.
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,

    /// Weights of ATSplat: a file of `atsplat train` or `atsplat weights import`; by default the embedded weights of a small
    /// network trained on simulated rooms.
    #[arg(long, value_name = "FILE")]
    weights: Option<PathBuf>,

    /// quick takes a few scenes of each protocol, full all of them.
    #[arg(long, value_name = "SUITE", default_value = "quick")]
    suite: SuiteArg,

    /// Folder for results and report; an unfinished run in it is resumed.
    #[arg(long, short, value_name = "DIR", default_value = "reports/reproduced")]
    out: PathBuf,

    /// Maximum size of the page in megabytes; pictures of trials, the worst, typical and best first, fill what the rest leaves.
    #[arg(long, value_name = "MB", default_value_t = 8)]
    page_size: u16,

    /// Folder with the weights of LPIPS and ST-LPIPS, searched before torch's cache.
    #[arg(long, value_name = "DIR")]
    metric_weights: Option<PathBuf>,

    /// Read every image again to detect changes since its results were made.
    #[arg(long)]
    verify: bool,
}

/// Extent of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum SuiteArg {
    /// A few scenes of every protocol; takes minutes.
    Quick,
    /// All scenes.
    Full,
}

impl SuiteArg {
    /// Number of scenes of a simulated preset.
    const fn simulated_scenes(self, context_views: usize, targets: usize) -> usize {
        match self {
            Self::Full => usize::MAX,
            Self::Quick if context_views > 6 => 1,
            Self::Quick if targets > 8 => 2,
            Self::Quick if context_views > 2 => 4,
            Self::Quick => 8,
        }
    }

    /// Number of scenes per protocol on a user's data.
    const fn limit(self) -> Option<u64> {
        match self {
            Self::Quick => Some(4),
            Self::Full => None,
        }
    }
}

/// Results of methods on datasets.
struct Evaluated {
    results: Results,
    summary: Summary,
    /// Why no target was evaluated, if none was.
    nothing: Option<String>,
}

/// Reproduces; `true` if nothing was skipped and nothing failed.
pub(crate) fn run(args: &Args) -> anyhow::Result<bool> {
    std::fs::create_dir_all(&args.out).with_context(|| format!("creating the folder {}", args.out.display()))?;
    let mut warnings = Warnings::new();
    let Found { datasets, mut not_run } = args.found(&mut warnings)?;
    anyhow::ensure!(!datasets.is_empty(), "nothing to run: {}", reasons(&not_run));
    let trained = embedded::trained(args.weights.as_deref())?;
    let of_ablations: Vec<usize> =
        datasets.iter().enumerate().filter(|(_, dataset)| is_for_ablations(dataset)).map(|(at, _)| at).collect();
    let Evaluated { results, summary, nothing } =
        args.evaluate("results", &datasets, &trained.methods()?, Some(TimingPlan::default()))?;
    if let Some(why) = nothing {
        bail!("nothing was evaluated: {why}");
    }
    let (sections, live) = match expansion::shown(&datasets, &trained) {
        Ok(shown) => {
            not_run.extend(shown.not_run);
            (vec![shown.section], shown.live)
        }
        Err(error) => {
            not_run.push(NotRun { what: "plots of expansion".to_owned(), why: format!("{error:#}") });
            (Vec::new(), Vec::new())
        }
    };
    let mut stores = vec![("results", results)];
    let mut complete = summary.is_complete();
    if !of_ablations.is_empty() {
        let all = datasets.into_iter().enumerate();
        let datasets: Vec<Dataset> = all.filter(|(at, _)| of_ablations.contains(at)).map(|(_, one)| one).collect();
        // Ablation tables have no times.
        let Evaluated { results, summary, .. } = args.evaluate("ablations", &datasets, &trained.variants()?, None)?;
        complete &= summary.is_complete();
        stores.push(("ablations", results));
    }
    let report = summary::write(&args.out, &stores, sections, live, args.page_size)?;
    print_warnings(&warnings);
    for (_, results) in &stores {
        print_findings(results, &warnings);
    }
    summary::print(&report, &stores, &not_run, &trained, &args.out)?;
    Ok(complete && not_run.is_empty())
}

fn is_for_ablations(dataset: &Dataset) -> bool {
    let stands_for = dataset.preset.stands_for.as_deref().unwrap_or(&dataset.preset.name);
    ABLATIONS.contains(&stands_for)
}

fn reasons(not_run: &[NotRun]) -> String {
    not_run.iter().map(|NotRun { what, why }| format!("{what}: {why}")).collect::<Vec<_>>().join("; ")
}

impl Args {
    fn found(&self, warnings: &mut Warnings) -> anyhow::Result<Found> {
        if let Some(folder) = &self.data {
            Ok(find_datasets(folder, warnings)?)
        } else {
            let limit = |context_views, targets| self.suite.simulated_scenes(context_views, targets);
            Ok(Found { datasets: simulated_datasets(limit)?, not_run: Vec::new() })
        }
    }

    fn evaluate(
        &self,
        name: &str,
        datasets: &[Dataset],
        methods: &[Arc<dyn Method>],
        timing: Option<TimingPlan>,
    ) -> anyhow::Result<Evaluated> {
        let suite = self.suite_of(datasets)?;
        let limit = if self.data.is_some() { self.suite.limit() } else { None };
        let plan = Plan {
            datasets,
            methods,
            suite: &suite,
            selection: Selection { limit, shard: None },
            timing,
            pictures: KeepPictures::Worst,
            prefetch: Prefetch { trials: 2, decode: DecodeAhead::All, max_bytes: 512 << 20 },
        };
        let mut store = Store::resume(&self.store(name), plan.provenance(provenance())?)?;
        if self.verify {
            store = store.reread_pictures()?;
        }
        let progress = Progress::new("results", usize::try_from(plan.steps()).context("too many results")?);
        let (results, summary) = runner::run(&plan, store, &|| progress.step())?;
        let nothing = plan.nothing_evaluated(&results);
        Ok(Evaluated { results, summary, nothing })
    }

    fn store(&self, name: &str) -> PathBuf {
        Path::join(&self.out, name)
    }

    fn suite_of(&self, datasets: &[Dataset]) -> anyhow::Result<Suite> {
        let ids = datasets.iter().flat_map(|dataset| metric_ids(&dataset.preset.metrics));
        let definitions = named_metrics(ids)?;
        let folders = WeightsFolders::new(self.metric_weights.iter().cloned().collect());
        let networks = Networks::for_definitions(&definitions, &folders.then(WeightsFolders::torch_hub()))?;
        Ok(Suite::new(definitions, networks, 512 << 20))
    }
}
