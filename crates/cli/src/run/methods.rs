//! Which methods, in words.

use std::path::PathBuf;
use std::str::FromStr;
use std::sync::{Arc, Mutex};

use anyhow::Context as _;
use atsplat_eval::method::{
    AtSplat, Backend, ConstantsChoice, GaussianFrame, Method, NearestView, Ply, Renders, Splatting, Warp,
};
use atsplat_model::network::Device;
use atsplat_splat::effects::EffectSelection;
use clap::{Args, ValueEnum};

use crate::reconstruct::network::NetworkWords;
use crate::render::backend::{BackendWord, backend};
use crate::render::words;

/// A method as the command line names it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct MethodWord {
    name: Option<String>,
    kind: Kind,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    AtSplat,
    NearestView,
    Warp,
    Renders(PathBuf),
    Ply(PathBuf),
}

impl FromStr for MethodWord {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (name, method) = match text.split_once('=') {
            Some((name, method)) => (Some(named(name)?), method),
            None => (None, text),
        };
        let folder = |path: &str| Some(PathBuf::from(path)).filter(|path| !path.as_os_str().is_empty());
        let kind = match method.split_once(':') {
            None if method == "atsplat" => Some(Kind::AtSplat),
            None if method == "nearest-view" => Some(Kind::NearestView),
            None if method == "warp" => Some(Kind::Warp),
            Some(("renders", path)) => folder(path).map(Kind::Renders),
            Some(("ply", path)) => folder(path).map(Kind::Ply),
            _ => None,
        };
        let kind = kind.ok_or_else(|| {
            format!("expected atsplat, nearest-view, warp, renders:DIR or ply:DIR, with NAME= before it or not, found {text:?}")
        })?;
        let is_floor = matches!(kind, Kind::NearestView | Kind::Warp);
        if is_floor && name.is_some() {
            return Err(format!("{method} has no variants to tell apart by a name, found {text:?}"));
        }
        Ok(Self { name, kind })
    }
}

/// A method's name in the results.
pub(super) fn named(text: &str) -> Result<String, String> {
    let plain = |c: char| c.is_alphanumeric() || "-_.+ ".contains(c);
    if !text.trim().is_empty() && text.chars().all(plain) && !["truth", "context"].contains(&text) {
        return Ok(text.trim().to_owned());
    }
    Err(format!(
        "expected a name of letters, digits, spaces, - _ . and +, other than truth and context, found {text:?}"
    ))
}

#[derive(Debug, Args)]
pub(super) struct MethodWords {
    #[command(flatten)]
    network: NetworkWords,

    #[command(flatten)]
    gaussians: GaussianWords,
}

/// How Gaussians are read and rendered.
#[derive(Debug, Args)]
pub(super) struct GaussianWords {
    /// Numbers and rules of a rasterizer in place of the protocol's: exact, gsplat-1.5, gsplat-1.6, inria,
    /// pixelsplat-family, or a .toml.
    #[arg(long, value_name = "PRESET", value_parser = words::constants_name)]
    constants: Option<String>,

    /// black, white, or R,G,B from 0 to 1, in place of the protocol's.
    #[arg(long, value_name = "COLOUR", value_parser = words::background)]
    background: Option<[f64; 3]>,

    /// Effects that run where they are asked for: auto (only those that can change a picture by more than a quarter of an
    /// 8-bit step), all, none, or a list of names.
    #[arg(long, value_name = "LIST", default_value = "all")]
    effects: EffectSelection,

    /// Who renders.
    #[arg(long, value_name = "WHO", default_value = "cpu")]
    backend: BackendWord,

    /// Whose axes and unit of length imported Gaussians have: the dataset's, or the trial's, whose poses are normalised.
    #[arg(long, value_name = "FRAME", default_value = "dataset")]
    ply_frame: FrameWord,

    /// Take the opacities of imported PLY files for what they are and not for logits, as pixelSplat's and NoPoSplat's
    /// exporters write them.
    #[arg(long)]
    opacities_as_stored: bool,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum FrameWord {
    Dataset,
    Trial,
}

impl MethodWords {
    /// Words that do not fit together, told before anything is read.
    pub(super) fn check(&self) -> Result<(), clap::Error> {
        self.network.check_for_evaluation()
    }

    /// The methods, ready to run.
    pub(super) fn methods(&self, words: &[MethodWord]) -> anyhow::Result<Vec<Arc<dyn Method>>> {
        words.iter().map(|word| self.method(word)).collect()
    }

    fn method(&self, MethodWord { name, kind }: &MethodWord) -> anyhow::Result<Arc<dyn Method>> {
        match kind {
            Kind::AtSplat => {
                let source = self.network.source().context("--method atsplat")?;
                let (network, record) = source.load(&Device::flex())?;
                let weights = record.weights();
                let name = name.as_deref().unwrap_or("atsplat");
                let (seed, splatting) = (self.network.seed, self.gaussians.splatting()?);
                Ok(Arc::new(AtSplat::new(name, network, &weights, seed, splatting)?))
            }
            other => self.gaussians.imported(name.as_deref(), other),
        }
    }
}

impl GaussianWords {
    /// A method without a network.
    pub(super) fn imported(&self, name: Option<&str>, kind: &Kind) -> anyhow::Result<Arc<dyn Method>> {
        Ok(match kind {
            Kind::AtSplat => anyhow::bail!("a network is no imported method"),
            Kind::NearestView => Arc::new(NearestView),
            Kind::Warp => Arc::new(Warp),
            Kind::Renders(folder) => Arc::new(Renders::new(folder, name)?),
            Kind::Ply(folder) => {
                let frame = match self.ply_frame {
                    FrameWord::Dataset => GaussianFrame::Dataset,
                    FrameWord::Trial => GaussianFrame::Trial,
                };
                Arc::new(Ply::new(folder, name, frame, self.opacities_as_stored, self.splatting()?)?)
            }
        })
    }

    fn splatting(&self) -> anyhow::Result<Splatting> {
        let constants = match &self.constants {
            Some(name) => ConstantsChoice::These(words::constants(name)?),
            None => ConstantsChoice::OfPreset,
        };
        let (backend, passed_over) = match self.backend {
            BackendWord::Cpu => (Backend::default(), None),
            other => {
                let chosen = backend(other, None)?;
                if let Some(note) = &chosen.note {
                    crate::output::complain(&format!("warning: {note}"));
                }
                (Backend::One(Mutex::new(chosen.renderer)), chosen.note)
            }
        };
        Ok(Splatting { constants, background: self.background, effects: self.effects.clone(), backend, passed_over })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn methods_have_kinds_and_may_have_names() {
        let word = |name: Option<&str>, kind| Ok(MethodWord { name: name.map(str::to_owned), kind });
        assert_eq!("atsplat".parse(), word(None, Kind::AtSplat));
        assert_eq!("small=atsplat".parse(), word(Some("small"), Kind::AtSplat));
        assert_eq!("renders:a/b".parse(), word(None, Kind::Renders("a/b".into())));
        assert_eq!("MVSplat=ply:out:1".parse(), word(Some("MVSplat"), Kind::Ply("out:1".into())));
        for broken in ["", "splat", "renders", "renders:", "=warp", "x=warp", "truth=renders:a", "a/b=renders:c"] {
            assert!(broken.parse::<MethodWord>().is_err(), "{broken:?}");
        }
    }
}
