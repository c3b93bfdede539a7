use std::str::FromStr;

use atsplat_metrics::{Definition, Direction, definitions};
use atsplat_numeric::{decimals_of_interval, decimals_of_small};
use serde::{Deserialize, Deserializer, Serialize, Serializer, de};

use crate::numbers::{count_label, fixed, signed};

/// The quantity that a column shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// A metric of images.
    Metric(&'static Definition),
    /// Number of predicted Gaussians, averaged over trials.
    Gaussians,
    /// Gaussians of the trial with the fewest.
    GaussiansMin,
    /// Gaussians of the trial with the most.
    GaussiansMax,
    /// Median seconds from context views to Gaussians.
    Seconds,
    /// Tokens before expansion, averaged over trials.
    InitialTokens,
    /// Tokens after expansion, which become Gaussians.
    FinalTokens,
    /// Slope of a metric; only in tables of protocols.
    Slope(&'static Definition, SlopeOver),
    /// Paired difference of a metric to another method; in no definition, but in tables that are compared with one.
    Difference(&'static Definition),
}

/// The property of targets along which a slope is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SlopeOver {
    /// Overlap of the context views; per tenth.
    Overlap,
    /// Distance from the window of context frames; per frame.
    Distance,
}

const COSTS: [Quantity; 6] = [
    Quantity::Gaussians,
    Quantity::GaussiansMin,
    Quantity::GaussiansMax,
    Quantity::Seconds,
    Quantity::InitialTokens,
    Quantity::FinalTokens,
];

impl Quantity {
    /// Name in definitions and files.
    pub fn id(self) -> &'static str {
        match self {
            Self::Metric(metric) => metric.id,
            Self::Gaussians => "gaussians",
            Self::GaussiansMin => "gaussians-min",
            Self::GaussiansMax => "gaussians-max",
            Self::Seconds => "seconds",
            Self::InitialTokens => "initial-tokens",
            Self::FinalTokens => "final-tokens",
            Self::Slope(_, SlopeOver::Overlap) => "slope-over-overlap",
            Self::Slope(_, SlopeOver::Distance) => "slope-over-distance",
            Self::Difference(_) => "difference",
        }
    }

    /// Name in tables.
    pub fn title(self) -> &'static str {
        match self {
            Self::Metric(metric) | Self::Difference(metric) => metric.name,
            Self::Gaussians => "#Gauss.",
            Self::GaussiansMin => "#Gauss. min.",
            Self::GaussiansMax => "#Gauss. max.",
            Self::Seconds => "Time (s)",
            Self::InitialTokens => "N init.",
            Self::FinalTokens => "N final",
            Self::Slope(_, SlopeOver::Overlap) => "per 0.1 of overlap",
            Self::Slope(_, SlopeOver::Distance) => "per frame outside",
        }
    }

    /// The metric whose means it shows; `None` for costs, slopes and differences.
    pub(crate) const fn metric(self) -> Option<&'static Definition> {
        match self {
            Self::Metric(metric) => Some(metric),
            _ => None,
        }
    }

    /// Which direction is better; `None` if neither is.
    pub fn direction(self) -> Option<Direction> {
        match self {
            Self::Metric(metric) => Some(metric.direction),
            Self::Gaussians | Self::GaussiansMin | Self::GaussiansMax | Self::Seconds => Some(Direction::Lower),
            Self::InitialTokens | Self::FinalTokens | Self::Slope(..) | Self::Difference(_) => None,
        }
    }

    /// Formats a measured number: decibels with two decimals, other scores and seconds with three, times that would print as 0
    /// with more, Gaussians in thousands or millions of at most three digits unless `exact` (23 040 → `23K`, 24 772 → `24.8K`),
    /// tokens without decimals.
    pub fn print(self, value: f64, exact: bool) -> String {
        match self {
            _ if self.is_in_thousands(value, exact) => count_label(value),
            Self::Metric(metric) => fixed(value, metric.scale.decimals()),
            Self::Seconds => fixed(value, decimals_of_small(value, 3)),
            Self::Slope(..) | Self::Difference(_) => self.print_signed(value, None),
            Self::InitialTokens | Self::FinalTokens | Self::Gaussians | Self::GaussiansMin | Self::GaussiansMax => {
                format!("{value:.0}")
            }
        }
    }

    /// Formats a number with the digits that papers print: as [`Self::print`], but with Gaussians truncated to thousands
    /// (24 772 → `24K`).
    pub(crate) fn print_as_papers(self, value: f64, exact: bool) -> String {
        if value >= 1000.0 && self.is_in_thousands(value, exact) {
            return format!("{:.0}K", (value / 1000.0).trunc());
        }
        self.print(value, exact)
    }

    /// Whether it is a count of Gaussians that would have more than three digits.
    fn is_in_thousands(self, value: f64, exact: bool) -> bool {
        matches!(self, Self::Gaussians | Self::GaussiansMin | Self::GaussiansMax) && !exact && value >= 999.5
    }

    /// A number and the ends of its interval, as [`Self::print`]; slopes and differences with more decimals if the interval excludes 0
    /// and would not show it.
    pub(crate) fn print_with_interval(self, value: f64, interval: [f64; 2], exact: bool) -> [String; 3] {
        let [low, high] = interval;
        [value, low, high].map(|number| match self {
            Self::Slope(..) | Self::Difference(_) => self.print_signed(number, Some(interval)),
            _ => self.print(number, exact),
        })
    }

    /// A number with chosen decimals; a difference with more if the interval excludes 0 and would not show it.
    pub(crate) fn print_with_decimals(self, value: f64, decimals: usize, interval: Option<[f64; 2]>) -> String {
        match self {
            Self::Slope(..) | Self::Difference(_) => signed(value, decimals_of_interval(interval, decimals)),
            _ => fixed(value, decimals),
        }
    }

    /// A slope or difference.
    fn print_signed(self, value: f64, interval: Option<[f64; 2]>) -> String {
        let decimals = if let Self::Difference(metric) = self { metric.scale.decimals() } else { 3 };
        signed(value, decimals_of_interval(interval, decimals))
    }

    /// Whether a choice of the other quantity includes it: a metric includes its slopes.
    pub(crate) fn is_of(self, chosen: Self) -> bool {
        self == chosen || matches!(self, Self::Slope(metric, _) if chosen == Self::Metric(metric))
    }
}

