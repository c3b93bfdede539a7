use std::collections::BTreeMap;

use atsplat_camera::ImageSize;
use polars::prelude::*;

use super::InspectError;
use super::measure::{FrameMeasure, SceneMeasure};
use super::report::{
    Baselines, Inspection, Intrinsics, LensCounts, PictureCounts, Problem, SceneCounts, SceneSummary, SizeCount,
    Summary,
};
use crate::Warnings;

/// Examples told for each kind of problem.
const EXAMPLES: usize = 3;

/// All scenes' measures: counts added up, numbers in columns.
#[derive(Default)]
pub(super) struct Gathered {
    scenes: Vec<SceneRow>,
    pictures: PictureCounts,
    lenses: LensCounts,
    sizes: BTreeMap<ImageSize, u64>,
    stated_sizes: BTreeMap<ImageSize, u64>,
    scene: Vec<u64>,
    pinhole: [Vec<f64>; FrameMeasure::PINHOLE.len()],
    motion: [Vec<Option<f64>>; FrameMeasure::MOTION.len()],
}

struct SceneRow {
    key: String,
    frames: u64,
    pictures: u64,
    extent: Option<f64>,
    path_length: f64,
}

impl Gathered {
    pub(super) fn push(&mut self, measure: SceneMeasure) {
        let number = self.scenes.len() as u64;
        for frame in &measure.frames {
            self.scene.push(number);
            for (column, value) in self.pinhole.iter_mut().zip(frame.pinhole) {
                column.push(value);
            }
            for (position, column) in self.motion.iter_mut().enumerate() {
                column.push(frame.motion.and_then(|motion| motion.get(position).copied()));
            }
        }
        self.pictures = self.pictures.plus(measure.pictures);
        self.lenses = self.lenses.plus(measure.lenses);
        add(&mut self.sizes, &measure.sizes);
        add(&mut self.stated_sizes, &measure.stated_sizes);
        self.scenes.push(SceneRow {
            key: measure.key,
            frames: measure.frames.len() as u64,
            pictures: measure.pictures.files + measure.pictures.encoded,
            extent: measure.extent,
            path_length: measure.path_length,
        });
    }

    pub(super) fn report(
        self,
        format: &str,
        listed: usize,
        per_scene: bool,
        warnings: &Warnings,
    ) -> Result<Inspection, InspectError> {
        let (listed, read) = (listed as u64, self.scenes.len() as u64);
        let frames = frame_table(self.scene, self.pinhole, self.motion)?;
        let scenes = scene_table(&self.scenes, frames.clone())?;

        let of_frames = |name| summary(&frames, name);
        let of_scenes = |name| summary(&scenes, name);
        Ok(Inspection {
            format: format.to_owned(),
            scenes: SceneCounts { listed, read, unreadable: listed - read },
            frames: frames.height() as u64,
            frames_per_scene: of_scenes("frames")?,
            pictures: self.pictures,
            sizes: by_frequency(&self.sizes),
            stated_sizes: by_frequency(&self.stated_sizes),
            lenses: self.lenses,
            intrinsics: Intrinsics {
                fx: of_frames("fx")?,
                fy: of_frames("fy")?,
                cx: of_frames("cx")?,
                cy: of_frames("cy")?,
                fov_x_degrees: of_frames("fov_x_degrees")?,
                fov_y_degrees: of_frames("fov_y_degrees")?,
            },
            baselines: Baselines {
                step: of_frames("step")?,
                rotation_degrees: of_frames("rotation_degrees")?,
                scene_step: of_scenes("step")?,
                scene_rotation_degrees: of_scenes("rotation_degrees")?,
                extent: of_scenes("extent")?,
                path_length: of_scenes("path_length")?,
            },
            problems: problems(warnings),
            per_scene: if per_scene { scene_summaries(self.scenes, &scenes)? } else { Vec::new() },
        })
    }
}

/// One row a frame.
fn frame_table(
    scene: Vec<u64>,
    pinhole: [Vec<f64>; FrameMeasure::PINHOLE.len()],
    motion: [Vec<Option<f64>>; FrameMeasure::MOTION.len()],
) -> PolarsResult<DataFrame> {
    let mut columns = vec![Column::new("scene".into(), scene)];
    columns
        .extend(FrameMeasure::PINHOLE.into_iter().zip(pinhole).map(|(name, values)| Column::new(name.into(), values)));
    columns.extend(FrameMeasure::MOTION.into_iter().zip(motion).map(|(name, values)| Column::new(name.into(), values)));
    DataFrame::new_infer_height(columns)
}

/// One row a scene, in the order of scenes: what was measured whole, joined with medians over its frames.
/// Only order statistics are left to polars, which adds floats up in an order of its own.
fn scene_table(scenes: &[SceneRow], frames: DataFrame) -> PolarsResult<DataFrame> {
    let column = |name: &str, value: fn(&SceneRow) -> Option<f64>| {
        Column::new(name.into(), scenes.iter().map(value).collect::<Vec<_>>())
    };
    let whole = DataFrame::new_infer_height(vec![
        Column::new("scene".into(), (0..scenes.len() as u64).collect::<Vec<_>>()),
        column("frames", |scene| Some(scene.frames as f64)),
        column("extent", |scene| scene.extent),
        column("path_length", |scene| Some(scene.path_length)),
    ])?;
    let medians =
        frames.lazy().group_by([col("scene")]).agg(FrameMeasure::MOTION.map(|name| finite(name).median().alias(name)));
    whole
        .lazy()
        .join(medians, [col("scene")], [col("scene")], JoinArgs::new(JoinType::Left))
        .sort(["scene"], SortMultipleOptions::default())
        .collect()
}

fn finite(column: &str) -> Expr {
    col(column).filter(col(column).is_finite())
}

fn summary(table: &DataFrame, name: &str) -> PolarsResult<Summary> {
    let row = table
        .select([name])?
        .lazy()
        .select([
            finite(name).count().cast(DataType::UInt64).alias("count"),
            col(name).is_finite().not().sum().cast(DataType::UInt64).alias("non_finite"),
            finite(name).min().alias("min"),
            finite(name).median().alias("median"),
            finite(name).max().alias("max"),
        ])
        .collect()?;
    let count = |name| PolarsResult::Ok(row.column(name)?.u64()?.get(0).unwrap_or_default());
    let value = |name| PolarsResult::Ok(row.column(name)?.f64()?.get(0));
    Ok(Summary {
        count: count("count")?,
        non_finite: count("non_finite")?,
        min: value("min")?,
        median: value("median")?,
        max: value("max")?,
    })
}

fn scene_summaries(scenes: Vec<SceneRow>, table: &DataFrame) -> PolarsResult<Vec<SceneSummary>> {
    let (steps, rotations) = (table.column("step")?.f64()?, table.column("rotation_degrees")?.f64()?);
    let medians = steps.iter().zip(rotations.iter());
    let summaries = scenes.into_iter().zip(medians).map(|(scene, (step, rotation_degrees))| SceneSummary {
        key: scene.key,
        frames: scene.frames,
        pictures: scene.pictures,
        step,
        rotation_degrees,
        extent: scene.extent,
        path_length: scene.path_length,
    });
    Ok(summaries.collect())
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

impl PictureCounts {
    fn plus(self, other: Self) -> Self {
        Self {
            files: self.files + other.files,
            encoded: self.encoded + other.encoded,
            missing: self.missing + other.missing,
            absent: self.absent + other.absent,
            headers_read: self.headers_read + other.headers_read,
            headers_unreadable: self.headers_unreadable + other.headers_unreadable,
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
