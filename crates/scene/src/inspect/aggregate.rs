use std::collections::BTreeMap;

use atsplat_camera::ImageSize;
use atsplat_numeric::median;

use super::measure::{FrameMeasure, SceneMeasure};
use super::report::{
    Baselines, ImageCounts, Inspection, Intrinsics, LensCounts, Problem, SceneCounts, SceneSummary, SizeCount, Summary,
};
use crate::{Format, Warnings};

/// Examples listed for each kind of problem.
const EXAMPLES: usize = 3;

/// The measurements of all scenes: counts are summed, numbers collected in columns.
#[derive(Default)]
pub(super) struct Aggregate {
    /// [`Inspection::repeated_numbers`].
    pub(super) repeated_numbers: u64,
    scenes_in_one_place: u64,
    scenes: Vec<SceneSummary>,
    images: ImageCounts,
    lenses: LensCounts,
    sizes: BTreeMap<ImageSize, u64>,
    stated_sizes: BTreeMap<ImageSize, u64>,
    pinhole: [Vec<f64>; FrameMeasure::PINHOLE],
    motion: [Vec<f64>; FrameMeasure::MOTION],
}

impl Aggregate {
    pub(super) fn push(&mut self, measure: SceneMeasure) {
        let pinhole = measure.frames.iter().map(|frame| frame.pinhole);
        let motion: Vec<_> = measure.frames.iter().filter_map(|frame| frame.motion).collect();
        for row in pinhole {
            self.pinhole.iter_mut().zip(row).for_each(|(column, value)| column.push(value));
        }
        for row in &motion {
            self.motion.iter_mut().zip(row).for_each(|(column, value)| column.push(*value));
        }
        let of_scene = |read: fn(&[f64; FrameMeasure::MOTION]) -> f64| {
            median(motion.iter().map(read).filter(|value| value.is_finite()))
        };
        self.scenes_in_one_place += u64::from(measure.is_in_one_place);
        self.images = self.images.plus(measure.images);
        self.lenses = self.lenses.plus(measure.lenses);
        add(&mut self.sizes, &measure.sizes);
        add(&mut self.stated_sizes, &measure.stated_sizes);
        self.scenes.push(SceneSummary {
            key: measure.key,
            frames: measure.frames.len() as u64,
            images: measure.images.files + measure.images.encoded,
            step: of_scene(|[step, _]| *step),
            rotation_degrees: of_scene(|[_, rotation]| *rotation),
            extent: measure.extent,
            path_length: measure.path_length,
        });
    }

    pub(super) fn report(
        self,
        format: Format,
        listed: usize,
        left_out: u64,
        per_scene: bool,
        warnings: &Warnings,
    ) -> Inspection {
        let (listed, read) = (listed as u64, self.scenes.len() as u64);
        let [fx, fy, cx, cy, fov_x_degrees, fov_y_degrees] = self.pinhole.map(summary);
        let [step, rotation_degrees] = self.motion.map(summary);
        let of_scenes = |value: fn(&SceneSummary) -> Option<f64>| summary(self.scenes.iter().filter_map(value));
        Inspection {
            format,
            scenes: SceneCounts { listed, read, unreadable: listed - read, left_out },
            frames: self.scenes.iter().map(|scene| scene.frames).sum(),
            frames_per_scene: of_scenes(|scene| Some(scene.frames as f64)),
            images: self.images,
            sizes: by_frequency(&self.sizes),
            stated_sizes: by_frequency(&self.stated_sizes),
            lenses: self.lenses,
            intrinsics: Intrinsics { fx, fy, cx, cy, fov_x_degrees, fov_y_degrees },
            baselines: Baselines {
                step,
                rotation_degrees,
                scene_step: of_scenes(|scene| scene.step),
                scene_rotation_degrees: of_scenes(|scene| scene.rotation_degrees),
                extent: of_scenes(|scene| scene.extent),
                path_length: of_scenes(|scene| Some(scene.path_length)),
            },
            problems: problems(warnings),
            repeated_numbers: self.repeated_numbers,
            scenes_in_one_place: self.scenes_in_one_place,
            per_scene: if per_scene { self.scenes } else { Vec::new() },
        }
    }
}

/// Order statistics of the finite values, and the number of the others.
fn summary(values: impl IntoIterator<Item = f64>) -> Summary {
    let (mut finite, other): (Vec<f64>, Vec<f64>) = values.into_iter().partition(|value| value.is_finite());
    finite.sort_by(f64::total_cmp);
    Summary {
        count: finite.len() as u64,
        non_finite: other.len() as u64,
        min: finite.first().copied(),
        median: median(finite.iter().copied()),
        max: finite.last().copied(),
    }
}

fn by_frequency(sizes: &BTreeMap<ImageSize, u64>) -> Vec<SizeCount> {
    let mut counts: Vec<_> = sizes.iter().map(|(size, frames)| SizeCount { size: *size, frames: *frames }).collect();
    counts.sort_by_key(|count| std::cmp::Reverse(count.frames));
    counts
}

fn problems(warnings: &Warnings) -> Vec<Problem> {
    let of_kind = |(kind, count)| {
        let examples = warnings.kept().iter().filter(|warning| warning.kind == kind).take(EXAMPLES).cloned();
        Problem { kind, count, examples: examples.collect() }
    };
    warnings.counts().map(of_kind).collect()
}

fn add(total: &mut BTreeMap<ImageSize, u64>, part: &BTreeMap<ImageSize, u64>) {
    for (size, frames) in part {
        *total.entry(*size).or_default() += frames;
    }
}

impl ImageCounts {
    fn plus(self, other: Self) -> Self {
        Self {
            files: self.files + other.files,
            encoded: self.encoded + other.encoded,
            missing: self.missing + other.missing,
            empty: self.empty + other.empty,
            unposed: self.unposed + other.unposed,
            absent: self.absent + other.absent,
            headers_read: self.headers_read + other.headers_read,
            headers_unreadable: self.headers_unreadable + other.headers_unreadable,
            cut_short: self.cut_short + other.cut_short,
            unfit: self.unfit + other.unfit,
        }
    }
}

impl LensCounts {
    fn plus(self, other: Self) -> Self {
        Self {
            pinhole: self.pinhole + other.pinhole,
            opencv: self.opencv + other.opencv,
            fisheye: self.fisheye + other.fisheye,
        }
    }
}
