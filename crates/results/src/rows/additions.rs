//! What a run may add to the results that it resumes: metrics and scenes.

use atsplat_metrics::{Definition, definition};
use atsplat_numeric::counted;

use super::difference::differences;
use super::{MetricRecord, PresetRecord, Provenance};
use crate::ResultsError;

/// Digits of a hash that are shown.
const SHOWN_DIGITS: usize = 12;

impl Provenance {
    /// Takes over the metrics of a run that resumes these results: theirs, of which weights may be there that were not before, and
    /// others.
    ///
    /// # Errors
    /// [`ResultsError::Differences`] if the run would not compute one of theirs, or would compute it in another way: new rows would
    /// lack a number that others have.
    pub(super) fn add_metrics(&mut self, others: &[MetricRecord]) -> Result<(), ResultsError> {
        const ADVICE: &str = "; request the metrics of the existing results too (--metrics), with the same weights \
                              (--metric-weights), or choose another folder for the new results";
        let known = |id: &str| of_id(&self.metrics, id);
        let is_continued = |known: &MetricRecord, now: &MetricRecord| {
            let is_added = known.absent.is_some() && now.absent.is_none() && known.convention == now.convention;
            is_added || known.without_folders() == now.without_folders()
        };
        let missed = self.metrics.iter().filter_map(|known| {
            let now = of_id(others, &known.id);
            let is_same = now.is_some_and(|now| is_continued(known, now));
            (!is_same).then(|| described(["then", "now"], &known.id, [Some(known), now]))
        });
        differing("metrics", missed, ADVICE)?;
        // What was not computed for the same reason keeps its record.
        let joined = |now: &MetricRecord| {
            let same = known(&now.id).filter(|known| known.absent.is_some() == now.absent.is_some());
            same.unwrap_or(now).clone()
        };
        let metrics: Vec<MetricRecord> = others.iter().map(joined).collect();
        self.metrics = metrics;
        Ok(())
    }

    /// Checks that another part of the run has the same metrics, whichever folders were searched for weights.
    ///
    /// # Errors
    /// [`ResultsError::Differences`] naming those that differ.
    pub(super) fn check_metrics(&self, others: &[MetricRecord], advice: &'static str) -> Result<(), ResultsError> {
        let more = others.iter().filter(|other| of_id(&self.metrics, &other.id).is_none());
        let differing_ones = self.metrics.iter().chain(more).filter_map(|MetricRecord { id, .. }| {
            let records = [self.metrics.as_slice(), others].map(|metrics| of_id(metrics, id));
            let [first, second] = records.map(|record| record.map(MetricRecord::without_folders));
            (first != second).then(|| described(["in one store", "in the other"], id, records))
        });
        differing("metrics", differing_ones, advice)
    }

    /// Takes over the limit of a run that resumes these results, if it evaluates all of their scenes and more.
    ///
    /// # Errors
    /// [`ResultsError::Differences`] with both limits, also for a shard, whose scenes depend on the limit, and for a run without one
    /// of the protocols, whose scenes would stay limited.
    pub(super) fn extend_limit(&mut self, other: &Self) -> Result<(), ResultsError> {
        const ADVICE: &str = "; a run without --limit, or with a multiple of it, adds scenes to results of the same protocols that \
                              are not a shard; otherwise choose another folder for the new results";
        if self.limit == other.limit {
            return Ok(());
        }
        let left_out: Vec<&str> =
            self.presets.iter().map(|known| known.name.as_str()).filter(|name| other.preset(name).is_none()).collect();
        if self.shard.is_some() || !left_out.is_empty() || !is_extended(self.limit, other.limit) {
            let [then, now] = [self.limit, other.limit].map(scenes_of);
            let without =
                if left_out.is_empty() { String::new() } else { format!(", without {}", left_out.join(", ")) };
            return differing("limits", [format!("then {then}, now {now}{without}")], ADVICE);
        }
        self.limit = other.limit;
        for known in &mut self.presets {
            known.entries = other.preset(&known.name).map_or(known.entries, |now| now.entries);
        }
        Ok(())
    }

