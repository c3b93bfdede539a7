//! The renderer for graphics processors: compute kernels in WGSL, through wgpu on Vulkan, Metal, DX12 and GL.
//!
//! Every sum has one order, so that a device gives the same bits on every run, however buffers are cut to fit its
//! limits. The bound on pixels, which this crate's tests hold over every rule and lens, is 1/255 from the reference's
//! on 99.99 % of them, and 60 dB. [`GpuRenderer::new`] tests a driver on one picture without cut-offs that a rounding
//! could cross, to 1e-4, and its derivative: that finds one which computes nonsense, and no fault in rules that this
//! picture does not use.
//!
//! What lies in arrays by Gaussian, as degree-4 harmonics of millions, is cut to fit the device's bindings, and so are
//! frames and tile lists. Sixteen bytes of every Gaussian lie in one binding and bound their number: 8 million where
//! a device binds no more than WebGPU's default of 128 MiB, beyond which [`GpuError::TooLarge`] says so.
//!
//! Run have Vulkan and OpenGL on Mesa's software drivers. Metal and DX12 are compiled and untested; wgpu prefers
//! `dxcompiler.dll` where it finds one, and the old compiler beside may refuse the derivative's barriers, which the
//! self-test turns into an error.

mod adapters;
mod backward;
mod context;
mod error;
mod fallback;
mod forward;
mod gaussians;
mod gradients;
mod images;
mod kernels;
mod panics;
mod probe;
mod read;
mod record;
mod render;
mod self_test;
mod sort;
#[cfg(test)]
mod tests;
mod uniforms;
mod verdict;

pub use adapters::{ADAPTER_VARIABLE, AdapterChoice, AdapterDescription, AdapterKind, Examined, adapters, examine};
pub use error::GpuError;
pub use fallback::{Fallback, with_fallback};
pub use gaussians::{GpuGaussians, GpuPart};
pub use gradients::{GpuGradientPart, GpuGradients, GpuImageGradients, GpuStripGradients};
pub use images::{GpuRendering, GpuStrip};
pub use verdict::{ProbeStage, Verdict, VerdictKey, Watcher, WrongNumber};

use std::time::Instant;

use crate::{Gaussians, Gradients, ImageGradients, RenderOptions, Renderer, Rendering, SplatError, Stage, View};
use context::Context;
use kernels::{Pipelines, Pool};
use panics::catch_panics;
use record::Recorder;
use render::{Job, check_memory, check_memory_before_upload};

/// How a device is used; frames do not depend on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GpuOptions {
    /// Bytes that one picture or derivative may take on the device, its Gaussians and tile lists included; tile lists
    /// are cut to fit. Buffers that are kept from one picture to the next stay within it too. Not counted: up to 64 MiB
    /// on their way to the host, and what else the caller keeps there, as other scenes or earlier frames.
    pub memory_limit: u64,
    /// Bytes of the largest buffer, where that is less than the adapter allows.
    pub binding_limit: u64,
    /// Workgroups along one dimension of a dispatch, where that is less than the adapter allows.
    pub groups_limit: u32,
    /// Entries of a tile's list that one dispatch passes over, where that is less than the driver allows.
    pub entries_limit: u32,
    /// How many pixels a thread composites.
    pub threads: Threads,
}

/// How many pixels a thread composites; only the last bits of gradients depend on it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Threads {
    /// As suits the adapter.
    #[default]
    Automatic,
    /// Four pixels each: for graphics processors.
    Many,
    /// Sixteen pixels each: for processors that stand in for one.
    Few,
}

impl Default for GpuOptions {
    /// 8 GiB, and whatever the adapter allows.
    fn default() -> Self {
        Self {
            memory_limit: 8 << 30,
            binding_limit: u64::MAX,
            groups_limit: u32::MAX,
            entries_limit: u32::MAX,
            threads: Threads::Automatic,
        }
    }
}

/// A renderer on one device, which keeps its buffers from one view to the next.
#[derive(Debug)]
pub struct GpuRenderer {
    context: Context,
    options: GpuOptions,
    pipelines: Pipelines,
    pool: Pool,
    stages: Vec<Stage>,
}

impl GpuRenderer {
    /// Opens an adapter and tests it, forward and backward, against the reference.
    ///
    /// # Errors
    /// [`GpuError`]: no such adapter, one that cannot do what is needed, or does it wrong.
    pub fn new(choice: &AdapterChoice, options: GpuOptions) -> Result<Self, GpuError> {
        Self::watched(choice, options, &())
    }

