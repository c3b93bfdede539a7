use super::GpuOptions;
use super::bounds::{Bounds, Plan};
use super::context::Context;
use super::kernels::{Pipelines, Pool};
use super::record::{Finished, Recorder};
use super::render::Resources;
use crate::{GaussianCounts, SplatError};

/// Records commands that may be repeated.
pub(super) type Record<'a> = &'a dyn Fn(&mut Recorder<'_>, Resources<'_>) -> Result<Plan, SplatError>;

/// The parts of a renderer that work on its device.
pub(super) struct Work<'a> {
    pub(super) context: &'a Context,
    pub(super) pipelines: &'a mut Pipelines,
    pub(super) pool: &'a mut Pool,
    pub(super) limits: &'a GpuOptions,
    pub(super) bounds: &'a mut Bounds,
}

impl Work<'_> {
    /// Submits work whose results stay on the device. Whether they are complete is in `report` when the device is done.
    pub(super) fn submit(&mut self, report: &wgpu::Buffer, record: Record<'_>) -> Result<Plan, SplatError> {
        let mut recorder = Recorder::new(self.context, self.pipelines);
        let plan =
            record(&mut recorder, Resources { pool: self.pool, limits: self.limits, bounds: self.bounds, report })?;
        recorder.submit();
        Ok(plan)
    }

    /// Submits work and reads its results, again until they are complete.
    pub(super) fn run(
        &mut self,
        report: &wgpu::Buffer,
        sources: &[(&wgpu::Buffer, u64)],
        record: Record<'_>,
    ) -> Result<(GaussianCounts, Finished), SplatError> {
        loop {
            let mut recorder = Recorder::new(self.context, self.pipelines).timed();
            let plan =
                record(&mut recorder, Resources { pool: self.pool, limits: self.limits, bounds: self.bounds, report })?;
            let (finished, status) = recorder.submit_and_read_with_status(sources, report)?;
            if !self.bounds.learn(self.context, &plan, &status)? {
                return Ok((status.counts, finished));
            }
        }
    }
}
