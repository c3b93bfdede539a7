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
use atsplat_splat::RasterMode;
use atsplat_splat::effects::{EffectPlan, EffectSelection};

use crate::parse;
use crate::print::warn;
use crate::reconstruct::network::NetworkArgs;
use crate::render::backend::{BackendArg, backend};

/// The methods of one argument.
pub(super) type Methods = Vec<MethodSpec>;

#[derive(Debug, clap::Args)]
pub(super) struct MethodArgs {
    #[command(flatten)]
    network: NetworkArgs,

    /// Maximum number of Gaussians of 3dgs, mip-splatting and mcmc; MCMC grows towards it. By default 100000.
    #[arg(long, value_name = "N")]
    max_gaussians: Option<usize>,

    /// Seconds that a process of exec may take to start, and for each trial; after them it is killed, and a new one is
    /// started. By default 600.
    #[arg(long, value_name = "SECONDS", value_parser = parse::positive)]
    method_timeout: Option<f64>,

    /// Maximum number of processes of each exec. Each answers one trial at a time, and no more trials than --threads
    /// run at once. By default 1.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=256))]
    method_processes: Option<u16>,

    #[command(flatten)]
    gaussians: GaussianArgs,
}

/// Arguments for reading and rendering Gaussians.
#[derive(Debug, clap::Args)]
pub(super) struct GaussianArgs {
    /// Constants and rules of a rasterizer instead of the protocol's: exact, gsplat-1.5, gsplat-1.6, inria,
    /// pixelsplat-family, or a .toml. Their near and far planes are in the unit of the Gaussians: of imported files, that of
    /// --ply-frame.
    #[arg(long, value_name = "PRESET", value_parser = parse::constants_name)]
    constants: Option<String>,

    /// black, white, or R,G,B from 0 to 1, instead of the protocol's.
    #[arg(long, value_name = "COLOUR", value_parser = parse::background)]
    background: Option<[f64; 3]>,

    /// How Gaussians smaller than a pixel are drawn, of imported files and of exec, as in `render`. Protocols state no mode: the
    /// default is classic, with a warning where a file may be meant otherwise.
    #[arg(long, value_name = "MODE", value_parser = parse::named(parse::MODES))]
    mode: Option<RasterMode>,

    /// Which of the requested effects run: auto (the default, only those that can change an image by more than --tolerance),
    /// all, none, or a list of names.
    #[arg(long, value_name = "LIST")]
    effects: Option<EffectSelection>,

    /// Largest change of any colour sample that `--effects auto` may cause, in units of display range; by default a quarter
    /// of a step of 8 bits.
    #[arg(long, value_name = "CHANGE", value_parser = parse::not_negative)]
    tolerance: Option<f64>,

    /// Renderer, also of optimisations, instead of the one of --device. gpu takes the best adapter that passes its test,
    /// otherwise the CPU, and records why.
    #[arg(long, value_name = "NAME")]
    backend: Option<BackendArg>,

    /// Coordinate frame of imported Gaussians: the dataset's (the default), or that of the trial's normalised poses.
    #[arg(long, value_name = "FRAME", value_parser = parse::named(FRAMES))]
    ply_frame: Option<GaussianFrame>,

    /// Read stored opacities of imported PLY files as opacities, not logits, as written by the exporters of pixelSplat and
    /// NoPoSplat.
    #[arg(long)]
    opacities_as_stored: bool,
}

const FRAMES: [(&str, GaussianFrame); 2] = [("dataset", GaussianFrame::Dataset), ("trial", GaussianFrame::Trial)];

impl MethodArgs {
    /// Rejects contradicting arguments before anything is read.
    pub(super) fn check(&self, methods: &[MethodSpec]) -> Result<(), clap::Error> {
        let any = |is: fn(&MethodKind) -> bool| methods.iter().any(|method| is(&method.kind));
        let (networks, renders) = (any(MethodKind::has_network), any(MethodKind::uses_device));
        let imports = any(|kind| matches!(kind, MethodKind::Ply(_)));
        let executes = any(|kind| matches!(kind, MethodKind::Exec(_)));
        let optimises = any(|kind| matches!(kind, MethodKind::Optimised(..)));
        let of = |given: bool, name: &'static str| given.then_some(name);
        let unused = [
            (networks, self.network.given(), "is for methods with a network: atsplat, atsplat+refine"),
            (optimises, of(self.max_gaussians.is_some(), "--max-gaussians"), "is for 3dgs, mip-splatting and mcmc"),
            (
                networks || optimises,
                of(self.network.seed.is_some(), "--seed"),
                "is for methods with a network, 3dgs, mip-splatting and mcmc",
            ),
            (executes, of(self.method_timeout.is_some(), "--method-timeout"), "is for exec"),
            (executes, of(self.method_processes.is_some(), "--method-processes"), "is for exec"),
            (imports, of(self.gaussians.ply_frame.is_some(), "--ply-frame"), "is for ply"),
            (
                imports || executes,
                of(self.gaussians.opacities_as_stored, "--opacities-as-stored"),
                "is for ply and exec",
            ),
            (imports || executes, of(self.gaussians.mode.is_some(), "--mode"), "is for ply and exec"),
            (renders, self.gaussians.given(), "is for methods whose Gaussians are rendered"),
        ];
        if networks && !self.network.has_weights() {
            return Err(parse::usage_error(NetworkArgs::NO_WEIGHTS));
        }
        for (used, given, what) in unused {
            if let Some(name) = given.filter(|_| !used) {
                return Err(parse::usage_error(format!("{name} {what}; no method given here is one")));
            }
        }
        let checked = self.network.check().and_then(|()| self.network.device.check(renders));
        checked.and_then(|()| self.gaussians.check_tolerance()).map_err(parse::usage_error)
    }