    /// Drops scenes that only the record has, of an undivided run that stopped before it evaluated one: the run that resumes these
    /// results has fewer, and at least as many as have results. Whether those are among its scenes, the run checks.
    pub(crate) fn forget_added_scenes(&mut self, run: &Self, entries_of: impl Fn(&str) -> u64) {
        let is_whole = self.limit.is_none() && self.shard.is_none();
        for known in self.presets.iter_mut().filter(|_| is_whole) {
            let now = run.preset(&known.name).filter(|now| now.index_sha256 == known.index_sha256);
            if let Some(now) = now.filter(|now| (entries_of(&known.name)..known.entries).contains(&now.entries)) {
                known.entries = now.entries;
                known.scenes_sha256.clone_from(&now.scenes_sha256);
            }
        }
    }

    /// Checks that another part of the run has the same limit.
    ///
    /// # Errors
    /// [`ResultsError::Differences`] with both limits.
    pub(super) fn check_limit(&self, other: &Self, advice: &'static str) -> Result<(), ResultsError> {
        let [first, second] = [self.limit, other.limit].map(scenes_of);
        let both = (first != second).then(|| format!("in one store {first}, in the other {second}"));
        differing("limits", both, advice)
    }
}

impl PresetRecord {
    /// Takes over the entries of an undivided run that resumes these results, if its data have more scenes of the index. Whether one of
    /// the old scenes is missing now, the run checks.
    ///
    /// # Errors
    /// [`ResultsError::Differences`] with both numbers if the data have fewer scenes of the same index than before.
    pub(super) fn add_scenes_of(&mut self, now: &Self) -> Result<(), ResultsError> {
        const ADVICE: &str = "; restore the data, or choose another folder for the new results";
        if now.entries > self.entries {
            self.entries = now.entries;
            self.scenes_sha256.clone_from(&now.scenes_sha256);
        } else if now.entries < self.entries && now.index_sha256 == self.index_sha256 {
            let (then, now) = (counted(self.entries, "entry"), now.entries);
            let (what, name) = ("scenes in the data under", Some(self.name.clone()));
            let differences = format!("then {then} of the index, now {now}");
            return Err(ResultsError::Differences { what, name, differences, advice: ADVICE });
        }
        Ok(())
    }
}

fn of_id<'a>(metrics: &'a [MetricRecord], id: &str) -> Option<&'a MetricRecord> {
    metrics.iter().find(|metric| metric.id == id)
}

/// An error with what differs, if anything does.
fn differing(
    what: &'static str,
    found: impl IntoIterator<Item = String>,
    advice: &'static str,
) -> Result<(), ResultsError> {
    let found: Vec<String> = found.into_iter().collect();
    if found.is_empty() {
        return Ok(());
    }
    Err(ResultsError::Differences { what, name: None, differences: found.join("; "), advice })
}

/// `st-lpips: then computed, now not requested`: a metric in both of two records.
fn described([first, second]: [&str; 2], id: &str, records: [Option<&MetricRecord>; 2]) -> String {
    let [one, other] = records.map(|record| record.map_or_else(|| "not requested".to_owned(), MetricRecord::in_words));
    if one == other {
        // Such as another convention.
        let [one, other] =
            records.map(|record| record.map(MetricRecord::without_folders).into_iter().collect::<Vec<_>>());
        return differences(&one, &other);
    }
    format!("{id}: {first} {one}, {second} {other}")
}

impl MetricRecord {
    /// Whether it was computed, and with which weights.
    fn in_words(&self) -> String {
        if let Some(reason) = self.reason_of_absence() {
            return match definition(&self.id).and_then(Definition::network) {
                Some(network) => format!("not computed, because its weights {} were not found", network.file()),
                None => format!("not computed ({reason})"),
            };
        }
        let weights = self.weights_sha256.as_deref().map(|hash| hash.get(..SHOWN_DIGITS).unwrap_or(hash));
        weights.map_or_else(|| "computed".to_owned(), |digits| format!("computed with weights of SHA-256 {digits}…"))
    }
}

