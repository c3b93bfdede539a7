use pulp::Arch;
use rayon::prelude::*;

use super::blur::Blur;
use super::{Loss, Stack};

const C1: f64 = 0.01 * 0.01;
const C2: f64 = 0.03 * 0.03;

/// Structural dissimilarity, as a mean and per pixel.
#[derive(Clone, Debug, PartialEq)]
pub struct DSsim {
    /// The mean of `1 − SSIM`, and its gradient.
    pub loss: Loss,
    /// `1 − SSIM` at each pixel, mean of its channels: the target of the predicted uncertainty.
    pub map: Vec<f32>,
}

/// `1 − SSIM` as 3DGS's training computes SSIM (graphdeco-inria/gaussian-splatting `utils/loss_utils.py`): an 11×11
/// Gaussian window, black outside the picture, variances of the population.
pub fn d_ssim(render: &[f32], truth: &[f32], stack: Stack) -> DSsim {
    let per_view = (stack.pixels() * 3).max(1);
    let views: Vec<View> = render
        .par_chunks_exact(per_view)
        .zip(truth.par_chunks_exact(per_view))
        .map(|(render, truth)| Arch::new().dispatch(|| view(render, truth, stack)))
        .collect();
    let count = stack.samples() as f64;
    #[expect(clippy::cast_possible_truncation, reason = "gradients and maps are f32")]
    let f32s = |of: fn(&View) -> &[f64], scale: f64| {
        views.iter().flat_map(|view| of(view).iter().map(|value| (value * scale) as f32)).collect::<Vec<f32>>()
    };
    let sum: f64 = views.iter().map(|view| view.sum).sum();
    DSsim {
        loss: Loss { value: sum / count, gradient: f32s(|view| &view.gradient, 1.0 / count) },
        map: f32s(|view| &view.map, 1.0),
    }
}

/// The result for one picture: the sum of `1 − SSIM`, its gradient, and its mean over channels.
struct View {
    sum: f64,
    gradient: Vec<f64>,
    map: Vec<f64>,
}

#[inline]
fn view(render: &[f32], truth: &[f32], stack: Stack) -> View {
    let length = render.len();
    let mut blur = Blur::new(stack.height, stack.width);
    let mut input = vec![0.0; length];
    let mut blurred = |terms: &mut dyn Iterator<Item = f64>| {
        input.iter_mut().zip(terms).for_each(|(slot, term)| *slot = term);
        let mut out = vec![0.0; length];
        blur.run(&input, &mut out);
        out
    };
    let x = || render.iter().map(|x| f64::from(*x));
    let y = || truth.iter().map(|y| f64::from(*y));
    let (mean_x, mean_y) = (blurred(&mut x()), blurred(&mut y()));
    let squares = blurred(&mut x().zip(y()).map(|(x, y)| x * x + y * y));
    let products = blurred(&mut x().zip(y()).map(|(x, y)| x * y));

    let mut dissimilar = vec![0.0; length];
    // Derivatives of 1 − SSIM with respect to the blurred x, x² and xy.
    let [mut by_mean, mut by_square, mut by_product] = [(); 3].map(|()| vec![0.0; length]);
    for at in 0..length {
        let (mx, my) = (mean_x[at], mean_y[at]);
        let (means, cross) = (mx * mx + my * my, mx * my);
        let (a1, a2) = (2.0 * cross + C1, 2.0 * (products[at] - cross) + C2);
        let (b1, b2) = (means + C1, squares[at] - means + C2);
        let (over, similarity) = (1.0 / (b1 * b2), a1 * a2 / (b1 * b2));
        dissimilar[at] = 1.0 - similarity;
        by_mean[at] = 2.0 * (mx * similarity * (1.0 / b1 - 1.0 / b2) - my * (a2 - a1) * over);
        by_square[at] = similarity / b2;
        by_product[at] = -2.0 * a1 * over;
    }
    let mut gradient = blurred(&mut by_mean.into_iter());
    let square = blurred(&mut by_square.into_iter());
    let product = blurred(&mut by_product.into_iter());
    for (at, slot) in gradient.iter_mut().enumerate() {
        *slot += 2.0 * f64::from(render[at]) * square[at] + f64::from(truth[at]) * product[at];
    }
    let map = dissimilar.as_chunks::<3>().0.iter().map(|[r, g, b]| (r + g + b) / 3.0).collect();
    View { sum: dissimilar.iter().sum(), gradient, map }
}
