//! The Gaussians to start from.

use std::path::{Path, PathBuf};

use anyhow::Context as _;
use atsplat_eval::fitting::{PointsOf, Start, StartError, StartGaussians};
use atsplat_eval::reconstruct::{NetworkSource, WeightsRecord};
use atsplat_fit::{FitConfig, FitError};
use atsplat_model::network::Device;
use atsplat_model::weights::ModelWeights;

use super::OptimisationArgs;
use super::input::{Input, InputArgs};
use crate::embedded;
use crate::parse;
use crate::print::warn;
use crate::requirements::{Requirement, check_all};

#[derive(Debug, clap::Args)]
pub(super) struct StartArgs {
    /// Gaussians to start from: random:N (points seen by the cameras), points (COLMAP's, of the model in DATA), a folder with
    /// a points3D file, or a file of Gaussians (.ply, .spz, .splat).
    #[arg(long, value_name = "START", default_value = "random:10000", conflicts_with = "refine")]
    start: String,

    /// Nearest and farthest depth of random points, in scene units; by default around the point that the cameras look at.
    #[arg(long, value_name = "NEAR,FAR", conflicts_with = "refine", value_parser = depths)]
    depths: Option<[f64; 2]>,

    /// Read opacities of the PLY file to start from as opacities, not logits, as written by the exporters of pixelSplat and
    /// NoPoSplat. Files of pixelSplat's and DepthSplat's exporters are also rotated and scaled, and have no harmonics.
    #[arg(long, conflicts_with = "refine")]
    opacities_as_stored: bool,

    /// Start from what this network makes of the photos: a weights file, or micro-rooms or micro-yards, which are embedded in
    /// the binary. The strategy is then by default `fixed`.
    #[arg(long, value_name = "WEIGHTS")]
    pub(super) refine: Option<PathBuf>,
}

fn depths(text: &str) -> Result<[f64; 2], String> {
    let numbers = text.split_once(',').map(|(near, far)| (parse::positive(near), parse::positive(far)));
    match numbers {
        Some((Ok(near), Ok(far))) if near <= far => Ok([near, far]),
        _ => Err(format!("expected two positive lengths, the nearer first, such as 0.5,20, found {text:?}")),
    }
}

impl StartArgs {
    /// Rejects an invalid --start, and options that do not fit it.
    pub(super) fn check(&self) -> Result<(), clap::Error> {
        let start = self.start.parse::<Start>();
        let start = start.map_err(|error| parse::usage_error(format!("--start: {error}; N is at least 1")))?;
        let is_random = matches!(start, Start::Random(_));
        let is_file = matches!(&start, Start::At(path) if !path.is_dir());
        let checked = check_all(&[
            Requirement {
                options: &[("--depths", self.depths.is_some())],
                requires: &format!("--start random:N (found --start {})", self.start),
                satisfied: is_random,
            },
            Requirement {
                options: &[("--opacities-as-stored", self.opacities_as_stored)],
                requires: &format!("--start with a file of Gaussians (found --start {})", self.start),
                satisfied: is_file,
            },
        ]);
        checked.map_err(parse::usage_error)
    }

    /// What is read unless a network makes the start: a file or a folder, if there is one of this name.
    pub(super) fn path(&self) -> Option<&Path> {
        self.refine.is_none().then(|| Path::new(&self.start))
    }

    /// Whether the start are the points of DATA.
    pub(super) fn is_points(&self) -> bool {
        self.refine.is_none() && matches!(self.start.parse::<Start>(), Ok(Start::Points))
    }

    /// For the record, with the weights of a refinement: another file may have had their path before.
    fn name(&self, weights: Option<&WeightsRecord>) -> String {
        if let Some(path) = &self.refine {
            let hash = match weights {
                Some(WeightsRecord::File { sha256, .. }) => format!(", sha256 {sha256}"),
                Some(WeightsRecord::Untrained { .. }) | None => String::new(),
            };
            return format!("network {}{hash}", path.display());
        }
        let depths = self.depths.map_or_else(String::new, |[near, far]| format!(", depths {near},{far}"));
        let stored = if self.opacities_as_stored { ", opacities as stored" } else { "" };
        [self.start.as_str(), &depths, stored].concat()
    }

    /// The network of a refinement.
    pub(super) fn network(&self) -> anyhow::Result<Option<NetworkSource>> {
        let Some(path) = &self.refine else { return Ok(None) };
        let expected = || "a weights file of this toolkit, micro-rooms or micro-yards".to_owned();
        let file = embedded::find(path, expected)?;
        let config = ModelWeights::config_of(&file.stored).map_err(|error| error.in_file(path))?;
        Ok(Some(NetworkSource::from_file(config.clone(), path.clone(), file, config)))
    }

    /// The Gaussians to start from, in the frame of the views, and their name for the record. Warns of what is wrong with their
    /// file. `options` are those of the configuration.
    pub(super) fn gaussians(
        &self,
        input: &Input,
        args: &InputArgs,
        network: Option<(&NetworkSource, Device)>,
        config: &FitConfig,
        options: &OptimisationArgs,
    ) -> anyhow::Result<(StartGaussians, String)> {
        if let Some((source, device)) = network {
            let (network, weights) = source.load(&device)?;
            let made = network.reconstruct(&input.photos.views()?, config.seed).context("--refine")?;
            return Ok((made.gaussians.into(), self.name(Some(&weights))));
        }
        let start = self.start.parse::<Start>().context("--start")?;
        let applied = if start.reads_points() { args.applied_transform(&input.scene.key) } else { Ok(None) };
        let applied = applied.with_context(|| format!("--start {}", self.start))?;
        let of = PointsOf { data: &args.data, scene: &input.scene, applied };
        let made = start.gaussians(&input.training, of, self.depths, self.opacities_as_stored, config);
        let mut made = made.map_err(|error| match error {
            StartError::Fit(error @ FitError::Setting { name: "depths", .. }) => {
                anyhow::Error::from(error).context(format!("--start {} requires --depths NEAR,FAR", self.start))
            }
            StartError::Fit(error) => options.with_option(error),
            unread => anyhow::Error::from(unread).context(format!("--start {}", self.start)),
        })?;
        for warning in &mut made.warnings {
            *warning = format!("--start {}: {warning}", self.start);
            warn(warning);
        }
        Ok((made, self.name(None)))
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;

    #[test]
    fn a_start_is_recorded_with_all_that_decides_it() {
        let start = |depths: Option<[f64; 2]>, opacities_as_stored: bool, refine: Option<&str>| {
            let (start, refine) = ("start".to_owned(), refine.map(PathBuf::from));
            StartArgs { start, depths, opacities_as_stored, refine }
        };
        assert_eq!(start(None, false, None).name(None), "start");
        assert_eq!(start(Some([0.5, 20.0]), false, None).name(None), "start, depths 0.5,20");
        assert_eq!(start(None, true, None).name(None), "start, opacities as stored");
        let refined = start(None, false, Some("weights"));
        for sha256 in ["ab", "cd"] {
            let (file, hash, provenance) = (PathBuf::from("weights"), sha256.to_owned(), BTreeMap::new());
            let weights = WeightsRecord::File { file, sha256: hash, provenance };
            assert_eq!(refined.name(Some(&weights)), format!("network weights, sha256 {sha256}"));
        }
    }
}
