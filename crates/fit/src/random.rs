use atsplat_numeric::{SPLIT_MIX_STEP, SplitMix64, split_mix};

/// What random numbers are for; each purpose has a stream.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Purpose {
    Order,
    Background,
    Split,
    Relocation,
    Growth,
    Noise,
    Start,
}

/// A stream that depends on the seed, the purpose and a number (a step, an epoch or a block of Gaussians) alone, so that a
/// resumed run draws what an uninterrupted one would.
pub(crate) fn stream(seed: u64, purpose: Purpose, number: u64) -> SplitMix64 {
    let mixed = |state: u64, value: u64| split_mix(state.wrapping_add(SPLIT_MIX_STEP).wrapping_add(value));
    SplitMix64::new(mixed(mixed(mixed(0, seed), purpose as u64), number))
}

/// Three independent numbers of the standard normal distribution (Box and Muller 1958).
pub(crate) fn normals(random: &mut SplitMix64) -> [f64; 3] {
    let mut pair = || {
        let radius = (-2.0 * (1.0 - random.unit()).ln()).sqrt();
        let (sine, cosine) = (std::f64::consts::TAU * random.unit()).sin_cos();
        [radius * cosine, radius * sine]
    };
    let ([x, y], [z, _]) = (pair(), pair());
    [x, y, z]
}

/// Draws the numbers of [`normals`] without using them.
pub(crate) fn skip_normals(random: &mut SplitMix64) {
    (0..4).for_each(|_| _ = random.next_u64());
}

/// Positions drawn with replacement, with probabilities proportional to the weights; empty if they sum to zero.
pub(crate) fn weighted(random: &mut SplitMix64, weights: impl IntoIterator<Item = f64>, count: usize) -> Vec<usize> {
    let mut total = 0.0;
    let sums: Vec<f64> = weights
        .into_iter()
        .map(|weight| {
            total += weight;
            total
        })
        .collect();
    if !(total > 0.0 && total.is_finite()) {
        return Vec::new();
    }
    let draw = |_| {
        let at = random.unit() * total;
        // A product that rounds up to the total belongs to the last position of positive weight.
        sums.partition_point(|sum| *sum <= at).min(sums.partition_point(|sum| *sum < total))
    };
    (0..count).map(draw).collect()
}

#[cfg(test)]
mod tests {
    use atsplat_numeric::Tolerance;

    use super::*;

    #[test]
    fn normals_have_mean_zero_variance_one_and_normal_tails() {
        let mut random = stream(1, Purpose::Noise, 0);
        let draws: Vec<f64> = (0..20_000).flat_map(|_| normals(&mut random)).collect();
        let moment = |power: i32| draws.iter().map(|draw| draw.powi(power)).sum::<f64>() / draws.len() as f64;
        let close = |absolute| Tolerance { absolute, relative: 0.0 };
        close(0.02).assert([moment(1)], [0.0], "mean");
        close(0.03).assert([moment(2)], [1.0], "variance");
        close(0.15).assert([moment(4)], [3.0], "kurtosis");
    }

    #[test]
    fn skipped_normals_leave_the_stream_where_drawn_ones_do() {
        let [mut drawn, mut skipped] = [(); 2].map(|()| stream(1, Purpose::Noise, 3));
        normals(&mut drawn);
        skip_normals(&mut skipped);
        assert_eq!(drawn.next_u64(), skipped.next_u64());
    }

    #[test]
    fn weighted_draws_follow_the_weights() {
        let mut random = stream(2, Purpose::Relocation, 7);
        let draws = weighted(&mut random, [1.0, 0.0, 3.0], 8000);
        let share = draws.iter().filter(|position| **position == 2).count() as f64 / 8000.0;
        Tolerance { absolute: 0.02, relative: 0.0 }.assert([share], [0.75], "share of the third");
        assert!(!draws.contains(&1), "a weight of zero was drawn");
        assert!(weighted(&mut random, [0.0, 0.0], 5).is_empty());
    }

    #[test]
    fn streams_differ_by_seed_purpose_and_number() {
        let first = |seed, purpose, number| stream(seed, purpose, number).next_u64();
        let all = [
            first(0, Purpose::Order, 0),
            first(1, Purpose::Order, 0),
            first(0, Purpose::Split, 0),
            first(0, Purpose::Order, 1),
        ];
        assert_eq!(std::collections::BTreeSet::from(all).len(), 4);
    }
}
