use std::path::Path;

use anyhow::bail;
use atsplat_files::is_toml_path;
use atsplat_splat::scene_file::SceneFile;
use atsplat_splat::{Channels, Gaussians, MAX_SH_DEGREE, RasterMode, RenderOptions, RendererConstants};
use clap::ValueEnum;

use crate::parse;

/// Render options.
#[derive(Debug, clap::Args)]
pub(crate) struct RenderSettingsArgs {
    /// Constants and rules of a published rasterizer, by name or in a .toml; mip-splatting belongs to --mode antialiased. With
    /// pixelsplat-family, see --near; coefficient 14 of harmonics is evaluated as in its rasterizer's backward pass, which its
    /// forward pass contradicts.
    #[arg(long, value_name = "PRESET", default_value = "exact", value_parser = parse::ConstantsName)]
    constants: String,

    /// Near plane in scene units, instead of the preset's. The code of pixelsplat-family divides scenes by their dataset's near
    /// plane and culls at 0.2: give 0.2 times the dataset's near plane (for DepthSplat, 0.1).
    #[arg(long, value_name = "DEPTH", value_parser = parse::positive)]
    near: Option<f64>,

    /// Far plane in scene units, instead of the preset's.
    #[arg(long, value_name = "DEPTH", value_parser = parse::positive)]
    far: Option<f64>,

    /// black, white, or R,G,B from 0 to 1.
    #[arg(long, value_name = "COLOUR", default_value = "black", value_parser = parse::background)]
    background: [f64; 3],

    /// How Gaussians smaller than a pixel are rendered; by default as recorded in the file, else classic.
    #[arg(long, value_name = "MODE", value_parser = parse::named(parse::MODES))]
    mode: Option<RasterMode>,

    /// Highest degree of spherical harmonics that is evaluated.
    #[arg(long, value_name = "DEGREE", default_value_t = MAX_SH_DEGREE, value_parser = clap::value_parser!(u8).range(..=i64::from(MAX_SH_DEGREE)))]
    sh_degree: u8,

    /// Planes in addition to colour and alpha in EXR files: depth (the expected depth along the optical axis, 0 where alpha is 0),
    /// scalar, median-depth (that of the Gaussian after which half of the light or less is left, else 0); depth by default.
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    pub(super) channels: Vec<ChannelArg>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum ChannelArg {
    Depth,
    Scalar,
    MedianDepth,
}

impl RenderSettingsArgs {
    /// The file of the constants, if they are in one.
    pub(super) fn constants_file(&self) -> Option<&Path> {
        is_toml_path(&self.constants).then(|| Path::new(&self.constants))
    }

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
            let RendererConstants { near, far, .. } = constants;
            let text = format!("--near, --far: expected a near plane before the far plane, found {near} and {far}");
            return Err(parse::usage_error(text).into());
        }
        Ok(constants)
    }

    /// A warning for Gaussians with Mip-Splatting's 3D filter that are drawn in the default mode: a PLY records this filter, but not
    /// the 2D filter that belongs to it.
    pub(crate) fn warning(&self, gaussians: &Gaussians, mode: RasterMode) -> Option<&'static str> {
        let is_mip = gaussians.parts().filter_3d.is_some() && mode == RasterMode::Classic;
        (is_mip && self.mode.is_none()).then_some(
            "the Gaussians have 3D filters (filter_3D), as Mip-Splatting makes them, and are drawn in the classic mode: see \
             --mode antialiased and --constants mip-splatting",
        )
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

#[cfg(test)]
mod tests {
    use atsplat_splat::Cleaning;
    use clap::Parser as _;

    use super::*;

    #[derive(clap::Parser)]
    struct Command {
        #[command(flatten)]
        settings: RenderSettingsArgs,
    }

    #[test]
    fn a_mip_splatting_file_without_a_mode_is_warned_of() {
        let warning = |file: &str, args: &[&str]| {
            let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../splat/tests/fixtures/files").join(file);
            let scene = SceneFile::read(&path, Cleaning::Import, false).unwrap();
            let settings = Command::parse_from([&["render"][..], args].concat()).settings;
            let options = settings.options(settings.constants().unwrap(), &scene, false).unwrap();
            settings.warning(&scene.gaussians, options.mode)
        };
        let (mip, other) = ("degree4_mip_uncertainty.ply", "degree1_ascii.ply");
        let found = warning(mip, &[]).unwrap();
        assert!(found.contains("--mode antialiased") && found.contains("--constants"), "{found}");
        assert_eq!(warning(mip, &["--constants", "inria"]), Some(found), "no preset has its blur");
        for mode in ["classic", "antialiased"] {
            assert_eq!(warning(mip, &["--mode", mode]), None);
        }
        assert_eq!(warning(other, &[]), None);
    }
}
