use super::Loss;

/// Mean absolute difference between the rendered uncertainty and the error map, which is a constant (paper,
/// "Learning uncertainty in 2D space"). Both have one value per pixel.
pub fn uncertainty(rendered: &[f32], error_map: &[f32]) -> Loss {
    let count = rendered.len() as f64;
    let mut sum = 0.0;
    let signs = rendered.iter().zip(error_map).map(|(rendered, error)| {
        let difference = f64::from(*rendered) - f64::from(*error);
        sum += difference.abs();
        // As in PyTorch, the gradient is 0 where they are equal.
        #[expect(clippy::cast_possible_truncation, reason = "gradients are f32")]
        let gradient = match difference.partial_cmp(&0.0) {
            Some(std::cmp::Ordering::Greater) => (1.0 / count) as f32,
            Some(std::cmp::Ordering::Less) => (-1.0 / count) as f32,
            Some(std::cmp::Ordering::Equal) => 0.0,
            None => f32::NAN,
        };
        gradient
    });
    let gradient = signs.collect();
    Loss { value: sum / count, gradient }
}
