//! `atsplat budget`: tokens, Gaussians and memory of a configuration by formula, and whether the network keeps to them.

mod measure;
mod published;
mod report;

use anyhow::Context as _;
use atsplat_camera::ImageSize as CameraSize;
use atsplat_model::budget::{BudgetRange, MemoryEstimate, budget, memory};
use atsplat_model::{ImageSize, ModelConfig};

use crate::model_args::{ChangeArgs, ProcessorArg, model, model_size};
use crate::output::{print_report, warn};
use crate::parse;
use crate::progress::Progress;
use measure::Measurer;
use published::Published;
use report::{Report, Row};

#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// One configuration instead of the paper's table: a name, or a path that ends in .toml.
    #[arg(long, value_name = "NAME|FILE", value_parser = model)]
    model: Option<String>,

    /// Number of views; by default that of the configuration.
    #[arg(long, value_name = "N", requires = "model", value_parser = clap::value_parser!(u16).range(1..))]
    views: Option<u16>,

    /// Image size; by default that of the configuration. Width comes first, as in every command; the papers write 448x256
    /// as 256x448.
    #[arg(long, value_name = "WxH", requires = "model", value_parser = parse::size)]
    size: Option<CameraSize>,

    #[command(flatten)]
    changes: ChangeArgs,

    /// Run each row through a network with random weights, compare its counts with the formula, and print seconds and
    /// memory. The paper's high resolution takes minutes and 16 GiB.
    #[arg(long)]
    run: bool,

    /// Device of --run; wgpu needs a build with `--features gpu-network`. The peak is that of host memory.
    #[arg(long = "device", value_name = "DEVICE", default_value = "cpu", requires = "run")]
    processor: ProcessorArg,

    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// A configuration and its input.
struct Case {
    dataset: Option<&'static str>,
    config: ModelConfig,
    views: usize,
    size: ImageSize,
    published: Option<Published>,
}

/// Prints the table; `false` if a number differs from the expected one.
pub(crate) fn run(args: &Args) -> anyhow::Result<bool> {
    let cases = args.cases()?;
    let mut rows = Vec::with_capacity(cases.len());
    let mut measurer = Measurer::new(args.processor.open()?);
    let progress = args.run.then(|| Progress::new("networks", cases.len()));
    for case in cases {
        let Case { dataset, config, views, size, published } = case;
        let range: BudgetRange = budget(&config, views, size)?;
        let memory: MemoryEstimate = memory(&config, views, size)?;
        let name = config.name.clone();
        let measured = if args.run {
            warn(&format!("running {name}, {views} views of {size}"));
            Some(measurer.run(&config, views, size).with_context(|| format!("running {name}"))?)
        } else {
            None
        };
        rows.push(Row::new((dataset, name), (views, size), (&range, memory), published, measured));
        if let Some(progress) = &progress {
            progress.step();
        }
    }
    drop(progress);
    let report = Report { rows, changed: !args.changes.is_empty() };
    print_report(&report, args.json)?;
    Ok(report.is_right())
}

impl Args {
    fn cases(&self) -> anyhow::Result<Vec<Case>> {
        let published = published::table()?;
        let Some(name) = &self.model else {
            let case = |row: Published| -> anyhow::Result<Case> {
                let config = self.changes.applied(&ModelConfig::named(row.model)?)?;
                let (dataset, views, size) = (Some(row.dataset), row.views, row.size);
                // Nothing is published about a changed configuration.
                let published = self.changes.is_empty().then_some(row);
                Ok(Case { dataset, config, views, size, published })
            };
            return published.into_iter().map(case).collect();
        };
        let config = self.changes.applied(&ModelConfig::resolve(name)?)?;
        let views = self.views.map_or(config.views, usize::from);
        let size = self.size.map_or(config.resolution, model_size);
        let hash = config.hash()?;
        let is_this = |row: &Published| -> anyhow::Result<bool> {
            Ok((row.views, row.size) == (views, size) && ModelConfig::named(row.model)?.hash()? == hash)
        };
        let mut matching = None;
        for row in published {
            if is_this(&row)? {
                matching = Some(row);
            }
        }
        let dataset = matching.as_ref().map(|row| row.dataset);
        Ok(vec![Case { dataset, config, views, size, published: matching }])
    }
}
