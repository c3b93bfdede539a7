use atsplat_files::Sha256Digest;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Context as _;
use atsplat_splat::files::{self, Format};
use atsplat_splat::{Cleaning, Gaussians, Validation};
use clap::ValueEnum;
use serde::Serialize;

/// The scene file, and how broken Gaussians are handled.
#[derive(Debug, clap::Args)]
pub(crate) struct SceneArgs {
    /// Gaussians: PLY (3DGS' or PlayCanvas' compressed), SPZ or .splat.
    pub(crate) scene: PathBuf,

    /// How Gaussians that cannot be rendered are handled. `import` removes NaN and replaces infinite opacity logits by ±20;
    /// `repair` repairs what can be repaired; `reject` removes every Gaussian with a problem.
    #[arg(long, value_name = "POLICY", default_value = "import")]
    clean: CleanArg,

    /// Read stored opacities as opacities, not logits, as written by the exporters of pixelSplat and NoPoSplat.
    #[arg(long)]
    opacities_as_stored: bool,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum CleanArg {
    Import,
    Repair,
    Reject,
}

/// Origin of the Gaussians and how they were cleaned.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) struct SceneRecord {
    file: PathBuf,
    sha256: Sha256Digest,
    pub(crate) bytes: u64,
    pub(crate) format: Format,
    pub(crate) gaussians: usize,
    pub(crate) sh_degree: u8,
    opacities_as_stored: bool,
    /// Problems found on import: NaN is removed, infinite opacity logits become ±20.
    pub(crate) import: Validation,
    /// Problems found by the policy after import.
    pub(crate) cleaning: CleaningRecord,
    pub(crate) unused: Vec<String>,
    pub(crate) antialiased: Option<bool>,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) struct CleaningRecord {
    pub(crate) policy: Cleaning,
    pub(crate) found: Validation,
}

/// Gaussians of a file.
#[derive(Debug)]
pub(crate) struct SceneFile {
    pub(crate) gaussians: Gaussians,
    pub(crate) record: SceneRecord,
    /// Warnings.
    pub(crate) notes: Vec<String>,
    /// Seconds of reading, hashing and cleaning.
    pub(crate) reading_secs: f64,
}

impl SceneArgs {
    pub(crate) fn read(&self) -> anyhow::Result<SceneFile> {
        let start = Instant::now();
        let path = &self.scene;
        let (read, hashed) = rayon::join(|| files::read(path), || sha256(path));
        let (mut gaussians, import) = read?;
        let (sha256, bytes) = hashed?;
        let mut notes = Vec::new();
        if self.opacities_as_stored {
            gaussians = gaussians.with_opacities_as_stored();
        } else if import.opacities_may_be_no_logits {
            notes.push(
                "every stored opacity is in [0, 1]: these may be opacities, not logits, see --opacities-as-stored"
                    .to_owned(),
            );
        }
        let policy = match self.clean {
            CleanArg::Import => Cleaning::Import,
            CleanArg::Repair => Cleaning::Repair,
            CleanArg::Reject => Cleaning::Reject,
        };
        let found = gaussians.validate();
        let found = if found.is_clean() {
            found
        } else {
            let (remaining, found) = gaussians.cleaned(policy);
            gaussians = remaining;
            found
        };
        if gaussians.is_empty() {
            notes.push("no Gaussian is left: images show the background".to_owned());
        }
        let record = SceneRecord {
            file: path.clone(),
            sha256,
            bytes,
            format: import.format,
            gaussians: gaussians.len(),
            sh_degree: gaussians.sh_degree(),
            opacities_as_stored: self.opacities_as_stored,
            import: import.validation,
            cleaning: CleaningRecord { policy, found },
            unused: import.unused,
            antialiased: import.antialiased,
        };
        Ok(SceneFile { gaussians, record, notes, reading_secs: start.elapsed().as_secs_f64() })
    }
}

/// Hash and length of a regular file.
fn sha256(path: &Path) -> anyhow::Result<(Sha256Digest, u64)> {
    let reading = || format!("reading {}", path.display());
    if !std::fs::metadata(path).with_context(reading)?.is_file() {
        anyhow::bail!("reading {}: not a regular file", path.display());
    }
    Sha256Digest::of_reader(File::open(path).with_context(reading)?).with_context(reading)
}
