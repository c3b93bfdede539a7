use super::{Loss, Stack};

/// Structural dissimilarity, as a mean and per pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct DSsim {
    /// The mean of `1 − SSIM`, and its gradient.
    pub loss: Loss,
    /// `1 − SSIM` at each pixel, mean of its channels: the target of the predicted uncertainty.
    pub map: Vec<f32>,
}

/// `1 − SSIM` as 3DGS's training computes it: [`atsplat_metrics::DSsim`], averaged over pixels, channels and views.
pub fn d_ssim(render: &[f32], truth: &[f32], stack: Stack) -> DSsim {
    let per_view = (stack.pixels() * 3).max(1);
    let (mut of_view, mut of_this) = (atsplat_metrics::DSsim::default(), Vec::new());
    let (mut sum, mut gradient, mut map) = (0.0, Vec::with_capacity(render.len()), Vec::new());
    let count = stack.samples() as f64;
    #[expect(clippy::cast_possible_truncation, reason = "gradients are f32")]
    let weight = count.recip() as f32;
    for (render, truth) in render.chunks_exact(per_view).zip(truth.chunks_exact(per_view)) {
        sum += of_view.evaluate(render, truth, [stack.width, stack.height], &mut of_this);
        gradient.extend(of_this.iter().map(|value| weight * value));
        map.extend(of_view.values().as_chunks::<3>().0.iter().map(|[r, g, b]| (r + g + b) / 3.0));
    }
    DSsim { loss: Loss { value: sum / count, gradient }, map }
}
