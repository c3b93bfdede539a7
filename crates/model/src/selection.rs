//! Selection of the tokens that a block expands, as ascending indices, and the order of tokens afterwards.
//!
//! Results are exact and depend only on the arguments; ties go to the lower index.

use std::cmp::Reverse;

use crate::ModelError;
use crate::hash::Stream;

/// The `count` highest scores; ties go to the lower index.
///
/// # Errors
/// [`ModelError::Malformed`] if there are fewer scores, or one is NaN.
pub fn highest(scores: &[f32], count: usize) -> Result<Vec<usize>, ModelError> {
    check(scores)?;
    if count > scores.len() {
        let expected = format!("at most {} tokens to expand", scores.len());
        return Err(ModelError::malformed("selection", "count", expected, count));
    }
    // Adding 0 turns −0 into 0, which `total_cmp` would order apart.
    Ok(first_by(scores.len(), count, |&a, &b| {
        let score = |index: usize| scores[index] + 0.0;
        score(b).total_cmp(&score(a)).then(a.cmp(&b))
    }))
}

/// All scores above a threshold.
///
/// # Errors
/// [`ModelError::Malformed`] if a score is NaN.
pub fn above(scores: &[f32], threshold: f64) -> Result<Vec<usize>, ModelError> {
    check(scores)?;
    let chosen = scores.iter().enumerate().filter(|(_, score)| f64::from(**score) > threshold);
    Ok(chosen.map(|(index, _)| index).collect())
}

/// `count` of `tokens`, or all if there are fewer, drawn without replacement: those with the highest hashes of `keys` and
/// their index.
pub fn random(tokens: usize, count: usize, keys: &[u64]) -> Vec<usize> {
    let stream = Stream::of(keys);
    first_by(tokens, count.min(tokens), |&a, &b| {
        (Reverse(stream.bits(a as u64)), a).cmp(&(Reverse(stream.bits(b as u64)), b))
    })
}

/// The parent of each token after expansion: the unselected tokens in order, then `children` of each selected one in order.
/// `selected` ascends.
pub fn parents(tokens: usize, selected: &[usize], children: usize) -> Vec<usize> {
    let mut chosen = selected.iter().copied().peekable();
    let unselected = (0..tokens).filter(|token| chosen.next_if_eq(token).is_none());
    let mut parents: Vec<usize> = unselected.collect();
    parents.extend(selected.iter().flat_map(|&token| std::iter::repeat_n(token, children)));
    parents
}

/// The first `count` of `0..tokens` by `order`, ascending.
fn first_by(tokens: usize, count: usize, order: impl Fn(&usize, &usize) -> std::cmp::Ordering) -> Vec<usize> {
    let mut indices: Vec<usize> = (0..tokens).collect();
    if count < tokens {
        indices.select_nth_unstable_by(count, order);
        indices.truncate(count);
        indices.sort_unstable();
    }
    indices
}

fn check(scores: &[f32]) -> Result<(), ModelError> {
    match scores.iter().position(|score| score.is_nan()) {
        None => Ok(()),
        Some(token) => Err(ModelError::malformed("selection", format!("score of token {token}"), "a number", "NaN")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn ties_go_to_the_lower_index() {
        assert_eq!(highest(&[1.0, 3.0, 3.0, 3.0, 0.0], 2).unwrap(), [1, 2]);
        assert_eq!(highest(&[0.0, -0.0, 0.0], 2).unwrap(), [0, 1], "the zeros are equal");
        assert_eq!(highest(&[2.0; 5], 5).unwrap(), [0, 1, 2, 3, 4]);
        assert_eq!(highest(&[], 0).unwrap(), [0; 0]);
        assert!(highest(&[1.0], 2).is_err());
    }

    #[test]
    fn nan_is_an_error_that_names_the_token() {
        let error = highest(&[0.0, f32::NAN], 1).unwrap_err().to_string();
        assert!(error.contains("token 1") && error.contains("NaN"), "{error}");
        assert!(above(&[f32::NAN], 0.0).is_err());
    }

    #[test]
    fn thresholds_are_strict() {
        assert_eq!(above(&[0.05, 0.25, 0.5], 0.25).unwrap(), [2]);
        assert_eq!(above(&[0.5, f32::INFINITY], -1.0).unwrap(), [0, 1]);
    }

    #[test]
    fn unselected_come_first_then_children() {
        assert_eq!(parents(5, &[1, 3], 2), [0, 2, 4, 1, 1, 3, 3]);
        assert_eq!(parents(2, &[], 2), [0, 1]);
        assert_eq!(parents(2, &[0, 1], 3), [0, 0, 0, 1, 1, 1]);
    }

    #[test]
    fn random_choices_depend_on_every_key() {
        let chosen = |keys: &[u64]| random(100, 30, keys);
        assert_eq!(chosen(&[1, 2, 3]), chosen(&[1, 2, 3]));
        for other in [&[1, 2, 4][..], &[1, 3, 3], &[2, 2, 3], &[1, 2]] {
            assert_ne!(chosen(&[1, 2, 3]), chosen(other), "{other:?}");
        }
        let mut drawn = [0u32; 20];
        for seed in 0..2000 {
            for token in random(20, 5, &[seed]) {
                drawn[token] += 1;
            }
        }
        // Binomial(2000, 1/4): 500 ± 19; within six standard deviations.
        assert!(drawn.iter().all(|count| (384..617).contains(count)), "{drawn:?}");
    }

    proptest! {
        #[test]
        fn the_highest_are_a_sorted_prefix_of_a_full_sort(
            scores in prop::collection::vec((0u8..6).prop_map(f32::from), 0..60), share in 0.0..=1.0f64,
        ) {
            #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of 60")]
            let count = (share * scores.len() as f64) as usize;
            let mut sorted: Vec<usize> = (0..scores.len()).collect();
            sorted.sort_by(|&a, &b| scores[b].total_cmp(&scores[a]));
            sorted.truncate(count);
            sorted.sort_unstable();
            prop_assert_eq!(highest(&scores, count).unwrap(), sorted);
        }
    }
}
