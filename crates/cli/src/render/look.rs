use anyhow::bail;
use atsplat_splat::scene_file::SceneFile;
use atsplat_splat::{Channels, MAX_SH_DEGREE, PrincipalPoint, RasterMode, RenderOptions, RendererConstants};
use clap::ValueEnum;
use serde::Serialize;
use serde_json::Value;

use super::views::Shot;
use crate::parse;

/// Render options.
#[derive(Debug, clap::Args)]
pub(crate) struct LookArgs {
    /// Constants and rules of a published rasterizer: exact, gsplat-1.5, gsplat-1.6, inria, pixelsplat-family, or a .toml.
    #[arg(long, value_name = "PRESET", default_value = "exact", value_parser = parse::constants_name)]
    constants: String,

    /// Near plane in scene units, instead of the preset's.
    #[arg(long, value_name = "DEPTH", value_parser = parse::positive)]
    near: Option<f64>,

    /// Far plane in scene units, instead of the preset's.
    #[arg(long, value_name = "DEPTH", value_parser = parse::positive)]
    far: Option<f64>,

    /// black, white, or R,G,B from 0 to 1.
    #[arg(long, value_name = "COLOUR", default_value = "black", value_parser = parse::background)]
    background: [f64; 3],

    /// How Gaussians smaller than a pixel are drawn; by default as recorded in the file, else classic.
    #[arg(long, value_name = "MODE", value_parser = parse::named(MODES))]
    mode: Option<RasterMode>,

    /// Highest degree of spherical harmonics that is evaluated.
    #[arg(long, value_name = "DEGREE", default_value_t = MAX_SH_DEGREE, value_parser = clap::value_parser!(u8).range(..=i64::from(MAX_SH_DEGREE)))]
    sh_degree: u8,

    /// Planes in addition to colour and alpha in EXR files: depth, scalar, median-depth; depth by default.
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    pub(super) channels: Vec<ChannelArg>,
}

const MODES: [(&str, RasterMode); 2] = [("classic", RasterMode::Classic), ("antialiased", RasterMode::Antialiased)];

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum ChannelArg {
    Depth,
    Scalar,
    MedianDepth,
}

/// [`RenderOptions`] as recorded in `render.json`.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) struct LookRecord {
    constants: Value,
    background: [f64; 3],
    mode: RasterMode,
    max_sh_degree: u8,
    channels: Channels,
}

impl LookArgs {
    /// The constants; overrides are appended to their name.
    pub(crate) fn constants(&self) -> anyhow::Result<RendererConstants> {
        let mut constants = parse::constants(&self.constants)?;
        for (field, value) in [("near", self.near), ("far", self.far)] {
            let Some(value) = value else { continue };
            constants.name = format!("{} with {field} {value}", constants.name);
            *(if field == "near" { &mut constants.near } else { &mut constants.far }) = value;
        }
        let in_order = constants.near < constants.far;
        if !in_order {
            bail!("expected a near plane before the far plane, found {} and {}", constants.near, constants.far);
        }
        Ok(constants)
    }

    /// Options for a scene; `planes` if more than colour is written.
    pub(crate) fn options(
        &self,
        constants: RendererConstants,
        scene: &SceneFile,
        planes: bool,
    ) -> anyhow::Result<RenderOptions> {
        let requested = |channel| self.channels.contains(&channel);
        let channels = Channels {
            depth: planes && (requested(ChannelArg::Depth) || self.channels.is_empty()),
            scalar: requested(ChannelArg::Scalar),
            median_depth: requested(ChannelArg::MedianDepth),
        };
        if channels.scalar && scene.gaussians.parts().scalars.is_none() {
            bail!("--channels scalar: the Gaussians of this scene have no scalar (a PLY's `uncertainty`)");
        }
        let mode = match self.mode {
            Some(mode) => mode,
            None if scene.record.antialiased == Some(true) => RasterMode::Antialiased,
            None => RasterMode::Classic,
        };
        let background = self.background;
        Ok(RenderOptions {
            constants,
            background,
            mode,
            max_sh_degree: self.sh_degree,
            channels,
            ..RenderOptions::default()
        })
    }
}

/// The warning about principal points that the constants ignore.
pub(crate) fn ignored_principal_points(constants: &RendererConstants, shots: &[Shot]) -> Option<String> {
    const CENTRED: f64 = 1e-3;
    let is_off = |shot: &&Shot| {
        let intrinsics = shot.view.camera.intrinsics;
        !((intrinsics.cx - 0.5).abs() <= CENTRED && (intrinsics.cy - 0.5).abs() <= CENTRED)
    };
    let off = shots.iter().filter(is_off).count();
    (off > 0 && constants.principal_point == PrincipalPoint::Centre).then(|| {
        format!("{off} cameras have a principal point off the centre, which the constants {} ignore", constants.name)
    })
}

impl LookRecord {
    pub(crate) fn of(options: &RenderOptions) -> anyhow::Result<Self> {
        let mut constants = serde_json::to_value(&options.constants)?;
        if options.constants.far.is_infinite()
            && let Some(far) = constants.get_mut("far")
        {
            // JSON has no infinity.
            *far = Value::from("inf");
        }
        Ok(Self {
            constants,
            background: options.background,
            mode: options.mode,
            max_sh_degree: options.max_sh_degree,
            channels: options.channels,
        })
    }
}
