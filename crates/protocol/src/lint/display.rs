use std::fmt;

use atsplat_numeric::counted;

use super::{CountDistribution, DatasetFacts, LintReport, OverlapFacts, TargetCount};

impl fmt::Display for LintReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(file) = &self.file {
            row(f, "file", &format!("sha256 {}, {} bytes", file.sha256, file.size))?;
        }
        row(f, "content", &format!("sha256 {}", self.content_sha256))?;
        match self.recognised {
            None => row(f, "recognised", "no: none of the published files that atsplat knows")?,
            Some(recognised) => {
                let known = recognised.known;
                let how = if recognised.by_bytes { "" } else { ", same content in other bytes" };
                row(f, "recognised", &format!("{}, {} {}{how}", known.name, known.repository, known.path))?;
                row(f, "", known.notes)?;
            }
        }
        row(f, "keys", &format!("{}: {} null, {}", self.keys, self.null, counted(self.scenes, "scene")))?;
        if self.entries != self.scenes {
            row(f, "entries", &self.entries.to_string())?;
        }
        distribution(f, "context views", self.context_per_entry)?;
        distribution(f, "context gap", self.context_gap)?;
        row(f, "targets", &self.targets.to_string())?;
        distribution(f, "targets per scene", self.targets_per_scene)?;
        row(f, "leaked", &self.share(self.leaked, Self::LEAKED))?;
        row(f, "outside window", &self.share(self.outside_window, ["target", "targets"]))?;
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
    /// What leaked targets are, one and several.
    pub(super) const LEAKED: [&'static str; 2] = ["target is a context frame", "targets are context frames"];

    fn share(&self, places: TargetCount, what: [&str; 2]) -> String {
        if places.targets == 0 {
            return "none".to_owned();
        }
        let percent = 100.0 * places.targets as f64 / self.targets as f64;
        let scenes = counted(places.scenes, "scene");
        format!("{} ({percent:.1} %), in {scenes}", phrase(places.targets, what))
    }

    /// Counts of what entries should not have, zeros included, with phrases for one and for several.
    pub(super) const fn odd_entries(&self) -> [(u64, [&'static str; 2]); 5] {
        [
            (self.repeats.targets, ["target repeated in its entry", "targets repeated in their entry"]),
            (self.repeats.context, ["context frame repeated in its entry", "context frames repeated in their entry"]),
            (self.repeats.entries, ["entry repeated in its scene", "entries repeated in their scene"]),
            (self.without_context, ["entry without context frames", "entries without context frames"]),
            (self.without_targets, ["entry without targets", "entries without targets"]),
        ]
    }

    /// Lines for irregularities; none if there are none.
    fn irregularities(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut odd = self.odd_entries().to_vec();
        if let Some(file) = &self.file {
            let keys = file.notices.duplicate_keys.len() as u64;
            let repeated = ["repeated scene key; its last value counts", "repeated scene keys; the last value counts"];
            odd.push((keys, repeated));
            let words =
                ["overlap given as a word, read as NoPoSplat does", "overlaps given as words, read as NoPoSplat does"];
            odd.push((file.notices.overlap_words, words));
            odd.push((
                file.notices.unmeasured_overlaps,
                ["overlap of -1, read as none", "overlaps of -1, read as none"],
            ));
            let unscored = [
                "frame of the field \"target\" is no target: \"target_quantify\" lists those to score",
                "frames of the field \"target\" are no targets: \"target_quantify\" lists those to score",
            ];
            odd.push((file.notices.unscored_targets, unscored));
        }
        let counts = odd.into_iter().filter(|(count, _)| *count > 0).map(|(count, what)| phrase(count, what));
        let fields = self.file.iter().flat_map(|file| &file.notices.unknown_fields);
        let unknown = fields.map(|(name, count)| format!("{count} × field {name:?}, which the format does not define"));
        for (at, text) in counts.chain(unknown).enumerate() {
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

impl DatasetFacts {
    /// What targets with leaked images are, one and several.
    pub(super) const LEAKED_IMAGES: [&'static str; 2] =
        ["target shows the image file of a context frame", "targets show the image file of a context frame"];
}

impl fmt::Display for DatasetFacts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let dropped: u64 = self.dropped.values().sum();
        let usable = phrase(self.usable, ["entry gives a trial", "entries give a trial"]);
        row(f, "dataset", &format!("{usable}, {}", phrase(dropped, ["does not", "do not"])))?;
        for (reason, count) in &self.dropped {
            row(f, "", &format!("{count} dropped: {}", reason.name()))?;
            for example in self.examples.iter().filter(|example| example.reason == *reason) {
                row(f, "", &format!("  {:?} entry {}: {}", example.scene, example.entry, example.detail))?;
            }
        }
        if self.leaked_images > 0 {
            row(f, "", &phrase(self.leaked_images, Self::LEAKED_IMAGES))?;
        }
        if self.unused_scenes > 0 {
            let what =
                ["scene of the dataset is not used by the index", "scenes of the dataset are not used by the index"];
            row(f, "", &phrase(self.unused_scenes, what))?;
        }
        Ok(())
    }
}

/// A count, with what follows it for one and for several.
pub(super) fn phrase(count: u64, [one, several]: [&str; 2]) -> String {
    format!("{count} {}", if count == 1 { one } else { several })
}

fn distribution(f: &mut fmt::Formatter<'_>, name: &str, distribution: Option<CountDistribution>) -> fmt::Result {
    match distribution {
        None => row(f, name, "none"),
        Some(CountDistribution { min, max, .. }) if min == max => row(f, name, &min.to_string()),
        Some(CountDistribution { min, median, mean, max }) => {
            row(f, name, &format!("{min} to {max}, median {median}, mean {mean:.2}"))
        }
    }
}

fn row(f: &mut fmt::Formatter<'_>, name: &str, value: &str) -> fmt::Result {
    writeln!(f, "{name:<20}{value}")
}
