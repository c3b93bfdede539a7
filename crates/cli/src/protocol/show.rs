use atsplat_protocol::Preset;
use clap::Args;

use super::parse;
use crate::output::print_text;

#[derive(Debug, Args)]
pub(crate) struct Words {
    /// Name of a built-in preset, or a path that ends in `.toml`.
    #[arg(value_parser = parse::preset)]
    preset: String,

    /// Print JSON instead of TOML.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(words: &Words) -> anyhow::Result<bool> {
    let preset = Preset::resolve(&words.preset)?;
    let text = if words.json { serde_json::to_string_pretty(&preset)? + "\n" } else { preset.to_toml()? };
    print_text(&text)?;
    Ok(true)
}
