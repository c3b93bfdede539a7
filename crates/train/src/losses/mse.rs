use super::Loss;

/// Mean squared error over pixels, channels and views.
pub fn mse(render: &[f32], truth: &[f32]) -> Loss {
    let count = render.len() as f64;
    let mut sum = 0.0;
    let differences = render.iter().zip(truth).map(|(render, truth)| {
        let difference = f64::from(*render) - f64::from(*truth);
        sum += difference * difference;
        #[expect(clippy::cast_possible_truncation, reason = "gradients are f32")]
        let gradient = (2.0 * difference / count) as f32;
        gradient
    });
    let gradient = differences.collect();
    Loss { value: sum / count, gradient }
}
