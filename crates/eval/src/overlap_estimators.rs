//! Accuracy of overlap estimators against true co-visibility, on simulated scenes.

use std::fmt;

use atsplat_camera::{Camera, ImageSize};
use atsplat_numeric::{SplitMix64, mean, rank_correlation};
use atsplat_pixels::{ImageU8, PixelError, Rounding};
use atsplat_protocol::overlap::{DepthMap, OverlapEstimator, OverlapView};
use atsplat_protocol::{BinRule, OverlapBins, ProtocolError};
use atsplat_rooms::{Geometry, Request, RoomsError, SceneKind, SceneSeed, Simulation, Split};
use serde::Serialize;

/// The kinds are evaluated separately: results for indoor scenes may not be true outdoors.
pub const KINDS: [SceneKind; 2] = SceneKind::ALL;
/// Minimum distance of the two frames: neighbouring frames show nearly the same.
const MIN_GAP: usize = 5;

/// Scenes and pairs of views to measure on.
#[derive(Clone, Copy, Debug)]
pub struct EstimatorStudy {
    /// Number of scenes of each kind.
    pub scenes: u32,
    /// Number of pairs per scene.
    pub pairs: u32,
    /// Image size in pixels.
    pub size: ImageSize,
    /// Seed of the choice of pairs.
    pub seed: u64,
}

/// Why estimators cannot be measured.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EstimatorError {
    /// A scene cannot be simulated.
    #[error(transparent)]
    Rooms(#[from] RoomsError),
    /// A simulated image cannot be encoded.
    #[error(transparent)]
    Pixels(#[from] PixelError),
    /// A simulated depth map is broken.
    #[error("a simulated depth map: {0}")]
    Depth(#[from] ProtocolError),
}

/// Estimates of overlap against the truth. [`Display`](fmt::Display) prints the accuracy of each estimator.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct EstimatorReport {
    /// Number of simulated scenes.
    pub scenes: usize,
    /// Image size in pixels.
    pub size: ImageSize,
    /// Every pair of views.
    pub pairs: Vec<EstimatedPair>,
    /// Accuracy of each estimator on each kind of scenes.
    pub estimators: Vec<EstimatorAccuracy>,
}

/// Two views, their true overlap, and the estimates.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct EstimatedPair {
    /// Kind of the scene.
    pub kind: SceneKind,
    /// Key of the scene.
    pub scene: String,
    /// Positions of the two frames.
    pub frames: [usize; 2],
    /// True overlap, in \[0, 1\].
    pub truth: f64,
    /// In the order of the report's estimators; `null` if an estimator fails.
    pub estimates: Vec<Option<f64>>,
}

/// Accuracy of one estimator on one kind of scenes.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct EstimatorAccuracy {
    /// Kind of scenes.
    pub kind: SceneKind,
    /// Name of the estimator.
    pub estimator: &'static str,
    /// Number of pairs with an estimate.
    pub measured: usize,
    /// Spearman's correlation of estimates and truth.
    pub rank_correlation: Option<f64>,
    /// Mean of estimate minus truth.
    pub bias: Option<f64>,
    /// Mean of the absolute difference.
    pub error: Option<f64>,
    /// Share of pairs whose estimate is in the same bin of `NoPoSplat` as the truth.
    pub same_bin: Option<f64>,
}

impl EstimatorStudy {
    /// Measures these estimators. Calls `progress` after each scene.
    ///
    /// # Errors
    /// [`EstimatorError`] if a scene cannot be simulated.
    pub fn run(&self, estimators: &[OverlapEstimator], progress: &dyn Fn()) -> Result<EstimatorReport, EstimatorError> {
        let mut pairs = Vec::new();
        for kind in KINDS {
            for number in 0..self.scenes {
                let seed = SceneSeed { split: Split::Test, number };
                let simulation = Simulation::new(Request { size: self.size, ..Request::new(kind, seed) })?;
                for frames in self.draw_pairs(&simulation) {
                    pairs.push(measure(&simulation, frames, estimators)?);
                }
                progress();
            }
        }
        let mut rows = Vec::new();
        for kind in KINDS {
            let of_kind: Vec<&EstimatedPair> = pairs.iter().filter(|pair| pair.kind == kind).collect();
            let estimators = estimators.iter().enumerate();
            rows.extend(estimators.map(|(index, estimator)| accuracy(kind, estimator.name(), index, &of_kind)));
        }
        let scenes = KINDS.len() * self.scenes as usize;
        Ok(EstimatorReport { scenes, size: self.size, pairs, estimators: rows })
    }

    /// Draws pairs of frames with uniformly distributed gaps.
    fn draw_pairs(&self, simulation: &Simulation) -> Vec<[usize; 2]> {
        let last = simulation.shots().len() - 1;
        let mut random = SplitMix64::for_scene(self.seed, &simulation.key());
        let mut pair = || {
            let gap = random.within(MIN_GAP..=last)?;
            let first = random.within(0..=last - gap)?;
            Some([first, first + gap])
        };
        (0..self.pairs).filter_map(|_| pair()).collect()
    }
}

