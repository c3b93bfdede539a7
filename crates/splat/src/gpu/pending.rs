//! Work whose results stay on the device.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicBool, Ordering};

use super::bounds::Plan;
use super::gaussians::GpuGaussians;
use super::job::Job;
use super::record::Recorder;
use super::render::{self, Resources};
use super::status::{self, Status};
use super::work::Work;
use super::{GpuError, GpuGradients, GpuImageGradients, GpuRenderer, GpuRendering, backward};
use crate::{GaussianCounts, Gaussians, Gradients, RenderOptions, Rendering, SplatError, View};

/// A result on the device that the host has not waited for.
///
/// The lists of its computation may prove too short. [`GpuRenderer::settle`], or reading it, then repeats the
/// computation into the same buffers; until then the buffers of the Gaussians, and of the images' gradients, must keep
/// their contents.
#[derive(Debug)]
pub struct Pending<T> {
    result: T,
    task: Task,
    record: Record<T>,
    report: wgpu::Buffer,
    plan: Plan,
    /// Set once the result is complete.
    counts: OnceLock<GaussianCounts>,
    was_repeated: AtomicBool,
}

/// Records a task into its result.
type Record<T> = fn(&mut Recorder<'_>, Resources<'_>, &Task, &T) -> Result<Plan, SplatError>;

/// What is computed.
#[derive(Debug)]
struct Task {
    gaussians: GpuGaussians,
    views: Vec<View>,
    scenes: u32,
    options: RenderOptions,
    /// For gradients.
    images: Option<GpuImageGradients>,
}

impl Task {
    fn new(
        gaussians: &GpuGaussians,
        scenes: u32,
        views: &[View],
        options: &RenderOptions,
        images: Option<GpuImageGradients>,
    ) -> Result<Self, SplatError> {
        if views.is_empty() {
            return Err(SplatError::Length { field: "views", expected: 1, found: 0 });
        }
        Ok(Self { gaussians: gaussians.clone(), views: views.to_vec(), scenes, options: options.clone(), images })
    }

    fn job(&self) -> Job<'_> {
        Job { gaussians: &self.gaussians, views: &self.views, scenes: self.scenes, options: &self.options }
    }
}

impl<T> Pending<T> {
    /// The buffers, for commands that follow on the same queue. What they compute is to be discarded if
    /// [`GpuRenderer::settle`] says that the result was incomplete before.
    pub const fn unsettled(&self) -> &T {
        &self.result
    }

    /// Computes it again.
    fn repeat(&self, work: &mut Work<'_>) -> Result<Plan, SplatError> {
        self.was_repeated.store(true, Ordering::Relaxed);
        work.submit(&self.report, &|recorder, resources| (self.record)(recorder, resources, &self.task, &self.result))
    }
}

/// A complete result on the device.
#[derive(Clone, Copy, Debug)]
pub struct Settled<'a, T> {
    /// The result.
    pub result: &'a T,
    /// Counts of drawn and culled Gaussians.
    pub counts: GaussianCounts,
    /// Whether it had to be computed again since it was begun: what used its first result is to be discarded.
    pub was_repeated: bool,
}

impl GpuRenderer {
    /// Renders Gaussians on the device into buffers that stay there: one submission, without waiting for the device.
    /// Stages are not timed.
    ///
    /// # Errors
    /// As [`crate::Renderer::render`].
    pub fn render_resident(
        &mut self,
        gaussians: &GpuGaussians,
        view: &View,
        options: &RenderOptions,
    ) -> Result<Pending<GpuRendering>, SplatError> {
        self.render_batch(gaussians, 1, std::slice::from_ref(view), options)
    }

    /// As [`Self::render_resident`] for several scenes at once: equal numbers of Gaussians, stored scene by scene, and equal numbers
    /// of views, all of one size, those of the first scene first. Every kernel runs once for all of them. Images are stacked
    /// vertically; the counts of Gaussians are totals over all views.
    ///
    /// # Errors
    /// As [`Self::render_resident`]; [`SplatError::Length`] if there is no view or scenes differ; [`GpuError::TooLarge`] if one
    /// launch cannot do it, for which smaller batches are the remedy.
    pub fn render_batch(
        &mut self,
        gaussians: &GpuGaussians,
        scenes: u32,
        views: &[View],
        options: &RenderOptions,
    ) -> Result<Pending<GpuRendering>, SplatError> {
        let task = Task::new(gaussians, scenes, views, options, None)?;
        let mut work = self.work();
        let context = work.context;
        context.guarded(|| {
            render::check(context, work.limits, task.job())?;
            let mut allocate = |_: &mut _, name, _, bytes| context.buffer(name, bytes);
            let result = GpuRendering::allocate(context, work.pool, task.job(), &mut allocate)?;
            begin(&mut work, task, result, |recorder, resources, task, rendering| {
                render::record(recorder, resources, task.job(), rendering)
            })
        })
    }

    /// Backward pass for Gaussians and image gradients on the device, into buffers that stay there: one submission,
    /// without waiting for the device. Image gradients are not checked: one that is not finite makes gradients of the
    /// Gaussians listed in its tile, of the pose and of the background NaN or the largest f32. Stages are not timed.
    ///
    /// # Errors
    /// As [`crate::Renderer::backward`].
    pub fn backward_resident(
        &mut self,
        gaussians: &GpuGaussians,
        view: &View,
        options: &RenderOptions,
        images: &GpuImageGradients,
    ) -> Result<Pending<GpuGradients>, SplatError> {
        self.backward_batch(gaussians, 1, std::slice::from_ref(view), options, images)
    }

