use std::fmt;

use super::{DatasetFacts, LintReport, OverlapFacts, Spread, TargetCount};

impl fmt::Display for LintReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(file) = &self.file {
            row(f, "file", &format!("sha256 {}, {} bytes", file.sha256, file.size))?;
        }
        row(f, "content", &format!("sha256 {}", self.content_sha256))?;
        match self.recognised {
            None => row(f, "recognised", "no: not an official index file")?,
            Some(recognised) => {
                let known = recognised.known;
                let how = if recognised.by_bytes { "" } else { ", same content in other bytes" };
                row(f, "recognised", &format!("{}, {} {}{how}", known.name, known.repository, known.path))?;
                row(f, "", known.notes)?;
            }
        }
        row(f, "keys", &format!("{}: {} null, {} scenes", self.keys, self.null, self.scenes))?;
        if self.entries != self.scenes {
            row(f, "entries", &self.entries.to_string())?;
        }
        spread(f, "context views", self.context_per_entry)?;
        spread(f, "context gap", self.context_gap)?;
        row(f, "targets", &self.targets.to_string())?;
        spread(f, "targets per scene", self.targets_per_scene)?;
        row(f, "leaked", &self.share(self.leaked, "targets are context frames"))?;
        row(f, "outside window", &self.share(self.outside_window, "targets"))?;
        row(f, "targets by distance", &self.targets_by_distance.to_string())?;
        row(f, "windows at frame 0", &self.windows_at_zero.to_string())?;
        self.irregularities(f)?;
        match &self.overlap {
            None => row(f, "overlap", "none")?,
            Some(overlap) => write!(f, "{overlap}")?,
        }
        self.dataset.as_ref().map_or(Ok(()), |dataset| write!(f, "{dataset}"))
    }
}

impl LintReport {
    fn share(&self, places: TargetCount, what: &str) -> String {
        if places.targets == 0 {
            return "none".to_owned();
        }
        let percent = 100.0 * places.targets as f64 / self.targets as f64;
        format!("{} {what} ({percent:.1} %), in {} scenes", places.targets, places.scenes)
    }

    /// Lines for irregularities; none if there are none.
    fn irregularities(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let repeats = self.repeats;
        let mut odd = vec![
            (repeats.targets, "targets repeated in their entry"),
            (repeats.context, "context frames repeated in their entry"),
            (repeats.entries, "entries repeated in their scene"),
            (self.without_context, "entries without context frames"),
            (self.without_targets, "entries without targets"),
        ];
        if let Some(file) = &self.file {
            odd.push((file.notices.duplicate_keys.len() as u64, "repeated scene keys; the last value counts"));
            odd.push((file.notices.overlap_words, "overlaps given as words, read as NoPoSplat does"));
        }
        let odd = odd.into_iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!("{count} {what}"));
        let unknown = self.file.iter().flat_map(|file| &file.notices.unknown_fields);
        let unknown =
            unknown.map(|(name, count)| format!("{count} × field {name:?}, which the format does not define"));
        for (at, text) in odd.chain(unknown).enumerate() {
            row(f, if at == 0 { "odd" } else { "" }, &text)?;
        }
        Ok(())
    }
}

impl fmt::Display for OverlapFacts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        row(f, "overlap", &format!("{} to {}; {}", self.min, self.max, self.definition))?;
        row(f, "published bins", &self.published.to_string())?;
        row(f, "strict bins", &self.strict.to_string())
    }
}

impl fmt::Display for DatasetFacts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let dropped: u64 = self.dropped.values().sum();
        row(f, "dataset", &format!("{} entries give a trial, {dropped} do not", self.usable))?;
        for (reason, count) in &self.dropped {
            row(f, "", &format!("{count} dropped: {}", reason.name()))?;
            for example in self.examples.iter().filter(|example| example.reason == *reason) {
                row(f, "", &format!("  {:?} entry {}: {}", example.scene, example.entry, example.detail))?;
            }
        }
        if self.not_asked_for > 0 {
            row(f, "", &format!("{} scenes of the dataset are not used by the index", self.not_asked_for))?;
        }
        Ok(())
    }
}

fn spread(f: &mut fmt::Formatter<'_>, name: &str, spread: Option<Spread>) -> fmt::Result {
    match spread {
        None => row(f, name, "none"),
        Some(Spread { min, max, .. }) if min == max => row(f, name, &min.to_string()),
        Some(Spread { min, median, mean, max }) => {
            row(f, name, &format!("{min} to {max}, median {median}, mean {mean:.2}"))
        }
    }
}

fn row(f: &mut fmt::Formatter<'_>, name: &str, value: &str) -> fmt::Result {
    writeln!(f, "{name:<20}{value}")
}