impl FromStr for Quantity {
    type Err = String;

    /// A metric or cost by its id, in upper or lower case.
    fn from_str(id: &str) -> Result<Self, String> {
        let known = COSTS.into_iter().chain(definitions().iter().map(Self::Metric));
        known.clone().find(|quantity| quantity.id().eq_ignore_ascii_case(id)).ok_or_else(|| {
            let ids: Vec<&str> = known.map(Self::id).collect();
            format!("expected one of the quantities {}, found {id:?}", ids.join(", "))
        })
    }
}

impl Serialize for Quantity {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            // The only quantity that a table may have of several metrics.
            Self::Difference(metric) => serializer.collect_str(&format_args!("{}-difference", metric.id)),
            _ => serializer.serialize_str(self.id()),
        }
    }
}

impl<'de> Deserialize<'de> for Quantity {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        String::deserialize(deserializer)?.parse().map_err(de::Error::custom)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn truncates_counts_to_thousands_as_papers_do() {
        for (count, printed) in [
            (23_040.0, "23K"),
            (80_640.0, "80K"),
            (120_960.0, "120K"),
            (46_080.0, "46K"),
            (5_898_240.0, "5898K"),
            (999.0, "999"),
            (52_928.0, "52K"),
        ] {
            assert_eq!(Quantity::Gaussians.print_as_papers(count, false), printed);
        }
        assert_eq!(Quantity::Gaussians.print_as_papers(23_040.0, true), "23040");
        assert_eq!(Quantity::from_str("psnr").unwrap().print_as_papers(28.456, false), "28.46");
    }

