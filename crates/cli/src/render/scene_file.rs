use std::path::PathBuf;

use atsplat_splat::scene_file::SceneFile;
use atsplat_splat::{Cleaning, SplatError};

use crate::parse::named;

/// The scene file, and how broken Gaussians are handled.
#[derive(Debug, clap::Args)]
pub(crate) struct SceneArgs {
    /// Gaussians: PLY (3DGS' or PlayCanvas' compressed), SPZ or .splat.
    pub(crate) scene: PathBuf,

    /// How Gaussians that cannot be rendered are handled. `import` removes NaN and replaces infinite opacity logits by ±20;
    /// `repair` repairs what can be repaired; `reject` removes every Gaussian with a problem, infinite logits of a PLY included
    /// (other formats store opacities, of which 0 and 1 are valid).
    #[arg(long, value_name = "POLICY", default_value = "import", value_parser = named(POLICIES))]
    clean: Cleaning,

    /// Read stored opacities as opacities, not logits, as written by the exporters of pixelSplat and NoPoSplat.
    #[arg(long)]
    opacities_as_stored: bool,
}

const POLICIES: [(&str, Cleaning); 3] =
    [("import", Cleaning::Import), ("repair", Cleaning::Repair), ("reject", Cleaning::Reject)];

impl SceneArgs {
    pub(crate) fn read(&self) -> Result<SceneFile, SplatError> {
        SceneFile::read(&self.scene, self.clean, self.opacities_as_stored)
    }
}
