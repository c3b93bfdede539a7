//! Metrics of pairs of images.

use std::path::PathBuf;

use atsplat_eval::method::check_range;
use atsplat_eval::runner::{Dataset, suite};
use atsplat_metrics::{Score, definitions};
use atsplat_pixels::Image;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::array::Images;
use crate::error::Failure;
use crate::protocol::Data;
use crate::threads::work;

/// Metrics with their loaded networks.
#[pyclass(frozen, module = "atsplat._native")]
pub(crate) struct Suite(atsplat_metrics::Suite);

impl Suite {
    pub(crate) const fn get(&self) -> &atsplat_metrics::Suite {
        &self.0
    }
}

/// Id, unit, direction (1: more is better) and convention of every metric.
#[pyfunction]
pub(crate) fn metric_definitions() -> Vec<(&'static str, &'static str, i8, &'static str)> {
    let higher = |metric: &atsplat_metrics::Definition| match metric.direction {
        atsplat_metrics::Direction::Higher => 1,
        atsplat_metrics::Direction::Lower => -1,
    };
    definitions().iter().map(|metric| (metric.id, metric.unit, higher(metric), metric.convention)).collect()
}

#[pymethods]
impl Suite {
    /// The metrics of a protocol, if there is data, and those of these ids.
    #[new]
    fn new(
        py: Python<'_>,
        ids: Vec<String>,
        weights: Option<PathBuf>,
        data: Option<PyRef<'_, Data>>,
    ) -> Result<Self, Failure> {
        let dataset = data.map(|data| Dataset::clone(&data.dataset));
        work(py, || {
            let datasets: Vec<Dataset> = dataset.into_iter().collect();
            Ok(Self(suite(&datasets, &ids, weights.as_deref())?))
        })
    }

    #[getter]
    fn ids(&self) -> Vec<&'static str> {
        self.0.definitions().iter().map(|metric| metric.id).collect()
    }

    /// For each pair, one score for each metric: infinity where the images are identical and the metric has no bound.
    fn score(
        &self,
        py: Python<'_>,
        shape: Vec<usize>,
        renders: (String, Bound<'_, PyBytes>),
        truths: (String, Bound<'_, PyBytes>),
    ) -> Result<Vec<Vec<f64>>, Failure> {
        let renders = Images::of(&shape, &renders.0, renders.1.as_bytes())?;
        let truths = Images::of(&shape, &truths.0, truths.1.as_bytes())?;
        let count = renders.count;
        let of = |at| if count > 1 { format!("image {at} of {count}: ") } else { String::new() };
        let image = |field, images: &Images, at| {
            let image = images.image(at)?;
            check_range(&image).map_err(|problem| Failure::invalid(field, format!("{}{problem}", of(at))))?;
            Ok::<Image, Failure>(image)
        };
        let score = |at| {
            let (render, truth) = (image("render", &renders, at)?, image("truth", &truths, at)?);
            numbers(self.0.score(&render, &truth).scores, &of(at))
        };
        work(py, || (0..count).map(score).collect())
    }
}

fn numbers(scores: Vec<(&'static str, Score)>, of: &str) -> Result<Vec<f64>, Failure> {
    let number = |(id, score): (&str, Score)| match score {
        Score::Value(value) => Ok(value),
        Score::Identical => Ok(f64::INFINITY),
        Score::NotComputed(why) => Err(Failure::invalid(id, format!("{of}{why}"))),
    };
    scores.into_iter().map(number).collect()
}
