use atsplat_numeric::Extremes as _;

/// Decay of the average at a step, counted from 0: `decay`, but less in the first steps, when the initial weights would
/// outweigh the later ones.
pub fn warmed_up(decay: f64, step: u64) -> f64 {
    decay.minimum_of((1.0 + step as f64) / (10.0 + step as f64))
}

/// Updates an exponential moving average.
pub fn average(mean: &mut [f32], values: &[f32], decay: f64) {
    for (mean, value) in mean.iter_mut().zip(values) {
        let moved = f64::from(*mean) + (1.0 - decay) * (f64::from(*value) - f64::from(*mean));
        #[expect(clippy::cast_possible_truncation, reason = "weights are f32")]
        {
            *mean = moved as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use atsplat_numeric::Tolerance;

    #[test]
    fn past_values_decay_by_powers() {
        let (mut mean, history) = (vec![1.0f32, -2.0], [[3.0f32, 0.0], [5.0, 1.0], [-4.0, 8.0]]);
        for values in &history {
            average(&mut mean, values, 0.75);
        }
        let [a, b, c] = history.map(|values| values.map(f64::from));
        let expected = [(1.0, 0), (-2.0, 1)].map(|(first, at): (f64, usize)| {
            0.75f64.powi(3) * first + 0.25 * (0.75f64.powi(2) * a[at] + 0.75 * b[at] + c[at])
        });
        Tolerance::relative(1e-6).assert(mean.into_iter().map(f64::from), expected, "average");
    }

    #[test]
    fn the_decay_is_smaller_in_the_first_steps() {
        let found: Vec<f64> = [0, 8, 1_000_000].map(|step| warmed_up(0.999, step)).to_vec();
        Tolerance::relative(1e-12).assert(found, [0.1, 0.5, 0.999], "decay");
    }
}
