//! Arguments that select methods.

use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context as _;
use atsplat_eval::method::{
    AtSplat, ConstantsChoice, Exec, ExecSettings, MAX_GAUSSIANS, Method, MethodKind, MethodSpec, NearestView,
    Optimised, Ply, Renders, Splatting, Warp,
};
use atsplat_eval::{ComputeDevice, GaussianFrame};
use atsplat_splat::RasterMode;
use atsplat_splat::effects::{EffectPlan, EffectSelection};
use clap::builder::RangedU64ValueParser;

use crate::parse;
use crate::progress::waiting_for;
use crate::reconstruct::network::NetworkArgs;
use crate::requirements::{GivenOption, Requirement, check_all};

/// The methods of one argument.
pub(super) type Methods = Vec<MethodSpec>;

#[derive(Debug, clap::Args)]
pub(super) struct MethodArgs {
    #[command(flatten)]
    network: NetworkArgs,

    /// Maximum number of Gaussians of 3dgs, mip-splatting and mcmc; MCMC grows towards it. By default 100000.
    #[arg(long, value_name = "N", value_parser = RangedU64ValueParser::<usize>::new().range(4..))]
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
    /// Constants and rules of a rasterizer instead of the protocol's, by name or in a .toml. Their near and far planes are in the unit
    /// of the Gaussians: of imported files, that of --ply-frame.
    #[arg(long, value_name = "PRESET", value_parser = parse::ConstantsName)]
    constants: Option<String>,

    /// black, white, or R,G,B from 0 to 1, instead of the protocol's.
    #[arg(long, value_name = "COLOUR", value_parser = parse::background)]
    background: Option<[f64; 3]>,

    /// How Gaussians smaller than a pixel are rendered, of imported files and of exec, as in `render`. Protocols state no mode: the
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

    /// Coordinate frame of imported Gaussians: the dataset's (the default), or that of the trial's normalised poses.
    #[arg(long, value_name = "FRAME", value_parser = parse::named(parse::GAUSSIAN_FRAMES))]
    ply_frame: Option<GaussianFrame>,

    /// Published method whose pose normalisation, planes and renderer imported Gaussians have, as the protocol lists them: DepthSplat,
    /// iLRM and others of `protocol show`; by default ATSplat's.
    #[arg(long, value_name = "NAME")]
    setting: Option<String>,

    /// Read stored opacities of imported PLY files as opacities, not logits, as written by the exporters of pixelSplat and
    /// NoPoSplat. Files of pixelSplat's and DepthSplat's exporters are also rotated and scaled, and have no harmonics.
    #[arg(long)]
    opacities_as_stored: bool,
}

impl MethodArgs {
    /// Rejects contradicting arguments before anything is read.
    pub(super) fn check(&self, methods: &[MethodSpec]) -> Result<(), clap::Error> {
        let any = |is: fn(&MethodKind) -> bool| methods.iter().any(|method| is(&method.kind));
        let (networks, renders) = (any(MethodKind::has_network), any(MethodKind::uses_device));
        let imports = any(|kind| matches!(kind, MethodKind::Ply(_)));
        let executes = any(|kind| matches!(kind, MethodKind::Exec(_)));
        let optimises = any(|kind| matches!(kind, MethodKind::Optimised(..)));
        if networks && !self.network.has_weights() {
            return Err(parse::usage_error(NetworkArgs::NO_WEIGHTS));
        }
        let requirements = check_all(&[
            Requirement {
                options: &self.network.options(),
                requires: "one of the methods atsplat, atsplat+refine",
                satisfied: networks,
            },
            Requirement {
                options: &[("--max-gaussians", self.max_gaussians.is_some())],
                requires: "one of the methods 3dgs, mip-splatting, mcmc",
                satisfied: optimises,
            },
            Requirement {
                options: &[("--seed", self.network.seed.is_some())],
                requires: "one of the methods atsplat, atsplat+refine, 3dgs, mip-splatting, mcmc",
                satisfied: networks || optimises,
            },
            Requirement {
                options: &[
                    ("--method-timeout", self.method_timeout.is_some()),
                    ("--method-processes", self.method_processes.is_some()),
                ],
                requires: "the method exec",
                satisfied: executes,
            },
            Requirement {
                options: &self.gaussians.options_of_imports(),
                requires: "the method ply",
                satisfied: imports,
            },
            Requirement {
                options: &self.gaussians.options_of_files(),
                requires: "one of the methods ply, exec",
                satisfied: imports || executes,
            },
            Requirement {
                options: &self.gaussians.options_of_renders(),
                requires: "a method whose Gaussians are rendered",
                satisfied: renders,
            },
            Requirement {
                options: &[self.network.device.option()],
                requires: "a method with a network or Gaussians (images are compared on the CPU)",
                satisfied: renders,
            },
        ]);
        let checked = requirements.and_then(|()| self.network.check());
        checked.and_then(|()| self.gaussians.check_tolerance()).map_err(parse::usage_error)
    }

