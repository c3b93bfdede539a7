use atsplat_numeric::{Extremes as _, quantile};

use crate::numbers::{fixed, three_digits, with_minus_sign};

/// Maps values to positions along an axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::plot) struct Scale {
    low: f64,
    high: f64,
    rule: Rule,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum Rule {
    Linear,
    /// With the natural logarithms of both ends: the ends themselves, or their ratio, may be out of the range of numbers.
    Logarithmic {
        low: f64,
        high: f64,
    },
}

impl Scale {
    /// From `low` to `high`; slightly wider if they are equal.
    pub(in crate::plot) fn linear(low: f64, high: f64) -> Self {
        let (low, high) = if low <= high { (low, high) } else { (high, low) };
        let slack = if high > low { 0.0 } else { 0.5 };
        Self { low: low - slack, high: high + slack, rule: Rule::Linear }
    }

    /// Around all finite values, with a margin of the fraction `margin` of their range on either side.
    pub(in crate::plot) fn around(values: impl IntoIterator<Item = f64>, margin: f64) -> Self {
        let (low, high) = bounds(values).unwrap_or((0.0, 1.0));
        let equal = if high.abs() > 0.0 { 0.05 * high.abs() } else { 1.0 };
        let slack = if high > low { (high - low) * margin } else { equal };
        Self::linear(low - slack, high + slack)
    }

    /// Around the values of `extents` within one and a half interquartile ranges of the middle half of `means` (Tukey's
    /// fences), with a margin of the fraction `margin` of their range on either side.
    pub(in crate::plot) fn without_outliers(
        means: impl IntoIterator<Item = f64>,
        extents: impl IntoIterator<Item = f64>,
        margin: f64,
    ) -> Self {
        let mut sorted: Vec<f64> = means.into_iter().filter(|mean| mean.is_finite()).collect();
        sorted.sort_by(f64::total_cmp);
        let (Some(first), Some(third)) = (quantile(&sorted, 0.25), quantile(&sorted, 0.75)) else {
            return Self::around(extents, margin);
        };
        let reach = 1.5 * (third - first) + 1e-9 * third.abs();
        Self::around(extents.into_iter().filter(|value| (first - reach..=third + reach).contains(value)), margin)
    }

    /// From zero to slightly above all values.
    pub(in crate::plot) fn from_zero(values: impl IntoIterator<Item = f64>) -> Self {
        let high = bounds(values).map_or(1.0, |(_, high)| high);
        Self::linear(0.0, if high > 0.0 { high * 1.08 } else { 1.0 })
    }

    /// Logarithmic around all positive values, with a margin of the fraction `margin` of their range on either side.
    pub(in crate::plot) fn logarithmic(values: impl IntoIterator<Item = f64>, margin: f64) -> Self {
        let positive = values.into_iter().filter(|value| *value > 0.0).map(f64::ln);
        let (low, high) = bounds(positive).unwrap_or((0.0, 1.0));
        let slack = ((high - low) * margin).clamp(0.1, f64::INFINITY);
        let (low, high) = (low - slack, high + slack);
        let end = |logarithm: f64| logarithm.exp().clamp(f64::MIN_POSITIVE, f64::MAX);
        Self { low: end(low), high: end(high), rule: Rule::Logarithmic { low, high } }
    }

    /// The position of a value: 0 at the low end, 1 at the high end.
    pub(in crate::plot) fn position(self, value: f64) -> f64 {
        match self.rule {
            Rule::Linear => (value - self.low) / (self.high - self.low),
            Rule::Logarithmic { low, high } => (value.ln() - low) / (high - low),
        }
    }

    /// The column that contains a finite value where the range is divided into `columns` of equal width; values outside count into the
    /// first or the last.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the columns")]
    pub(in crate::plot) fn column(self, value: f64, columns: usize) -> usize {
        (self.position(value) * columns as f64).clamp(0.0, columns.saturating_sub(1) as f64) as usize
    }

    pub(in crate::plot) const fn low(self) -> f64 {
        self.low
    }

    pub(in crate::plot) const fn high(self) -> f64 {
        self.high
    }

    /// About `wanted` round values inside the range, at least two: a single one would not say what a length stands for.
    pub(in crate::plot) fn ticks(self, wanted: usize) -> Vec<f64> {
        match self.rule {
            Rule::Linear => self.linear_ticks(wanted),
            Rule::Logarithmic { .. } => self.logarithmic_ticks(wanted),
        }
    }

