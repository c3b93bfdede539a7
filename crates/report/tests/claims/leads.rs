//! Leads of one row over another, along overlap and along the distance outside the window.

use atsplat_protocol::{Aggregation, Preset};
use atsplat_results::statistics::{Leaked, MetricQuery, lead_along_distance, lead_along_overlap, paired_between};
use atsplat_results::{Results, TargetRow};

use crate::{ROOMS, difference_under, folder, in_decibels, query, require_lines, with_interval};

/// Whether offsets lead rays by more where views overlap less. The rows have no overlaps; an index with the same trials has.
#[test]
fn leads_of_offsets_over_rays_by_overlap_are_those_of_the_stores() {
    let readme = std::fs::read_to_string(folder().join("README.md")).unwrap();
    let index = folder().join("../../eval/experiments/claims/protocols/rooms-2v-200-overlaps.json");
    let index: serde_json::Value = serde_json::from_slice(&std::fs::read(index).unwrap()).unwrap();
    let slope = |training: usize, store: &str| {
        let mut trained = Training::read(training, store, ["full", "anchor-ray-depth"]);
        for row in &mut trained.results.targets {
            row.overlap = index[&row.key.scene]["overlap"].as_f64();
        }
        in_decibels(&trained.change_per_tenth_of_overlap())
    };
    let expected = vec![slope(1, "anchors"), slope(2, "anchors-seed-2")];
    require_lines(expected, |number| readme.contains(number));
}

/// The same after three times the samples, and whether offsets lead rays by more outside the window, training by training.
#[test]
fn leads_of_offsets_over_rays_outside_the_window_are_those_of_the_stores() {
    let readme = std::fs::read_to_string(folder().join("README.md")).unwrap();
    let trainings = [(1, "window"), (2, "window-seed-2")]
        .map(|(training, store)| Training::read(training, store, ["window", "window-ray-depth"]));
    let line = |text: &str, number: &dyn Fn(&Training) -> String| {
        let [first, second] = trainings.each_ref().map(number);
        format!("| {text} | {first} | {second} |")
    };
    let expected = vec![
        line("between two views", &|trained| trained.lead(ROOMS)),
        line("outside the window", &|trained| trained.lead(OUTSIDE)),
        line("1 to 15 frames outside", &|trained| trained.lead_at(1, 15)),
        line("16 to 30 frames outside", &|trained| trained.lead_at(16, 30)),
        line("31 to 45 frames outside", &|trained| trained.lead_at(31, 45)),
        line("change per frame outside", &Training::change_per_frame_outside),
        line("change per 0.1 of overlap", &Training::change_per_tenth_of_overlap),
    ];
    require_lines(expected, |line| readme.lines().any(|there| there == line));
    // The table of claims quotes both changes of each training.
    let changes = |trained: &Training| [trained.change_per_frame_outside(), trained.change_per_tenth_of_overlap()];
    let quoted = trainings.iter().flat_map(changes).map(|change| in_decibels(&change)).collect();
    require_lines(quoted, |number| readme.contains(number));
}

const OUTSIDE: (&str, u64, u64) = ("rooms-extrapolation-64", 200, 600);

/// A training of two rows: one with offsets from anchors, and one with Gaussians on rays.
struct Training {
    results: Results,
    rows: [String; 2],
}

impl Training {
    fn read(training: usize, store: &str, rows: [&str; 2]) -> Self {
        let results = Results::read(&folder().join(store).join("store")).unwrap();
        Self { results, rows: rows.map(|row| format!("{row}-{training}")) }
    }

    fn queries(&self, preset: &'static str) -> [MetricQuery<'_>; 2] {
        self.rows.each_ref().map(|row| MetricQuery { leaked: Leaked::Excluded, ..query(preset, row, "psnr") })
    }

    fn lead(&self, protocol: (&'static str, u64, u64)) -> String {
        difference_under(protocol, self.rows.each_ref().map(|row| (&self.results, row.as_str())), "psnr", 3)
    }

    fn change_per_frame_outside(&self) -> String {
        let [offsets, rays] = self.queries(OUTSIDE.0);
        let found = lead_along_distance((&self.results, &offsets), (&self.results, &rays)).unwrap();
        with_interval(found.slope, found.interval.unwrap(), 3)
    }

    fn change_per_tenth_of_overlap(&self) -> String {
        let [offsets, rays] = self.queries(ROOMS.0);
        let found = lead_along_overlap((&self.results, &offsets), (&self.results, &rays)).unwrap();
        assert_eq!(found.scenes, 200, "{}", self.rows[0]);
        with_interval(found.slope / 10.0, found.interval.unwrap().map(|end| end / 10.0), 3)
    }

    /// On targets of so many frames outside the window.
    fn lead_at(&self, from: u64, to: u64) -> String {
        let mut results = self.results.clone();
        results.targets.retain(|row| (from..=to).contains(&row.signed_distance.unsigned_abs()));
        let [offsets, rays] = self.queries(OUTSIDE.0);
        let found = paired_between((&results, &offsets), (&results, &rays), Aggregation::SceneMeans).unwrap();
        with_interval(found.difference, found.interval.unwrap(), 3)
    }
}

/// How far the embedded network is ahead of the plane warp on all rooms, as the page of the checkpoints says.
#[test]
fn leads_of_the_embedded_network_are_those_of_the_stores() {
    let page = std::fs::read_to_string(folder().join("../../eval/checkpoints/README.md")).unwrap();
    let lead = |store: &str, preset: &'static str, keep: &dyn Fn(&TargetRow) -> bool| {
        let mut results = Results::read(&folder().join(store).join("store")).unwrap();
        results.targets.retain(keep);
        let difference = |metric: &'static str, decimals: usize| {
            let rows =
                ["atsplat", "warp"].map(|row| MetricQuery { leaked: Leaked::Excluded, ..query(preset, row, metric) });
            let found = paired_between((&results, &rows[0]), (&results, &rows[1]), Aggregation::SceneMeans).unwrap();
            (with_interval(found.difference, found.interval.unwrap(), decimals), found.scenes)
        };
        let ((psnr, scenes), (ssim, _)) = (difference("psnr", 2), difference("ssim", 3));
        format!("{scenes} | {psnr} | {ssim} |")
    };
    let bins = Preset::named("rooms-overlap-128").unwrap().overlap_bins.unwrap();
    let overlap = |name: &'static str| {
        lead("overlap", "rooms-overlap-128", &|row| row.overlap.and_then(|overlap| bins.name_of(overlap)) == Some(name))
    };
    let outside = |from: u64, to: u64| {
        let is_inside = |row: &TargetRow| (from..=to).contains(&row.signed_distance.unsigned_abs());
        lead("extrapolation", "rooms-extrapolation-128", &is_inside)
    };
    let expected = [
        format!("| two views | {}", lead("rooms-2v", "rooms-2v-128", &|_| true)),
        format!("| small overlap | {}", overlap("small")),
        format!("| medium overlap | {}", overlap("medium")),
        format!("| large overlap | {}", overlap("large")),
        format!("| outside the window | {}", lead("extrapolation", "rooms-extrapolation-128", &|_| true)),
        format!("| 1 to 15 frames outside | {}", outside(1, 15)),
        format!("| 16 to 30 frames outside | {}", outside(16, 30)),
        format!("| 31 to 45 frames outside | {}", outside(31, 45)),
    ];
    require_lines(expected.to_vec(), |line| page.contains(line));
}
