use std::fmt;

use atsplat_eval::tradeoff::{Axis, Frontier, Point, Price, Tradeoff};
use serde::Serialize;

/// Frontiers of every protocol and metric.
#[derive(Serialize)]
#[serde(rename_all = "kebab-case")]
pub(super) struct Report {
    pub(super) tradeoffs: Vec<Tradeoff>,
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (at, tradeoff) in self.tradeoffs.iter().enumerate() {
            let Tradeoff { preset, metric, unit, frontiers, .. } = tradeoff;
            for frontier in frontiers {
                let blank = if at == 0 && frontier.axis == Axis::Seconds { "" } else { "\n" };
                let paid = match frontier.axis {
                    Axis::Seconds => "seconds",
                    Axis::Gaussians => "Gaussians",
                };
                writeln!(f, "{blank}{preset}: {metric} against {paid}")?;
                points(f, frontier)?;
                prices(f, frontier, unit)?;
            }
        }
        writeln!(f, "\nSeconds are medians of encoding and of rendering one view, added: until the first picture.")
    }
}

fn points(f: &mut fmt::Formatter<'_>, frontier: &Frontier) -> fmt::Result {
    writeln!(f, "  {:<40} {:>10} {:>12} {:>12}", "", "quality", "ms", "Gaussians")?;
    for Point { label, quality, secs, gaussians, on_frontier, .. } in &frontier.points {
        let mark = if *on_frontier { "*" } else { " " };
        let ms = secs.map_or("-".to_owned(), |secs| format!("{:.1}", 1e3 * secs));
        let gaussians = gaussians.map_or("-".to_owned(), |count| format!("{count:.0}"));
        let knee = if frontier.knee.as_ref() == Some(label) { "  knee" } else { "" };
        writeln!(f, "{mark} {label:<40} {quality:>10.4} {ms:>12} {gaussians:>12}{knee}")?;
    }
    for (label, reason) in &frontier.left_out {
        writeln!(f, "- {label:<40} left out: {reason}")?;
    }
    Ok(())
}

fn prices(f: &mut fmt::Formatter<'_>, frontier: &Frontier, unit: &str) -> fmt::Result {
    for Price { from, to, gain, step, secs, gaussians } in &frontier.prices {
        let ms = secs.map(|secs| format!("{:+.1} ms", 1e3 * secs));
        let gaussians = gaussians.map(|count| format!("{count:+.0} Gaussians"));
        let paid: Vec<String> = ms.into_iter().chain(gaussians).collect();
        let unit = if unit.is_empty() { String::new() } else { format!(" {unit}") };
        writeln!(f, "  {from} to {to}, {gain:.4}{unit} better: the next {step}{unit} for {}", paid.join(" and "))?;
    }
    Ok(())
}
