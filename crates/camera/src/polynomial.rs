//! The two questions that lens polynomials raise: where do they stop growing, and where do they reach
//! a value.

/// Bisection halves an interval of 1e8 down to the last bit of the smallest roots that matter.
const BISECTIONS: usize = 120;
/// Far from the root a power falls by a fixed share per step: 400 of them cross 20 decades of x⁷.
const NEWTON_STEPS: usize = 400;

/// `coefficients[0] + coefficients[1]·x + …`
pub(crate) fn evaluate(coefficients: &[f64], x: f64) -> f64 {
    coefficients.iter().rev().fold(0.0, |sum, coefficient| sum * x + coefficient)
}

/// The point up to which a polynomial that is positive at 0 stays positive, at most `upper`.
pub(crate) fn positive_up_to(coefficients: &[f64], upper: f64) -> f64 {
    roots(coefficients, upper).first().copied().unwrap_or(upper)
}

/// All sign changes in (0, `upper`), ascending: between two neighbouring extrema a polynomial is
/// monotone, and the extrema are the sign changes of its derivative.
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

/// The last point before the sign change of `f` between `low` and `high`.
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

/// Where a function that grows from 0 at 0 reaches `target` ≥ 0, or `None` where it does not before
/// `upper`. `function` returns its value and its slope; Newton's method inside a shrinking bracket.
pub(crate) fn solve_increasing(function: impl Fn(f64) -> (f64, f64), target: f64, upper: f64) -> Option<f64> {
    let (mut low, mut high) = (0.0, target);
    while high < upper && function(high).0 < target {
        (low, high) = (high, 2.0 * high);
    }
    if high >= upper {
        high = (function(upper).0 > target).then_some(upper)?;
    }
    // Near the axis every lens is the identity, so the target itself is a good start.
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
    fn the_first_of_several_roots_is_found() {
        // (1 − x)(1 − x/2)(1 − x/3)
        let cubic = [1.0, -11.0 / 6.0, 1.0, -1.0 / 6.0];
        Tolerance::relative(1e-14).assert([positive_up_to(&cubic, 1e8)], [1.0], "first root");
    }

    #[test]
    fn without_a_root_the_bound_comes_back() {
        let bounds = [positive_up_to(&[1.0, 0.0, 3.0], 1e8), positive_up_to(&[1.0], 5.0)];
        Tolerance::EXACT.assert(bounds, [1e8, 5.0], "bounds");
        Tolerance::EXACT.assert([positive_up_to(&[1.0, 0.0, 0.0], 5.0)], [5.0], "zero leading coefficients");
    }

    #[test]
    fn an_increasing_function_is_solved_or_refused() {
        let cube = |x: f64| (x * x * x, 3.0 * x * x);
        for target in [0.0, 1e-30, 8.0, 1e30] {
            let x = solve_increasing(cube, target, f64::INFINITY).unwrap();
            Tolerance { absolute: 1e-100, relative: 1e-13 }.assert([x * x * x], [target], "cube root");
        }
        assert_eq!(solve_increasing(cube, 9.0, 2.0), None);
    }
}
