//! `atsplat score`: evaluates output files of any other method under a protocol.

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::bail;
use atsplat_eval::method::{Method, MethodSpec, Renders};

use super::evaluate;
use super::methods::GaussianArgs;
use super::protocols::ProtocolArgs;
use super::settings::{SettingArgs, TimingArgs};
use super::stated::StatedCostArgs;
use crate::device::DeviceArgs;
use crate::parse::{self, usage_error};
use crate::requirements::{Requirement, check_all};

#[derive(Debug, clap::Args)]
#[command(
    override_usage = "atsplat score <PRESET|FILE>… --data <PATH> <--renders <DIR>|--ply <DIR>> --out <STORE> [OPTIONS]",
    after_help = "Images are found as SCENE/color/000029.png (pixelSplat and its descendants), SCENE/000029.png or \
                  SCENE/29.png, as .exr, which precedes a .png of the same name, and as .npy where a scene has no other \
                  images; Gaussians as SCENE.ply, SCENE/gaussians.ply or SCENE/point_cloud.ply, .spz and .splat too, or as \
                  SCENE/point_cloud/iteration_30000/point_cloud.ply (3DGS); if the index has several entries of a \
                  scene, SCENE is SCENE-0 for the first, SCENE-1 for the second. A frame's number is its position in the scene, \
                  as in the evaluation index. Files that are missing, damaged, transparent or of another size or \
                  encoding, floats in another range than [0, 1], and frames with two files are counted as failed targets."
)]
pub(crate) struct Args {
    #[command(flatten)]
    protocols: ProtocolArgs,

    /// Folder of images that the method rendered.
    #[arg(long, value_name = "DIR", required_unless_present = "ply", conflicts_with = "ply")]
    renders: Option<PathBuf>,

    /// Folder of Gaussians that the method wrote.
    #[arg(long, value_name = "DIR")]
    ply: Option<PathBuf>,

    /// Name in the results; by default the folder's name.
    #[arg(long, value_name = "NAME", value_parser = MethodSpec::name_of)]
    name: Option<String>,

    /// Title in tables and plots, such as "Ours (K=8)"; by default the name. It can be given later or corrected: no render is scored
    /// again.
    #[arg(long, value_name = "TEXT", value_parser = parse::title)]
    title: Option<String>,

    /// The method gives the same bits every time: `drift` then compares bit by bit, otherwise by intervals of the means.
    #[arg(long)]
    deterministic: bool,

    #[command(flatten, next_help_heading = "Costs of images")]
    stated: StatedCostArgs,

    #[command(flatten, next_help_heading = "Gaussians")]
    device: DeviceArgs,

    #[command(flatten, next_help_heading = "Gaussians")]
    gaussians: GaussianArgs,

    #[command(flatten, next_help_heading = "Run")]
    settings: SettingArgs,

    #[command(flatten, next_help_heading = "Run")]
    timing: TimingArgs,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<bool> {
    args.protocols.check()?;
    let requirements = check_all(&[
        Requirement {
            options: &args.gaussians.options(),
            requires: "--ply (images are compared as they are)",
            satisfied: args.ply.is_some(),
        },
        Requirement {
            options: &[args.device.option()],
            requires: "--ply (images are compared on the CPU)",
            satisfied: args.ply.is_some(),
        },
        Requirement {
            options: &args.stated.options(),
            requires: "--renders (Gaussians in files are counted)",
            satisfied: args.renders.is_some(),
        },
    ]);
    requirements.and_then(|()| args.gaussians.check_tolerance()).map_err(usage_error)?;
    let timing = args.timing.plan()?;
    let (name, title) = (args.name.as_deref(), args.title.as_deref());
    let method: Arc<dyn Method> = match (&args.renders, &args.ply) {
        (Some(folder), _) => {
            let renders = Renders::new(folder, name)?.titled(title).deterministic(args.deterministic);
            Arc::new(renders.at_cost(args.stated.cost()))
        }
        (None, Some(folder)) => {
            let ply = args.gaussians.ply(folder, name, &args.device.open()?)?;
            Arc::new(ply.titled(title).deterministic(args.deterministic))
        }
        (None, None) => bail!("expected --renders or --ply"),
    };
    evaluate(&args.protocols, &[method], &args.settings, timing)
}
