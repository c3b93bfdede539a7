use crate::config::{Grid, PositionInterpolation};

/// Resizes a square grid of vectors to another grid, as the published variants of DINOv2 do.
pub(super) fn resized_grid(values: &[f32], side: usize, grid: Grid, rule: PositionInterpolation) -> Vec<f32> {
    let dim = values.len() / (side * side);
    let (rows, columns) = (taps(side, grid.rows, rule), taps(side, grid.columns, rule));
    let mut resized = Vec::with_capacity(grid.len() * dim);
    for row in &rows {
        for column in &columns {
            let start = resized.len();
            resized.resize(start + dim, 0.0f32);
            for &(y, weight_y) in row {
                for &(x, weight_x) in column {
                    #[expect(clippy::cast_possible_truncation, reason = "embeddings are f32")]
                    let weight = (weight_y * weight_x) as f32;
                    let from = &values[(y * side + x) * dim..];
                    for (sum, value) in resized.iter_mut().skip(start).zip(from) {
                        *sum += weight * value;
                    }
                }
            }
        }
    }
    resized
}

/// Input indices and weights of each output sample.
fn taps(from: usize, to: usize, rule: PositionInterpolation) -> Vec<Vec<(usize, f64)>> {
    let last = from.saturating_sub(1);
    let sample = |at: usize| match rule {
        PositionInterpolation::OffsetBicubic => {
            // Four taps around the source coordinate, clamped at the border.
            let source = (at as f64 + 0.5) * from as f64 / (to as f64 + 0.1) - 0.5;
            let before = source.floor();
            (-1..3i32)
                .map(|tap| {
                    let position = before + f64::from(tap);
                    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a small whole number")]
                    let index = if position > 0.0 { (position as usize).min(last) } else { 0 };
                    (index, cubic(source - position, -0.75))
                })
                .collect()
        }
        PositionInterpolation::AntialiasedBicubic => {
            let scale = from as f64 / to as f64;
            let stretch = if scale > 1.0 { scale } else { 1.0 };
            let centre = (at as f64 + 0.5) * scale;
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "not negative, and small")]
            let [first, end] = [centre - 2.0 * stretch + 0.5, centre + 2.0 * stretch + 0.5]
                .map(|bound| if bound > 0.0 { (bound as usize).min(from) } else { 0 });
            let weights: Vec<f64> =
                (first..end).map(|input| cubic((input as f64 - centre + 0.5) / stretch, -0.5)).collect();
            let sum: f64 = weights.iter().sum();
            (first..end).zip(weights).map(|(input, weight)| (input, weight / sum)).collect()
        }
    };
    (0..to).map(sample).collect()
}

/// Cubic convolution kernel of Keys.
fn cubic(x: f64, a: f64) -> f64 {
    let x = x.abs();
    if x <= 1.0 {
        ((a + 2.0) * x - (a + 3.0)) * x * x + 1.0
    } else if x < 2.0 {
        ((a * x - 5.0 * a) * x + 8.0 * a) * x - 4.0 * a
    } else {
        0.0
    }
}
