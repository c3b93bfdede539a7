use std::fmt;

use atsplat_numeric::counted;

use super::format::{change, range, score, short, signed, size};
use super::probe::{Attribution, StageVerdict};
use super::{
    Basis, ChangedImage, Comparison, DataComparison, DriftReport, DriftVerdict, Finding, ImageRole, Limit, LimitOrigin,
    SceneChange, scene_limit,
};

/// Number of changed images that are listed.
const MAX_LISTED: usize = 10;

impl fmt::Display for DriftVerdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Same => "same",
            Self::Within => "within limits",
            Self::Nothing => "nothing compared",
            Self::Drifted => "DRIFTED",
        })
    }
}

impl fmt::Display for Basis {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Exact => "exact",
            Self::Bound => "bound",
            Self::Interval => "interval",
        })
    }
}

impl fmt::Display for StageVerdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Same => "same",
            Self::Empty => "nothing",
            Self::Changed => "CHANGED",
        })
    }
}

impl fmt::Display for DriftReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { verdict, comparisons, findings, data, differences, attribution, not_attributed, .. } = self;
        writeln!(
            f,
            "{:<24} {:<16} {:<12} {:>10} {:>10} {:>12} {:>26} {:>8} {:<8} verdict",
            "preset", "method", "metric", "baseline", "now", "difference", "95 % interval", "targets", "basis"
        )?;
        for comparison in comparisons {
            line(f, comparison)?;
        }
        if !findings.is_empty() {
            writeln!(f)?;
        }
        for finding in findings {
            writeln!(f, "{:<13} {finding}", finding.verdict)?;
        }
        if !differences.is_empty() {
            writeln!(f, "\nDifferent from the baseline:")?;
        }
        for difference in differences {
            writeln!(f, "  {difference}")?;
        }
        write!(f, "\n{data}")?;
        if let Some(attribution) = attribution {
            writeln!(f, "\n{attribution}")?;
        }
        if let Some(reason) = not_attributed {
            writeln!(f, "\nNo attribution: {reason}")?;
        }
        writeln!(f, "\n{}\n\nVerdict: {verdict}", self.conclusion())
    }
}

impl fmt::Display for Finding {
    /// `PRESET, METHOD: targets are missing: 3, such as scene 1 0 frame 2`, without the verdict.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { preset, method, kind, verdict: _, count, example } = self;
        let of = if method.is_empty() { preset.clone() } else { format!("{preset}, {method}") };
        write!(f, "{of}: {}", kind.description())?;
        if example.is_empty() { Ok(()) } else { write!(f, ": {count}, such as {example}") }
    }
}

impl Comparison {
    /// Both means, their difference and its interval, with units; `-` for one that is unknown.
    pub(super) fn numbers(&self) -> [String; 4] {
        let Self { metric, baseline, now, paired, .. } = self;
        let or_dash = |number: Option<String>| number.unwrap_or_else(|| "-".to_owned());
        let mean = |value: &Option<f64>| or_dash(value.map(|value| score(metric, value)));
        let difference = paired.as_ref().map(|paired| change(metric, paired.difference));
        let interval = paired.as_ref().and_then(|paired| paired.interval).map(|bounds| range(metric, bounds));
        [mean(baseline), mean(now), or_dash(difference), or_dash(interval)]
    }

    /// The verdict, and the direction of a drift.
    pub(super) fn judgement(&self) -> String {
        let improved = self.improved().filter(|_| self.verdict == DriftVerdict::Drifted);
        let direction = improved.map_or("", |better| if better { ", better" } else { ", worse" });
        format!("{}{direction}", self.verdict)
    }
}

