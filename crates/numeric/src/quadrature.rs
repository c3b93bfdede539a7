/// Abscissae and weights of Gauss–Legendre quadrature on [−1, 1] with five points, exact for polynomials up to degree 9.
pub const GAUSS_LEGENDRE: [(f64, f64); 5] = [
    (-0.906_179_845_938_664, 0.236_926_885_056_189_08),
    (-0.538_469_310_105_683_1, 0.478_628_670_499_366_47),
    (0.0, 0.568_888_888_888_888_9),
    (0.538_469_310_105_683_1, 0.478_628_670_499_366_47),
    (0.906_179_845_938_664, 0.236_926_885_056_189_08),
];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Tolerance;

    #[test]
    fn integrates_polynomials_up_to_degree_9() {
        let integral = |degree: i32| GAUSS_LEGENDRE.iter().map(|(x, weight)| weight * x.powi(degree)).sum::<f64>();
        for degree in 0..10 {
            let exact = if degree % 2 == 0 { 2.0 / f64::from(degree + 1) } else { 0.0 };
            Tolerance::absolute(1e-14).assert([integral(degree)], [exact], &format!("x^{degree}"));
        }
        let error = (integral(10) - 2.0 / 11.0).abs();
        assert!(error > 1e-3, "{error}: of degree 10 it is not exact");
    }
}
