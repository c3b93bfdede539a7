use atsplat_results::{MethodRecord, Results, Shard};

use super::*;
use crate::sample::{atsplat, nearest_view, preset, results, results_over};

#[test]
fn settings_of_several_stores_are_on_one_frontier() {
    let first = results(vec![preset("re10k-2v-256")], vec![atsplat("atsplat", |_| ()), nearest_view()]);
    let more = results(vec![preset("re10k-2v-256")], vec![atsplat("atsplat", |_| ())]);
    let sources = [Source { label: "run", results: &first }, Source { label: "more", results: &more }];
    let all = merged_results(&sources, &first.provenance.presets[0]);
    let names: Vec<&str> = all.provenance.methods.iter().map(|method| method.name.as_str()).collect();
    assert_eq!(names, ["atsplat", "nearest-view", "atsplat, more"]);
    assert_eq!(all.trials.len(), first.trials.len() + more.trials.len());
    let plots = frontier_plots(&sources).unwrap();
    assert_eq!(plots.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>(), ["frontier-re10k-2v-256"]);
    let texts: Vec<&str> = plots[0].1.texts().collect();
    assert!(texts.iter().any(|text| text.contains("No point against Gaussians: Nearest view")), "{texts:?}");
    assert!(texts.iter().any(|text| text.contains("Frontier against time: ")), "{texts:?}");
    assert_eq!(plots[0].1.faults(), []);
}

#[test]
fn times_of_whole_answers_are_marked_on_the_axis_of_time_alone() {
    let mut results = results(vec![preset("re10k-2v-256")], vec![atsplat("a", |_| ()), atsplat("b", |_| ())]);
    let texts = |results: &Results| {
        let plots = frontier_plots(&[Source { label: "run", results }]).unwrap();
        assert_eq!(plots[0].1.faults(), []);
        plots[0].1.texts().map(str::to_owned).collect::<Vec<_>>()
    };
    assert!(!texts(&results).iter().any(|text| text.contains('‡')));
    results.provenance.methods[0].kind = "exec".to_owned();
    let texts = texts(&results);
    let count = |label: &str| texts.iter().filter(|text| text.trim_end_matches(" ?") == label).count();
    assert_eq!([count("ATSplat (a) ‡"), count("ATSplat (a)")], [1, 1], "{texts:?}");
    assert_eq!([count("ATSplat (b) ‡"), count("ATSplat (b)")], [0, 2], "{texts:?}");
    let said = texts.join(" ");
    assert!(said.contains("; ‡ the whole answer, with reading and writing of files"), "{said}");
}

/// The second method is 3 dB worse in every scene.
#[test]
fn few_scenes_are_named_as_the_reason_for_no_interval() {
    let methods = || vec![atsplat("a", |_| ()), atsplat("b", |_| ())];
    let says = |scenes| {
        let results = results_over(vec![preset("re10k-2v-256")], methods(), scenes);
        let plots = frontier_plots(&[Source { label: "run", results: &results }]).unwrap();
        plots[0].1.texts().any(|text| text.contains("With fewer than 6 scenes there is no interval"))
    };
    // The third scene of the second method failed.
    assert_eq!([6, 7].map(says), [true, false]);
}

#[test]
fn protocols_of_one_name_have_separate_plots() {
    let first = results(vec![preset("re10k-2v-256")], vec![atsplat("a", |_| ()), atsplat("b", |_| ())]);
    let mut changed = first.clone();
    changed.provenance.presets[0].hash = "another".to_owned();
    let mut repainted = first.clone();
    repainted.trials.iter_mut().for_each(|row| row.data_hash = Some("other images".to_owned()));
    for other in [changed, repainted] {
        let sources = [Source { label: "run", results: &first }, Source { label: "elsewhere", results: &other }];
        let plots = frontier_plots(&sources).unwrap();
        let names: Vec<&str> = plots.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(names, ["frontier-re10k-2v-256", "frontier-re10k-2v-256-2"]);
        let texts: Vec<&str> = plots[0].1.texts().collect();
        assert!(texts.iter().any(|text| text.contains("ATSplat (a)")), "of one title: {texts:?}");
        assert!(!texts.iter().any(|text| text.contains("elsewhere")), "{texts:?}");
    }
}

