use std::collections::BTreeSet;
use std::fmt;

use atsplat_numeric::counted;
use atsplat_results::excerpts;

use super::format::{change, range, score, short, signed, size};
use super::probe::{Attribution, StageVerdict};
use super::{
    Basis, ChangedImage, Comparison, DataComparison, DriftReport, DriftVerdict, Finding, ImageRole, Limit, SceneChange,
    scene_limit,
};

/// Number of changed images that are listed.
const MAX_LISTED: usize = 10;

impl fmt::Display for DriftVerdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Same => "same",
            Self::Within => "within",
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
        let Self { verdict, comparisons, findings, data, differences, attribution, not_attributed } = self;
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
            writeln!(f, "{:<8} {finding}", finding.verdict)?;
        }
        if !differences.is_empty() {
            writeln!(f, "\nDifferent from the baseline:")?;
        }
        for difference in differences {
            // Values such as configurations are long.
            let values = [&difference.baseline, &difference.now].map(|value| value.as_deref().unwrap_or("nothing"));
            let [was, now] = excerpts(values, 48);
            writeln!(f, "  {}: was {was}, is now {now}", difference.what)?;
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
        write!(f, "{of}: {}: {count}, such as {example}", kind.description())
    }
}

impl DriftReport {
    /// What changed: metrics themselves, then the first changed stage, or what was compared without a change.
    fn conclusion(&self) -> String {
        let (changed, unexplained) = self.drifted_metrics();
        let of_metric = |(metric, what): &(&str, &str)| {
            format!("The {what} of {metric} is not the baseline's, which moves its numbers whatever the methods do. ")
        };
        let metrics: String = changed.iter().map(of_metric).collect();
        format!("{metrics}{}", self.stages(unexplained))
    }

    /// The metrics that drifted and are measured otherwise than in the baseline, with what differs about them; and whether a metric
    /// drifted that is measured as before.
    fn drifted_metrics(&self) -> (Vec<(&str, &str)>, bool) {
        const FIELDS: [(&str, &str); 2] = [("convention", "convention"), ("weights-sha256", "weights file")];
        let comparisons = self.comparisons.iter().filter(|comparison| comparison.verdict == DriftVerdict::Drifted);
        let drifted: BTreeSet<&str> = comparisons.map(|comparison| comparison.metric.as_str()).collect();
        let differs = |what: &str| self.differences.iter().any(|difference| difference.what == what);
        let changed = |metric: &str| {
            FIELDS.into_iter().find(|(field, _)| differs(&format!("metric {metric}, {field}"))).map(|(_, what)| what)
        };
        let (mut named, mut unexplained) = (Vec::new(), false);
        for metric in drifted {
            match changed(metric) {
                Some(what) => named.push((metric, what)),
                None => unexplained = true,
            }
        }
        (named, unexplained)
    }

    /// The first changed stage, or what was compared without a change; `moved` says whether a number did.
    fn stages(&self, moved: bool) -> String {
        if let Some(stage) = self.first_stage() {
            return format!("The first stage that changed is the {}.", stage.name());
        }
        let data = match self.data.verdict() {
            StageVerdict::Empty => "No image of the dataset could be compared",
            _ => "The dataset's images are the baseline's",
        };
        let stages = self.attribution.iter().flat_map(|attribution| &attribution.stages);
        let empty: Vec<&str> =
            stages.filter(|stage| stage.verdict == StageVerdict::Empty).map(|stage| stage.stage.name()).collect();
        match &self.attribution {
            None if self.not_attributed.is_some() => format!("{data}; the probe could not be run."),
            None => format!("{data}; no probe was run."),
            Some(_) if empty.is_empty() && moved => format!(
                "{data}; no stage of the probe changed. The cause is outside atsplat's pipeline: the method's files, such as \
                 renders or weights, or its code."
            ),
            Some(_) if empty.is_empty() => format!("{data}; no stage of the probe changed."),
            Some(_) => format!("{data}; the probe had nothing to compare for: {}.", empty.join(", ")),
        }
    }
}

fn line(f: &mut fmt::Formatter<'_>, comparison: &Comparison) -> fmt::Result {
    let Comparison { preset, method, metric, verdict, basis, baseline, now, paired, changed, .. } = comparison;
    let number = |value: &Option<f64>| value.map_or("-".to_owned(), |value| score(metric, value));
    let difference = paired.as_ref().map_or("-".to_owned(), |paired| change(metric, paired.difference));
    let interval = paired.as_ref().and_then(|paired| paired.interval);
    let interval = interval.map_or("-".to_owned(), |bounds| range(metric, bounds));
    let direction = comparison
        .improved()
        .filter(|_| *verdict == DriftVerdict::Drifted)
        .map_or("", |better| if better { ", better" } else { ", worse" });
    let targets = paired.as_ref().map_or("-".to_owned(), |paired| format!("{changed}/{}", paired.targets));
    writeln!(
        f,
        "{preset:<24} {method:<16} {metric:<12} {:>10} {:>10} {difference:>12} {interval:>26} {targets:>8} {basis:<8} {verdict}{direction}",
        number(baseline),
        number(now),
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
        write!(f, "; means may vary by {}, those of a scene by {}", size(metric, limit), size(metric, of_scene))?;
    }
    writeln!(f)
}

impl fmt::Display for Limit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { preset, method, metric, limit, runs, scene } = self;
        let runs = counted(*runs, "run");
        write!(f, "{preset}, {method}: {metric} may vary by {}, from {runs}", size(metric, *limit))?;
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
        let Self { compared, changed, unknown } = self;
        let differ = format!("{}/{compared}", changed.len());
        writeln!(f, "{:<10} {:<10} {differ:>15} images differ", "data", self.verdict())?;
        for image in changed.iter().take(MAX_LISTED) {
            writeln!(f, "    {}: {image}", image.preset)?;
        }
        if let Some(more) = changed.len().checked_sub(MAX_LISTED).filter(|more| *more > 0) {
            writeln!(f, "    and {more} more")?;
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