    #[test]
    fn measured_counts_are_rounded_to_three_digits() {
        for (count, printed) in [
            (23_040.0, "23K"),
            (24_772.0, "24.8K"),
            (1999.0, "2K"),
            (2699.0, "2.7K"),
            (5120.0, "5.12K"),
            (8999.0, "9K"),
            (120_960.0, "121K"),
            (5_898_240.0, "5.9M"),
            (999.0, "999"),
            (999.7, "1K"),
        ] {
            assert_eq!(Quantity::GaussiansMax.print(count, false), printed);
        }
        assert_eq!(Quantity::InitialTokens.print(2699.0, false), "2699");
    }

    #[test]
    fn numbers_have_the_decimals_of_their_quantity() {
        assert_eq!(Quantity::Gaussians.print(23_040.0, true), "23040");
        assert_eq!(Quantity::from_str("psnr").unwrap().print(28.456, false), "28.46");
        assert_eq!(Quantity::from_str("lpips").unwrap().print(0.1184, false), "0.118");
        let times = [0.2884, 0.0006, 0.000_48, 4.87e-6, 0.0].map(|secs| Quantity::Seconds.print(secs, false));
        assert_eq!(times, ["0.288", "0.001", "0.000480", "0.00000487", "0.000"]);
        let renamed: &Definition = Box::leak(Box::new(Definition { unit: "decibels", ..definitions()[0] }));
        assert_eq!(Quantity::Metric(renamed).print(28.456, false), "28.46", "whatever its unit is called");
        let ssims = [-0.0004, -0.0006, 0.0004].map(|value| Quantity::from_str("ssim").unwrap().print(value, false));
        assert_eq!(ssims, ["0.000", "-0.001", "0.000"], "no sign without a digit");
        let difference = |id: &str| match Quantity::from_str(id).unwrap() {
            Quantity::Metric(metric) => Quantity::Difference(metric),
            other => other,
        };
        let differences = [-0.004, 0.0004, 0.006].map(|value| difference("psnr").print(value, false));
        assert_eq!(differences, ["0.00", "0.00", "+0.01"]);
        assert_eq!([-0.0004, 0.0006].map(|value| difference("ssim").print(value, false)), ["0.000", "+0.001"]);
        let decided = difference("psnr").print_with_interval(-0.0018, [-0.0028, -0.000_76], false);
        assert_eq!(decided, ["-0.002", "-0.003", "-0.001"]);
        let lpips = Quantity::from_str("lpips").unwrap().print_with_interval(0.1, [0.0001, 0.2], false);
        assert_eq!(lpips, ["0.100", "0.000", "0.200"], "of no difference");
        assert_eq!(Quantity::from_str("psnr").unwrap().print_with_decimals(28.456_78, 4, None), "28.4568");
        assert_eq!(difference("psnr").print_with_decimals(-0.0018, 1, None), "0.0");
        assert_eq!(difference("psnr").print_with_decimals(-0.0018, 1, Some([-0.0028, -0.0008])), "-0.002");
    }

    #[test]
    fn every_quantity_is_read_by_its_id() {
        let metrics = definitions().iter().map(Quantity::Metric);
        for quantity in COSTS.into_iter().chain(metrics) {
            let json = serde_json::to_string(&quantity).unwrap();
            assert_eq!(serde_json::from_str::<Quantity>(&json).unwrap(), quantity);
            assert_eq!(Quantity::from_str(&quantity.id().to_uppercase()), Ok(quantity));
            assert!(!quantity.title().is_empty());
        }
        assert!(serde_json::from_str::<Quantity>("\"psmr\"").unwrap_err().to_string().contains("psnr"));
    }
}