/// All texts of the first plot of a store, one after the other.
fn said(results: &Results) -> String {
    let plots = frontier_plots(&[Source { label: "run", results }]).unwrap();
    assert_eq!(plots[0].1.faults(), []);
    plots[0].1.texts().collect::<Vec<_>>().join("\n")
}

/// The third scene of the second method failed.
#[test]
fn a_mean_over_fewer_targets_says_so() {
    let store = |methods| results_over(vec![preset("re10k-2v-256")], methods, 8);
    let lacking = said(&store(vec![atsplat("a", |_| ()), atsplat("b", |_| ())]));
    let expected = "Means over fewer targets: ATSplat (b): 7 of 8 scenes, 21 of 24 targets.";
    assert!(lacking.contains(expected) && !lacking.contains("Incomplete"), "{lacking}");
    let mut whole = store(vec![atsplat("a", |_| ()), nearest_view(), atsplat("b", |_| ())]);
    whole.provenance.methods.remove(1);
    whole.trials.retain(|row| row.key.method != "nearest-view");
    whole.targets.retain(|row| row.key.method != "nearest-view");
    assert!(!said(&whole).contains("fewer targets"));
    whole.provenance.shard = Some(Shard { number: 2, count: 3 });
    assert!(said(&whole).contains(" Incomplete: shard 2 of 3 of the run."));
}

#[test]
fn intervals_are_promised_where_they_are_drawn() {
    let texts =
        |scenes| said(&results_over(vec![preset("re10k-2v-256")], vec![atsplat("a", |_| ()), nearest_view()], scenes));
    let bars = "Bars: 95 % intervals over scenes. Horizontal bars: quartiles of the time.";
    assert!(texts(8).contains(bars), "{}", texts(8));
    let few = texts(4);
    assert!(!few.contains("95 % intervals") && few.contains("Horizontal bars: quartiles of the time."), "{few}");
}

#[test]
fn the_title_names_the_costs_that_are_drawn() {
    let mut results = results(vec![preset("re10k-2v-256")], vec![atsplat("a", |_| ()), atsplat("b", |_| ())]);
    let has_title = |results: &Results, title: &str| said(results).lines().any(|line| line == title);
    assert!(has_title(&results, "PSNR against time to the first image and against Gaussians"));
    results.timings.clear();
    assert!(has_title(&results, "PSNR against Gaussians"), "{}", said(&results));
}

#[test]
fn a_device_is_that_of_its_method() {
    let mut results = results(vec![preset("re10k-2v-256")], vec![atsplat("a", |_| ()), atsplat("b", |_| ())]);
    for row in results.timings.iter_mut().filter(|row| row.key.method == "b") {
        row.network_adapter = Some("card".to_owned());
    }
    let one = said(&results);
    assert!(one.contains("; timed on a processor") && one.contains("; ATSplat (b): network on card"), "{one}");
    results.timings.iter_mut().for_each(|row| row.network_adapter = Some("card".to_owned()));
    let both = said(&results);
    assert!(both.contains("; network on card") && !both.contains(": network on card"), "{both}");
}

/// The second method is worse than the first, and faster.
#[test]
fn random_weights_are_on_no_frontier() {
    let random = MethodRecord { untrained: true, ..atsplat("b", |_| ()) };
    let mut results = results(vec![preset("re10k-2v-256")], vec![atsplat("a", |_| ()), random, nearest_view()]);
    results.timings.iter_mut().filter(|row| row.key.method == "b").for_each(|row| row.encode = vec![0.001; 5]);
    let texts = said(&results);
    assert!(texts.contains("No point: ATSplat (b), untrained (random weights)."), "{texts}");
    assert!(!texts.lines().any(|text| text.starts_with("ATSplat (b)")), "{texts}");
    assert_eq!(texts.matches("ATSplat (b)").count(), 1, "{texts}");
    results.provenance.methods.truncate(2);
    assert!(frontier_plots(&[Source { label: "run", results: &results }]).unwrap().is_empty(), "one method is left");
}
