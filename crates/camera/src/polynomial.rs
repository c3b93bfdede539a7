//! Polynomials of lens models: the end of their increasing range, and their inverse.

/// Enough to bisect an interval of 1e8 down to the last bit of the smallest relevant roots.
const BISECTIONS: usize = 120;
/// Far from the root of a power, Newton's method converges linearly: 400 steps cross 20 decades of x⁷.
const NEWTON_STEPS: usize = 400;

/// `coefficients[0] + coefficients[1]·x + …`
pub(crate) fn evaluate(coefficients: &[f64], x: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, coefficient| sum * x + coefficient)
}

/// The first root of a polynomial that is positive at 0, or `upper` if that is smaller.
pub(crate) fn positive_up_to(coefficients: &[f64], upper: f64) -> f64 {
    roots(coefficients, upper).first().copied().unwrap_or(upper)
}

/// All sign changes in (0, `upper`), ascending: between neighbouring extrema, which are the sign changes of the
/// derivative, a polynomial is monotone.
fn roots(coefficients: &[f64], upper: f64) -> Vec<f64> {
    if coefficients.len() < 2 {
        return Vec::new();
    }
    let derivative: Vec<f64> = (1u32..).zip(&coefficients[1..]).map(|(power, c)| f64::from(power) * c).collect();
    let mut ends = roots(&derivative, upper);
    ends.push(upper);
    let mut found = Vec::new();
    let mut start = 0.0;
    for end in ends {
        if evaluate(coefficients, start).signum() * evaluate(coefficients, end).signum() < 0.0 {
            found.push(bisect(|x| evaluate(coefficients, x), start, end));
        }
        start = end;
    }
    found
}

/// The last number before the sign change of `f` between `low` and `high`.
fn bisect(f: impl Fn(f64) -> f64, mut low: f64, mut high: f64) -> f64 {
    let sign = f(low).signum();
    for _ in 0..BISECTIONS {
        let middle = low + 0.5 * (high - low);
        if f(middle) * sign > 0.0 {
            low = middle;
        } else {
            high = middle;
        }
    }
    low
}

/// Solves `function(x) = target` ≥ 0 for an increasing function with value 0 at 0; `None` if the solution is not below
/// `upper`. `function` returns its value and derivative; the solver is Newton's method in a shrinking bracket.
pub(crate) fn solve_increasing(function: impl Fn(f64) -> (f64, f64), target: f64, upper: f64) -> Option<f64> {
    let (mut low, mut high) = (0.0, target);
    while high < upper && function(high).0 < target {
        (low, high) = (high, 2.0 * high);
    }
    if high >= upper {
        high = (function(upper).0 > target).then_some(upper)?;
    }
    // Near the axis every lens is almost the identity, so the target is a good initial value.
    let mut x = if low > 0.0 { low } else { high };
    for _ in 0..NEWTON_STEPS {
        let (value, slope) = function(x);
        if value > target {
            high = x;
        } else {
            low = x;
        }
        let newton = x - (value - target) / slope;
        let next = if newton > low && newton < high { newton } else { low + 0.5 * (high - low) };
        if (next - x).abs() <= 2.0 * f64::EPSILON * x {
            return Some(next);
        }
        x = next;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use atsplat_numeric::Tolerance;

    #[test]
    fn finds_the_first_of_several_roots() {
        // (1 − x)(1 − x/2)(1 − x/3)
        let cubic = [1.0, -11.0 / 6.0, 1.0, -1.0 / 6.0];
        Tolerance::relative(1e-14).assert([positive_up_to(&cubic, 1e8)], [1.0], "first root");
    }

    #[test]
    fn returns_the_bound_without_a_root() {
        let bounds = [positive_up_to(&[1.0, 0.0, 3.0], 1e8), positive_up_to(&[1.0], 5.0)];
        Tolerance::EXACT.assert(bounds, [1e8, 5.0], "bounds");
        Tolerance::EXACT.assert([positive_up_to(&[1.0, 0.0, 0.0], 5.0)], [5.0], "zero leading coefficients");
    }

    #[test]
    fn solves_increasing_functions_up_to_the_bound() {
        let cube = |x: f64| (x * x * x, 3.0 * x * x);
        for target in [0.0, 1e-30, 8.0, 1e30] {
            let x = solve_increasing(cube, target, f64::INFINITY).unwrap();
            Tolerance { absolute: 1e-100, relative: 1e-13 }.assert([x * x * x], [target], "cube root");
        }
        assert_eq!(solve_increasing(cube, 9.0, 2.0), None);
    }
}
