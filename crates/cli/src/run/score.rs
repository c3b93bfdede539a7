//! `atsplat score`: what any other method wrote, under a protocol.

use std::path::PathBuf;

use clap::Args;

use super::evaluate;
use super::methods::{GaussianWords, Kind, named};
use super::protocols::ProtocolWords;
use super::settings::{SettingWords, TimingArgs};

#[derive(Debug, Args)]
#[command(
    override_usage = "atsplat score <PRESET|FILE>… --data <PATH> <--renders <DIR>|--ply <DIR>> --out <STORE> [OPTIONS]",
    after_help = "Pictures are found as SCENE/color/000029.png (pixelSplat and its descendants), SCENE/000029.png or \
                  SCENE/29.png, .exr before .png; Gaussians as SCENE.ply, SCENE/gaussians.ply or SCENE/point_cloud.ply, .spz \
                  and .splat too. A frame's number is its position in the scene, as in the evaluation index. What is \
                  missing, damaged, transparent or of another size is a failed target and counted."
)]
pub(crate) struct Words {
    #[command(flatten)]
    protocols: ProtocolWords,

    /// Folder of pictures that the method rendered.
    #[arg(long, value_name = "DIR", required_unless_present = "ply", conflicts_with = "ply")]
    renders: Option<PathBuf>,

    /// Folder of Gaussians that the method wrote.
    #[arg(long, value_name = "DIR")]
    ply: Option<PathBuf>,

    /// What the results call it; by default the folder's name.
    #[arg(long, value_name = "NAME", value_parser = named)]
    name: Option<String>,

    #[command(flatten, next_help_heading = "Gaussians")]
    gaussians: GaussianWords,

    #[command(flatten, next_help_heading = "Run")]
    settings: SettingWords,

    #[command(flatten, next_help_heading = "Run")]
    timing: TimingArgs,
}

pub(crate) fn run(words: &Words) -> anyhow::Result<bool> {
    let kinds = words.renders.iter().cloned().map(Kind::Renders).chain(words.ply.iter().cloned().map(Kind::Ply));
    let methods = kinds.map(|kind| words.gaussians.imported(words.name.as_deref(), &kind));
    evaluate(&words.protocols, &methods.collect::<anyhow::Result<Vec<_>>>()?, &words.settings, words.timing)
}