    fn linear_ticks(self, wanted: usize) -> Vec<f64> {
        let rough = (self.high - self.low) / wanted.clamp(1, 100) as f64;
        let power = 10f64.powf(rough.log10().floor());
        let steps = [10.0, 5.0, 2.0, 1.0, 0.5, 0.2].map(|digit| digit * power);
        let wide_enough = steps.iter().rposition(|step| *step >= rough).unwrap_or_default();
        let options: Vec<Vec<f64>> = steps.iter().skip(wide_enough).map(|step| self.multiples(*step)).collect();
        // Narrower steps than there is room for, where the range has fewer than three multiples of a wider one.
        let three = options.iter().position(|ticks| (3..=wanted.clamp(1, 100) + 2).contains(&ticks.len()));
        let chosen = three.or_else(|| options.iter().position(|ticks| ticks.len() > 1)).unwrap_or_default();
        options.into_iter().nth(chosen).unwrap_or_default()
    }

    /// The multiples of a step inside the range, at most a hundred.
    fn multiples(self, step: f64) -> Vec<f64> {
        let (first, last) = ((self.low / step).ceil(), (self.high / step + 1e-9).floor());
        let mut ticks = Vec::new();
        let mut at = first;
        while at <= last && ticks.len() < 100 {
            // Multiplied, because summed rounding errors would show in labels; `+ 0.0` avoids "-0".
            ticks.push(at * step + 0.0);
            at += 1.0;
        }
        ticks
    }

    fn logarithmic_ticks(self, wanted: usize) -> Vec<f64> {
        const DIGITS: [&[f64]; 3] = [&[1.0, 2.0, 5.0], &[1.0, 3.0], &[1.0]];
        let inside = |digits: &[f64]| {
            let mut ticks = Vec::new();
            let mut decade = self.low.log10().floor();
            while decade <= self.high.log10() && ticks.len() < 100 {
                ticks.extend(digits.iter().map(|digit| digit * 10f64.powf(decade)));
                decade += 1.0;
            }
            ticks.retain(|tick| (self.low..=self.high).contains(tick));
            ticks
        };
        let options: Vec<Vec<f64>> = DIGITS.into_iter().map(inside).collect();
        let fitting = options.iter().find(|ticks| ticks.len() <= wanted + 2).or(options.last());
        match fitting {
            Some(ticks) if ticks.len() >= 2 => ticks.clone(),
            _ => self.linear_ticks(wanted),
        }
    }
}

/// The smallest and the largest finite value.
pub(in crate::plot) fn bounds(values: impl IntoIterator<Item = f64>) -> Option<(f64, f64)> {
    let finite = values.into_iter().filter(|value| value.is_finite());
    finite.fold(None, |bounds, value| match bounds {
        None => Some((value, value)),
        Some((low, high)) => Some((value.minimum_of(low), value.maximum_of(high))),
    })
}

/// A tick's label, with as many decimals as all ticks need.
pub(in crate::plot) fn label(value: f64, ticks: &[f64]) -> String {
    const MAX: usize = 6;
    let whole = |decimals: usize| {
        let power = 10f64.powf(decimals as f64);
        ticks.iter().all(|tick| (tick * power - (tick * power).round()).abs() < 1e-6 * power.sqrt())
    };
    let decimals = (0..MAX).find(|decimals| whole(*decimals)).unwrap_or(MAX);
    with_minus_sign(&fixed(value, decimals))
}

/// The unit in which all ticks of a time axis are written: its name, and its length in seconds.
pub(in crate::plot) fn time_unit(secs: impl IntoIterator<Item = f64>) -> (&'static str, f64) {
    let longest = bounds(secs).map_or(1.0, |(_, high)| high);
    match longest {
        secs if secs >= 300.0 => ("minutes", 60.0),
        secs if secs >= 2.0 => ("seconds", 1.0),
        secs if secs >= 2e-3 => ("milliseconds", 1e-3),
        _ => ("microseconds", 1e-6),
    }
}

/// A tick's label, with only the digits that it needs itself, for logarithmic axes.
pub(in crate::plot) fn single_label(value: f64) -> String {
    label(value, &[value])
}