/// Whether the scenes of one limit are among those of another: limited scenes are spread evenly ([`atsplat_numeric::spread`]), so
/// that those of a multiple contain them, however many there are.
fn is_extended(then: Option<u64>, now: Option<u64>) -> bool {
    match (then, now) {
        (Some(then), Some(now)) => now > then && now.is_multiple_of(then),
        (Some(_), None) => true,
        (None, _) => false,
    }
}

fn scenes_of(limit: Option<u64>) -> String {
    limit.map_or_else(|| "all scenes".to_owned(), |limit| counted(limit, "scene"))
}

#[cfg(test)]
mod tests {
    use atsplat_numeric::spread;

    use super::*;
    use crate::Shard;

    const ADVICE: &str = "; advice";

    fn metric(id: &str) -> MetricRecord {
        MetricRecord { id: id.to_owned(), convention: format!("as {id}"), ..MetricRecord::default() }
    }

    fn with_weights(id: &str, hash: &str) -> MetricRecord {
        MetricRecord { weights_sha256: Some(hash.to_owned()), ..metric(id) }
    }

    fn without_weights(id: &str, folder: &str) -> MetricRecord {
        let absent = Some(format!("weights absent: {id} needs a file; get it; looked in {folder}"));
        MetricRecord { absent, ..metric(id) }
    }

    fn run(metrics: &[MetricRecord]) -> Provenance {
        Provenance { metrics: metrics.to_vec(), ..Provenance::default() }
    }

    #[test]
    fn metrics_and_their_weights_are_added() {
        let then = [metric("psnr"), without_weights("lpips", "/a"), without_weights("st-lpips", "/a")];
        let now = [metric("psnr"), with_weights("lpips", "397923af"), without_weights("st-lpips", "/b"), metric("l1")];
        let mut known = run(&then);
        known.add_metrics(&now).unwrap();
        let [psnr, lpips, _, l1] = now.clone();
        assert_eq!(known.metrics, [psnr, lpips, without_weights("st-lpips", "/a"), l1], "in the order of the run");
        let error = known.check_metrics(&then, ADVICE).unwrap_err().to_string();
        let expected = "metrics of the two runs differ: lpips: in one store computed with weights of SHA-256 397923af…, in the \
                        other not computed, because its weights vgg16-397923af.pth were not found; l1: in one store computed, in \
                        the other not requested; advice";
        assert_eq!(error, expected);
        known.check_metrics(&now, ADVICE).unwrap();
    }

    #[test]
    fn metrics_that_a_run_would_not_compute_in_the_same_way_are_rejected() {
        let then = [metric("psnr"), with_weights("st-lpips", "b356b3824d5cfe"), metric("l1")];
        let refused = |now: &[MetricRecord]| {
            let mut known = run(&then);
            let error = known.add_metrics(now).unwrap_err();
            assert_eq!(known, run(&then), "nothing was taken over");
            match error {
                ResultsError::Differences { what: "metrics", differences, .. } => differences,
                other => panic!("{other}"),
            }
        };
        let [psnr, st_lpips, l1] = then.clone();
        assert_eq!(refused(&[psnr.clone(), st_lpips.clone()]), "l1: then computed, now not requested");
        let absent = "st-lpips: then computed with weights of SHA-256 b356b3824d5c…, now not computed, because its weights \
                      alex_shift_tolerant.pth were not found";
        assert_eq!(refused(&[psnr.clone(), without_weights("st-lpips", "/a"), l1.clone()]), absent);
        let other = refused(&[psnr, with_weights("st-lpips", "0123"), l1.clone()]);
        assert!(other.ends_with("b356b3824d5c…, now computed with weights of SHA-256 0123…"), "{other}");
        let convention = "as before".to_owned();
        let changed = refused(&[MetricRecord { convention, ..metric("psnr") }, st_lpips, l1]);
        assert_eq!(changed, "psnr.convention: as psnr and as before");
    }

