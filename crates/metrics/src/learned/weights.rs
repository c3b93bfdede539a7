use std::path::{Path, PathBuf};

use atsplat_pickle::SharedBytes;
use atsplat_tensors::{StoredTensors, TensorError};
use serde::Serialize;
use thiserror::Error;

use super::LpipsNetwork;

/// Why a learned metric cannot be loaded.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum LoadError {
    /// Its weights were not found.
    #[error("{0}")]
    Absent(WeightsAbsent),
    /// A file is not a valid weights file.
    #[error(transparent)]
    File(#[from] TensorError),
    /// A file does not match the network.
    #[error("weights of {}: tensor {tensor}: expected {expected}, found {found}", network.name())]
    Mismatch {
        /// The expected network.
        network: LpipsNetwork,
        /// Name of the tensor.
        tensor: String,
        /// Shape, or finite numbers.
        expected: String,
        /// What was found.
        found: String,
    },
}

/// Missing weights of a learned metric: which file, how to get it, where it was searched.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Error)]
#[error("weights absent: {} needs {file}; {advice}; looked in {}", network.name(), list(looked_in))]
#[serde(rename_all = "kebab-case")]
pub struct WeightsAbsent {
    /// Which network.
    pub network: LpipsNetwork,
    /// Name of the missing file.
    pub file: String,
    /// How to get it, in one sentence.
    pub advice: String,
    /// Folders and files that were searched.
    pub looked_in: Vec<PathBuf>,
}

impl WeightsAbsent {
    pub(crate) fn new(network: LpipsNetwork, looked_in: Vec<PathBuf>) -> Self {
        Self { network, file: network.file().to_owned(), advice: network.advice().to_owned(), looked_in }
    }

    /// The text of such an error without the searched folders, which differ between machines that lack the same file.
    pub fn without_folders(text: &str) -> &str {
        text.split_once("; looked in ").map_or(text, |(reason, _)| reason)
    }
}

fn list(paths: &[PathBuf]) -> String {
    if paths.is_empty() {
        return "no folder".to_owned();
    }
    let home = std::env::var_os("HOME").map(PathBuf::from);
    paths.iter().map(|path| with_tilde(path, home.as_deref())).collect::<Vec<_>>().join(", ")
}

/// Abbreviates the home folder: results are published and should not contain user names.
fn with_tilde(path: &Path, home: Option<&Path>) -> String {
    match home.filter(|home| !home.as_os_str().is_empty()).and_then(|home| path.strip_prefix(home).ok()) {
        Some(below) => Path::new("~").join(below).display().to_string(),
        None => path.display().to_string(),
    }
}

impl LpipsNetwork {
    /// Published file name of the network's weights.
    pub const fn file(self) -> &'static str {
        match self {
            Self::LpipsVgg => "vgg16-397923af.pth",
            Self::LpipsAlex => "alexnet-owt-7be5be79.pth",
            Self::StLpipsAlex => "alex_shift_tolerant.pth",
            Self::StLpipsVgg => "vgg_shift_tolerant.pth",
        }
    }

    /// First eight digits of the published file's SHA-256, which torchvision's file names contain.
    pub const fn sha256_prefix(self) -> &'static str {
        match self {
            Self::LpipsVgg => "397923af",
            Self::LpipsAlex => "7be5be79",
            Self::StLpipsAlex => "b356b382",
            Self::StLpipsVgg => "44597da6",
        }
    }

    /// Whether a file with this SHA-256, in hexadecimal, is the published one.
    pub fn is_published(self, sha256: &str) -> bool {
        sha256.starts_with(self.sha256_prefix())
    }

    /// How to get the file.
    pub const fn advice(self) -> &'static str {
        match self {
            Self::LpipsVgg => {
                "get it from https://download.pytorch.org/models/vgg16-397923af.pth, or let \
                 `torchvision.models.vgg16(weights=\"IMAGENET1K_V1\")` put it into torch's cache"
            }
            Self::LpipsAlex => {
                "get it from https://download.pytorch.org/models/alexnet-owt-7be5be79.pth, or let \
                 `torchvision.models.alexnet(weights=\"IMAGENET1K_V1\")` put it into torch's cache"
            }
            Self::StLpipsAlex | Self::StLpipsVgg => {
                "it is in the package stlpips_pytorch 0.0.2 on PyPI, under stlpips_pytorch/weights/vST0.0"
            }
        }
    }
}

/// Folders that are searched for weights, in order.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct WeightsFolders(Vec<PathBuf>);

impl WeightsFolders {
    /// These folders.
    pub const fn new(folders: Vec<PathBuf>) -> Self {
        Self(folders)
    }

    /// PyTorch's download folder: `$TORCH_HOME/hub/checkpoints`, else
    /// `$XDG_CACHE_HOME/torch/hub/checkpoints`, else `~/.cache/torch/hub/checkpoints` (`torch.hub.get_dir`).
    pub fn torch_hub() -> Self {
        Self::torch_hub_of(|name| std::env::var_os(name).map(PathBuf::from))
    }

