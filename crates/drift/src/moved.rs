//! What moved: which recorded settings explain it, and what nothing that is recorded explains.

use std::collections::BTreeSet;

use atsplat_results::MethodRecord;

use super::change::Change;
use super::provenance::is_of_network;
use super::{Cause, Comparison, Difference, DriftReport, DriftVerdict, Finding, FindingKind, Setting};

/// Where a number moved, or a target has no score any more, although nothing that is recorded changed.
const OF_METHOD: &str = "outside atsplat's pipeline: the method's files, such as renders or weights, or its code";
/// Where targets of the baseline have no row, and nothing else moved.
const NOT_RUN: &str = "outside atsplat's pipeline: a part of the targets was run, as with a limit, a shard, scenes that are not \
                       in the data, or a run that is not done";
/// Fields of a method that say what its weights are.
const WEIGHTS: [&str; 3] = ["weights-sha256", MethodRecord::WEIGHTS_SEED, MethodRecord::BACKBONE_SHA256];
/// Fields of a method that say what its network is.
const NETWORK: [&str; 2] = [MethodRecord::MODEL, MethodRecord::MODEL_HASH];

/// Metrics that drifted and are not measured as in the baseline, metrics that are not computed any more, and methods that drifted with
/// other settings or weights or were not run.
pub(super) fn causes_of_drift(
    comparisons: &[Comparison],
    findings: &[Finding],
    differences: &[Difference],
) -> Vec<Change> {
    let drifted = || comparisons.iter().filter(|comparison| comparison.verdict == DriftVerdict::Drifted);
    let metrics: BTreeSet<&str> = drifted().map(|comparison| comparison.metric.as_str()).collect();
    let of_metric = |metric: &&str| {
        let what = measured_differently(metric, differences)?;
        Some(Change::new(Cause::Metric, format!("the {what} of {metric} is not the baseline's")))
    };
    let loses_scores = findings.iter().any(|finding| finding.kind == FindingKind::Score);
    let lost = differences.iter().filter(|difference| loses_scores && is_lost_metric(difference));
    let of_lost = lost.map(|difference| Change::new(Cause::Metric, difference.to_string()));
    let of_findings = findings.iter().filter(|finding| is_moved(finding, differences));
    let methods: BTreeSet<&str> = drifted()
        .map(|comparison| comparison.method.as_str())
        .chain(of_findings.map(|finding| finding.method.as_str()))
        .collect();
    let settings = methods.into_iter().flat_map(|method| settings_of(method, differences));
    let of_settings = settings.map(|difference| Change::new(Cause::Method, difference.to_string()));
    metrics.iter().filter_map(of_metric).chain(of_lost).chain(of_settings).collect()
}

/// What differs about how a metric is measured, if something does.
fn measured_differently(metric: &str, differences: &[Difference]) -> Option<&'static str> {
    const FIELDS: [(&str, &str); 2] = [("convention", "convention"), ("weights-sha256", "weights file")];
    let setting = Setting::Metric(metric.to_owned());
    let is_field =
        |difference: &Difference, field: &str| difference.of == setting && difference.field.as_deref() == Some(field);
    let differs = |field: &str| differences.iter().any(|difference| is_field(difference, field));
    FIELDS.into_iter().find(|&(field, _)| differs(field)).map(|(_, what)| what)
}

/// Whether it says that a metric was computed for the baseline, and no longer is.
fn is_lost_metric(difference: &Difference) -> bool {
    let Difference { of: Setting::Metric(_), field, baseline, now } = difference else { return false };
    match field.as_deref() {
        None => now.as_deref() == Some("absent"),
        Some(field) => field == "absent" && baseline.is_none(),
    }
}

/// Whether what a method gave is not what it gave in the baseline.
fn is_moved(finding: &Finding, differences: &[Difference]) -> bool {
    finding.verdict == DriftVerdict::Drifted
        && match finding.kind {
            FindingKind::Missing | FindingKind::Status | FindingKind::Render | FindingKind::Count => true,
            // A metric that is not computed at all is a change of its own.
            FindingKind::Score => !differences.iter().any(is_lost_metric),
            _ => false,
        }
}

/// The settings of a method that differ: its weights first, then its network. Whether it was run at all is one of them.
fn settings_of<'a>(method: &str, differences: &'a [Difference]) -> Vec<&'a Difference> {
    let of = Setting::Method(method.to_owned());
    let rank = |difference: &Difference| match difference.field.as_deref() {
        _ if difference.of != of => None,
        None => Some(0),
        // The same renders may be in another folder.
        Some("folder") => None,
        Some(field) if WEIGHTS.contains(&field) => Some(1),
        Some(field) if NETWORK.contains(&field) => Some(2),
        Some(field) if is_of_network(field) => Some(3),
        Some(_) => Some(4),
    };
    let mut found: Vec<(u8, &Difference)> =
        differences.iter().filter_map(|difference| Some((rank(difference)?, difference))).collect();
    found.sort_by_key(|(rank, _)| *rank);
    found.into_iter().map(|(_, difference)| difference).collect()
}

impl DriftReport {
    /// What moved although neither its metric nor its method is known to have changed: the detail of [`Cause::Outside`]. `None` if
    /// nothing did, or if nothing was compared, so that the baseline may be that of another run.
    pub(super) fn moved_outside(&self) -> Option<String> {
        if self.compared_nothing() {
            return None;
        }
        let is_unexplained = |method: &str| settings_of(method, &self.differences).is_empty();
        let is_number = |comparison: &Comparison| {
            comparison.verdict == DriftVerdict::Drifted
                && is_unexplained(&comparison.method)
                && measured_differently(&comparison.metric, &self.differences).is_none()
        };
        let is_found = |finding: &&Finding| is_moved(finding, &self.differences) && is_unexplained(&finding.method);
        let found: Vec<&Finding> = self.findings.iter().filter(is_found).collect();
        let (missing, given): (Vec<&Finding>, Vec<&Finding>) =
            found.into_iter().partition(|finding| finding.kind == FindingKind::Missing);
        let (cause, example) = if given.is_empty() && !self.comparisons.iter().any(is_number) {
            (NOT_RUN, Some(*missing.first()?))
        } else {
            // A number that moved says more than that its render did.
            (OF_METHOD, given.into_iter().find(|finding| finding.kind != FindingKind::Render))
        };
        Some(example.map_or_else(|| cause.to_owned(), |finding| format!("{cause}; {finding}")))
    }
}