    /// The scenes of the smaller limit are among those of the larger one, whatever their number.
    #[test]
    fn a_multiple_of_a_limit_has_its_scenes() {
        for (then, now) in (1..8).flat_map(|then| (1..30).map(move |now| (then, now))) {
            if is_extended(Some(then as u64), Some(now as u64)) {
                for all in 0..40 {
                    let scenes = spread(all, now);
                    assert!(spread(all, then).iter().all(|at| scenes.contains(at)), "{then} and {now} of {all}");
                }
            }
        }
        assert!(is_extended(Some(2), Some(6)) && !is_extended(Some(2), Some(5)) && !is_extended(Some(4), Some(2)));
        assert!(is_extended(Some(2), None) && !is_extended(None, Some(2)) && !is_extended(Some(0), Some(2)));
    }

    /// A chunk of the data was missing, is there now, and is missing again. Another index is another run.
    #[test]
    fn scenes_that_were_missing_are_added() {
        let of = |entries, scenes: &str, index: &str| PresetRecord {
            name: "p".to_owned(),
            index_sha256: index.to_owned(),
            entries,
            scenes_sha256: Some(scenes.to_owned()),
            ..PresetRecord::default()
        };
        let run = |preset: PresetRecord| {
            let schema_version = crate::store::SCHEMA_VERSION;
            Provenance { schema_version, presets: vec![preset], ..Provenance::default() }
        };
        let mut known = run(of(189, "some", "index"));
        known.resume_with(run(of(225, "all", "index"))).unwrap();
        assert_eq!(known, run(of(225, "all", "index")));
        let refused = known.clone().resume_with(run(of(189, "some", "index"))).unwrap_err().to_string();
        let expected = "scenes in the data under p of the two runs differ: then 225 entries of the index, now 189; ";
        assert!(refused.starts_with(expected) && refused.contains("restore the data"), "{refused}");
        for entries in [189, 300] {
            let refused = known.clone().resume_with(run(of(entries, "all", "another"))).unwrap_err().to_string();
            assert!(
                refused.starts_with("presets p of the two runs differ: ") && refused.contains("index"),
                "{refused}"
            );
        }
        let shard = |entries| {
            let shard = Some(Shard { number: 1, count: 2 });
            Provenance { shard, ..run(of(entries, "all", "index")) }
        };
        assert!(shard(189).resume_with(shard(225)).is_err(), "a part of the scenes");
    }

    #[test]
    fn a_limit_is_extended_for_all_protocols_or_not() {
        let of = |limit, presets: &[(&str, u64)]| {
            let preset = |(name, entries): &(&str, u64)| PresetRecord {
                name: (*name).to_owned(),
                entries: *entries,
                ..PresetRecord::default()
            };
            Provenance { limit, presets: presets.iter().map(preset).collect(), ..Provenance::default() }
        };
        let then = of(Some(3), &[("a", 3), ("b", 6)]);
        let now = of(None, &[("b", 40), ("c", 7), ("a", 20)]);
        let mut known = then.clone();
        known.extend_limit(&now).unwrap();
        assert_eq!(known, of(None, &[("a", 20), ("b", 40)]), "other protocols are added elsewhere");
        let refused = |known: &Provenance, now: &Provenance| {
            let mut extended = known.clone();
            let error = extended.extend_limit(now).unwrap_err().to_string();
            assert_eq!(extended, *known);
            error
        };
        let error = refused(&then, &of(None, &[("a", 20)]));
        assert!(
            error.starts_with("limits of the two runs differ: then 3 scenes, now all scenes, without b; "),
            "{error}"
        );
        let error = refused(&now, &Provenance { limit: Some(1), ..now.clone() });
        assert!(error.contains("then all scenes, now 1 scene; "), "{error}");
        let shard = Provenance { shard: Some(Shard { number: 1, count: 2 }), ..then.clone() };
        let error = refused(&shard, &Provenance { limit: None, ..shard.clone() });
        assert!(error.contains("then 3 scenes, now all scenes; ") && error.contains("not a shard"), "{error}");
        let error = then.check_limit(&now, ADVICE).unwrap_err().to_string();
        assert_eq!(error, "limits of the two runs differ: in one store 3 scenes, in the other all scenes; advice");
        then.check_limit(&of(Some(3), &[]), ADVICE).unwrap();
    }
}
