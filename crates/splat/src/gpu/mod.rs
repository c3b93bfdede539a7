//! The GPU renderer: WGSL compute kernels, through wgpu on Vulkan, Metal, DX12 and GL.
//!
//! A rendering is one submission, and the host waits only for what it reads: the device counts how long lists have to be
//! while it fills them, and a rendering whose lists were too short is repeated with longer ones.
//!
//! Every sum has a fixed order, so that a device gives bit-identical results on every run, however buffers are split to
//! fit its limits. This crate's tests require, for every rule and lens, that 99.99 % of pixels are within 1/255 of the
//! reference, and a PSNR of 60 dB. [`GpuRenderer::new`] tests a driver on one image without thresholds that rounding
//! could cross, to 1e-4, on its gradients, and on a batch of small images: this detects a broken driver, but not errors
//! in rules that the test images do not use.
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
mod bounds;
mod context;
mod counts;
mod error;
mod forward;
mod gaussians;
mod gradients;
mod host;
mod image;
mod images;
mod job;
mod kernels;
mod layout;
mod lists;
mod options;
mod panics;
mod pending;
mod probe;
mod read;
mod record;
mod render;
mod self_test;
mod self_test_batch;
mod self_test_cache;
mod self_test_result;
mod sort;
mod status;
#[cfg(test)]
mod tests;
mod uniforms;
mod windows;
mod work;

pub use adapters::{
    ADAPTER_VARIABLE, AdapterChoice, AdapterDescription, AdapterKind, ExaminedAdapter, adapters, examine, select,
};
pub use counts::GpuCounts;
pub use error::GpuError;
pub use gaussians::{GpuGaussians, GpuPart};
pub use gradients::{GpuGradientPart, GpuGradients, GpuImageGradients, GpuStripGradients, ScreenGradients};
pub use host::Uploaded;
pub use image::{GpuImage, ImageFormat, ImageNumbers};
pub use images::{GpuRendering, GpuStrip};
pub use options::{GpuOptions, GpuOverrides, Threads};
pub use pending::{Pending, Settled};
pub use self_test_cache::SelfTestCache;
pub use self_test_result::{ProbeStage, SelfTestKey, SelfTestObserver, SelfTestResult, WrongResult};

use crate::{Gaussians, MAX_SH_DEGREE, SplatError, Stage, View};
use bounds::Bounds;
use context::Context;
use kernels::{Pipelines, Pool};
use panics::catch_panics;
use render::check_memory;
use work::Work;

/// A renderer on one device, which reuses its buffers from view to view.
#[derive(Debug)]
pub struct GpuRenderer {
    context: Context,
    options: GpuOptions,
    pipelines: Pipelines,
    pool: Pool,
    bounds: Bounds,
    stages: Vec<Stage>,
}

impl GpuRenderer {
    /// Opens an adapter and tests its forward and backward pass against the reference, and a batch against its views one by
    /// one.
    ///
    /// # Errors
    /// [`GpuError`] if there is no such adapter, or it lacks a required capability or fails the test.
    pub fn new(choice: &AdapterChoice, options: GpuOptions) -> Result<Self, GpuError> {
        Self::observed(choice, options, &())
    }

    /// As [`Self::new`], reporting to `observer`; an adapter whose result it has cached is not tested again.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn observed(
        choice: &AdapterChoice,
        options: GpuOptions,
        observer: &dyn SelfTestObserver,
    ) -> Result<Self, GpuError> {
        Self::open(&adapters::choose(choice)?, options, observer)
    }

    /// Opens an adapter, and tests it unless its result is cached.
    fn open(
        (adapter, description): &adapters::Candidate,
        options: GpuOptions,
        observer: &dyn SelfTestObserver,
    ) -> Result<Self, GpuError> {
        let name = description.to_string();
        let known = adapters::cached_result(description, &options, observer);
        tracing::debug!(adapter = name, is_result_cached = known.is_some(), "opening graphics adapter");
        if let Some(result) = &known {
            result.outcome(&name)?;
        }
        catch_panics(&name, || {
            observer.begins(description, ProbeStage::Opening);
            let context = Context::open(adapter, description, &options)?;
            let mut renderer = Self::with_context(context, options)?;
            if known.is_none() {
                let tested = self_test::self_test(&mut renderer, &|stage| observer.begins(description, stage));
                if let (Some(key), Some(result)) =
                    (adapters::cache_key(description, &options), SelfTestResult::of(&tested))
                {
                    observer.store(&key, &result);
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
        let (pool, bounds) = (Pool::default(), Bounds::default());
        Ok(Self { context, options, pipelines, pool, bounds, stages: Vec::new() })
    }

    /// The adapter's name and backend.
    pub fn adapter(&self) -> &str {
        &self.context.name
    }

    /// The device, for sharing buffers. An error that wgpu finds in commands other than this renderer's is returned
    /// once, by the renderer's next call, as [`GpuError::Rejected`]; of commands within [`Self::guarded`], at once.
    pub const fn device(&self) -> &wgpu::Device {
        &self.context.device
    }

    /// The device's queue.
    pub const fn queue(&self) -> &wgpu::Queue {
        &self.context.queue
    }

    /// Tests the device: compares an image and its gradients with the reference, and those of a batch with its views one by
    /// one.
    ///
    /// # Errors
    /// [`GpuError::SelfTest`] for wrong results, and any error of the driver.
    pub fn self_test(&mut self) -> Result<(), GpuError> {
        let adapter = self.context.name.clone();
        catch_panics(&adapter, || self_test::self_test(self, &|_stage| ()))
    }

    /// Runs commands of the caller on the device, and returns the errors that they raise. Outside of it, wgpu panics for an
    /// error on a device opened by the caller without an error handler.
    ///
    /// # Errors
    /// Those of `work`; [`GpuError::OutOfMemory`] and [`GpuError::Rejected`] for an error of its commands,
    /// [`GpuError::Device`] for a lost device.
    pub fn guarded<T>(&self, work: impl FnOnce() -> Result<T, SplatError>) -> Result<T, SplatError> {
        self.context.guarded(work)
    }

    /// Frees the buffers that are kept for reuse.
    pub fn free_buffers(&mut self) {
        self.pool.clear();
        self.pipelines.free_uniforms();
        self.context.free_staging();
    }

    /// What passed between the host and the device since the renderer was opened.
    pub fn counts(&self) -> GpuCounts {
        self.context.counters.counts()
    }

    /// Begins work: buffers of earlier work may be reused, unless some could not be allocated.
    fn work(&mut self) -> Work<'_> {
        if self.context.take_failure() {
            self.free_buffers();
        }
        self.stages.clear();
        self.pool.begin_frame();
        let Self { context, pool, pipelines, options: limits, bounds, .. } = self;
        Work { context, pipelines, pool, limits, bounds }
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
        images::strips(&self.context, view, 1)
    }
}
