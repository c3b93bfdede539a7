//! Records next to files of Gaussians.

use std::path::Path;

use anyhow::Context as _;
use atsplat_files::Sha256Digest;
use serde::Serialize;

/// A record, and the hash of the file that it belongs to: a file that was replaced since has another.
#[derive(Serialize)]
struct OfFile<'a, R> {
    #[serde(flatten)]
    record: &'a R,
    #[serde(rename = "file-sha256")]
    file_sha256: Sha256Digest,
}

/// The text of a record of `file`, which is written already.
pub(crate) fn record_of<R: Serialize>(record: &R, file: &Path) -> anyhow::Result<String> {
    let file_sha256 = Sha256Digest::of_file(file).with_context(|| format!("reading {}", file.display()))?;
    Ok(format!("{}\n", serde_json::to_string_pretty(&OfFile { record, file_sha256 })?))
}
