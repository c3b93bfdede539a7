//! Arguments that select methods.

use std::path::PathBuf;
use std::str::FromStr;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use atsplat_eval::ComputeDevice;
use atsplat_eval::method::{
    AtSplat, Backend, ConstantsChoice, Exec, ExecSettings, GaussianFrame, MAX_GAUSSIANS, Method, NearestView,
    Optimised, Ply, Renders, Splatting, Warp,
};
use atsplat_fit::{Budget, Strategy};
use atsplat_splat::effects::{EffectPlan, EffectSelection};
use clap::ValueEnum;

use crate::parse;
use crate::reconstruct::network::NetworkArgs;
use crate::render::backend::{BackendArg, backend};

/// A method on the command line: `KIND` or `NAME=KIND`.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct MethodArg {
    name: Option<String>,
    kind: Kind,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) enum Kind {
    AtSplat,
    /// The network's Gaussians, optimised further.
    Refined(Budget),
    /// Gaussians optimised from a random start.
    Optimised(Strategy, Budget),
    NearestView,
    Warp,
    Renders(PathBuf),
    Ply(PathBuf),
    /// A process with this command.
    Exec(String),
}

impl Kind {
    /// Whether it has a network or Gaussians to render.
    pub(super) const fn uses_device(&self) -> bool {
        !matches!(self, Self::NearestView | Self::Warp | Self::Renders(_))
    }
}

/// The methods of one argument, separated by commas. A command is the last one: it may hold commas itself.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct MethodList(Vec<MethodArg>);

impl FromStr for MethodList {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut methods = Vec::new();
        let mut rest = Some(text);
        while let Some(text) = rest {
            let is_command = parts(text).1.starts_with("exec:");
            let (first, others) =
                text.split_once(',').filter(|_| !is_command).map_or((text, None), |(a, b)| (a, Some(b)));
            methods.push(first.parse()?);
            rest = others;
        }
        Ok(Self(methods))
    }
}

/// Name and method of `NAME=METHOD`; a method may hold an equals sign after its colon.
fn parts(text: &str) -> (Option<&str>, &str) {
    match text.split_once('=') {
        Some((name, method)) if !name.contains([':', ',']) => (Some(name), method),
        _ => (None, text),
    }
}

