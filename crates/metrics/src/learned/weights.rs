use std::path::{Path, PathBuf};

use atsplat_model::ModelError;
use serde::Serialize;
use thiserror::Error;

use super::Network;

/// Why a learned metric cannot be computed.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum LoadError {
    /// Its weights are nowhere.
    #[error("{0}")]
    Absent(WeightsAbsent),
    /// A file is not one of weights.
    #[error(transparent)]
    File(#[from] ModelError),
    /// A file holds other weights.
    #[error("weights of {}: tensor {tensor}: expected {expected}, found {found}", network.name())]
    Unfit {
        /// For which network.
        network: Network,
        /// Name in the file.
        tensor: String,
        /// Shape, or finite numbers.
        expected: String,
        /// What is there.
        found: String,
    },
}

/// A learned metric's weights were not found: what is missing, where it was looked for, how to get it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Error)]
#[error("weights absent: {} needs {file}; {advice}; looked in {}", network.name(), list(looked_in))]
#[serde(rename_all = "kebab-case")]
pub struct WeightsAbsent {
    /// Which network.
    pub network: Network,
    /// Name of the file that is missing.
    pub file: String,
    /// How to get it, in one sentence.
    pub advice: String,
    /// Folders and files that were tried.
    pub looked_in: Vec<PathBuf>,
}

impl WeightsAbsent {
    pub(crate) fn new(network: Network, looked_in: Vec<PathBuf>) -> Self {
        Self { network, file: network.file().to_owned(), advice: network.advice().to_owned(), looked_in }
    }
}

fn list(paths: &[PathBuf]) -> String {
    if paths.is_empty() {
        return "no folder".to_owned();
    }
    let home = std::env::var_os("HOME").map(PathBuf::from);
    paths.iter().map(|path| shown(path, home.as_deref())).collect::<Vec<_>>().join(", ")
}

/// Results are published: whose home it was need not be in them.
fn shown(path: &Path, home: Option<&Path>) -> String {
    match home.filter(|home| !home.as_os_str().is_empty()).and_then(|home| path.strip_prefix(home).ok()) {
        Some(below) => Path::new("~").join(below).display().to_string(),
        None => path.display().to_string(),
    }
}

impl Network {
    /// Name of the file that holds the network's weights, as its publisher names it.
    pub const fn file(self) -> &'static str {
        match self {
            Self::LpipsVgg => "vgg16-397923af.pth",
            Self::LpipsAlex => "alexnet-owt-7be5be79.pth",
            Self::StLpipsAlex => "alex_shift_tolerant.pth",
            Self::StLpipsVgg => "vgg_shift_tolerant.pth",
        }
    }

    /// What the file's sha256 begins with, where its publisher's name says so.
    pub const fn sha256_prefix(self) -> Option<&'static str> {
        match self {
            Self::LpipsVgg => Some("397923af"),
            Self::LpipsAlex => Some("7be5be79"),
            Self::StLpipsAlex | Self::StLpipsVgg => None,
        }
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

/// Folders in which weights are looked for, in order.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct WeightsFolders(Vec<PathBuf>);

impl WeightsFolders {
    /// These folders.
    pub const fn new(folders: Vec<PathBuf>) -> Self {
        Self(folders)
    }

    /// Where PyTorch keeps what it downloads: `$TORCH_HOME/hub/checkpoints`, else
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

    /// These folders, then the others.
    #[must_use]
    pub fn then(mut self, others: Self) -> Self {
        self.0.extend(others.0);
        self
    }

    /// The network's file, under its publisher's name.
    ///
    /// # Errors
    /// [`WeightsAbsent`].
    pub fn find(&self, network: Network) -> Result<PathBuf, WeightsAbsent> {
        let candidates = self.0.iter().map(|folder| folder.join(network.file()));
        candidates.into_iter().find(|path| path.is_file()).ok_or_else(|| WeightsAbsent::new(network, self.0.clone()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_are_those_of_torch_hub() {
        let of = |set: &[(&str, &str)]| {
            let variables: Vec<(String, PathBuf)> = set.iter().map(|(k, v)| ((*k).to_owned(), v.into())).collect();
            WeightsFolders::torch_hub_of(|name| variables.iter().find(|(k, _)| k == name).map(|(_, v)| v.clone())).0
        };
        let home = ("HOME", "/h");
        assert_eq!(of(&[home]), [Path::new("/h/.cache/torch/hub/checkpoints")]);
        assert_eq!(of(&[home, ("XDG_CACHE_HOME", "/c")]), [Path::new("/c/torch/hub/checkpoints")]);
        assert_eq!(of(&[home, ("XDG_CACHE_HOME", "/c"), ("TORCH_HOME", "/t")]), [Path::new("/t/hub/checkpoints")]);
        assert_eq!(of(&[home, ("TORCH_HOME", "")]), [Path::new("/h/.cache/torch/hub/checkpoints")]);
        assert!(of(&[]).is_empty());
    }

    #[test]
    fn what_is_absent_is_said_with_the_way_to_get_it() {
        let folder = tempfile::tempdir().unwrap();
        let folders = WeightsFolders::new(vec![folder.path().to_owned()]);
        let error = folders.find(Network::LpipsVgg).unwrap_err().to_string();
        for part in ["vgg16-397923af.pth", "https://download.pytorch.org", &folder.path().display().to_string()] {
            assert!(error.contains(part), "{error}");
        }
        std::fs::write(folder.path().join("vgg16-397923af.pth"), b"").unwrap();
        assert!(folders.find(Network::LpipsVgg).is_ok());
    }

    #[test]
    fn homes_are_not_told() {
        let home = Some(Path::new("/home/somebody"));
        assert_eq!(shown(Path::new("/home/somebody/.cache/torch"), home), "~/.cache/torch");
        assert_eq!(shown(Path::new("/data/weights"), home), "/data/weights");
        assert_eq!(shown(Path::new("/data"), None), "/data");
        assert_eq!(shown(Path::new("/data"), Some(Path::new(""))), "/data");
    }
}
