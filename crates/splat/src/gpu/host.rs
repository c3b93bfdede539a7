//! Rendering for the host: Gaussians are copied to the device, and results back.

use std::time::Instant;

use super::context::Context;
use super::gaussians::GpuGaussians;
use super::job::Job;
use super::kernels::Pool;
use super::render::{self, check_memory_before_upload};
use super::{
    GpuCounts, GpuGradients, GpuImageGradients, GpuOptions, GpuRenderer, GpuRendering, ScreenGradients, backward,
    images, status,
};
use crate::cpu::Scaled;
use crate::{
    Gaussians, Gradients, ImageGradients, MAX_SH_DEGREE, RenderOptions, Renderer, Rendering, SplatError, Stage, View,
};

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
        self.rendered(view, options, &|context, pool, limits| {
            options.check_harmonics(gaussians)?;
            check_memory_before_upload(gaussians, view, limits.memory_limit)?;
            // No Gaussian keeps a band above the packed degree, so that dropping it is within the packed bound.
            let packed = options.harmonics.as_ref().map_or(MAX_SH_DEGREE, |packed| packed.degree());
            let degree = options.sh_degree(packed);
            Ok(GpuGaussians::upload(context, pool, gaussians, degree)?)
        })
    }

    fn backward(
        &mut self,
        gaussians: &Gaussians,
        view: &View,
        options: &RenderOptions,
        images: &ImageGradients<f32>,
    ) -> Result<Gradients<f32>, SplatError> {
        Ok(self.differentiate(Inputs { gaussians, uploaded: None, view, options, images }, None)?.0)
    }

    fn stages(&self) -> Vec<Stage> {
        self.stages.clone()
    }

    fn device_counts(&self) -> Option<GpuCounts> {
        Some(self.counts())
    }

    fn on_adapter(&mut self) -> Option<&mut GpuRenderer> {
        Some(self)
    }
}

/// Gaussians on the host, and their copy by [`GpuRenderer::upload`].
#[derive(Clone, Copy, Debug)]
pub struct Uploaded<'a> {
    /// On the host.
    pub host: &'a Gaussians,
    /// On the device.
    pub device: &'a GpuGaussians,
}

/// Inputs of a backward pass, on the host.
#[derive(Clone, Copy)]
struct Inputs<'a> {
    gaussians: &'a Gaussians,
    /// Their copy on the device, if there is one.
    uploaded: Option<&'a GpuGaussians>,
    view: &'a View,
    options: &'a RenderOptions,
    images: &'a ImageGradients<f32>,
}

/// Whether absolute gradients of the projected means are requested.
#[derive(Clone, Copy)]
struct Absolute(bool);

/// Copies Gaussians to the device, or finds those that are there.
type Copied<'a> = &'a dyn Fn(&Context, &mut Pool, &GpuOptions) -> Result<GpuGaussians, SplatError>;

impl GpuRenderer {
    /// As [`Renderer::render`], of Gaussians that are on the device.
    ///
    /// # Errors
    /// As [`Renderer::render`].
    pub fn render_uploaded(
        &mut self,
        gaussians: &GpuGaussians,
        view: &View,
        options: &RenderOptions,
    ) -> Result<Rendering<f32>, SplatError> {
        self.rendered(view, options, &|_, _, _| Ok(gaussians.clone()))
    }

    fn rendered(
        &mut self,
        view: &View,
        options: &RenderOptions,
        gaussians: Copied<'_>,
    ) -> Result<Rendering<f32>, SplatError> {
        let start = Instant::now();
        let mut work = self.work();
        let context = work.context;
        let (rendering, timings) = context.guarded(|| {
            let resident = gaussians(context, work.pool, work.limits)?;
            let job = Job::of_view(&resident, view, options);
            render::check(context, work.limits, job)?;
            let mut allocate = |pool: &mut Pool, name, part, bytes| pool.get(context, name, part, bytes);
            let images = GpuRendering::allocate(context, work.pool, job, &mut allocate)?;
            let report = work.pool.get(context, "report", 0, status::BYTES)?;
            let (counts, finished) = work.run(&report, &images.sources(), &|recorder, resources| {
                render::record(recorder, resources, job, &images)
            })?;
            Ok::<_, SplatError>((images.arrange(&finished.contents, counts), finished.timings))
        })?;
        self.stages = stages(&timings, start.elapsed().as_secs_f64());
        Ok(rendering)
    }

    /// As [`Renderer::backward`], with what density control needs; absolute gradients of the projected means only if
    /// `absolute`.
    ///
    /// # Errors
    /// As [`Renderer::backward`]; [`SplatError::Length`] for a copy of other Gaussians, and for gradients of depth or scalar
    /// together with absolute ones, which is not supported.
    pub fn backward_with_screen(
        &mut self,
        Uploaded { host, device }: Uploaded<'_>,
        view: &View,
        options: &RenderOptions,
        images: &ImageGradients<f32>,
        absolute: bool,
    ) -> Result<(Gradients<f32>, ScreenGradients), SplatError> {
        if absolute {
            images.check_colour_only()?;
        }
        let inputs = Inputs { gaussians: host, uploaded: Some(device), view, options, images };
        let (gradients, screen) = self.differentiate(inputs, Some(Absolute(absolute)))?;
        Ok((gradients, ScreenGradients::new(screen)))
    }

    /// The backward pass; pairs of [`ScreenGradients`] if they are requested.
    fn differentiate(
        &mut self,
        Inputs { gaussians, uploaded, view, options, images }: Inputs<'_>,
        screen: Option<Absolute>,
    ) -> Result<(Gradients<f32>, Vec<[f32; 2]>), SplatError> {
        let start = Instant::now();
        let largest = images.check(view)?;
        options.check()?;
        // Scaling passes the gradients through the exposure.
        let Scaled { images, unit } = Scaled::of(images, largest, options);
        let options = &RenderOptions { exposure: None, ..options.clone() };
        let mut work = self.work();
        let context = work.context;
        let (gradients, timings) = context.guarded(|| {
            let resident = if let Some(uploaded) = uploaded {
                uploaded.clone()
            } else {
                check_memory_before_upload(gaussians, view, work.limits.memory_limit)?;
                GpuGaussians::upload(context, work.pool, gaussians, MAX_SH_DEGREE)?
            };
            view.optics(&options.constants)?;
            let strips = images::strips(context, view, 1)?;
            let images = GpuImageGradients::upload(context, work.pool, view, &strips, &images)?;
            let job = Job::of_view(&resident, view, options);
            backward::check(context, work.limits, job, &images)?;
            let mut allocate = |pool: &mut Pool, name, part, bytes| pool.get(context, name, part, bytes);
            let made = GpuGradients::allocate(work.pool, &resident, screen.is_some(), &mut allocate)?;
            let report = work.pool.get(context, "report", 0, status::BYTES)?;
            let absolute = screen.is_some_and(|Absolute(absolute)| absolute);
            let (_, finished) = work.run(&report, &made.sources(), &|recorder, resources| {
                backward::record(recorder, resources, job, (&images, &made, absolute))
            })?;
            made.check(gaussians)?;
            Ok::<_, SplatError>((made.arrange(&finished.contents, gaussians, unit), finished.timings))
        })?;
        self.stages = stages(&timings, start.elapsed().as_secs_f64());
        Ok(gradients)
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
