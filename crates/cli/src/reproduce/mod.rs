//! `atsplat reproduce`: runs everything that can run here and writes the full report.

mod expansion;
mod film;
mod summary;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context as _, bail};
use atsplat_eval::ComputeDevice;
use atsplat_eval::discovery::{DiscoveredDatasets, NotRun, find_datasets, simulated_datasets};
use atsplat_eval::method::Method;
use atsplat_eval::runner::{self, Dataset, KeepImages, Plan, Selection};
use atsplat_eval::timing::TimingPlan;
use atsplat_eval::trained::{TrainedGroup, TrainedNetworks};
use atsplat_eval::weights_list::WeightsList;
use atsplat_files::is_toml_path;
use atsplat_fit::Budget;
use atsplat_protocol::trial::{DecodeAhead, Prefetch};
use atsplat_report::definition::TableDefinition;
use atsplat_report::page::PlotSection;
use atsplat_report::plot_data::optimisation_section;
use atsplat_report::store_labels;
use atsplat_report::table::Source;
use atsplat_results::Results;
use atsplat_scene::Warnings;
use clap::ValueEnum;

use crate::device::DeviceArgs;
use crate::embedded;
use crate::output_lock::OutputLock;
use crate::overwrite::check_results_folder;
use crate::progress::Progress;
use crate::provenance;
use crate::report::PageArgs;
use crate::run::merge::reject_duplicates;
use crate::run::settings::EvaluationArgs;
use crate::warnings::{print_findings, print_warnings};

