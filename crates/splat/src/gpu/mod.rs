//! The GPU renderer: WGSL compute kernels, through wgpu on Vulkan, Metal, DX12 and GL.
//!
//! Every sum has a fixed order, so that a device gives bit-identical results on every run, however buffers are split to
//! fit its limits. This crate's tests require, for every rule and lens, that 99.99 % of pixels are within 1/255 of the
//! reference, and a PSNR of 60 dB. [`GpuRenderer::new`] tests a driver on one image without thresholds that rounding
//! could cross, to 1e-4, and on its gradients: this detects a broken driver, but not errors in rules that the test
//! image does not use.
//!
//! Per-Gaussian arrays, such as degree-4 SH coefficients of millions, are split to fit the device's binding limits, and
//! so are images and tile lists. Sixteen bytes per Gaussian must fit one binding, which limits their number: to 8
//! million with WebGPU's default of 128 MiB per binding; beyond that, [`GpuError::TooLarge`] is returned.
//!
//! Tested with Vulkan and OpenGL on Mesa's software drivers; Metal and DX12 are compiled but untested. wgpu prefers
//! `dxcompiler.dll` if it finds one; the older FXC compiler may reject the barriers of the backward pass, which the
//! self-test reports as an error.

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
mod verdict_cache;

pub use adapters::{
    ADAPTER_VARIABLE, AdapterChoice, AdapterDescription, AdapterKind, ExaminedAdapter, adapters, examine, select,
};
pub use error::GpuError;
pub use fallback::{Fallback, with_fallback};
pub use gaussians::{GpuGaussians, GpuPart};
pub use gradients::{GpuGradientPart, GpuGradients, GpuImageGradients, GpuStripGradients};
pub use images::{GpuRendering, GpuStrip};
pub use verdict::{ProbeStage, Verdict, VerdictKey, Watcher, WrongResult};
pub use verdict_cache::VerdictCache;

use std::time::Instant;

use crate::{
    Gaussians, Gradients, ImageGradients, MAX_SH_DEGREE, RenderOptions, Renderer, Rendering, SplatError, Stage, View,
};
use context::Context;
use kernels::{Pipelines, Pool};
use panics::catch_panics;
use record::Recorder;
use render::{Job, check_memory, check_memory_before_upload};

/// Execution options; images do not depend on them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GpuOptions {
    /// Limit on the bytes of one forward or backward pass on the device, including Gaussians and tile lists; tile lists
    /// are split to fit. Buffers kept between passes also stay within it. Not counted: up to 64 MiB of staging buffers,
    /// and other buffers of the caller, such as other scenes or earlier images.
    pub memory_limit: u64,
    /// Limit on the bytes of a buffer, if smaller than the adapter's.
    pub binding_limit: u64,
    /// Limit on the workgroups along one dimension of a dispatch, if smaller than the adapter's.
    pub groups_limit: u32,
    /// Limit on the entries of a tile's list per dispatch, if smaller than the driver's.
    pub entries_limit: u32,
    /// Number of pixels per thread.
    pub threads: Threads,
}

/// Number of pixels per thread; only the last bits of gradients depend on it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Threads {
    /// Chosen by the kind of adapter.
    #[default]
    Automatic,
    /// Four pixels per thread: for GPUs.
    Many,
    /// Sixteen pixels per thread: for software adapters.
    Few,
}

impl Default for GpuOptions {
    /// 8 GiB, and the adapter's own limits.
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

/// A renderer on one device, which reuses its buffers from view to view.
#[derive(Debug)]
pub struct GpuRenderer {
    context: Context,
    options: GpuOptions,
    pipelines: Pipelines,
    pool: Pool,
    stages: Vec<Stage>,
}

impl GpuRenderer {
    /// Opens an adapter and tests its forward and backward pass against the reference.
    ///
    /// # Errors
    /// [`GpuError`] if there is no such adapter, or it lacks a required capability or fails the test.
    pub fn new(choice: &AdapterChoice, options: GpuOptions) -> Result<Self, GpuError> {
        Self::watched(choice, options, &())
    }