    /// Loads the methods.
    pub(super) fn load(&self, methods: &[MethodSpec]) -> anyhow::Result<Vec<Arc<dyn Method>>> {
        let has_network = methods.iter().any(|method| method.kind.has_network());
        let device = self.network.device;
        let device = if has_network { device.open_for_networks()? } else { device.open()? };
        methods.iter().map(|spec| self.method(spec, &device)).collect()
    }

    /// Of methods whose Gaussians are not imported: they are rendered in their own mode.
    fn own_splatting(&self, device: &ComputeDevice) -> anyhow::Result<Splatting> {
        Ok(Splatting { mode: None, ..self.gaussians.splatting(device)? })
    }

    fn method(
        &self,
        MethodSpec { name, kind }: &MethodSpec,
        device: &ComputeDevice,
    ) -> anyhow::Result<Arc<dyn Method>> {
        let name = name.as_deref();
        let seed = self.network.call_seed();
        match kind {
            MethodKind::AtSplat => {
                let source = self.network.source().context("--method atsplat")?;
                let (network, record) = source.load(&device.network()?)?;
                let splatting = self.own_splatting(device)?;
                let method = AtSplat::new(name.unwrap_or("atsplat"), network, &record.weights(), seed, splatting)?;
                Ok(Arc::new(method.with_training(record.training(), record.trained_poses())))
            }
            MethodKind::Refined(budget) => {
                let source = self.network.source().context("--method atsplat+refine")?;
                let (network, record) = source.load(&device.network()?)?;
                let splatting = self.own_splatting(device)?;
                let method = Optimised::refined(name, network, &record.weights(), *budget, seed, splatting)?;
                Ok(Arc::new(method.with_training(record.training(), record.trained_poses())))
            }
            MethodKind::Optimised(strategy, budget) => {
                let limit = self.max_gaussians.unwrap_or(MAX_GAUSSIANS);
                let splatting = self.own_splatting(device)?;
                Ok(Arc::new(Optimised::from_scratch(name, *strategy, *budget, limit, seed, splatting)))
            }
            MethodKind::Exec(command) => Ok(Arc::new(Exec::start(ExecSettings {
                command: command.clone(),
                name: name.map(str::to_owned),
                limit: Duration::try_from_secs_f64(self.method_timeout.unwrap_or(EXEC_SECONDS))
                    .context("--method-timeout")?,
                processes: self.method_processes.unwrap_or(1).into(),
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

/// Seconds of an exec's start, and of each of its trials.
const EXEC_SECONDS: f64 = 600.0;

impl GaussianArgs {
    /// The first argument about rendering Gaussians that is given.
    pub(super) fn given(&self) -> Option<&'static str> {
        parse::first_given([
            ("--constants", self.constants.is_some()),
            ("--background", self.background.is_some()),
            ("--effects", self.effects.is_some()),
            ("--tolerance", self.tolerance.is_some()),
            ("--backend", self.backend.is_some()),
        ])
    }

    /// Rejects a tolerance if the effects that run do not depend on it.
    pub(super) fn check_tolerance(&self) -> Result<(), String> {
        let chosen = self.effects.as_ref().is_some_and(|effects| *effects != EffectSelection::Auto);
        if chosen && self.tolerance.is_some() {
            return Err("--tolerance is for --effects auto: other effects run whatever they change".to_owned());
        }
        Ok(())
    }

    /// Rejects these arguments if there are no Gaussians.
    pub(super) fn check_unused(&self) -> Result<(), String> {
        let of_files = [
            ("--mode", self.mode.is_some()),
            ("--ply-frame", self.ply_frame.is_some()),
            ("--opacities-as-stored", self.opacities_as_stored),
        ];
        let given = self.given().or(parse::first_given(of_files));
        given.map_or(Ok(()), |name| Err(format!("{name} is for --ply: images are compared as they are")))
    }

    /// The method of a folder of Gaussians.
    pub(super) fn ply(&self, folder: &Path, name: Option<&str>, device: &ComputeDevice) -> anyhow::Result<Ply> {
        Ok(Ply::new(
            folder,
            name,
            self.ply_frame.unwrap_or(GaussianFrame::Dataset),
            self.opacities_as_stored,
            self.splatting(device)?,
        )?)
    }

    fn splatting(&self, device: &ComputeDevice) -> anyhow::Result<Splatting> {
        let constants = match &self.constants {
            Some(name) => ConstantsChoice::Fixed(parse::constants(name)?),
            None => ConstantsChoice::FromPreset,
        };
        let (backend, skipped_adapter) = match self.backend {
            None => (device.backend(), None),
            Some(BackendArg::Cpu) => (Backend::default(), None),
            Some(BackendArg::Gpu) if device.is_adapter() => (device.backend(), None),
            Some(other) => {
                let chosen = backend(other, None)?;
                if let Some(note) = &chosen.note {
                    warn(note);
                }
                (Backend::shared(chosen.renderer, chosen.adapter), chosen.note)
            }
        };
        let effects = self.effects.clone().unwrap_or_default();
        let tolerance = self.tolerance.unwrap_or(EffectPlan::TOLERANCE);
        let (background, mode) = (self.background, self.mode);
        Ok(Splatting { constants, background, mode, effects, tolerance, backend, skipped_adapter })
    }
}
