use std::fmt;
use std::path::PathBuf;

use anyhow::{Context as _, bail};
use atsplat_protocol::{BuiltIndex, IndexBuilder, IndexLayout};
use atsplat_scene::{SceneSource as _, Warnings};
use clap::Args;
use serde::Serialize;

use crate::output::{PendingFile, print_report, print_warnings};
use crate::progress::Progress;

#[derive(Debug, Args)]
pub(crate) struct Words {
    /// Dataset, in any format that is read.
    data: PathBuf,

    /// Where the index goes.
    #[arg(long, short, value_name = "INDEX")]
    out: PathBuf,

    /// TOML file with a `[sampler]` table and, if wanted, an `[overlap]` table.
    #[arg(long, value_name = "TOML", conflicts_with = "sampler", required_unless_present = "sampler")]
    config: Option<PathBuf>,

    /// Sampler by name: farthest-point, evenly-spaced, overlap-pairs, bounded, all-frames.
    #[arg(long, value_name = "NAME")]
    sampler: Option<String>,

    /// One setting of the sampler, as TOML, e.g. `--set views=6`; repeatable.
    #[arg(long = "set", value_name = "KEY=VALUE", requires = "sampler")]
    settings: Vec<String>,

    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
#[serde(rename_all = "kebab-case")]
struct Report<'a> {
    rule: &'a IndexBuilder,
    scenes: usize,
    entries: usize,
    refused_entries: usize,
    nulls: &'a std::collections::BTreeMap<&'static str, usize>,
}

pub(crate) fn run(words: &Words) -> anyhow::Result<bool> {
    let builder = builder(words)?;
    let out = PendingFile::open(&words.out)?;
    let mut warnings = Warnings::new();
    let dataset = atsplat_scene::open(&words.data, &mut warnings)?;
    let progress = Progress::new("scenes", dataset.keys().len());
    let built = builder.build(&dataset, &|| progress.step(), &mut warnings);
    drop(progress);
    out.finish(built.index.to_json(&IndexLayout::PIXELSPLAT).as_bytes())?;
    let BuiltIndex { scenes, entries, nulls, refused_entries, .. } = &built;
    let report = Report {
        rule: &builder,
        scenes: *scenes,
        entries: *entries,
        refused_entries: *refused_entries,
        nulls,
    };
    print_report(&report, words.json)?;
    print_warnings(&warnings);
    Ok(nulls.is_empty())
}

fn builder(words: &Words) -> anyhow::Result<IndexBuilder> {
    let (text, place) = match (&words.config, &words.sampler) {
        (Some(path), _) => {
            let text = std::fs::read_to_string(path).with_context(|| format!("reading {}", path.display()))?;
            (text, path.display().to_string())
        }
        (None, Some(name)) => {
            let mut text = format!("[sampler]\nsampler = {name:?}\n");
            for setting in &words.settings {
                if !setting.contains('=') || setting.contains('\n') {
                    bail!("--set takes KEY=VALUE, found {setting:?}");
                }
                text.push_str(setting);
                text.push('\n');
            }
            (text, "--sampler and --set".to_owned())
        }
        (None, None) => bail!("either --config or --sampler is needed"),
    };
    toml::from_str(&text).with_context(|| format!("reading the sampler's settings from {place}"))
}

impl fmt::Display for Report<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "sampler {}: {} scenes, {} entries", self.rule.sampler.name(), self.scenes, self.entries)?;
        if self.refused_entries > 0 {
            writeln!(f, "{:>7}  entries refused for their overlap", self.refused_entries)?;
        }
        for (reason, count) in self.nulls {
            writeln!(f, "{count:>7}  scenes null: {reason}")?;
        }
        Ok(())
    }
}