    /// As [`Self::new`], reporting to `watcher`; an adapter whose verdict it remembers is not tested again.
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
        tracing::debug!(adapter = name, is_test_remembered = known.is_some(), "opening graphics adapter");
        if let Some(verdict) = &known {
            verdict.outcome(&name)?;
        }
        catch_panics(&name, || {
            watcher.begins(description, ProbeStage::Opening);
            let context = Context::open(adapter, description, &options)?;
            let mut renderer = Self::with_context(context, options)?;
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

    /// Renders on a device opened by the caller, without touching its error handlers: a lost device is reported by wgpu
    /// with the next command. The device is not tested; see [`Self::self_test`].
    ///
    /// # Errors
    /// [`GpuError::Unfit`] for a device with limits below wgpu's defaults for compute.
    pub fn with_device(device: wgpu::Device, queue: wgpu::Queue, options: GpuOptions) -> Result<Self, GpuError> {
        let info = device.adapter_info();
        let name = format!("{} ({:?})", info.name, info.backend);
        Self::with_context(Context::with_device(device, queue, name, &options)?, options)
    }

    fn with_context(mut context: Context, options: GpuOptions) -> Result<Self, GpuError> {
        let mut pipelines = Pipelines::default();
        context.limit_iterations(probe::max_iterations(&context, &mut pipelines)?);
        Ok(Self { context, options, pipelines, pool: Pool::default(), stages: Vec::new() })
    }

    /// The adapter's name and backend.
    pub fn adapter(&self) -> &str {
        &self.context.name
    }

    /// The device, for sharing buffers. An error that wgpu finds in commands other than this renderer's is returned
    /// once, by the renderer's next call, as [`GpuError::Refused`].
    pub const fn device(&self) -> &wgpu::Device {
        &self.context.device
    }

    /// The device's queue.
    pub const fn queue(&self) -> &wgpu::Queue {
        &self.context.queue
    }

    /// Tests the device: compares an image and its gradients with the reference.
    ///
    /// # Errors
    /// [`GpuError::SelfTest`] for wrong results, and any error of the driver.
    pub fn self_test(&mut self) -> Result<(), GpuError> {
        let adapter = self.context.name.clone();
        catch_panics(&adapter, || self_test::self_test(self, &|_stage| ()))
    }

    /// Frees the buffers that are kept for reuse.
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
        context.guarded(|| Ok(GpuGaussians::upload(context, &mut Pool::default(), gaussians, MAX_SH_DEGREE)?))
    }

    /// Renders Gaussians on the device into buffers that stay there. Only the number of (tile, Gaussian) pairs is read
    /// back, and the lengths of the tile lists if one may be very long. Stages are not timed, because it does not
    /// wait for the device.
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
            let mut allocate = |_: &mut Pool, name, _, bytes| context.buffer(name, bytes);
            let job = Job { gaussians, view, options };
            let rendering = render::record(&mut recorder, pool, limits, job, &mut allocate)?;
            recorder.submit();
            Ok(rendering)
        })
    }

    /// Backward pass for Gaussians and image gradients on the device, into buffers that stay there. Non-finite image
    /// gradients are not detected: the results become 0 or the largest f32. Stages are not timed.
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
            let mut allocate = |_: &mut Pool, name, _, bytes| context.buffer(name, bytes);
            let job = Job { gaussians, view, options };
            let gradients = backward::record(&mut recorder, pool, limits, job, images, &mut allocate)?;
            recorder.submit();
            Ok(gradients)
        })
    }

    /// Largest number of Gaussians per part that the adapter can bind.
    pub fn part_length(&self, sh_degree: u8) -> usize {
        gaussians::part_length(&self.context, sh_degree)
    }

    /// First row and number of rows of each strip that an image is split into.
    ///
    /// # Errors
    /// [`SplatError::View`] for an empty image or one with more than 65 535 pixels per side; [`GpuError::TooLarge`] if
    /// the adapter cannot bind 16 of its rows.
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

    /// Copies gradients to the host; `gaussians` must have the size and arrays that they were computed for.
    ///
    /// # Errors
    /// [`SplatError::Length`] if the Gaussians differ in number or SH degree, or in whether they have scalars;
    /// [`SplatError::Gpu`].
    pub fn read_gradients(
        &self,
        gradients: &GpuGradients,
        gaussians: &Gaussians,
    ) -> Result<Gradients<f32>, SplatError> {
        self.context.guarded(|| gradients.read(&self.context, gaussians))
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
        let start = Instant::now();
        self.stages.clear();
        self.pool.begin_frame();
        let Self { context, pool, pipelines, options: limits, .. } = self;
        let (rendering, timings) = context.guarded(|| {
            options.check_harmonics(gaussians)?;
            check_memory_before_upload(gaussians, view, limits.memory_limit)?;
            // No Gaussian keeps a band above the packed degree, so that dropping it is within the packed bound.
            let packed = options.harmonics.as_ref().map_or(MAX_SH_DEGREE, |packed| packed.degree());
            let degree = options.max_sh_degree.min(packed);
            let resident = GpuGaussians::upload(context, pool, gaussians, degree)?;
            let mut recorder = Recorder::new(context, pipelines);
            let mut allocate = |pool: &mut Pool, name, part, bytes| pool.get(context, name, part, bytes);
            let job = Job { gaussians: &resident, view, options };
            let rendering = render::record(&mut recorder, pool, limits, job, &mut allocate)?;
            let timings = recorder.finish()?;
            Ok::<_, SplatError>((rendering.read(context)?, timings))
        })?;
        self.stages = stages(&timings, start.elapsed().as_secs_f64());
        Ok(rendering)
    }

    fn backward(
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
        let (gradients, timings) = context.guarded(|| {
            check_memory_before_upload(gaussians, view, limits.memory_limit)?;
            let resident = GpuGaussians::upload(context, pool, gaussians, MAX_SH_DEGREE)?;
            view.optics(&options.constants)?;
            let images = GpuImageGradients::upload(context, pool, view, &images::strips(context, view)?, images)?;
            let mut recorder = Recorder::new(context, pipelines);
            let mut allocate = |pool: &mut Pool, name, part, bytes| pool.get(context, name, part, bytes);
            let job = Job { gaussians: &resident, view, options };
            let gradients = backward::record(&mut recorder, pool, limits, job, &images, &mut allocate)?;
            let timings = recorder.finish()?;
            Ok::<_, SplatError>((gradients.read(context, gaussians)?, timings))
        })?;
        self.stages = stages(&timings, start.elapsed().as_secs_f64());
        Ok(gradients)
    }

    fn stages(&self) -> Vec<Stage> {
        self.stages.clone()
    }
}

/// Sums the stages by name, in order of execution; a single stage `whole` if the device cannot time them.
fn stages(timings: &[(&'static str, f64)], whole: f64) -> Vec<Stage> {
    let mut stages: Vec<Stage> = Vec::new();
    for (name, secs) in timings {
        match stages.iter_mut().find(|stage| stage.name == *name) {
            Some(stage) => stage.secs += secs,
            None => stages.push(Stage { name, secs: *secs }),
        }
    }
    if stages.is_empty() { vec![Stage { name: "whole", secs: whole }] } else { stages }
}
