//! A run before its first step: photos, start, and the number of steps.

use std::time::Instant;

use atsplat_eval::ComputeDevice;
use atsplat_fit::{Deadline, Fit, FitConfig, FitDevice, Strategy};
use atsplat_scene::Warnings;
use atsplat_splat::{Gaussians, Validation};

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
        let input = self.input.read(source.as_ref(), self.optimisation.background, &mut warnings)?;
        print_warnings(&warnings);
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
        let of_broken = broken_warning(fit.start_validation());
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

/// What is wrong with initial Gaussians, in the words of the warning of a file's: those of a network come here as they are.
fn broken_warning(found: &Validation) -> Option<String> {
    let Validation { total, invalid, rejected, repaired, findings, .. } = found;
    let kinds: Vec<String> = findings.iter().map(ToString::to_string).collect();
    (!found.is_clean()).then(|| {
        format!(
            "{invalid} of {total} initial Gaussians are broken, of which {rejected} are removed and {repaired} repaired: {}",
            kinds.join("; ")
        )
    })
}

#[cfg(test)]
mod tests {
    use atsplat_splat::{Cleaning, GaussianParts};

    use super::*;

    #[test]
    fn broken_initial_gaussians_are_counted_by_what_became_of_them() {
        let mut parts = GaussianParts {
            means: vec![[0.0; 3]; 4],
            quaternions: vec![[1.0, 0.0, 0.0, 0.0]; 4],
            log_scales: vec![[-1.0; 3]; 4],
            opacity_logits: vec![0.5; 4],
            sh: vec![[0.25; 3]; 4],
            ..GaussianParts::default()
        };
        let warning = |parts: &GaussianParts| {
            broken_warning(&Gaussians::new(parts.clone()).unwrap().into_cleaned(Cleaning::Repair).1)
        };
        assert_eq!(warning(&parts), None);
        (parts.means[1][0], parts.opacity_logits[2], parts.opacity_logits[3]) = (f32::NAN, 99.0, -99.0);
        let expected = "3 of 4 initial Gaussians are broken, of which 1 are removed and 2 repaired: means not a number in 1, first \
                        1; opacity logits out of range in 2, first 2";
        assert_eq!(warning(&parts).as_deref(), Some(expected));
    }
}