/// Seconds in a suitable unit.
pub(in crate::plot) fn seconds_label(secs: f64) -> String {
    match secs {
        secs if secs >= 100.0 => format!("{} min", three_digits(secs / 60.0)),
        secs if secs >= 1.0 => format!("{} s", three_digits(secs)),
        secs if secs >= 1e-3 => format!("{} ms", three_digits(secs * 1e3)),
        secs => format!("{} µs", three_digits(secs * 1e6)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        assert_eq!(Scale::linear(0.13, 1.02).ticks(5), [0.2, 0.4, 0.600_000_000_000_000_1, 0.8, 1.0]);
        assert_eq!(
            Scale::linear(-1.0, 1.0).ticks(4).iter().map(|t| label(*t, &[0.0, 0.5])).collect::<Vec<_>>(),
            ["−1.0", "−0.5", "0.0", "0.5", "1.0"]
        );
        let ticks = Scale::logarithmic([5e3, 1e6], 0.05).ticks(6);
        assert_eq!(ticks, [5e3, 1e4, 2e4, 5e4, 1e5, 2e5, 5e5, 1e6]);
        for scale in [
            Scale::linear(3.0, 3.0),
            Scale::around([f64::NAN], 0.1),
            Scale::from_zero([]),
            Scale::logarithmic([0.0], 0.1),
        ] {
            assert!(scale.ticks(5).len() >= 2, "{scale:?}");
        }
    }

    /// A panel of 290 px has room for three ticks.
    #[test]
    fn an_axis_has_at_least_two_ticks() {
        assert_eq!(Scale::linear(20.6, 59.4).ticks(3), [30.0, 40.0, 50.0], "the multiples of 20 are one");
        assert_eq!(Scale::linear(21.0, 62.0).ticks(3), [30.0, 40.0, 50.0, 60.0], "the multiples of 20 are two");
        assert_eq!(Scale::linear(19.0, 61.0).ticks(3), [20.0, 40.0, 60.0]);
        for wanted in 2..12 {
            for start in 0..200 {
                let low = 0.37 * f64::from(start) - 20.0;
                for range in [0.013, 0.7, 1.0, 3.9, 38.8, 41.0, 99.0, 2500.0] {
                    let ticks = Scale::linear(low, low + range).ticks(wanted);
                    assert!((2..=wanted + 3).contains(&ticks.len()), "{wanted} from {low}, {range}: {ticks:?}");
                }
            }
        }
    }

    #[test]
    fn labels_have_as_many_digits_as_needed() {
        assert_eq!(label(0.25, &[0.0, 0.25, 0.5]), "0.25");
        assert_eq!(label(28.0, &[26.0, 28.0]), "28");
        assert_eq!([0.022, 1.5, 600.0, 2e-5].map(seconds_label), ["22 ms", "1.5 s", "10 min", "20 µs"]);
    }

    #[test]
    fn an_outlier_does_not_stretch_the_scale() {
        let means = [18.0, 19.0, 20.0, 21.0, 22.0, 100.0];
        let scale = Scale::without_outliers(means, means.into_iter().chain([17.5, 60.0]), 0.0);
        assert_eq!([scale.low().to_bits(), scale.high().to_bits()], [17.5f64.to_bits(), 22.0f64.to_bits()]);
        let level = Scale::without_outliers([3.0; 4], [3.0; 4], 0.1);
        assert!(level.low() < 3.0 && level.high() > 3.0, "equal values are not outliers: {level:?}");
        assert_eq!(time_unit([0.189, 8.9e-6]), ("milliseconds", 1e-3));
        assert_eq!([0.01, 0.5, 20.0].map(single_label), ["0.01", "0.5", "20"]);
    }

    #[test]
    fn positions_range_from_zero_to_one() {
        let scale = Scale::logarithmic([1.0, 100.0], 0.0);
        assert!(scale.position(10.0) > 0.49 && scale.position(10.0) < 0.51);
        let values = [5e-324, 1e-300, 2.0, 1e300];
        let wide = Scale::logarithmic(values, 0.12);
        assert!(wide.low() > 0.0 && wide.high().is_finite(), "{wide:?}");
        let positions = values.map(|value| wide.position(value));
        assert!(positions.is_sorted() && positions[0] > 0.09 && positions[3] < 0.91, "{positions:?}");
        assert!(wide.ticks(5).iter().all(|tick| wide.position(*tick).is_finite()), "{wide:?}");
        assert_eq!(Scale::linear(2.0, 4.0).position(3.0).to_bits(), 0.5f64.to_bits());
    }

    #[test]
    fn columns_contain_their_lower_ends() {
        let columns = [1.0, 2.0, 2.4, 2.5, 3.9, 4.0, 5.0].map(|value| Scale::linear(2.0, 4.0).column(value, 4));
        assert_eq!(columns, [0, 0, 0, 1, 3, 3, 3]);
    }
}
