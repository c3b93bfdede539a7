use atsplat_files::Sha256Digest;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::Context as _;
use atsplat_splat::files::{self, Format};
use atsplat_splat::{Cleaning, Gaussians, Validation};
use clap::{Args, ValueEnum};
use serde::Serialize;

/// Which Gaussians, and what becomes of broken ones.
#[derive(Debug, Args)]
pub(crate) struct SceneWords {
    /// Gaussians: PLY (3DGS' or PlayCanvas' compressed), SPZ or .splat.
    pub(crate) scene: PathBuf,

    /// What becomes of Gaussians that cannot be rendered. `import` leaves out NaN and takes infinite opacity logits for
    /// ±20; `repair` mends what can be mended; `reject` leaves out whatever has a problem.
    #[arg(long, value_name = "POLICY", default_value = "import")]
    clean: CleanWord,

    /// Read the stored opacities as opacities; pixelSplat's and NoPoSplat's exporters write those, not logits.
    #[arg(long)]
    opacities_as_stored: bool,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum CleanWord {
    Import,
    Repair,
    Reject,
}

/// Where the Gaussians came from and what was done to them.
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
    /// What reading found: NaN is left out, infinite opacity logits become ±20.
    pub(crate) import: Validation,
    /// What the policy found after that.
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

/// Gaussians out of a file.
#[derive(Debug)]
pub(crate) struct SceneFile {
    pub(crate) gaussians: Gaussians,
    pub(crate) record: SceneRecord,
    /// What a user should know.
    pub(crate) notes: Vec<String>,
    /// Seconds for reading, hashing and cleaning.
    pub(crate) reading_secs: f64,
}

impl SceneWords {
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
                "every stored opacity lies in [0, 1]: these may be opacities and not logits, see --opacities-as-stored"
                    .to_owned(),
            );
        }
        let policy = match self.clean {
            CleanWord::Import => Cleaning::Import,
            CleanWord::Repair => Cleaning::Repair,
            CleanWord::Reject => Cleaning::Reject,
        };
        let found = gaussians.validate();
        let found = if found.is_clean() {
            found
        } else {
            let (left, found) = gaussians.cleaned(policy);
            gaussians = left;
            found
        };
        if gaussians.is_empty() {
            notes.push("no Gaussian is left: pictures show the background".to_owned());
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

/// Hash and length of a regular file; a pipe is left to the reader to refuse.
fn sha256(path: &Path) -> anyhow::Result<(Sha256Digest, u64)> {
    let doing = || format!("reading {}", path.display());
    if !std::fs::metadata(path).with_context(doing)?.is_file() {
        anyhow::bail!("reading {}: not a regular file", path.display());
    }
    Sha256Digest::of_reader(File::open(path).with_context(doing)?).with_context(doing)
}
