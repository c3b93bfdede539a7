//! Rendering on the CPU: tensors of any backend are copied to the host and back.

use std::sync::{Arc, Mutex, PoisonError};

use atsplat_splat::cpu::{CpuRenderer, Recording};
use atsplat_splat::{
    GaussianCounts, GaussianParts, Gaussians, Gradients, ImageGradients, Rendering, SplatError, View, sh_coefficients,
};
use burn::backend::tensor::{Device, FloatTensor};
use burn::backend::{Backend, Flex, TensorMetadata};
use burn::tensor::{Shape, TensorData, try_read_sync};

use super::{INPUTS, Inputs, RenderBackend, Request};

/// One recording per view; those of a scene share its Gaussians.
pub(super) type Recorded = Arc<Mutex<Vec<Recording<Arc<Gaussians>>>>>;

impl RenderBackend for Flex {
    type Recorded = Recorded;

    fn render(inputs: Inputs<Self>, request: &Request) -> FloatTensor<Self> {
        render::<Self>(inputs, request)
    }

    fn record(inputs: Inputs<Self>, request: &Request) -> (Recorded, FloatTensor<Self>) {
        record::<Self>(inputs, request)
    }

    fn differentiate(
        recorded: Recorded,
        images: FloatTensor<Self>,
        shapes: &[Shape; INPUTS],
        request: &Request,
    ) -> Inputs<Self> {
        differentiate::<Self>(&recorded, images, shapes, request)
    }
}

pub(super) fn render<B: Backend>(inputs: Inputs<B>, request: &Request) -> FloatTensor<B> {
    let device = inputs[0].device();
    let render = |(gaussians, views): (Gaussians, &[View])| {
        CpuRenderer::default().render_many(&gaussians, views, &request.options)
    };
    let rendered = scenes::<B>(inputs, request).and_then(|scenes| {
        let scenes = scenes.into_iter().zip(request.views_by_scene());
        Ok(scenes.map(render).collect::<Result<Vec<_>, SplatError>>()?.concat())
    });
    let images = rendered.map(|images| images.iter().map(|image| (image.counts, request.interleaved(image))).unzip());
    tensor::<B>(request.finish(images), request.shape(), &device)
}

pub(super) fn record<B: Backend>(inputs: Inputs<B>, request: &Request) -> (Recorded, FloatTensor<B>) {
    let device = inputs[0].device();
    let recorded = scenes::<B>(inputs, request).and_then(|scenes| {
        let mut renderer = CpuRenderer::default();
        let mut recordings = Vec::new();
        for (gaussians, views) in scenes.into_iter().zip(request.views_by_scene()) {
            let gaussians = Arc::new(gaussians);
            for view in views {
                recordings.push(renderer.record(Arc::clone(&gaussians), view, &request.options)?);
            }
        }
        Ok(recordings)
    });
    let (recordings, images) = match recorded {
        Ok(recordings) => {
            let images = recordings.iter().map(Recording::rendering);
            let images = images.map(|image| (image.counts, request.interleaved(image))).unzip();
            (recordings, request.finish(Ok(images)))
        }
        Err(error) => (Vec::new(), request.finish(Err(error))),
    };
    (Arc::new(Mutex::new(recordings)), tensor::<B>(images, request.shape(), &device))
}

pub(super) fn differentiate<B: Backend>(
    recorded: &Recorded,
    images: FloatTensor<B>,
    shapes: &[Shape; INPUTS],
    request: &Request,
) -> Inputs<B> {
    let device = images.device();
    let mut recordings = recorded.lock().unwrap_or_else(PoisonError::into_inner);
    let mut gradients = gradients(&mut recordings, numbers::<B>(images), request)
        .inspect_err(|reason| request.set_backward_failure(reason.clone()));
    std::array::from_fn(|input| {
        let shape = shapes[input].clone();
        let numbers = match &mut gradients {
            Err(_) => vec![f32::NAN; shape.num_elements()],
            // No scalars were rendered, so nothing depends on them.
            Ok(all) if all[input].is_empty() => vec![0.0; shape.num_elements()],
            Ok(all) => std::mem::take(&mut all[input]),
        };
        B::float_from_data(TensorData::new(numbers, shape), &device)
    })
}

/// Gradients with respect to each input, or why there are none; `pixels` are those with respect to the images.
fn gradients(
    recordings: &mut [Recording<Arc<Gaussians>>],
    pixels: Option<Vec<f32>>,
    request: &Request,
) -> Result<[Vec<f32>; INPUTS], String> {
    let pixels = pixels.ok_or("the gradients of the images cannot be read from their device")?;
    let [images, height, width, channels] = request.shape();
    let per_image = height * width * channels;
    let (recorded, given) = (recordings.len(), pixels.len());
    if recorded != images || given != images * per_image {
        let expected = format!("{images} images of {per_image} numbers");
        return Err(format!("gradients of images: expected {expected}, found {recorded} images and {given} numbers"));
    }
    let mut recorded = recordings.iter_mut().zip(pixels.chunks_exact(per_image.max(1)));
    let mut all: [Vec<f32>; INPUTS] = Default::default();
    for views in request.views_by_scene() {
        let mut sums: [Vec<f32>; INPUTS] = Default::default();
        // Views are summed in their order.
        for (recording, pixels) in recorded.by_ref().take(views.len()) {
            let gradients = recording.backward(&request.image_gradients(pixels));
            add(&mut sums, gradients.map_err(|error| error.to_string())?);
        }
        all.iter_mut().zip(sums).for_each(|(all, sum)| all.extend(sum));
    }
    Ok(all)
}