    /// Loads the methods. Rejects options about Gaussians if only processes could have read them, and these give images.
    pub(super) fn load(&self, methods: &[MethodSpec]) -> anyhow::Result<Vec<Arc<dyn Method>>> {
        let has_network = methods.iter().any(|method| method.kind.has_network());
        let device = self.network.device;
        let device = if has_network { device.open_for_networks()? } else { device.open()? };
        let loaded = methods.iter().map(|spec| self.method(spec, &device)).collect::<anyhow::Result<Vec<_>>>()?;
        self.check_rendered(methods, &loaded)?;
        Ok(loaded)
    }

    /// As [`Self::check`], now that processes have said what they give.
    fn check_rendered(&self, methods: &[MethodSpec], loaded: &[Arc<dyn Method>]) -> Result<(), clap::Error> {
        // Exactly the methods whose Gaussians are rendered record constants.
        let rendered = methods.iter().zip(loaded).filter(|(_, method)| method.record().constants.is_some());
        let rendered: Vec<&MethodKind> = rendered.map(|(spec, _)| &spec.kind).collect();
        let requires = "a method that gives Gaussians (the processes of exec give images)";
        let are_given = rendered.iter().any(|kind| matches!(kind, MethodKind::Ply(_) | MethodKind::Exec(_)));
        let (of_files, of_renders) = (self.gaussians.options_of_files(), self.gaussians.options_of_renders());
        let checked = check_all(&[
            Requirement { options: &of_files, requires, satisfied: are_given },
            Requirement { options: &of_renders, requires, satisfied: !rendered.is_empty() },
            Requirement { options: &[self.network.device.option()], requires, satisfied: !rendered.is_empty() },
        ]);
        checked.map_err(parse::usage_error)
    }