fn line(f: &mut fmt::Formatter<'_>, comparison: &Comparison) -> fmt::Result {
    let Comparison { preset, method, metric, basis, paired, changed, .. } = comparison;
    let [baseline, now, difference, interval] = comparison.numbers();
    let verdict = comparison.judgement();
    let targets = paired.as_ref().map_or("-".to_owned(), |paired| format!("{changed}/{}", paired.targets));
    writeln!(
        f,
        "{preset:<24} {method:<16} {metric:<12} {baseline:>10} {now:>10} {difference:>12} {interval:>26} {targets:>8} {basis:<8} {verdict}",
    )?;
    if comparison.identical > 0 {
        let are = if comparison.identical == 1 { "is" } else { "are" };
        let targets = counted(comparison.identical, "target");
        writeln!(f, "    {targets} {are} left out: identical to the truth, in the baseline or now")?;
    }
    let Some(at) = &comparison.largest_at else { return Ok(()) };
    write!(f, "    largest change {} at {at}", size(metric, comparison.largest))?;
    if let (Some(limit), Some(of_scene)) = (comparison.limit, comparison.scene_limit) {
        if let Some(SceneChange { scene, change: by }) = &comparison.largest_scene {
            write!(f, "; the mean of {scene} changed by {}", change(metric, *by))?;
        }
        let is_larger = paired.as_ref().is_some_and(|paired| paired.difference.abs() > limit);
        let is_unsure = is_larger && comparison.verdict == DriftVerdict::Within;
        let unsure = if is_unsure { " (this difference is larger, but its interval is not beyond)" } else { "" };
        write!(
            f,
            "; means may vary by {}{unsure}, those of a scene by {}",
            size(metric, limit),
            size(metric, of_scene)
        )?;
    }
    writeln!(f)
}

impl fmt::Display for Limit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { preset, method, metric, limit, origin, scene } = self;
        let origin = match origin {
            LimitOrigin::Stated => "as stated".to_owned(),
            LimitOrigin::Least => "the least limit".to_owned(),
            LimitOrigin::Estimated(runs) => format!("from {}", counted(*runs, "run")),
        };
        write!(f, "{preset}, {method}: {metric} may vary by {}, {origin}", size(metric, *limit))?;
        if scene.is_some() {
            // As it applies: the least limit of a scene may be larger.
            write!(f, "; the mean of a scene by {}", size(metric, scene_limit(metric, Some(self), 1)))?;
        }
        Ok(())
    }
}

impl fmt::Display for DataComparison {
    /// One line, and one for each of the first changed images.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { compared, changed, unknown, preprocessed_differently } = self;
        let differ = format!("{}/{compared}", changed.len());
        writeln!(f, "{:<10} {:<10} {differ:>15} images differ", "data", self.verdict())?;
        for image in changed.iter().take(MAX_LISTED) {
            writeln!(f, "    {}: {image}", image.preset)?;
        }
        if let Some(more) = changed.len().checked_sub(MAX_LISTED).filter(|more| *more > 0) {
            writeln!(f, "    and {more} more")?;
        }
        if *preprocessed_differently > 0 {
            let images = counted(*preprocessed_differently, "image");
            writeln!(f, "    {images} not compared: the preset crops or resizes them differently")?;
        }
        match unknown {
            0 => Ok(()),
            unknown => writeln!(
                f,
                "    {unknown} images have a digest on one side only and are not monitored; accept the baseline again to monitor them"
            ),
        }
    }
}

impl fmt::Display for ChangedImage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let roles: Vec<&str> = self.roles.iter().copied().map(ImageRole::name).collect();
        write!(f, "scene {}, frame {} ({})", self.scene, self.frame, roles.join(" and "))
    }
}

impl fmt::Display for Attribution {
    /// The probe's stages with their effects on the probe's numbers.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:<10} {:<10} {:>15} {:>10}", "stage", "alone", "values differ", "largest")?;
        for metric in &self.metrics {
            write!(f, " {:>12}", metric.metric)?;
        }
        writeln!(f)?;
        for (at, stage) in self.stages.iter().enumerate() {
            let differ = format!("{}/{}", stage.differing, stage.values);
            let (name, verdict) = (stage.stage.name(), stage.verdict);
            write!(f, "{name:<10} {verdict:<10} {differ:>15} {:>10}", short(stage.largest))?;
            for metric in &self.metrics {
                #[expect(clippy::expect_used, reason = "a metric has one effect for each stage")]
                let effect = *metric.effects.get(at).expect("the effect of a stage");
                write!(f, " {:>12}", signed(effect, 4))?;
            }
            writeln!(f)?;
        }
        write!(f, "{:<48}", "probe, then to now")?;
        for metric in &self.metrics {
            write!(f, " {:>12}", signed(metric.now - metric.baseline, 4))?;
        }
        Ok(())
    }
}