#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Folder with datasets and evaluation indices, at any depth but not in hidden folders: RE10K, DL3DV, any posed capture.
    /// By default, simulated scenes.
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,

    /// Weights of ATSplat: a file of `atsplat train` or `atsplat weights import`, or a .toml that lists them by protocol,
    /// table and variant; by default the embedded weights of small networks trained on simulated rooms and yards.
    #[arg(long, value_name = "FILE")]
    weights: Option<PathBuf>,

    /// quick takes a few scenes of each protocol, full all of them.
    #[arg(long, value_name = "SUITE", default_value = "quick")]
    suite: SuiteArg,

    /// Also optimise every trial on its context views for a number of steps (3000) or seconds (10s): 3DGS,
    /// Mip-Splatting and MCMC from random points, and refinement of the network's Gaussians.
    #[arg(long, value_name = "BUDGET")]
    fit: Option<Budget>,

    #[command(flatten)]
    device: DeviceArgs,

    /// Folder for results and report; an unfinished run in it is resumed.
    #[arg(long, short, value_name = "DIR", default_value = "reports/reproduced")]
    out: PathBuf,

    #[command(flatten)]
    page: PageArgs,

    #[command(flatten)]
    evaluation: EvaluationArgs,

    /// Start the report with the curves of these results: accuracy against seconds of optimisation, as `atsplat tradeoff sweep`
    /// measures it; may be given several times.
    #[arg(long, value_name = "STORE")]
    curve: Vec<PathBuf>,
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
            Self::Quick if context_views > 2 => 3,
            Self::Quick => 8,
        }
    }

    /// What is timed of each protocol.
    fn timing(self) -> TimingPlan {
        match self {
            Self::Quick => TimingPlan { trials: 2, ..TimingPlan::default() },
            Self::Full => TimingPlan::default(),
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
    /// Why no target was evaluated, if none was.
    why_empty: Option<String>,
}

/// The stores of a reproduction by the names of their folders, and those without any result.
#[derive(Default)]
struct Stores {
    all: Vec<(String, Results)>,
    empty: Vec<NotRun>,
}

impl Stores {
    fn add(&mut self, name: String, Evaluated { results, why_empty }: Evaluated) {
        self.empty.extend(why_empty.map(|why| NotRun { what: name.clone(), why }));
        self.all.push((name, results));
    }
}

/// Reproduces; `true` if nothing was skipped and nothing failed.
pub(crate) fn run(args: &Args) -> anyhow::Result<bool> {
    reject_duplicates(&args.curve)?;
    if let Some(data) = &args.data {
        check_results_folder(&args.out, data)?;
    }
    let curves = args.curves()?;
    let mut warnings = Warnings::new();
    let DiscoveredDatasets { datasets, paths, mut not_run } = args.found(&mut warnings)?;
    paths.iter().try_for_each(|data| check_results_folder(&args.out, data))?;
    let lock = OutputLock::of(&args.out)?;
    anyhow::ensure!(!datasets.is_empty(), "nothing to run: {}", reasons(&not_run));
    let device = args.device.open_for_networks()?;
    let mut networks = networks(args.weights.as_deref(), device)?;
    let found = not_run.len();
    let groups = networks.groups(datasets, &mut not_run)?;
    // Left out on purpose, which is not incomplete.
    let unlisted = not_run.len() - found;
    anyhow::ensure!(!groups.is_empty(), "nothing to run: {}", reasons(&not_run));
    let mut stores = Stores::default();
    for (at, TrainedGroup { trained, datasets }) in groups.iter().enumerate() {
        let name = numbered("results", at);
        let mut methods = trained.methods()?;
        methods.extend(args.fit.map(|budget| trained.optimised(budget)).transpose()?.unwrap_or_default());
        let evaluated = args.evaluate(&name, datasets, &methods, Some(args.suite.timing()))?;
        stores.add(name, evaluated);
    }
    if stores.empty.len() == groups.len() {
        let reasons: Vec<&str> = stores.empty.iter().map(|store| store.why.as_str()).collect();
        bail!("nothing was evaluated: {}", reasons.join("; "));
    }
    let (mut sections, mut live) = (curves, Vec::new());
    for TrainedGroup { trained, datasets } in groups.iter().take(1) {
        match expansion::report_parts(datasets, trained) {
            Ok(parts) => {
                not_run.extend(parts.not_run);
                sections.push(parts.section);
                live = parts.live;
            }
            Err(error) => {
                not_run.push(NotRun { what: "plots of expansion".to_owned(), why: format!("{error:#}") });
            }
        }
    }
    let trained = groups.iter().map(|group| group.trained.description.clone()).collect::<Vec<_>>().join("; ");
    for (at, (methods, datasets)) in networks.ablations(groups)?.into_iter().enumerate() {
        let name = numbered("ablations", at);
        // Ablation tables have no times.
        let evaluated = args.evaluate(&name, &datasets, &methods, None)?;
        stores.add(name, evaluated);
    }
    let Stores { all: stores, empty } = stores;
    not_run.extend(empty);
    let report = summary::write(lock.folder_lock(), &stores, sections, live, args.page)?;
    print_warnings(&warnings);
    print_findings(&stores.iter().map(|(_, results)| results).collect::<Vec<_>>(), &warnings);
    summary::print(&report, &stores, &not_run, &trained, &args.out)?;
    let complete = stores.iter().all(|(_, results)| results.gaps().is_empty());
    Ok(complete && not_run.len() == unlisted)
}

/// The networks of `--weights`: a weights file, a list (`.toml`), or by default the embedded weights.
fn networks(weights: Option<&Path>, device: ComputeDevice) -> anyhow::Result<TrainedNetworks> {
    let tables = TableDefinition::presets_by_name()?;
    let list = match weights {
        None => embedded::by_protocol(&tables)?,
        Some(path) if is_toml_path(path) => WeightsList::read(path, &tables, &embedded::NAMES)?,
        Some(path) => WeightsList::one(path.to_owned()),
    };
    Ok(TrainedNetworks::new(list, device, |path| embedded::trained(Some(path))))
}

/// `results`, `results-2` …
fn numbered(name: &str, at: usize) -> String {
    if at == 0 { name.to_owned() } else { format!("{name}-{}", at + 1) }
}

fn reasons(not_run: &[NotRun]) -> String {
    not_run.iter().map(|NotRun { what, why }| format!("{what}: {why}")).collect::<Vec<_>>().join("; ")
}

impl Args {
    /// The section with the results of `--curve`, with which the report starts.
    fn curves(&self) -> anyhow::Result<Vec<PlotSection>> {
        let read = self.curve.iter().zip(Results::read_each(&self.curve));
        let results = read.map(|(path, results)| results.with_context(|| format!("--curve {}", path.display())));
        let results = results.collect::<anyhow::Result<Vec<_>>>()?;
        let labels = store_labels(&self.curve);
        let sources = labels.iter().zip(&results).map(|(label, results)| Source { label, results });
        let section = optimisation_section(&sources.collect::<Vec<_>>())?;
        anyhow::ensure!(
            self.curve.is_empty() || section.is_some(),
            "--curve: expected trials that were optimised with several budgets, and timed; found none"
        );
        Ok(section.into_iter().collect())
    }

    fn found(&self, warnings: &mut Warnings) -> anyhow::Result<DiscoveredDatasets> {
        if let Some(folder) = &self.data {
            Ok(find_datasets(folder, warnings)?)
        } else {
            let limit = |context_views, targets| self.suite.simulated_scenes(context_views, targets);
            Ok(DiscoveredDatasets { datasets: simulated_datasets(limit)?, ..DiscoveredDatasets::default() })
        }
    }

    fn evaluate(
        &self,
        name: &str,
        datasets: &[Dataset],
        methods: &[Arc<dyn Method>],
        timing: Option<TimingPlan>,
    ) -> anyhow::Result<Evaluated> {
        let suite = self.evaluation.suite(datasets, &[])?;
        let limit = if self.data.is_some() { self.suite.limit() } else { None };
        let plan = Plan {
            datasets,
            methods,
            suite: &suite,
            selection: Selection { limit, shard: None },
            timing,
            images: KeepImages::Worst,
            prefetch: Prefetch { trials: 2, decode: DecodeAhead::All, max_bytes: 512 << 20 },
        };
        let store = self.evaluation.store(&self.out.join(name), plan.provenance(provenance())?)?;
        let progress = Progress::new("results", usize::try_from(plan.steps()).context("too many results")?);
        let (results, _) = runner::run(&plan, store, &|step| progress.result(step))?;
        let why_empty = plan.nothing_evaluated(&results);
        Ok(Evaluated { results, why_empty })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// One of the tables' stores and one of ablations are empty.
    #[test]
    fn stores_without_results_are_named_with_the_reason() {
        let evaluated = |why: Option<&str>| {
            let why_empty = why.map(str::to_owned);
            Evaluated { results: Results::default(), why_empty }
        };
        let mut stores = Stores::default();
        for (name, at, why) in [
            ("results", 0, None),
            ("results", 1, Some("the index has no entry")),
            ("ablations", 0, Some("out of memory")),
            ("ablations", 1, None),
        ] {
            stores.add(numbered(name, at), evaluated(why));
        }
        assert_eq!(reasons(&stores.empty), "results-2: the index has no entry; ablations: out of memory");
        assert_eq!(stores.all.len(), 4);
    }
}