    /// For methods whose Gaussians are not imported, and which set the mode themselves.
    fn splatting_without_mode(&self, device: &ComputeDevice) -> anyhow::Result<Splatting> {
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
                let splatting = self.splatting_without_mode(device)?;
                let method = AtSplat::new(name.unwrap_or("atsplat"), network, &record.weights(), seed, splatting)?;
                let method = method.with_training(record.training(), record.trained_under());
                Ok(Arc::new(method.with_high_resolution(source.high_resolution().cloned())?))
            }
            MethodKind::Refined(budget) => {
                let source = self.network.source().context("--method atsplat+refine")?;
                let (network, record) = source.load(&device.network()?)?;
                let splatting = self.splatting_without_mode(device)?;
                let method = Optimised::refined(name, network, &record.weights(), *budget, seed, splatting)?;
                let method = method.with_training(record.training(), record.trained_under());
                Ok(Arc::new(method.with_high_resolution(source.high_resolution().cloned())?))
            }
            MethodKind::Optimised(strategy, budget) => {
                let limit = self.max_gaussians.unwrap_or(MAX_GAUSSIANS);
                let splatting = self.splatting_without_mode(device)?;
                Ok(Arc::new(Optimised::from_scratch(name, *strategy, *budget, limit, seed, splatting)))
            }
            MethodKind::Exec(command) => Ok(Arc::new(self.started(command, name, device)?)),
            MethodKind::NearestView => Ok(Arc::new(NearestView)),
            MethodKind::Warp => Ok(Arc::new(Warp)),
            MethodKind::Renders(folder) => Ok(Arc::new(Renders::new(folder, name)?)),
            MethodKind::Ply(folder) => Ok(Arc::new(self.gaussians.ply(folder, name, device)?)),
        }
    }

    /// Starts the first process of an exec, which may load a network first.
    fn started(&self, command: &str, name: Option<&str>, device: &ComputeDevice) -> anyhow::Result<Exec> {
        let secs = self.method_timeout.unwrap_or(EXEC_SECONDS);
        let settings = ExecSettings {
            command: command.to_owned(),
            name: name.map(str::to_owned),
            limit: Duration::try_from_secs_f64(secs).context("--method-timeout")?,
            processes: self.method_processes.unwrap_or(1).into(),
            opacities_as_stored: self.gaussians.opacities_as_stored,
            splatting: self.gaussians.splatting(device)?,
        };
        let start = format!("{} to start, at most {secs} s", name.unwrap_or(command));
        Ok(waiting_for(&start, || Exec::start(settings))?)
    }
}

/// Seconds of an exec's start, and of each of its trials.
const EXEC_SECONDS: f64 = 600.0;

impl GaussianArgs {
    /// Options about rendering Gaussians.
    fn options_of_renders(&self) -> [GivenOption; 4] {
        [
            ("--constants", self.constants.is_some()),
            ("--background", self.background.is_some()),
            ("--effects", self.effects.is_some()),
            ("--tolerance", self.tolerance.is_some()),
        ]
    }

    /// Options about files of Gaussians, those of exec included.
    fn options_of_files(&self) -> [GivenOption; 2] {
        [("--opacities-as-stored", self.opacities_as_stored), ("--mode", self.mode.is_some())]
    }

    /// Options about folders of Gaussians alone.
    fn options_of_imports(&self) -> [GivenOption; 2] {
        [("--ply-frame", self.ply_frame.is_some()), ("--setting", self.setting.is_some())]
    }

    /// All options, of which images alone need none.
    pub(super) fn options(&self) -> Vec<GivenOption> {
        [&self.options_of_renders()[..], &self.options_of_files(), &self.options_of_imports()].concat()
    }

    /// Rejects a tolerance if the effects that run do not depend on it.
    pub(super) fn check_tolerance(&self) -> Result<(), String> {
        let effects = self.effects.clone().unwrap_or_default();
        check_all(&[Requirement {
            options: &[("--tolerance", self.tolerance.is_some())],
            requires: &format!("--effects auto (found --effects {effects})"),
            satisfied: effects == EffectSelection::Auto,
        }])
    }

    /// The method of a folder of Gaussians.
    pub(super) fn ply(&self, folder: &Path, name: Option<&str>, device: &ComputeDevice) -> anyhow::Result<Ply> {
        let (frame, splatting) = (self.ply_frame.unwrap_or_default(), self.splatting(device)?);
        let ply = Ply::new(folder, name, frame, self.opacities_as_stored, splatting)?;
        Ok(ply.with_setting(self.setting.as_deref()))
    }

    fn splatting(&self, device: &ComputeDevice) -> anyhow::Result<Splatting> {
        let constants = match &self.constants {
            Some(name) => ConstantsChoice::Fixed(parse::constants(name)?),
            None => ConstantsChoice::FromPreset,
        };
        let effects = self.effects.clone().unwrap_or_default();
        let tolerance = self.tolerance.unwrap_or(EffectPlan::TOLERANCE);
        let (background, mode, backend) = (self.background, self.mode, device.backend());
        Ok(Splatting { constants, background, mode, effects, tolerance, backend })
    }
}
