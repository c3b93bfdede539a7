//! `atsplat protocol list` and `show`: the built-in presets.

use std::fmt;

use atsplat_protocol::Preset;
use serde::Serialize;

use crate::parse;
use crate::print::{print_report, print_text};

#[derive(Debug, clap::Args)]
pub(crate) struct ListArgs {
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

pub(crate) fn list(args: &ListArgs) -> anyhow::Result<()> {
    let rows = Preset::names().map(|name| Preset::named(name).map(row)).collect::<Result<_, _>>()?;
    print_report(&Presets(rows), args.json)
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

#[derive(Debug, clap::Args)]
pub(crate) struct ShowArgs {
    /// Name of a built-in preset, or a path that ends in `.toml`.
    #[arg(value_parser = parse::preset)]
    preset: String,

    /// Print JSON instead of TOML.
    #[arg(long)]
    json: bool,
}

pub(crate) fn show(args: &ShowArgs) -> anyhow::Result<()> {
    let preset = Preset::resolve(&args.preset)?;
    let text = if args.json { serde_json::to_string_pretty(&preset)? + "\n" } else { preset.to_toml()? };
    print_text(&text)
}