    /// As [`Self::backward_resident`] for a batch, see [`Self::render_batch`]; the gradient of a Gaussian is summed over the views of
    /// its scene, in their order.
    ///
    /// # Errors
    /// As [`Self::backward_resident`] and [`Self::render_batch`].
    pub fn backward_batch(
        &mut self,
        gaussians: &GpuGaussians,
        scenes: u32,
        views: &[View],
        options: &RenderOptions,
        images: &GpuImageGradients,
    ) -> Result<Pending<GpuGradients>, SplatError> {
        let task = Task::new(gaussians, scenes, views, options, Some(images.clone()))?;
        let mut work = self.work();
        let context = work.context;
        context.guarded(|| {
            backward::check(context, work.limits, task.job(), image_gradients(&task))?;
            let mut allocate = |_: &mut _, name, _, bytes| context.buffer(name, bytes);
            let result = GpuGradients::allocate(work.pool, gaussians, false, &mut allocate)?;
            begin(&mut work, task, result, |recorder, resources, task, gradients| {
                backward::record(recorder, resources, task.job(), (image_gradients(task), gradients, false))
            })
        })
    }

    /// Waits for the device, unless it has before, and repeats the computation if lists were too short.
    ///
    /// # Errors
    /// [`SplatError::Gpu`].
    pub fn settle<'a, T>(&mut self, pending: &'a Pending<T>) -> Result<Settled<'a, T>, SplatError> {
        let mut settled = self.settle_all(&[pending])?;
        Ok(settled.remove(0))
    }

    /// As [`Self::settle`] for several results, with a single wait.
    ///
    /// # Errors
    /// [`SplatError::Gpu`].
    #[expect(clippy::expect_used, reason = "results without counts stay open")]
    pub fn settle_all<'a, T>(&mut self, pending: &[&'a Pending<T>]) -> Result<Vec<Settled<'a, T>>, SplatError> {
        let mut work = self.work();
        let context = work.context;
        context.guarded(|| {
            let mut open: Vec<(usize, Plan)> = pending.iter().map(|one| one.plan).enumerate().collect();
            open.retain(|(at, _)| pending[*at].counts.get().is_none());
            while !open.is_empty() {
                let reports: Vec<_> = open.iter().map(|(at, _)| (&pending[*at].report, status::BYTES)).collect();
                let contents = context.read(&reports)?;
                let mut incomplete = Vec::new();
                for ((at, plan), bytes) in open.into_iter().zip(contents) {
                    let status = Status::parse(&context.name, &bytes)?;
                    if work.bounds.learn(context, &plan, &status)? {
                        incomplete.push((at, pending[at].repeat(&mut work)?));
                    } else {
                        pending[at].counts.get_or_init(|| status.counts);
                    }
                }
                open = incomplete;
            }
            let settled = pending.iter().map(|one| {
                let counts = *one.counts.get().expect("the loop ends when every result has its counts");
                Settled { result: &one.result, counts, was_repeated: one.was_repeated.load(Ordering::Relaxed) }
            });
            Ok(settled.collect())
        })
    }

    /// Copies images to the host, with one wait for the device.
    ///
    /// # Errors
    /// [`SplatError::Gpu`].
    pub fn read(&mut self, rendering: &Pending<GpuRendering>) -> Result<Rendering<f32>, SplatError> {
        let (contents, counts) = self.complete(rendering, &rendering.result.sources(), &|_| Ok(()))?;
        Ok(rendering.result.arrange(&contents, counts))
    }

    /// Copies gradients to the host, with one wait for the device; `gaussians` must have the size and arrays that they
    /// were computed for.
    ///
    /// # Errors
    /// [`SplatError::Length`] if the Gaussians differ in number or SH degree, or in whether they have scalars;
    /// [`SplatError::Gpu`].
    pub fn read_gradients(
        &mut self,
        gradients: &Pending<GpuGradients>,
        gaussians: &Gaussians,
    ) -> Result<Gradients<f32>, SplatError> {
        gradients.result.check(gaussians)?;
        let (contents, _) = self.complete(gradients, &gradients.result.sources(), &|_| Ok(()))?;
        Ok(gradients.result.arrange(&contents, gaussians, 1.0).0)
    }

    /// Reads buffers, which `prepare` may fill from a result, together with its report; again until it is complete.
    pub(super) fn complete<T>(
        &mut self,
        pending: &Pending<T>,
        sources: &[(&wgpu::Buffer, u64)],
        prepare: &dyn Fn(&mut Recorder<'_>) -> Result<(), GpuError>,
    ) -> Result<(Vec<Vec<u8>>, GaussianCounts), SplatError> {
        let mut work = self.work();
        let context = work.context;
        context.guarded(|| {
            let mut plan = pending.plan;
            loop {
                let mut recorder = Recorder::new(context, work.pipelines);
                prepare(&mut recorder)?;
                let (finished, status) = recorder.submit_and_read_with_status(sources, &pending.report)?;
                if !work.bounds.learn(context, &plan, &status)? {
                    return Ok((finished.contents, *pending.counts.get_or_init(|| status.counts)));
                }
                plan = pending.repeat(&mut work)?;
            }
        })
    }
}

#[expect(clippy::expect_used, reason = "tasks of the backward pass have image gradients")]
fn image_gradients(task: &Task) -> &GpuImageGradients {
    task.images.as_ref().expect("a task of the backward pass")
}

fn begin<T>(work: &mut Work<'_>, task: Task, result: T, record: Record<T>) -> Result<Pending<T>, SplatError> {
    let report = work.context.buffer("report", status::BYTES)?;
    let counts = OnceLock::new();
    let plan = work.submit(&report, &|recorder, resources| record(recorder, resources, &task, &result))?;
    Ok(Pending { result, task, record, report, plan, counts, was_repeated: AtomicBool::new(false) })
}
