//! The losses of renders: of one sample's with known gradients, or of several samples' as part of the graph.

use atsplat_model::network::{RenderedTensors, f32_values};

use super::Objective;
use super::group::{Group, Run};
use crate::losses::{Stack, d_ssim, graph, mse, uncertainty};

impl Objective {
    pub(super) fn compare_final(
        &self,
        images: &RenderedTensors,
        index: usize,
        stack: Stack,
        perceptual_weight: f64,
        group: &mut Group<'_>,
    ) {
        let truth = &group.samples[index].targets.images;
        let rgb = f32_values(images.rgb.clone());
        let mut loss = mse(&rgb, truth);
        let terms = &mut group.terms[index];
        terms.mse = loss.value;
        if perceptual_weight > 0.0 {
            let perceptual = self.perceptual.evaluate(&rgb, truth, stack);
            terms.perceptual = perceptual.value;
            loss.add(&perceptual, perceptual_weight);
        }
        terms.total += loss.value;
        group.add_of_images(images, Some((loss.gradient.as_slice(), 1.0)), None);
    }

    pub(super) fn compare_final_in_graph(
        &self,
        images: RenderedTensors,
        run: &Run,
        perceptual_weight: f64,
        group: &mut Group<'_>,
    ) {
        let (first, count, truth) = (run.samples.start, run.count(), run.truth(run.stack.views));
        let mse = graph::mse(images.rgb.clone(), truth.clone(), count);
        group.add_in_graph(first, |terms| &mut terms.mse, 1.0, mse);
        if perceptual_weight > 0.0 {
            let perceptual = self.perceptual.in_graph(images.rgb, truth, &run.d_ssim, count);
            group.add_in_graph(first, |terms| &mut terms.perceptual, perceptual_weight, perceptual);
        }
    }

    pub(super) fn compare_intermediate(
        &self,
        images: &RenderedTensors,
        index: usize,
        stack: Stack,
        group: &mut Group<'_>,
    ) {
        #[expect(clippy::expect_used, reason = "the stack has at most all of the sample's targets")]
        let truth = group.samples[index].targets.images.get(..stack.samples()).expect("a prefix of the targets");
        let rgb = f32_values(images.rgb.clone());
        let dissimilarity = d_ssim(&rgb, truth, stack);
        let mut loss = mse(&rgb, truth);
        let terms = &mut group.terms[index];
        terms.intermediate_mse += loss.value;
        terms.intermediate_d_ssim += dissimilarity.loss.value;
        loss.add(&dissimilarity.loss, self.config.intermediate_d_ssim_weight);
        terms.total += self.config.intermediate_weight * loss.value;
        let uncertainty = images.scalar.as_ref().map(|map| {
            let loss = uncertainty(&f32_values(map.clone()), &dissimilarity.map);
            terms.uncertainty += loss.value;
            terms.total += self.config.uncertainty_weight * loss.value;
            loss.gradient
        });
        let weight = self.config.intermediate_weight;
        let rgb = (weight > 0.0).then_some((loss.gradient.as_slice(), weight));
        let scalar = uncertainty.as_deref().map(|gradient| (gradient, self.config.uncertainty_weight));
        group.add_of_images(images, rgb, scalar);
    }

    pub(super) fn compare_intermediate_in_graph(
        &self,
        images: RenderedTensors,
        run: &Run,
        views: usize,
        group: &mut Group<'_>,
    ) {
        let (first, count, truth) = (run.samples.start, run.count(), run.truth(views));
        let map = run.d_ssim.map(images.rgb.clone(), truth.clone());
        let weight = self.config.intermediate_weight;
        let mse = graph::mse(images.rgb, truth, count);
        group.add_in_graph(first, |terms| &mut terms.intermediate_mse, weight, mse);
        let d_ssim = graph::means(map.clone(), count);
        let d_ssim_weight = weight * self.config.intermediate_d_ssim_weight;
        group.add_in_graph(first, |terms| &mut terms.intermediate_d_ssim, d_ssim_weight, d_ssim);
        if let Some(predicted) = images.scalar {
            let error_map = map.mean_dim(1).squeeze_dim::<3>(1);
            let loss = graph::uncertainty(predicted, error_map, count);
            group.add_in_graph(first, |terms| &mut terms.uncertainty, self.config.uncertainty_weight, loss);
        }
    }
}
