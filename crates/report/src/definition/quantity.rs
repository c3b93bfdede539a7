use atsplat_metrics::{Definition, Direction, definition, definitions};
use serde::{Deserialize, Deserializer, Serialize, Serializer, de};

/// What a column shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// A metric of pictures.
    Metric(&'static Definition),
    /// Gaussians of a scene, all that are predicted, averaged over trials.
    Gaussians,
    /// Those of the trial with the fewest.
    GaussiansMin,
    /// Those of the trial with the most.
    GaussiansMax,
    /// Median seconds from context views to Gaussians.
    Seconds,
    /// Tokens before expansion, averaged over trials.
    InitialTokens,
    /// Tokens that became Gaussians.
    FinalTokens,
}

const COSTS: [(Quantity, &str, &str); 6] = [
    (Quantity::Gaussians, "gaussians", "#Gauss."),
    (Quantity::GaussiansMin, "gaussians-min", "#Gauss. min."),
    (Quantity::GaussiansMax, "gaussians-max", "#Gauss. max."),
    (Quantity::Seconds, "seconds", "Time (s)"),
    (Quantity::InitialTokens, "initial-tokens", "N init."),
    (Quantity::FinalTokens, "final-tokens", "N final"),
];

impl Quantity {
    /// Name in definitions and files.
    pub fn id(self) -> &'static str {
        match self {
            Self::Metric(metric) => metric.id,
            other => COSTS.iter().find(|(own, _, _)| *own == other).map_or("", |(_, id, _)| id),
        }
    }

    /// Name in tables.
    pub fn title(self) -> &'static str {
        match self {
            Self::Metric(metric) => metric.name,
            other => COSTS.iter().find(|(own, _, _)| *own == other).map_or("", |(_, _, title)| title),
        }
    }

    /// Which way is better; `None` where neither is.
    pub fn direction(self) -> Option<Direction> {
        match self {
            Self::Metric(metric) => Some(metric.direction),
            Self::Gaussians | Self::GaussiansMin | Self::GaussiansMax | Self::Seconds => Some(Direction::Lower),
            Self::InitialTokens | Self::FinalTokens => None,
        }
    }

    /// Whether it counts Gaussians, which papers cut to thousands.
    pub const fn counts_gaussians(self) -> bool {
        matches!(self, Self::Gaussians | Self::GaussiansMin | Self::GaussiansMax)
    }

    /// A number as papers print it: decibels with two decimals, other scores and seconds with three, Gaussians cut to
    /// thousands unless `exact` (23 040 → `23K`), tokens whole.
    pub fn print(self, value: f64, exact: bool) -> String {
        match self {
            Self::Metric(metric) if metric.unit == "dB" => format!("{value:.2}"),
            Self::Metric(_) | Self::Seconds => format!("{value:.3}"),
            Self::InitialTokens | Self::FinalTokens => format!("{value:.0}"),
            _ if exact || value.abs() < 1000.0 => format!("{value:.0}"),
            _ => format!("{:.0}K", (value / 1000.0).trunc()),
        }
    }

    fn of(id: &str) -> Option<Self> {
        let cost = COSTS.iter().find(|(_, known, _)| *known == id).map(|(quantity, _, _)| *quantity);
        cost.or_else(|| definition(id).map(Self::Metric))
    }
}

impl Serialize for Quantity {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.id())
    }
}

impl<'de> Deserialize<'de> for Quantity {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let id = String::deserialize(deserializer)?;
        Self::of(&id).ok_or_else(|| {
            let costs = COSTS.iter().map(|(_, id, _)| *id);
            let known: Vec<&str> = costs.chain(definitions().iter().map(|metric| metric.id)).collect();
            de::Error::custom(format!("expected a quantity of {}, found {id:?}", known.join(", ")))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_are_cut_to_thousands_as_papers_cut_them() {
        for (count, printed) in [
            (23_040.0, "23K"),
            (80_640.0, "80K"),
            (120_960.0, "120K"),
            (46_080.0, "46K"),
            (5_898_240.0, "5898K"),
            (999.0, "999"),
            (52_928.0, "52K"),
        ] {
            assert_eq!(Quantity::Gaussians.print(count, false), printed);
        }
        assert_eq!(Quantity::Gaussians.print(23_040.0, true), "23040");
        assert_eq!(Quantity::of("psnr").unwrap().print(28.456, false), "28.46");
        assert_eq!(Quantity::of("lpips").unwrap().print(0.1184, false), "0.118");
    }

    #[test]
    fn every_quantity_is_read_by_its_own_name() {
        let metrics = definitions().iter().map(Quantity::Metric);
        for quantity in COSTS.iter().map(|(quantity, _, _)| *quantity).chain(metrics) {
            let json = serde_json::to_string(&quantity).unwrap();
            assert_eq!(serde_json::from_str::<Quantity>(&json).unwrap(), quantity);
            assert!(!quantity.title().is_empty());
        }
        assert!(serde_json::from_str::<Quantity>("\"psmr\"").unwrap_err().to_string().contains("psnr"));
    }
}
