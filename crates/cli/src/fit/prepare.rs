//! A run before its first step: photos, start, and the number of steps.

use std::time::Instant;

use atsplat_eval::ComputeDevice;
use atsplat_fit::{Deadline, Fit, FitConfig, FitDevice, Strategy};
use atsplat_scene::Warnings;
use atsplat_splat::Gaussians;

use super::Args;
use super::input::Input;
use crate::print::warn;
use crate::warnings::print_warnings;

pub(super) struct Prepared {
    pub(super) input: Input,
    pub(super) start: StartSummary,
    pub(super) fit: Fit,
    pub(super) deadline: Option<Deadline>,
    /// Seconds that planning took, which counts as optimisation.
    pub(super) planning_secs: f64,
}

/// The start, for the record.
pub(super) struct StartSummary {
    pub(super) name: String,
    /// Number of Gaussians, with those that were removed.
    pub(super) gaussians: usize,
    /// Gaussians that were removed when their file was read.
    pub(super) removed: usize,
}

impl Args {
    /// Reads the photos and the start, and plans the steps.
    pub(super) fn prepare(&self) -> anyhow::Result<Prepared> {
        let mut warnings = Warnings::new();
        let source = self.start.network()?;
        let device = self.open_device(source.is_some())?;
        let input = self.input.read(source.as_ref(), &mut warnings)?;
        print_warnings(&warnings);
        self.check_photos(&input.scene.frames)?;
        // With --refine, the whole run is in the network's world.
        let mut config = self.optimisation.config(input.photos.trial().normalisation().new_from_old.scale);
        let network = match &source {
            Some(source) => Some((source, device.network()?)),
            None => None,
        };
        let (start, name) = self.start.gaussians(&input, &self.input, network, &config, &self.optimisation)?;
        warn_of_start(&start.gaussians, &config);

        let device = device.backend().fit_device();
        let begin = Instant::now();
        let planned = self.optimisation.budget().plan(&config, &input.training, &start.gaussians, &device);
        let (steps, deadline) = planned.map_err(|error| self.optimisation.with_option(error))?;
        let planning_secs = begin.elapsed().as_secs_f64();
        config.steps = steps;
        let fit = self.fit(config, &input, &start.gaussians, device)?;
        warn_of_fit(&fit, start.gaussians.len(), deadline.is_some());

        let gaussians = start.gaussians.len() + start.removed;
        let start = StartSummary { name, gaussians, removed: start.removed };
        Ok(Prepared { input, start, fit, deadline, planning_secs })
    }

    /// Opens the device, on which --refine runs a network too.
    fn open_device(&self, runs_network: bool) -> anyhow::Result<ComputeDevice> {
        if runs_network {
            self.device.check_networks()?;
        }
        self.device.open_within(self.optimisation.memory_limit())
    }

    /// The run: that of the checkpoint, or a new one.
    fn fit(&self, config: FitConfig, input: &Input, start: &Gaussians, device: FitDevice) -> anyhow::Result<Fit> {
        let views = input.training.clone();
        let fit = match self.checkpoint.as_deref().filter(|path| self.resume && path.is_file()) {
            Some(path) => Fit::resume(config, views, &input.held_out, start, device, path),
            None => Fit::new(config, views, start).map(|fit| fit.on(device)),
        };
        fit.map_err(|error| self.optimisation.with_option(error))
    }
}

/// Warns of properties of the initial Gaussians that are dropped or not optimised.
fn warn_of_start(start: &Gaussians, config: &FitConfig) {
    let (found, kept, strategy) = (start.sh_degree(), config.sh_degree, config.strategy);
    if found > kept {
        warn(&format!(
            "the initial Gaussians have spherical harmonics of degree {found}: those above --sh-degree {kept} are dropped"
        ));
    }
    if start.parts().filter_3d.is_some() && strategy != Strategy::MipSplatting {
        let name = strategy.name();
        warn(&format!(
            "the initial Gaussians have 3D filters (filter_3D), which the strategy {name} leaves as they are"
        ));
    }
}

/// Warns of invalid initial Gaussians, of which there are `count`, and of a run that is too short for density control.
fn warn_of_fit(fit: &Fit, count: usize, is_timed: bool) {
    if fit.dropped() > 0 {
        warn(&format!("{} of {count} initial Gaussians are invalid and were dropped", fit.dropped()));
    }
    if let Some(text) = fit.density_warning() {
        warn(&format!("{}{text}", if is_timed { "as planned so far, " } else { "" }));
    }
}
