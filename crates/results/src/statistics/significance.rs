//! Student's and the normal distribution, and the sign test.

use std::f64::consts::{FRAC_2_PI, FRAC_PI_2, PI};

/// Quantile of Student's distribution with `freedom` ≥ 1 degrees for a probability in (0.5, 1).
pub fn student_quantile(probability: f64, freedom: usize) -> f64 {
    let within = 2.0 * probability - 1.0;
    let root = (freedom.clamp(1, usize::MAX) as f64).sqrt();
    // Bisection of the angle whose tangent is t / √freedom, in [0, π/2]; 60 steps resolve every bit.
    let (mut low, mut high) = (0.0, FRAC_PI_2);
    for _ in 0..60 {
        let middle = f64::midpoint(low, high);
        if probability_within(middle, freedom) < within {
            low = middle;
        } else {
            high = middle;
        }
    }
    root * f64::midpoint(low, high).tan()
}

/// Probability that |t| is at most `√freedom · tan(angle)` (Abramowitz and Stegun 26.7.3 and 26.7.4).
fn probability_within(angle: f64, freedom: usize) -> f64 {
    let (sine, cosine) = angle.sin_cos();
    let squared = cosine * cosine;
    let odd = freedom % 2 == 1;
    // sin·(1 + 1/2·cos² + 1·3/2·4·cos⁴ …) for even degrees, sin·cos·(1 + 2/3·cos² …) for odd ones.
    let (mut term, mut series) = (1.0, 0.0);
    let mut step = if odd { 3 } else { 2 };
    while step <= freedom {
        series += term;
        term *= squared * (step - 1) as f64 / step as f64;
        step += 2;
    }
    if odd { FRAC_2_PI * (angle + sine * cosine * series) } else { sine * series }
}

/// Probability that a standard normal variable exceeds `value` ≥ 1 (Laplace's continued fraction; 200 terms are exact to
/// the last bit in this range).
pub(super) fn normal_tail(value: f64) -> f64 {
    let fraction = (1..=200u32).rev().fold(value, |fraction, term| value + f64::from(term) / fraction);
    (-0.5 * value * value).exp() / ((2.0 * PI).sqrt() * fraction)
}

/// Exact two-sided binomial test without ties: the probability, if both sides are equally likely to win, of a score at least
/// as uneven as this one. 1 without wins and losses.
pub fn sign_test(wins: u64, losses: u64) -> f64 {
    let (fewer, games) = (wins.min(losses), wins + losses);
    if games == 0 {
        return 1.0;
    }
    // ln of (games choose fewer) / 2^games; the probabilities of lower scores follow by their ratios.
    let choices: f64 = (1..=fewer).map(|k| ((games - fewer + k) as f64 / k as f64).ln()).sum();
    let likeliest = choices - games as f64 * std::f64::consts::LN_2;
    let (mut ratio, mut sum) = (1.0, 1.0);
    for k in (1..=fewer).rev() {
        ratio *= k as f64 / (games - k + 1) as f64;
        sum += ratio;
        if ratio < f64::EPSILON * sum {
            break;
        }
    }
    let both = 2.0 * likeliest.exp() * sum;
    if both < 1.0 { both } else { 1.0 }
}
