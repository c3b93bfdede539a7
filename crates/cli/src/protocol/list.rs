use std::fmt;

use atsplat_protocol::Preset;
use clap::Args;
use serde::Serialize;

use crate::output::print_report;

#[derive(Debug, Args)]
pub(crate) struct Words {
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
struct Row {
    name: String,
    dataset: String,
    views: usize,
    scenes: u64,
    title: String,
}

#[derive(Debug, Serialize)]
#[serde(transparent)]
struct Presets(Vec<Row>);

pub(crate) fn run(words: &Words) -> anyhow::Result<bool> {
    let rows = Preset::names().map(|name| Preset::named(name).map(row)).collect::<Result<_, _>>()?;
    print_report(&Presets(rows), words.json)?;
    Ok(true)
}

fn row(preset: Preset) -> Row {
    Row {
        views: preset.index.context_views,
        scenes: preset.index.scenes,
        name: preset.name,
        dataset: preset.dataset,
        title: preset.title,
    }
}

impl fmt::Display for Presets {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{:<24} {:<8} {:>5} {:>6}  title", "preset", "dataset", "views", "scenes")?;
        for row in &self.0 {
            writeln!(f, "{:<24} {:<8} {:>5} {:>6}  {}", row.name, row.dataset, row.views, row.scenes, row.title)?;
        }
        Ok(())
    }
}
