//! `atsplat budget`: tokens, Gaussians and memory of a configuration by formula, and whether the network has these
//! counts.

use anyhow::Context as _;
use atsplat_camera::ImageSize as CameraSize;
use atsplat_eval::budget::{BudgetCase, BudgetMeasurer, BudgetReport, BudgetRow, PublishedBudget, published_budgets};
use atsplat_model::ModelConfig;
use atsplat_model::network::Processor;

use crate::model_args::{ConfigOverrideArgs, model};
use crate::print::{print_report, print_status};
use crate::progress::Progress;

#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// One configuration instead of the paper's table: a name, or a path that ends in .toml.
    #[arg(long, value_name = "NAME|FILE", value_parser = model)]
    model: Option<String>,

    /// Number of views; by default that of the configuration.
    #[arg(long, value_name = "N", requires = "model", value_parser = clap::value_parser!(u16).range(1..))]
    views: Option<u16>,

    /// Image size; by default that of the configuration. Width comes first, as in every command; the papers write 448x256
    /// as 256x448. The counts are those of weights that were trained at this size; `run` shows others their training's scale.
    #[arg(long, value_name = "WxH", requires = "model")]
    size: Option<CameraSize>,

    #[command(flatten)]
    changes: ConfigOverrideArgs,

    /// Run each row through a network with random weights, compare its counts with the formula, and print seconds and
    /// memory. The paper's high resolution takes minutes and 4 GiB.
    #[arg(long)]
    run: bool,

    /// Device of --run: cpu, wgpu (the best graphics adapter) or wgpu:N (number N of `atsplat adapters`); an adapter
    /// requires a build with `--features gpu-network`. The printed peak is always that of host memory.
    #[arg(long = "device", value_name = "cpu|wgpu[:N]", default_value = "cpu", requires = "run")]
    processor: Processor,

    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// Prints the table; `false` if a number differs from the expected one.
pub(crate) fn run(args: &Args) -> anyhow::Result<bool> {
    let cases = args.cases()?;
    let mut rows = Vec::with_capacity(cases.len());
    let mut measurer = BudgetMeasurer::new(args.processor.open().context("--device")?);
    let progress = args.run.then(|| Progress::new("networks", cases.len()));
    for case in cases {
        let measured = if args.run {
            let BudgetCase { config, views, size, .. } = &case;
            print_status(&format!("running {}, {views} views of {size}", config.name));
            let measured = measurer.run(config, *views, *size);
            Some(measured.with_context(|| format!("running {}", config.name))?)
        } else {
            None
        };
        rows.push(BudgetRow::new(case, measured)?);
        if let Some(progress) = &progress {
            progress.step();
        }
    }
    drop(progress);
    let report = BudgetReport { rows, changed: !args.changes.is_empty() };
    print_report(&report, args.json)?;
    Ok(report.is_consistent())
}

impl Args {
    fn cases(&self) -> anyhow::Result<Vec<BudgetCase>> {
        let published = published_budgets()?;
        let Some(name) = &self.model else {
            let case = |row: PublishedBudget| -> anyhow::Result<BudgetCase> {
                let config = self.changes.applied(&ModelConfig::named(&row.model)?)?;
                let (dataset, views, size) = (Some(row.dataset.clone()), row.views, row.size);
                // Nothing is published about a changed configuration.
                let published = self.changes.is_empty().then_some(row);
                Ok(BudgetCase { dataset, config, views, size, published })
            };
            return published.into_iter().map(case).collect();
        };
        let config = self.changes.applied(&ModelConfig::resolve(name)?)?;
        let views = self.views.map_or(config.views, usize::from);
        let size = self.size.map_or(config.resolution, Into::into);
        let hash = config.hash()?;
        let is_this = |row: &PublishedBudget| -> anyhow::Result<bool> {
            Ok((row.views, row.size) == (views, size) && ModelConfig::named(&row.model)?.hash()? == hash)
        };
        let mut matching = None;
        for row in published {
            if is_this(&row)? {
                matching = Some(row);
            }
        }
        let dataset = matching.as_ref().map(|row| row.dataset.clone());
        Ok(vec![BudgetCase { dataset, config, views, size, published: matching }])
    }
}
