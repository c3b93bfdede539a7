use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;

use atsplat_files::Sha256Digest;
use serde::Serialize;

use super::{BackboneWeights, ImportReport, OtherSets};

/// A weights file of another implementation that was read by a key map.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct ImportedFile {
    /// The file.
    pub file: PathBuf,
    /// Its hash.
    pub sha256: Sha256Digest,
    /// Name of the configuration.
    pub model: String,
    /// Whether it has every parameter.
    pub complete: bool,
    /// What was found in it.
    #[serde(flatten)]
    pub found: ImportReport,
    /// The backbone's file, if it is another.
    pub backbone: Option<ImportedBackbone>,
    /// The weights file, once it is written.
    pub out: Option<PathBuf>,
}

/// The file of a backbone that was read.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct ImportedBackbone {
    file: PathBuf,
    sha256: Sha256Digest,
    known: Option<&'static str>,
    matched: usize,
}

impl ImportedBackbone {
    /// The record of a backbone that was read from `file`.
    pub fn new(file: PathBuf, backbone: &BackboneWeights) -> Self {
        let known = backbone.known.map(|known| known.what);
        Self { file, sha256: backbone.sha256, known, matched: backbone.report.matched.len() }
    }
}

impl ImportedFile {
    /// What the import records in the weights file as provenance.
    pub fn provenance(&self) -> BTreeMap<String, String> {
        let name = atsplat_files::name_of(&self.file);
        let mut provenance = BTreeMap::from([
            ("imported-by".to_owned(), format!("atsplat {}", env!("CARGO_PKG_VERSION"))),
            ("imported-from".to_owned(), name),
            ("imported-sha256".to_owned(), self.sha256.to_string()),
            ("key-map".to_owned(), self.found.key_map.clone()),
        ]);
        if let Some(OtherSets { used, others }) = &self.found.other_sets {
            provenance.insert("imported-prefix".to_owned(), used.clone());
            provenance.insert("other-prefixes".to_owned(), others.join(" "));
        }
        if let Some(ImportedBackbone { sha256, known: what, .. }) = &self.backbone {
            provenance.insert("backbone-sha256".to_owned(), sha256.to_string());
            provenance.insert("backbone".to_owned(), what.unwrap_or("of no known hash").to_owned());
        }
        provenance
    }
}

impl fmt::Display for ImportedFile {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{} (sha256 {})", self.file.display(), self.sha256)?;
        if self.complete {
            writeln!(f, "{}", self.found)?;
        } else {
            // What is missing is no sample.
            writeln!(f, "{:#}", self.found)?;
        }
        if let Some(ImportedBackbone { file, sha256, known, matched }) = &self.backbone {
            let known = known.unwrap_or("an unknown file");
            writeln!(f, "backbone: {matched} parameters of {} (sha256 {sha256}): {known}", file.display())?;
        }
        match &self.out {
            Some(out) => writeln!(f, "the model {} into {}", self.model, out.display()),
            None if self.complete => writeln!(f, "complete: --out writes it"),
            None => Ok(()),
        }
    }
}
