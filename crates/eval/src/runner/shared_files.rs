//! Imported files that are scored under several protocols although these give a method other context views.

use std::collections::BTreeSet;

use atsplat_protocol::{EvaluationIndex, IndexEntry};
use atsplat_results::RunWarning;

use super::{Dataset, Findings, Plan};

impl Findings {
    /// Adds the scenes of a part of a dataset's index whose imported files are also those of another protocol of the plan, under which
    /// the method had to make them from other context views.
    pub(super) fn add_shared_files(&mut self, plan: &Plan<'_>, dataset: &Dataset, index: &EvaluationIndex) {
        for record in plan.methods.iter().map(|method| method.record()) {
            if !record.record_kind().imports_files() {
                continue;
            }
            // A file of Gaussians holds all frames.
            let is_of_frames = record.has_finished_images();
            let others = || plan.datasets.iter().filter(|other| other.name != dataset.name);
            let of_scene = |(scene, entries): (&String, &Vec<IndexEntry>)| {
                others().find_map(|other| {
                    let theirs = other.index.index.scenes.get(scene)?;
                    let at =
                        entries.iter().zip(theirs).position(|(entry, other)| are_shared(entry, other, is_of_frames))?;
                    let [here, there] = [entries, theirs].map(|all| all.get(at).map(frames).unwrap_or_default());
                    Some(format!("{scene}, entry {at}: frames {here}, and {there} under {}", other.name))
                })
            };
            let shared: Vec<String> = index.scenes.iter().filter_map(of_scene).collect();
            if let Some(first) = shared.first() {
                let kind = RunWarning::SharedFiles.about(&record.name);
                self.add(&dataset.name, &kind, shared.len() as u64, first.clone());
            }
        }
    }
}

/// Whether a file of one entry is also one of the other, which has other context views.
fn are_shared(entry: &IndexEntry, other: &IndexEntry, is_of_frames: bool) -> bool {
    let views = |entry: &IndexEntry| entry.context.iter().copied().collect::<BTreeSet<_>>();
    let has_shared_target = || entry.target.iter().any(|frame| other.target.contains(frame));
    views(entry) != views(other) && (!is_of_frames || has_shared_target())
}

fn frames(entry: &IndexEntry) -> String {
    entry.context.iter().map(ToString::to_string).collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_shared_if_an_entry_has_other_views_and_the_same_files() {
        let entry = |context: &[usize], target: &[usize]| IndexEntry {
            context: context.to_vec(),
            target: target.to_vec(),
            overlap: None,
        };
        let here = entry(&[0, 4], &[5, 6]);
        for (other, of_frames, of_scenes) in [
            (entry(&[0, 2, 4], &[6, 7]), true, true),
            (entry(&[0, 2, 4], &[7]), false, true),
            (entry(&[4, 0], &[5, 6]), false, false),
            (here.clone(), false, false),
        ] {
            assert_eq!([true, false].map(|is| are_shared(&here, &other, is)), [of_frames, of_scenes], "{other:?}");
        }
    }
}
