//! Statistics of camera motion over clips: simulated ones and those of any dataset.

use std::fmt;

use atsplat_camera::ImageSize;
use atsplat_numeric::quantile;
use atsplat_scene::{SceneSource, WarningKind, Warnings};
use rayon::prelude::*;
use serde::Serialize;

use crate::path::timed_cameras;
use crate::{ClipMotion, EffectChoice, Request, RoomsError, SceneKind, SceneSeed, Simulation, Split};

/// Camera motion of groups of clips. [`Display`](fmt::Display) prints the quantiles as a table.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct MotionReport {
    /// The groups of clips.
    pub groups: Vec<ClipGroup>,
    /// Quantiles of each measure of each group.
    pub quantiles: Vec<MotionQuantiles>,
}

impl MotionReport {
    /// Computes the quantiles of these groups.
    pub fn new(groups: Vec<ClipGroup>) -> Self {
        Self { quantiles: quantiles_of(&groups), groups }
    }
}

/// Clips of one source.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct ClipGroup {
    /// Name of the source.
    pub name: String,
    /// Motion of each clip.
    pub clips: Vec<ClipMotion>,
    /// Number of skipped clips of less than half a second, or of more than a million.
    pub too_short: usize,
    /// Number of clips without timestamps: they have no speeds, and baselines as if they had 30 frames per second.
    pub without_times: usize,
}

/// Quantiles of one measure over the clips of one group.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct MotionQuantiles {
    /// Name and unit of the measure.
    pub measure: &'static str,
    /// Name of the group.
    pub group: String,
    /// Number of clips with this measure.
    pub measured: usize,
    /// The quantiles.
    pub quantiles: [Option<f64>; MOTION_QUANTILES.len()],
}

/// The quantiles of [`MotionQuantiles`].
pub const MOTION_QUANTILES: [f64; 5] = [0.1, 0.25, 0.5, 0.75, 0.9];
/// Name with unit, and value of a clip.
pub type MotionMeasure = (&'static str, fn(&ClipMotion) -> Option<f64>);

/// The measures of a clip.
pub const MOTION_MEASURES: [MotionMeasure; 8] = [
    ("speed, units/s", |clip| clip.speed),
    ("turn rate, °/s", |clip| clip.turn_degrees_per_second),
    ("straightness", |clip| clip.straightness),
    ("travel to axis, °", |clip| clip.travel_to_axis_degrees),
    ("baseline, 45 frames", |clip| clip.baseline_45),
    ("baseline, 90 frames", |clip| clip.baseline_90),
    ("baseline, 135 frames", |clip| clip.baseline_135),
    ("focal length / width", |clip| Some(clip.fx)),
];

/// Image size of RE10K, so that focal lengths relative to the width are comparable.
const SIZE: ImageSize = ImageSize { width: 640, height: 360 };

impl ClipGroup {
    /// The real RE10K clips whose statistics the simulator draws from.
    ///
    /// # Errors
    /// [`RoomsError::Motion`] if the embedded measurements are broken.
    pub fn re10k() -> Result<Self, RoomsError> {
        Ok(Self { name: "RE10K".to_owned(), clips: ClipMotion::real()?, too_short: 0, without_times: 0 })
    }

    /// Trajectories of the first `count` simulated scenes, without rendering. Calls `progress` after each.
    ///
    /// # Errors
    /// [`RoomsError`] if a scene cannot be simulated.
    pub fn simulated(
        kind: SceneKind,
        split: Split,
        count: u32,
        progress: &(dyn Fn() + Sync),
    ) -> Result<Self, RoomsError> {
        let clip = |number| {
            let request = Request::new(kind, SceneSeed { split, number });
            let simulation = Simulation::new(Request { size: SIZE, effects: EffectChoice::None, ..request })?;
            progress();
            Ok(ClipMotion::of_shots(&simulation.key(), simulation.shots()))
        };
        let clips = (0..count).into_par_iter().map(clip).collect::<Result<Vec<_>, RoomsError>>()?;
        Ok(Self::new(format!("simulated {kind}"), clips, 0))
    }

    fn new(name: String, clips: Vec<Option<ClipMotion>>, without_times: usize) -> Self {
        let too_short = clips.iter().filter(|clip| clip.is_none()).count();
        Self { name, clips: clips.into_iter().flatten().collect(), too_short, without_times }
    }

    /// The clips of a dataset; unreadable scenes become warnings. Calls `progress` after each.
    pub fn of_dataset(
        name: String,
        dataset: &(impl SceneSource + ?Sized),
        warnings: &mut Warnings,
        progress: &(dyn Fn() + Sync),
    ) -> Self {
        let times = dataset.times();
        let read = dataset.keys().par_iter().map(|key| {
            let mut warnings = Warnings::new();
            let loaded = dataset.load(key, &mut warnings);
            let clip = loaded.map(|scene| {
                let has_times = scene.has_times(times);
                let motion = ClipMotion::of(&scene.key, timed_cameras(&scene, times));
                (if has_times { motion } else { motion.map(ClipMotion::without_times) }, has_times)
            });
            progress();
            (key, clip, warnings)
        });
        let read: Vec<_> = read.collect();
        let (mut clips, mut without_times) = (Vec::new(), 0);
        for (key, clip, of_scene) in read {
            warnings.merge(of_scene);
            match clip {
                Ok((clip, has_times)) => {
                    clips.push(clip);
                    without_times += usize::from(!has_times);
                }
                Err(error) => warnings.push(WarningKind::UnreadableScene, key.as_str(), error.to_string()),
            }
        }
        Self::new(name, clips, without_times)
    }
}

fn quantiles_of(groups: &[ClipGroup]) -> Vec<MotionQuantiles> {
    let row = |(measure, read): MotionMeasure, group: &ClipGroup| {
        let mut values: Vec<f64> = group.clips.iter().filter_map(read).collect();
        values.sort_by(f64::total_cmp);
        MotionQuantiles {
            measure,
            group: group.name.clone(),
            measured: values.len(),
            quantiles: MOTION_QUANTILES.map(|share| quantile(&values, share)),
        }
    };
    MOTION_MEASURES.iter().flat_map(|measure| groups.iter().map(|group| row(*measure, group))).collect()
}

impl fmt::Display for MotionReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let width = self.groups.iter().map(|group| group.name.chars().count()).fold(5, usize::max);
        write!(f, "{:<21} {:<width$} {:>5}", "", "", "clips")?;
        MOTION_QUANTILES.iter().try_for_each(|share| write!(f, " {:>8}", format!("{:.0} %", share * 100.0)))?;
        writeln!(f)?;
        for MotionQuantiles { measure, group, measured, quantiles } in &self.quantiles {
            write!(f, "{measure:<21} {group:<width$} {measured:>5}")?;
            for value in quantiles {
                write!(f, " {:>8}", value.map_or("-".to_owned(), |value| format!("{value:.3}")))?;
            }
            writeln!(f)?;
        }
        Ok(())
    }
}
