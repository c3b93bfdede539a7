//! Arguments that select methods.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use atsplat_eval::ComputeDevice;
use atsplat_eval::method::{
    AtSplat, Backend, ConstantsChoice, Exec, ExecSettings, GaussianFrame, MAX_GAUSSIANS, Method, MethodKind,
    MethodSpec, NearestView, Optimised, Ply, Renders, Splatting, Warp,
};
use atsplat_splat::effects::{EffectPlan, EffectSelection};

use crate::parse;
use crate::reconstruct::network::NetworkArgs;
use crate::render::backend::{BackendArg, backend};

/// The methods of one argument.
pub(super) type Methods = Vec<MethodSpec>;

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
    #[arg(long, value_name = "FRAME", default_value = "dataset", value_parser = parse::named(FRAMES))]
    ply_frame: GaussianFrame,

    /// Read stored opacities of imported PLY files as opacities, not logits, as written by the exporters of pixelSplat and
    /// NoPoSplat.
    #[arg(long)]
    opacities_as_stored: bool,
}

const FRAMES: [(&str, GaussianFrame); 2] = [("dataset", GaussianFrame::Dataset), ("trial", GaussianFrame::Trial)];

impl MethodArgs {
    /// Rejects contradicting arguments before anything is read.
    pub(super) fn check(&self, methods: &[MethodSpec]) -> Result<(), clap::Error> {
        let uses_device = methods.iter().any(|method| method.kind.uses_device());
        self.network.check().and_then(|()| self.network.device.check(uses_device)).map_err(parse::usage_error)
    }

    /// Loads the methods.
    pub(super) fn load(&self, methods: &[MethodSpec]) -> anyhow::Result<Vec<Arc<dyn Method>>> {
        let has_network = methods.iter().any(|method| method.kind.has_network());
        let device = self.network.device;
        let device = if has_network { device.open_for_networks()? } else { device.open()? };
        methods.iter().map(|spec| self.method(spec, &device)).collect()
    }

    fn method(
        &self,
        MethodSpec { name, kind }: &MethodSpec,
        device: &ComputeDevice,
    ) -> anyhow::Result<Arc<dyn Method>> {
        let name = name.as_deref();
        let seed = self.network.seed;
        match kind {
            MethodKind::AtSplat => {
                let source = self.network.source().context("--method atsplat")?;
                let (network, record) = source.load(&device.network()?)?;
                let splatting = self.gaussians.splatting(device)?;
                let method = AtSplat::new(name.unwrap_or("atsplat"), network, &record.weights(), seed, splatting)?;
                Ok(Arc::new(method.trained(record.training())))
            }
            MethodKind::Refined(budget) => {
                let source = self.network.source().context("--method atsplat+refine")?;
                let (network, record) = source.load(&device.network()?)?;
                let splatting = self.gaussians.splatting(device)?;
                Ok(Arc::new(Optimised::refined(name, network, &record.weights(), *budget, seed, splatting)?))
            }
            MethodKind::Optimised(strategy, budget) => {
                let (limit, splatting) = (self.max_gaussians, self.gaussians.splatting(device)?);
                Ok(Arc::new(Optimised::from_scratch(name, *strategy, *budget, limit, seed, splatting)))
            }
            MethodKind::Exec(command) => Ok(Arc::new(Exec::start(ExecSettings {
                command: command.clone(),
                name: name.map(str::to_owned),
                limit: Duration::try_from_secs_f64(self.method_timeout).context("--method-timeout")?,
                processes: self.method_processes.into(),
                opacities_as_stored: self.gaussians.opacities_as_stored,
                splatting: self.gaussians.splatting(device)?,
            })?)),
            MethodKind::NearestView => Ok(Arc::new(NearestView)),
            MethodKind::Warp => Ok(Arc::new(Warp)),
            MethodKind::Renders(folder) => Ok(Arc::new(Renders::new(folder, name)?)),
            MethodKind::Ply(folder) => Ok(Arc::new(self.gaussians.ply(folder, name, device)?)),
        }
    }
}

impl GaussianArgs {
    /// The method of a folder of Gaussians.
    pub(super) fn ply(&self, folder: &Path, name: Option<&str>, device: &ComputeDevice) -> anyhow::Result<Ply> {
        Ok(Ply::new(folder, name, self.ply_frame, self.opacities_as_stored, self.splatting(device)?)?)
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