    /// The same; `watcher` hears of it, and an adapter whose verdict it remembers is not tested again.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn watched(choice: &AdapterChoice, options: GpuOptions, watcher: &dyn Watcher) -> Result<Self, GpuError> {
        Self::open(&adapters::choose(choice)?, options, watcher)
    }

    /// Opens an adapter, and tests it unless its verdict is remembered.
    fn open(
        (adapter, description): &adapters::Candidate,
        options: GpuOptions,
        watcher: &dyn Watcher,
    ) -> Result<Self, GpuError> {
        let name = description.to_string();
        let known = adapters::recalled(description, &options, watcher);
        if let Some(verdict) = &known {
            verdict.outcome(&name)?;
        }
        catch_panics(&name, || {
            watcher.begins(description, ProbeStage::Opening);
            let context = Context::open(adapter, description, &options)?;
            let mut renderer = Self::over(context, options)?;
            if known.is_none() {
                let tested = self_test::self_test(&mut renderer, &|stage| watcher.begins(description, stage));
                if let Some(verdict) = Verdict::of(&tested).filter(|_| options == GpuOptions::default()) {
                    watcher.keep(&VerdictKey::of(description), &verdict);
                }
                tested?;
            }
            renderer.pool.clear();
            Ok(renderer)
        })
    }

    /// Renders on a device that somebody else opened, and leaves its error handlers alone: a device that is lost shows
    /// in what wgpu says of the next command. It is not tested; [`Self::self_test`] does that.
    ///
    /// # Errors
    /// [`GpuError::Unfit`] for a device with limits below wgpu's defaults for compute.
    pub fn with_device(device: wgpu::Device, queue: wgpu::Queue, options: GpuOptions) -> Result<Self, GpuError> {
        let info = device.adapter_info();
        let name = format!("{} ({:?})", info.name, info.backend);
        Self::over(Context::with_device(device, queue, name, &options)?, options)
    }

    fn over(mut context: Context, options: GpuOptions) -> Result<Self, GpuError> {
        let mut pipelines = Pipelines::default();
        context.limit_iterations(probe::max_iterations(&context, &mut pipelines)?);
        Ok(Self { context, options, pipelines, pool: Pool::default(), stages: Vec::new() })
    }

    /// The adapter's name and backend.
    pub fn adapter(&self) -> &str {
        &self.context.name
    }

    /// The device, for buffers that are shared with it. An error that wgpu finds in other commands than this
    /// renderer's is returned once, by the renderer's next call, as [`GpuError::Refused`].
    pub const fn device(&self) -> &wgpu::Device {
        &self.context.device
    }

    /// The device's queue.
    pub const fn queue(&self) -> &wgpu::Queue {
        &self.context.queue
    }

    /// Tests the device: a picture and its derivative against the reference's.
    ///
    /// # Errors
    /// [`GpuError::SelfTest`] for wrong numbers, and whatever the driver fails with.
    pub fn self_test(&mut self) -> Result<(), GpuError> {
        let adapter = self.context.name.clone();
        catch_panics(&adapter, || self_test::self_test(self, &|_stage| ()))
    }

    /// Frees the buffers that are kept for the next picture.
    pub fn free_buffers(&mut self) {
        self.pool.clear();
    }

    /// Copies Gaussians to the device.
    ///
    /// # Errors
    /// [`SplatError::Memory`], [`SplatError::Gpu`].
    pub fn upload(&mut self, gaussians: &Gaussians) -> Result<GpuGaussians, SplatError> {
        check_memory(gaussians.size_in_bytes(), self.options.memory_limit)?;
        let context = &self.context;
        context.guarded(|| Ok(GpuGaussians::upload(context, &mut Pool::default(), gaussians)?))
    }

    /// Renders Gaussians that are on the device into buffers that stay there. Only the count of pairs of tiles and
    /// Gaussians comes to the host, and where some tile may have very many, the lengths of the tiles' lists. Stages
    /// are not timed, as it does not wait for the device.
    ///
    /// # Errors
    /// As [`crate::Renderer::render`].
    pub fn render_resident(
        &mut self,
        gaussians: &GpuGaussians,
        view: &View,
        options: &RenderOptions,
    ) -> Result<GpuRendering, SplatError> {
        self.stages.clear();
        self.pool.begin_frame();
        let Self { context, pool, pipelines, options: limits, .. } = self;
        context.guarded(|| {
            let mut recorder = Recorder::new(context, pipelines);
            let mut make = |_: &mut Pool, name, _, bytes| context.buffer(name, bytes);
            let job = Job { gaussians, view, options };
            let rendering = render::record(&mut recorder, pool, limits, job, &mut make)?;
            recorder.submit();
            Ok(rendering)
        })
    }

    /// Differentiates with respect to Gaussians that are on the device, from gradients that are, into buffers that
    /// stay there. Gradients that are not finite are not looked for: what they lead to comes out as 0 or the largest
    /// f32. Stages are not timed.
    ///
    /// # Errors
    /// As [`crate::Renderer::backward`].
    pub fn backward_resident(
        &mut self,
        gaussians: &GpuGaussians,
        view: &View,
        options: &RenderOptions,
        images: &GpuImageGradients,
    ) -> Result<GpuGradients, SplatError> {
        self.stages.clear();
        self.pool.begin_frame();
        let Self { context, pool, pipelines, options: limits, .. } = self;
        context.guarded(|| {
            let mut recorder = Recorder::new(context, pipelines);
            let mut make = |_: &mut Pool, name, _, bytes| context.buffer(name, bytes);
            let job = Job { gaussians, view, options };
            let gradients = backward::record(&mut recorder, pool, limits, job, images, &mut make)?;
            recorder.submit();
            Ok(gradients)
        })
    }

    /// Gaussians of the longest part that the adapter can bind.
    pub fn part_length(&self, sh_degree: u8) -> usize {
        gaussians::part_length(&self.context, sh_degree)
    }

    /// First row and number of rows of the strips that a picture is cut into.
    ///
    /// # Errors
    /// [`SplatError::View`] for a picture without pixels or with more than 65 535 a side; [`GpuError::TooLarge`] for
    /// one of which the adapter cannot bind 16 rows.
    pub fn strips(&self, view: &View) -> Result<Vec<[u32; 2]>, SplatError> {
        images::strips(&self.context, view)
    }

    /// Copies images to the host.
    ///
    /// # Errors
    /// [`SplatError::Gpu`].
    pub fn read(&self, rendering: &GpuRendering) -> Result<Rendering<f32>, SplatError> {
        self.context.guarded(|| Ok(rendering.read(&self.context)?))
    }

    /// Copies gradients to the host, by Gaussians of the number and the arrays that they were made from.
    ///
    /// # Errors
    /// [`SplatError::Length`] for Gaussians of another number, degree or with scalars that the gradients lack or have
    /// alone; [`SplatError::Gpu`].
    pub fn read_gradients(
        &self,
        gradients: &GpuGradients,
        gaussians: &Gaussians,
    ) -> Result<Gradients<f32>, SplatError> {
        self.context.guarded(|| gradients.read(&self.context, gaussians))
    }

    fn render_from_host(
        &mut self,
        gaussians: &Gaussians,
        view: &View,
        options: &RenderOptions,
    ) -> Result<Rendering<f32>, SplatError> {
        let start = Instant::now();
        self.stages.clear();
        self.pool.begin_frame();
        let Self { context, pool, pipelines, options: limits, .. } = self;
        let (rendering, timed) = context.guarded(|| {
            check_memory_before_upload(gaussians, view, limits.memory_limit)?;
            let resident = GpuGaussians::upload(context, pool, gaussians)?;
            let mut recorder = Recorder::new(context, pipelines);
            let mut make = |pool: &mut Pool, name, part, bytes| pool.get(context, name, part, bytes);
            let job = Job { gaussians: &resident, view, options };
            let rendering = render::record(&mut recorder, pool, limits, job, &mut make)?;
            let timed = recorder.finish()?;
            Ok::<_, SplatError>((rendering.read(context)?, timed))
        })?;
        self.stages = stages(&timed, start.elapsed().as_secs_f64());
        Ok(rendering)
    }

    fn backward_from_host(
        &mut self,
        gaussians: &Gaussians,
        view: &View,
        options: &RenderOptions,
        images: &ImageGradients<f32>,
    ) -> Result<Gradients<f32>, SplatError> {
        let start = Instant::now();
        images.check(view)?;
        self.stages.clear();
        self.pool.begin_frame();
        let Self { context, pool, pipelines, options: limits, .. } = self;
        let (gradients, timed) = context.guarded(|| {
            check_memory_before_upload(gaussians, view, limits.memory_limit)?;
            let resident = GpuGaussians::upload(context, pool, gaussians)?;
            view.optics(&options.constants)?;
            let images = GpuImageGradients::upload(context, pool, view, &images::strips(context, view)?, images)?;
            let mut recorder = Recorder::new(context, pipelines);
            let mut make = |pool: &mut Pool, name, part, bytes| pool.get(context, name, part, bytes);
            let job = Job { gaussians: &resident, view, options };
            let gradients = backward::record(&mut recorder, pool, limits, job, &images, &mut make)?;
            let timed = recorder.finish()?;
            Ok::<_, SplatError>((gradients.read(context, gaussians)?, timed))
        })?;
        self.stages = stages(&timed, start.elapsed().as_secs_f64());
        Ok(gradients)
    }
}

impl Renderer for GpuRenderer {
    fn name(&self) -> String {
        format!("gpu, {}", self.context.name)
    }

    fn render(
        &mut self,
        gaussians: &Gaussians,
        view: &View,
        options: &RenderOptions,
    ) -> Result<Rendering<f32>, SplatError> {
        self.render_from_host(gaussians, view, options)
    }

    fn backward(
        &mut self,
        gaussians: &Gaussians,
        view: &View,
        options: &RenderOptions,
        images: &ImageGradients<f32>,
    ) -> Result<Gradients<f32>, SplatError> {
        self.backward_from_host(gaussians, view, options, images)
    }

    fn stages(&self) -> Vec<Stage> {
        self.stages.clone()
    }
}

/// Stages of one name together, in the order of the work; the whole where the device cannot tell.
fn stages(timed: &[(&'static str, f64)], whole: f64) -> Vec<Stage> {
    let mut stages: Vec<Stage> = Vec::new();
    for (name, secs) in timed {
        match stages.iter_mut().find(|stage| stage.name == *name) {
            Some(stage) => stage.secs += secs,
            None => stages.push(Stage { name, secs: *secs }),
        }
    }
    if stages.is_empty() { vec![Stage { name: "whole", secs: whole }] } else { stages }
}
