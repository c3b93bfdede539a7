//! `atsplat budget`: tokens, Gaussians and memory of a configuration, before anything runs; and whether the network keeps
//! to them.

mod measure;
mod published;
mod report;

use anyhow::Context as _;
use atsplat_camera::ImageSize as CameraSize;
use atsplat_model::budget::{BudgetRange, MemoryEstimate, budget, memory};
use atsplat_model::{ImageSize, ModelConfig};
use clap::Args;

use crate::model_words::{ChangeWords, ProcessorWord, model};
use crate::output::{complain, print_report};
use crate::progress::Progress;
use crate::render::words;
use measure::Measurer;
use published::Published;
use report::{Report, Row};

#[derive(Debug, Args)]
pub(crate) struct Words {
    /// One configuration instead of the paper's table: a name, or a path that ends in .toml.
    #[arg(long, value_name = "NAME|FILE", value_parser = model)]
    model: Option<String>,

    /// How many views; by default what the configuration is for.
    #[arg(long, value_name = "N", requires = "model", value_parser = clap::value_parser!(u16).range(1..))]
    views: Option<u16>,

    /// Size of the pictures; by default what the configuration is for. Width comes first here, as in every command; the
    /// papers write 448x256 as 256x448.
    #[arg(long, value_name = "WxH", requires = "model", value_parser = words::size)]
    size: Option<CameraSize>,

    #[command(flatten)]
    changes: ChangeWords,

    /// Run each row through a network with fresh weights, compare its counts with the formula's, and tell seconds and
    /// memory. The paper's high resolution takes minutes, and 16 GiB.
    #[arg(long)]
    run: bool,

    /// What --run computes on; wgpu needs a build with `--features gpu-network`. The peak is that of the host's memory.
    #[arg(long = "device", value_name = "DEVICE", default_value = "cpu", requires = "run")]
    processor: ProcessorWord,

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

/// Prints the table; `false` where a figure is not what it should be.
pub(crate) fn run(words: &Words) -> anyhow::Result<bool> {
    let cases = words.cases()?;
    let mut rows = Vec::with_capacity(cases.len());
    let mut measurer = Measurer::new(words.processor.open()?);
    let progress = words.run.then(|| Progress::new("networks", cases.len()));
    for case in cases {
        let Case { dataset, config, views, size, published } = case;
        let range: BudgetRange = budget(&config, views, size)?;
        let memory: MemoryEstimate = memory(&config, views, size)?;
        let name = config.name.clone();
        let measured = if words.run {
            complain(&format!("running {name}, {views} views of {size}"));
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
    let report = Report { rows, changed: !words.changes.is_empty() };
    print_report(&report, words.json)?;
    Ok(report.is_right())
}

impl Words {
    fn cases(&self) -> anyhow::Result<Vec<Case>> {
        let published = published::table()?;
        let Some(name) = &self.model else {
            let case = |row: Published| -> anyhow::Result<Case> {
                let config = self.changes.applied(&ModelConfig::named(row.model)?)?;
                let (dataset, views, size) = (Some(row.dataset), row.views, row.size);
                // Changes make another network, of which nothing is published.
                let published = self.changes.is_empty().then_some(row);
                Ok(Case { dataset, config, views, size, published })
            };
            return published.into_iter().map(case).collect();
        };
        let config = self.changes.applied(&ModelConfig::resolve(name)?)?;
        let views = self.views.map_or(config.views, usize::from);
        let size =
            self.size.map_or(config.resolution, |size| ImageSize::new(size.height as usize, size.width as usize));
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