fn measure(
    simulation: &Simulation,
    frames: [usize; 2],
    estimators: &[OverlapEstimator],
) -> Result<EstimatedPair, EstimatorError> {
    let [first, second] = frames;
    let truth = simulation.covisibility(first, second)?.overlap();
    let needs_images = estimators.iter().any(OverlapEstimator::needs_images);
    let (a, b) =
        (SimulatedView::of(simulation, first, needs_images)?, SimulatedView::of(simulation, second, needs_images)?);
    let (view_a, view_b) = (a.view()?, b.view()?);
    // A failed estimate, for example of two images without common features, is a result.
    let estimates = estimators.iter().map(|estimator| estimator.estimate(&view_a, &view_b).ok()).collect();
    Ok(EstimatedPair { kind: simulation.request().kind, scene: simulation.key(), frames, truth, estimates })
}

/// A view with all inputs of an estimator.
struct SimulatedView {
    camera: Camera,
    geometry: Geometry,
    image: Option<ImageU8>,
}

impl SimulatedView {
    fn of(simulation: &Simulation, frame: usize, with_image: bool) -> Result<Self, EstimatorError> {
        let image = || Ok::<_, EstimatorError>(simulation.image(frame)?.to_u8(Rounding::Nearest)?);
        Ok(Self {
            camera: simulation.camera(frame)?,
            geometry: simulation.geometry(frame)?,
            image: with_image.then(image).transpose()?,
        })
    }

    fn view(&self) -> Result<OverlapView<'_>, EstimatorError> {
        let depth = DepthMap::new(self.geometry.size, &self.geometry.depth)?;
        Ok(OverlapView { camera: &self.camera, image: self.image.as_ref(), depth: Some(depth) })
    }
}

fn accuracy(kind: SceneKind, estimator: &'static str, index: usize, pairs: &[&EstimatedPair]) -> EstimatorAccuracy {
    let both = |pair: &&EstimatedPair| Some((pair.truth, pair.estimates.get(index).copied().flatten()?));
    let (truths, estimates): (Vec<f64>, Vec<f64>) = pairs.iter().filter_map(both).unzip();
    let mean_of = |value: &dyn Fn(f64, f64) -> f64| {
        mean(truths.iter().zip(&estimates).map(|(truth, estimate)| value(*truth, *estimate)))
    };
    let bins = OverlapBins::noposplat(BinRule::Strict);
    EstimatorAccuracy {
        kind,
        estimator,
        measured: truths.len(),
        rank_correlation: rank_correlation(&truths, &estimates),
        bias: mean_of(&|truth, estimate| estimate - truth),
        error: mean_of(&|truth, estimate| (estimate - truth).abs()),
        same_bin: mean_of(&|truth, estimate| f64::from(bins.place(truth) == bins.place(estimate))),
    }
}

impl fmt::Display for EstimatorReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{} pairs of views of {} simulated scenes, {}", self.pairs.len(), self.scenes, self.size)?;
        let [kind, estimator, measured, rank, bias, error, same] =
            ["scenes", "estimator", "measured", "rank corr.", "bias", "error", "same bin"];
        writeln!(f, "{kind:<7} {estimator:<22} {measured:>8} {rank:>10} {bias:>7} {error:>7} {same:>8}")?;
        let number = |value: Option<f64>| value.map_or("-".to_owned(), |value| format!("{value:.3}"));
        for row in &self.estimators {
            let share = row.same_bin.map_or("-".to_owned(), |share| format!("{:.0} %", share * 100.0));
            writeln!(
                f,
                "{:<7} {:<22} {:>8} {:>10} {:>7} {:>7} {:>8}",
                row.kind.to_string(),
                row.estimator,
                row.measured,
                number(row.rank_correlation),
                number(row.bias),
                number(row.error),
                share
            )?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use atsplat_numeric::Tolerance;

    use super::*;

    #[test]
    fn accuracy_is_over_the_pairs_with_an_estimate() {
        let pair = |truth, estimate: Option<f64>| EstimatedPair {
            kind: SceneKind::Rooms,
            scene: "s".to_owned(),
            frames: [0, 1],
            truth,
            estimates: vec![None, estimate],
        };
        let pairs = [pair(0.5, Some(0.7)), pair(0.2, Some(0.1)), pair(0.9, None)];
        let pairs: Vec<&EstimatedPair> = pairs.iter().collect();
        let found = accuracy(SceneKind::Rooms, "epipolar-ray", 1, &pairs);
        assert_eq!(found.measured, 2);
        let numbers = [found.bias, found.error, found.same_bin, found.rank_correlation].map(Option::unwrap);
        // 0.5 is in the middle bin and 0.7 in the upper one, 0.2 and 0.1 in the lower one.
        Tolerance::F64.assert(numbers, [0.05, 0.15, 0.5, 1.0], "bias, error, same bin, rank correlation");
        let none = accuracy(SceneKind::Rooms, "epipolar-ray", 0, &pairs);
        assert_eq!((none.measured, none.bias, none.error, none.same_bin), (0, None, None, None));
    }
}