impl FromStr for MethodArg {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (name, method) = parts(text);
        let name = name.map(named).transpose()?;
        let folder = |path: &str| Some(PathBuf::from(path)).filter(|path| !path.as_os_str().is_empty());
        let kind = match method.split_once(':') {
            None if method == "atsplat" => Some(Kind::AtSplat),
            None if method == "nearest-view" => Some(Kind::NearestView),
            None if method == "warp" => Some(Kind::Warp),
            Some(("renders", path)) => folder(path).map(Kind::Renders),
            Some(("ply", path)) => folder(path).map(Kind::Ply),
            Some(("exec", command)) if !command.trim().is_empty() => Some(Kind::Exec(command.to_owned())),
            Some(("atsplat+refine", budget)) => Some(Kind::Refined(parse::budget(budget)?)),
            Some(("3dgs", budget)) => Some(Kind::Optimised(Strategy::Gaussians3d, parse::budget(budget)?)),
            Some(("mip-splatting", budget)) => Some(Kind::Optimised(Strategy::MipSplatting, parse::budget(budget)?)),
            Some(("mcmc", budget)) => Some(Kind::Optimised(Strategy::Mcmc, parse::budget(budget)?)),
            _ => None,
        };
        let kind = kind.ok_or_else(|| {
            format!(
                "expected atsplat, nearest-view, warp, renders:DIR, ply:DIR, exec:COMMAND, or 3dgs, mip-splatting, mcmc or \
                 atsplat+refine with a budget, as 3dgs:3000 (steps) or mcmc:10s, optionally after NAME=, found {text:?}"
            )
        })?;
        let is_baseline = matches!(kind, Kind::NearestView | Kind::Warp);
        if is_baseline && name.is_some() {
            return Err(format!("{method} has no variants and takes no name, found {text:?}"));
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

#[derive(Debug, clap::Args)]
pub(super) struct MethodArgs {
    #[command(flatten)]
    network: NetworkArgs,

    /// Most Gaussians of 3dgs, mip-splatting and mcmc; MCMC uses them all.
    #[arg(long, value_name = "N", default_value_t = MAX_GAUSSIANS)]
    max_gaussians: usize,

    /// Seconds that a process of exec may take to start, and for each trial; then it is killed and started again.
    #[arg(long, value_name = "SECONDS", default_value_t = 600.0, value_parser = parse::positive)]
    method_timeout: f64,

    /// Most processes of each exec at once. Each answers one trial at a time, and no more trials than --threads run at once.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=256))]
    method_processes: u16,

    #[command(flatten)]
    gaussians: GaussianArgs,
}

/// Arguments for reading and rendering Gaussians.
#[derive(Debug, clap::Args)]
pub(super) struct GaussianArgs {
    /// Constants and rules of a rasterizer instead of the protocol's: exact, gsplat-1.5, gsplat-1.6, inria,
    /// pixelsplat-family, or a .toml.
    #[arg(long, value_name = "PRESET", value_parser = parse::constants_name)]
    constants: Option<String>,

    /// black, white, or R,G,B from 0 to 1, instead of the protocol's.
    #[arg(long, value_name = "COLOUR", value_parser = parse::background)]
    background: Option<[f64; 3]>,

    /// Which of the requested effects run: auto (only those that can change an image by more than --tolerance), all, none,
    /// or a list of names.
    #[arg(long, value_name = "LIST", default_value = "auto")]
    effects: EffectSelection,

    /// Largest change of any colour sample that `--effects auto` may cause, in units of display range.
    #[arg(long, value_name = "CHANGE", default_value_t = EffectPlan::TOLERANCE, value_parser = parse::not_negative)]
    tolerance: f64,

    /// Renderer, of optimisations too, if not that of --device. gpu takes the best adapter that passes its test, or else the
    /// CPU, and records why.
    #[arg(long, value_name = "WHO")]
    backend: Option<BackendArg>,

    /// Coordinate frame of imported Gaussians: the dataset's, or that of the trial's normalised poses.
    #[arg(long, value_name = "FRAME", default_value = "dataset")]
    ply_frame: FrameArg,

    /// Read stored opacities of imported PLY files as opacities, not logits, as written by the exporters of pixelSplat and
    /// NoPoSplat.
    #[arg(long)]
    opacities_as_stored: bool,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum FrameArg {
    Dataset,
    Trial,
}

impl MethodArgs {
    /// Rejects contradicting arguments before anything is read.
    pub(super) fn check(&self, lists: &[MethodList]) -> Result<(), clap::Error> {
        let kinds = || lists.iter().flat_map(|MethodList(methods)| methods).map(|method| &method.kind);
        self.network
            .check()
            .and_then(|()| self.network.device.check(kinds().any(Kind::uses_device)))
            .map_err(parse::usage_error)
    }

    /// Loads the methods.
    pub(super) fn methods(&self, lists: &[MethodList]) -> anyhow::Result<Vec<Arc<dyn Method>>> {
        let all = || lists.iter().flat_map(|MethodList(methods)| methods);
        let has_network = all().any(|method| matches!(method.kind, Kind::AtSplat | Kind::Refined(_)));
        let device = self.network.device;
        let device = if has_network { device.open_for_networks()? } else { device.open()? };
        all().map(|arg| self.method(arg, &device)).collect()
    }

    fn method(&self, MethodArg { name, kind }: &MethodArg, device: &ComputeDevice) -> anyhow::Result<Arc<dyn Method>> {
        match kind {
            Kind::AtSplat => {
                let source = self.network.source().context("--method atsplat")?;
                let (network, record) = source.load(&device.network()?)?;
                let weights = record.weights();
                let name = name.as_deref().unwrap_or("atsplat");
                let (seed, splatting) = (self.network.seed, self.gaussians.splatting(device)?);
                let method = AtSplat::new(name, network, &weights, seed, splatting)?;
                Ok(Arc::new(method.trained(record.training())))
            }
            Kind::Refined(budget) => {
                let source = self.network.source().context("--method atsplat+refine")?;
                let (network, record) = source.load(&device.network()?)?;
                let (seed, splatting) = (self.network.seed, self.gaussians.splatting(device)?);
                let name = name.as_deref();
                Ok(Arc::new(Optimised::refined(name, network, &record.weights(), *budget, seed, splatting)?))
            }
            Kind::Optimised(strategy, budget) => {
                let (seed, splatting) = (self.network.seed, self.gaussians.splatting(device)?);
                let limit = self.max_gaussians;
                let name = name.as_deref();
                Ok(Arc::new(Optimised::from_scratch(name, *strategy, *budget, limit, seed, splatting)))
            }
            Kind::Exec(command) => Ok(Arc::new(Exec::start(ExecSettings {
                command: command.clone(),
                name: name.clone(),
                limit: Duration::try_from_secs_f64(self.method_timeout).context("--method-timeout")?,
                processes: self.method_processes.into(),
                opacities_as_stored: self.gaussians.opacities_as_stored,
                splatting: self.gaussians.splatting(device)?,
            })?)),
            other => self.gaussians.imported(name.as_deref(), other, device),
        }
    }
}

impl GaussianArgs {
    /// A method without a network.
    pub(super) fn imported(
        &self,
        name: Option<&str>,
        kind: &Kind,
        device: &ComputeDevice,
    ) -> anyhow::Result<Arc<dyn Method>> {
        Ok(match kind {
            Kind::AtSplat | Kind::Refined(_) | Kind::Optimised(..) | Kind::Exec(_) => {
                anyhow::bail!("only imported methods can be scored")
            }
            Kind::NearestView => Arc::new(NearestView),
            Kind::Warp => Arc::new(Warp),
            Kind::Renders(folder) => Arc::new(Renders::new(folder, name)?),
            Kind::Ply(folder) => {
                let frame = match self.ply_frame {
                    FrameArg::Dataset => GaussianFrame::Dataset,
                    FrameArg::Trial => GaussianFrame::Trial,
                };
                Arc::new(Ply::new(folder, name, frame, self.opacities_as_stored, self.splatting(device)?)?)
            }
        })
    }

    fn splatting(&self, device: &ComputeDevice) -> anyhow::Result<Splatting> {
        let constants = match &self.constants {
            Some(name) => ConstantsChoice::These(parse::constants(name)?),
            None => ConstantsChoice::FromPreset,
        };
        let (backend, passed_over) = match self.backend {
            None => (device.backend(), None),
            Some(BackendArg::Cpu) => (Backend::default(), None),
            Some(BackendArg::Gpu) if device.is_adapter() => (device.backend(), None),
            Some(other) => {
                let chosen = backend(other, None)?;
                if let Some(note) = &chosen.note {
                    crate::output::warn(&format!("warning: {note}"));
                }
                (Backend::shared(chosen.renderer, chosen.adapter), chosen.note)
            }
        };
        let (background, effects, tolerance) = (self.background, self.effects.clone(), self.tolerance);
        Ok(Splatting { constants, background, effects, tolerance, backend, passed_over })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parses_methods_with_optional_names() {
        let method = |name: Option<&str>, kind| Ok(MethodArg { name: name.map(str::to_owned), kind });
        assert_eq!("atsplat".parse(), method(None, Kind::AtSplat));
        assert_eq!("small=atsplat".parse(), method(Some("small"), Kind::AtSplat));
        assert_eq!("renders:a/b".parse(), method(None, Kind::Renders("a/b".into())));
        assert_eq!("MVSplat=ply:out:1".parse(), method(Some("MVSplat"), Kind::Ply("out:1".into())));
        assert_eq!("mcmc:10s".parse(), method(None, Kind::Optimised(Strategy::Mcmc, Budget::Seconds(10.0))));
        assert_eq!("long=atsplat+refine:300".parse(), method(Some("long"), Kind::Refined(Budget::Steps(300))));
        assert_eq!("exec:a --b=1".parse(), method(None, Kind::Exec("a --b=1".to_owned())));
        assert_eq!("x=exec:a --b=1".parse(), method(Some("x"), Kind::Exec("a --b=1".to_owned())));
        let list = |text: &str| text.parse::<MethodList>().map(|list| list.0);
        let methods = list("warp,x=renders:a,y=exec:b 1,2").unwrap();
        assert_eq!(methods[1], method(Some("x"), Kind::Renders("a".into())).unwrap());
        assert_eq!(methods[2..], [method(Some("y"), Kind::Exec("b 1,2".to_owned())).unwrap()]);
        assert!(list("warp,").is_err() && list("exec: ").is_err() && list("").is_err());
        for broken in ["3dgs", "3dgs:", "3dgs:0", "mcmc:-1s", "mip-splatting:ten", "3dgs:1.5"] {
            assert!(broken.parse::<MethodArg>().is_err(), "{broken:?}");
        }
        for broken in ["", "splat", "renders", "renders:", "=warp", "x=warp", "truth=renders:a", "a/b=renders:c"] {
            assert!(broken.parse::<MethodArg>().is_err(), "{broken:?}");
        }
    }
}
