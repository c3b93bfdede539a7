use std::f64::consts::{FRAC_2_PI, FRAC_PI_2, PI};

/// The value below which a Student variable of `freedom` ≥ 1 degrees falls with this probability, in (0.5, 1).
pub(crate) fn student_quantile(probability: f64, freedom: usize) -> f64 {
    let within = 2.0 * probability - 1.0;
    let root = (freedom.clamp(1, usize::MAX) as f64).sqrt();
    // The angle whose tangent is t / √freedom lies between 0 and a right one; halving 60 times leaves no bit to decide.
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

/// The probability that |t| is at most `√freedom · tan(angle)` (Abramowitz and Stegun 26.7.3 and 26.7.4).
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

/// The probability that a standard normal variable exceeds `value` ≥ 1 (Laplace's continued fraction, whose terms beyond
/// the two-hundredth change nothing from there on).
pub(super) fn normal_tail(value: f64) -> f64 {
    let fraction = (1..=200u32).rev().fold(value, |fraction, term| value + f64::from(term) / fraction);
    (-0.5 * value * value).exp() / ((2.0 * PI).sqrt() * fraction)
}