    fn torch_hub_of(variable: impl Fn(&str) -> Option<PathBuf>) -> Self {
        let set = |name| variable(name).filter(|path| !path.as_os_str().is_empty());
        let cache = || set("XDG_CACHE_HOME").or_else(|| Some(set("HOME")?.join(".cache")));
        let home = set("TORCH_HOME").or_else(|| Some(cache()?.join("torch")));
        Self(home.map(|home| home.join("hub/checkpoints")).into_iter().collect())
    }

    /// Appends other folders.
    #[must_use]
    pub fn then(mut self, others: Self) -> Self {
        self.0.extend(others.0);
        self
    }

    /// Finds the network's file by its published name.
    ///
    /// # Errors
    /// [`WeightsAbsent`].
    pub fn find(&self, network: LpipsNetwork) -> Result<PathBuf, WeightsAbsent> {
        let candidates = self.0.iter().map(|folder| folder.join(network.file()));
        candidates.into_iter().find(|path| path.is_file()).ok_or_else(|| WeightsAbsent::new(network, self.0.clone()))
    }
}

/// LPIPS's heads v0.1 (BSD-2, `weights/LICENSE.lpips`), converted from the files of the lpips package 0.1.4 by
/// `oracle/make_heads.py`.
const VGG_HEADS: &[u8] = include_bytes!("../../weights/lpips-v0.1-vgg.safetensors");
const ALEX_HEADS: &[u8] = include_bytes!("../../weights/lpips-v0.1-alex.safetensors");

/// The embedded heads; `None` for ST-LPIPS, whose file contains network and heads.
///
/// # Errors
/// Never in practice: the embedded bytes are covered by tests.
pub fn embedded_heads(network: LpipsNetwork) -> Option<Result<StoredTensors, LoadError>> {
    let bytes = match network {
        LpipsNetwork::LpipsVgg => VGG_HEADS,
        LpipsNetwork::LpipsAlex => ALEX_HEADS,
        LpipsNetwork::StLpipsAlex | LpipsNetwork::StLpipsVgg => return None,
    };
    Some(StoredTensors::parse(SharedBytes::new(bytes)).map_err(LoadError::from))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_follow_torch_hub() {
        let folders = |set: &[(&str, &str)]| {
            let variables: Vec<(String, PathBuf)> = set.iter().map(|(k, v)| ((*k).to_owned(), v.into())).collect();
            WeightsFolders::torch_hub_of(|name| variables.iter().find(|(k, _)| k == name).map(|(_, v)| v.clone())).0
        };
        let home = ("HOME", "/h");
        assert_eq!(folders(&[home]), [Path::new("/h/.cache/torch/hub/checkpoints")]);
        assert_eq!(folders(&[home, ("XDG_CACHE_HOME", "/c")]), [Path::new("/c/torch/hub/checkpoints")]);
        assert_eq!(folders(&[home, ("XDG_CACHE_HOME", "/c"), ("TORCH_HOME", "/t")]), [Path::new("/t/hub/checkpoints")]);
        assert_eq!(folders(&[home, ("TORCH_HOME", "")]), [Path::new("/h/.cache/torch/hub/checkpoints")]);
        assert!(folders(&[]).is_empty());
    }

    #[test]
    fn absent_weights_are_reported_with_instructions() {
        let folder = tempfile::tempdir().unwrap();
        let folders = WeightsFolders::new(vec![folder.path().to_owned()]);
        let error = folders.find(LpipsNetwork::LpipsVgg).unwrap_err().to_string();
        for part in ["vgg16-397923af.pth", "https://download.pytorch.org", &folder.path().display().to_string()] {
            assert!(error.contains(part), "{error}");
        }
        let reason = WeightsAbsent::without_folders(&error);
        assert!(reason.ends_with(LpipsNetwork::LpipsVgg.advice()) && reason.contains("vgg16-397923af.pth"), "{reason}");
        let elsewhere = WeightsAbsent::new(LpipsNetwork::LpipsVgg, Vec::new()).to_string();
        assert_eq!(reason, WeightsAbsent::without_folders(&elsewhere));
        assert_eq!(WeightsAbsent::without_folders("another reason"), "another reason");
        std::fs::write(folder.path().join("vgg16-397923af.pth"), b"").unwrap();
        assert!(folders.find(LpipsNetwork::LpipsVgg).is_ok());
    }

    #[test]
    fn home_folders_are_abbreviated() {
        let home = Some(Path::new("/home/user"));
        assert_eq!(with_tilde(Path::new("/home/user/.cache/torch"), home), "~/.cache/torch");
        assert_eq!(with_tilde(Path::new("/data/weights"), home), "/data/weights");
        assert_eq!(with_tilde(Path::new("/data"), None), "/data");
        assert_eq!(with_tilde(Path::new("/data"), Some(Path::new(""))), "/data");
    }
}
