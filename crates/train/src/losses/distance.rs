use super::Loss;

/// Mean absolute difference between the logarithms of predicted and exact distances, both positive, one value per patch.
/// Patches whose exact distance is infinite (sky) count for nothing; without any other patch the loss is 0.
pub fn log_distance(predicted: &[f32], exact: &[f32]) -> Loss {
    let count = exact.iter().filter(|exact| exact.is_finite()).count().max(1) as f64;
    let mut sum = 0.0;
    let slope = |(predicted, exact): (&f32, &f32)| {
        if *exact == f32::INFINITY {
            return 0.0;
        }
        let (predicted, exact) = (f64::from(*predicted), f64::from(*exact));
        let difference = predicted.ln() - exact.ln();
        sum += difference.abs();
        // As in PyTorch, the gradient is 0 where they are equal.
        let sign = if difference == 0.0 { 0.0 } else { difference.signum() };
        #[expect(clippy::cast_possible_truncation, reason = "gradients are f32")]
        let slope = (sign / (predicted * count)) as f32;
        slope
    };
    let gradient = predicted.iter().zip(exact).map(slope).collect();
    Loss { value: sum / count, gradient }
}

#[cfg(test)]
mod tests {
    use atsplat_numeric::Tolerance;

    use super::*;

    /// By hand: (|ln 2| + |ln ½| + 0) / 3; slopes ±1 / (3 · predicted).
    #[test]
    fn too_far_is_pulled_nearer_and_too_near_further() {
        let loss = log_distance(&[4.0, 3.0, 7.0, 5.0], &[2.0, 6.0, f32::INFINITY, 5.0]);
        let close = Tolerance::relative(1e-6);
        close.assert([loss.value], [2.0 * 2f64.ln() / 3.0], "value");
        let expected = [1.0 / (3.0 * 4.0), -1.0 / (3.0 * 3.0), 0.0, 0.0];
        close.assert(loss.gradient.iter().copied().map(f64::from), expected, "gradient");
        assert_eq!(log_distance(&[4.0], &[f32::INFINITY]), Loss { value: 0.0, gradient: vec![0.0] });
        assert!(log_distance(&[f32::NAN], &[2.0]).value.is_nan(), "NaN is not hidden");
    }
}
