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
    /// What was warned of before the first step, the photos included.
    pub(super) warnings: Vec<String>,
}

impl Args {
    /// Reads the photos and the start, and plans the steps.
    pub(super) fn prepare(&self) -> anyhow::Result<Prepared> {
        let mut warnings = Warnings::new();
        let source = self.start.network()?;
        let device = self.open_device(source.is_some())?;
        let input = self.input.read(source.as_ref(), self.optimisation.background, &mut warnings);
        // They may explain a failure.
        print_warnings(&warnings);
        let input = input?;
        let warnings = warnings.summary().map(|(kind, count, first)| format!("{count} × {kind}: {first}"));
        let mut warnings: Vec<String> = warnings.collect();
        self.check_photos(&input.scene.frames)?;
        // With --refine, the whole run is in the network's world.
        let mut config = self.optimisation.config(input.photos.trial().normalisation().new_from_old.scale);
        let network = match &source {
            Some(source) => Some((source, device.network()?)),
            None => None,
        };
        let (start, name) = self.start.gaussians(&input, &self.input, network, &config, &self.optimisation)?;
        self.check_start(&start.gaussians)?;
        warnings.extend_from_slice(&start.warnings);
        let of_start = warnings_of_start(&start.gaussians, &config);
        for text in &of_start {
            warn(text);
        }
        warnings.extend(of_start);

        let device = device.backend().fit_device();
        let begin = Instant::now();
        let planned = self.optimisation.budget().plan(&config, &input.training, &start.gaussians, &device);
        let (steps, deadline) = planned.map_err(|error| self.optimisation.with_option(error))?;
        let planning_secs = begin.elapsed().as_secs_f64();
        config.steps = steps;
        let fit = self.fit(config, &input, &start.gaussians, device)?;
        let count = start.gaussians.len();
        let planned = if deadline.is_some() { "as planned so far, " } else { "" };
        let of_density = |text: Option<String>| text.map(|text| format!("{planned}{text}"));
        // Those of a file are repaired and warned of when it is read; those of a network come here as they are.
        let of_broken = fit.start_validation().warning("initial Gaussians");
        of_broken.iter().chain(&of_density(fit.density_warning())).for_each(|text| warn(text));
        // That of a resumed run is about the rest of it; its record is that of an uninterrupted one.
        let first = fit.first_density_warning(count - fit.start_validation().rejected);
        warnings.extend(of_broken.into_iter().chain(of_density(first)));

        let start = StartSummary { name, gaussians: count + start.removed, removed: start.removed, warnings };
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

/// Properties of the initial Gaussians that are left out or not optimised.
fn warnings_of_start(start: &Gaussians, config: &FitConfig) -> Vec<String> {
    let (found, kept, strategy) = (start.sh_degree(), config.sh_degree, config.strategy);
    let mut warnings = Vec::new();
    if found > kept {
        warnings.push(format!(
            "the initial Gaussians have spherical harmonics of degree {found}: those above --sh-degree {kept} are dropped"
        ));
    }
    if start.parts().filter_3d.is_some() && strategy != Strategy::MipSplatting {
        let name = strategy.name();
        warnings.push(format!(
            "the initial Gaussians have 3D filters (filter_3D), which the strategy {name} leaves as they are"
        ));
    }
    warnings
}