/// The Gaussians of each scene in the format of the CPU renderer, checked.
#[expect(clippy::expect_used, reason = "as burn, which panics if a tensor cannot be read from its device")]
pub(super) fn scenes<B: Backend>(inputs: Inputs<B>, request: &Request) -> Result<Vec<Gaussians>, SplatError> {
    let [means, quaternions, log_scales, opacity_logits, sh, scalars] =
        inputs.map(|input| numbers::<B>(input).expect("the numbers of a tensor"));
    let count = opacity_logits.len() / request.scenes.max(1);
    let stored = sh_coefficients(request.sh_degree);
    let of_scene = |scene: usize| {
        Gaussians::new(GaussianParts {
            means: rows(means.as_chunks().0, scene, count),
            quaternions: rows(quaternions.as_chunks().0, scene, count),
            log_scales: rows(log_scales.as_chunks().0, scene, count),
            opacity_logits: rows(&opacity_logits, scene, count),
            sh_degree: request.sh_degree,
            sh: rows(sh.as_chunks().0, scene, count * stored),
            scalars: request.options.channels.scalar.then(|| rows(&scalars, scene, count)),
            filter_3d: None,
        })
    };
    (0..request.scenes).map(of_scene).collect()
}

/// The elements of one scene; each scene has `count`.
fn rows<T: Clone>(all: &[T], scene: usize, count: usize) -> Vec<T> {
    all[scene * count..(scene + 1) * count].to_vec()
}

impl Request {
    /// Sets the outcome and returns the images, or zeros after an error.
    fn finish(&self, images: Result<(Vec<GaussianCounts>, Vec<Vec<f32>>), SplatError>) -> Vec<f32> {
        let (outcome, images) = match images {
            Ok((counts, images)) => (Ok(counts), images.concat()),
            Err(error) => (Err(error), vec![0.0; self.shape().iter().product()]),
        };
        self.set_outcome(outcome);
        images
    }

    fn interleaved(&self, image: &Rendering<f32>) -> Vec<f32> {
        let mut pixels = Vec::with_capacity(image.alpha.len() * self.channels());
        for (at, (rgb, alpha)) in image.rgb.iter().zip(&image.alpha).enumerate() {
            pixels.extend(rgb);
            pixels.push(*alpha);
            let extra = [&image.depth, &image.scalar].into_iter().flatten();
            pixels.extend(extra.filter_map(|image| image.get(at)));
        }
        pixels
    }

    /// Gradients with respect to the images of one view.
    fn image_gradients(&self, pixels: &[f32]) -> ImageGradients<f32> {
        let pixels = || pixels.chunks_exact(self.channels());
        let channel = |at: usize| pixels().map(|pixel| pixel[at]).collect::<Vec<f32>>();
        let depth = self.options.channels.depth;
        ImageGradients {
            rgb: pixels().filter_map(|pixel| pixel.first_chunk().copied()).collect(),
            alpha: Some(channel(3)),
            depth: depth.then(|| channel(4)),
            scalar: self.options.channels.scalar.then(|| channel(4 + usize::from(depth))),
        }
    }
}

fn add(sums: &mut [Vec<f32>; INPUTS], gradients: Gradients<f32>) {
    let Gradients { means, quaternions, log_scales, opacity_logits, sh, scalars, .. } = gradients;
    let parts = [
        means.into_flattened(),
        quaternions.into_flattened(),
        log_scales.into_flattened(),
        opacity_logits,
        sh.into_flattened(),
        scalars,
    ];
    for (sum, part) in sums.iter_mut().zip(parts) {
        if sum.is_empty() {
            *sum = part;
        } else {
            sum.iter_mut().zip(part).for_each(|(sum, part)| *sum += part);
        }
    }
}

fn tensor<B: Backend>(values: Vec<f32>, shape: [usize; 4], device: &Device<B>) -> FloatTensor<B> {
    B::float_from_data(TensorData::new(values, shape), device)
}

/// The tensor's numbers, row-major; `None` if its device failed.
fn numbers<B: Backend>(tensor: FloatTensor<B>) -> Option<Vec<f32>> {
    let data = try_read_sync(B::float_into_data(tensor)).and_then(Result::ok)?;
    data.convert::<f32>().try_into_vec().ok()
}
