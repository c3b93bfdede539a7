use atsplat_numeric::Tolerance;
use atsplat_results::{MethodRecord, Shard, TargetRow, TrialKey, TrialStatus};

use super::*;
use crate::sample::{atsplat, nearest_view, preset, results, results_over};

/// Two budgets of refinement and one of 3DGS, with the network that refinement starts from and a baseline.
fn methods() -> Vec<MethodRecord> {
    let optimised = |name: &str, kind: &str| {
        let mut record = MethodRecord { kind: kind.to_owned(), parameters: [].into(), ..atsplat(name, |_| ()) };
        record.record_model("nano", "1f");
        record
    };
    vec![
        optimised("atsplat", "atsplat"),
        optimised("refined 10", "atsplat+refine"),
        optimised("refined 100", "atsplat+refine"),
        optimised("3dgs-100", "3dgs"),
        nearest_view(),
    ]
}

/// With two views, by times of a stated order.
#[test]
fn budgets_of_one_method_are_a_curve_that_starts_from_the_network() {
    let mut store = results(vec![preset("re10k-2v-256")], methods());
    for timing in &mut store.timings {
        let secs = match timing.key.method.as_str() {
            "refined 100" => 3.0,
            "atsplat" => 0.1,
            _ => 0.5,
        };
        timing.encode = vec![secs; 5];
    }
    for trial in &mut store.trials {
        trial.context_psnr = (trial.key.method == "3dgs-100").then_some(41.5);
    }
    let curves = |store: &Results| curves(store, &store.provenance.presets.iter().collect::<Vec<_>>()).unwrap();
    let found = curves(&store).unwrap();
    let [panel] = &found.panels[..] else { panic!("{:?}", found.panels) };
    assert_eq!(panel.name, "2 views · 4 scenes");
    let lengths: Vec<(&str, usize)> =
        panel.curves.iter().map(|(label, points)| (label.as_str(), points.len())).collect();
    assert_eq!(lengths, [("ATSplat + refinement", 3), ("3DGS", 1)]);
    let refined = &panel.curves[0].1;
    assert!(refined[0].secs < refined[1].secs && 4.0 * refined[1].secs < refined[2].secs, "{refined:?}");
    assert_eq!((refined[0].context, panel.curves[1].1[0].context), (None, Some(41.5)));

    // Targets that are context views are not held out.
    let mut leaking = store.clone();
    leaking.targets.extend(store.targets.iter().map(|target| {
        let scores = target.scores.keys().map(|metric| (metric.clone(), 99.0)).collect();
        TargetRow { target: target.target + 50, leaked: true, scores, ..target.clone() }
    }));
    let values = |store: &Results| {
        let of_curve = |(_, points): &(String, Vec<OptimisationPoint>)| -> Vec<f64> {
            points.iter().map(|point| point.held_out.value).collect()
        };
        curves(store).unwrap().panels[0].curves.iter().flat_map(of_curve).collect::<Vec<f64>>()
    };
    Tolerance::EXACT.assert(values(&leaking), values(&store), "held out");

    store.timings.retain(|timing| timing.key.method != "refined 100");
    let said = |store: &Results| curves(store).unwrap().draw().texts().collect::<Vec<_>>().join("\n");
    let note = said(&store);
    assert!(note.contains("Not plotted, because no time was measured: ") && !note.contains("interval"), "{note}");
    let mut many = results_over(vec![preset("re10k-2v-256")], methods(), 8);
    many.timings.iter_mut().for_each(|timing| timing.encode = vec![0.5; 5]);
    let note = said(&many);
    assert!(note.contains("Bars: 95 % intervals over scenes."), "{note}");
    let alone = results(vec![preset("re10k-2v-256")], vec![atsplat("atsplat", |_| ()), nearest_view()]);
    assert!(curves(&alone).is_none());
    // The same protocol with three views, on another index.
    let mut more = results(vec![preset("re10k-2v-256")], methods()[..4].to_vec());
    for (at, method) in more.provenance.methods.iter_mut().enumerate() {
        method.name = format!("{at} with three");
    }
    let renamed =
        |name: &str| format!("{} with three", methods().iter().position(|method| method.name == name).unwrap());
    more.provenance.presets[0].name.push_str("-3-views");
    let name = &more.provenance.presets[0].name;
    for trial in &mut more.trials {
        (trial.key.method, trial.key.preset) = (renamed(&trial.key.method), name.clone());
        trial.context = vec![0, 15, 30];
    }
    for target in &mut more.targets {
        (target.key.method, target.key.preset) = (renamed(&target.key.method), name.clone());
    }
    for timing in &mut more.timings {
        (timing.key.method, timing.key.preset) = (renamed(&timing.key.method), name.clone());
        timing.encode = vec![0.7; 5];
    }
    let mut both = store.clone();
    both.provenance.presets.extend(more.provenance.presets);
    both.provenance.methods.extend(more.provenance.methods);
    both.trials.extend(more.trials);
    both.targets.extend(more.targets);
    both.timings.extend(more.timings);
    let panels: Vec<String> = curves(&both).unwrap().panels.into_iter().map(|panel| panel.name).collect();
    assert_eq!(panels, ["2 views · 4 scenes", "3 views · 4 scenes"]);
    let source = |label| Source { label, results: &store };
    let names = optimisation_plots(&[source("a"), source("b")]).unwrap();
    let names: Vec<&str> = names.iter().map(|(name, _)| name.as_str()).collect();
    assert_eq!(names, ["optimisation-re10k-2v-256", "optimisation-re10k-2v-256-b"]);
}

#[test]
fn bins_of_overlap_have_separate_panels() {
    let mut overlap = results(vec![preset("re10k-overlap")], methods()[..4].to_vec());
    for (at, trial) in overlap.trials.iter_mut().enumerate() {
        trial.overlap = Some(if at % 2 == 0 { 0.2 } else { 0.7 });
        trial.context_psnr = Some(if at % 2 == 0 { 20.0 } else { 40.0 });
        if trial.key.scene == "aa11" {
            trial.status = TrialStatus::Partial;
        }
    }
    let of_trial = |key: &TrialKey| overlap.trials.iter().find(|trial| trial.key == *key).unwrap().overlap;
    let overlaps: Vec<_> = overlap.targets.iter().map(|target| of_trial(&target.key)).collect();
    overlap.targets.iter_mut().zip(overlaps).for_each(|(target, overlap)| target.overlap = overlap);
    overlap.timings.iter_mut().enumerate().for_each(|(at, timing)| timing.encode = vec![0.1 + at as f64; 5]);
    let OptimisationCurves { panels, subtitle, .. } =
        curves(&overlap, &[&overlap.provenance.presets[0]]).unwrap().unwrap();
    assert!(subtitle.contains("; 4 scenes"), "of both panels: {subtitle}");
    let shown: Vec<(&str, Option<f64>)> =
        panels.iter().map(|panel| (panel.name.as_str(), panel.curves[0].1[1].context)).collect();
    assert_eq!(shown, [("small overlap · 2 scenes", Some(20.0)), ("large overlap · 2 scenes", Some(40.0))]);
}

#[test]
fn overlaps_of_another_estimator_are_in_no_bin() {
    let optimised = |name: &str| MethodRecord { kind: REFINEMENT.to_owned(), ..atsplat(name, |_| ()) };
    let panels = |overlap_estimators: Vec<String>| -> Vec<String> {
        let record = PresetRecord { overlap_estimators, ..preset("re10k-overlap") };
        let results = results(vec![record], vec![optimised("refined 10"), optimised("refined 100")]);
        let plot = curves(&results, &[&results.provenance.presets[0]]).unwrap().unwrap();
        plot.panels.into_iter().map(|panel| panel.name).collect()
    };
    let binned = panels(Vec::new());
    assert!(binned.iter().all(|name| name.contains(" overlap · ")), "{binned:?}");
    assert_eq!(panels(vec!["another".to_owned()]), ["2 views · 4 scenes"]);
}

/// The third scene of the first refinement failed; one target of the first scene is a context view.
#[test]
fn a_setting_over_fewer_targets_says_so_and_a_device_is_that_of_its_method() {
    let mut store = results_over(vec![preset("re10k-2v-256")], methods(), 8);
    let of_3dgs = store.timings.iter_mut().filter(|timing| timing.key.method == "3dgs-100");
    of_3dgs.for_each(|timing| timing.renderer_adapter = Some("card".to_owned()));
    let curves = |store: &Results| curves(store, &[&store.provenance.presets[0]]).unwrap().unwrap();
    let found = curves(&store);
    assert_eq!(found.panels[0].name, "2 views · 8 scenes");
    let expected = "Means over fewer targets: ATSplat (refined 10) with 2 views: 7 of 8 scenes, 20 of 23 targets.";
    assert!(found.note.contains(expected) && !found.note.contains("Incomplete"), "{}", found.note);
    let subtitle = &found.subtitle;
    assert!(subtitle.contains("; timed on a processor, 2 threads"), "{subtitle}");
    assert!(subtitle.contains("; ATSplat (3dgs-100): renderer on card"), "{subtitle}");
    store.provenance.methods[1].untrained = true;
    store.provenance.shard = Some(Shard { number: 1, count: 2 });
    let expected = " Random weights: ATSplat (refined 10), untrained. Incomplete: shard 1 of 2 of the run.";
    assert!(curves(&store).note.ends_with(expected), "{}", curves(&store).note);
}

/// Two trainings of one configuration, each refined with two budgets; the second is timed on a busy machine.
#[test]
fn each_network_has_a_curve_from_its_own_start() {
    let of_network = |network: &str| {
        ["", " + 10", " + 100"].map(|budget| {
            let kind = if budget.is_empty() { NETWORK } else { REFINEMENT };
            let weights_sha256 = Some(format!("weights of {network}"));
            let name = format!("{network}{budget}");
            let title = name.clone();
            let mut record = MethodRecord { kind: kind.to_owned(), weights_sha256, title, ..atsplat(&name, |_| ()) };
            record.parameters.clear();
            record.record_model("nano", "1f");
            record
        })
    };
    let threedgs = MethodRecord { kind: "3dgs".to_owned(), parameters: [].into(), ..atsplat("3dgs", |_| ()) };
    let plot = |networks: &[&str]| {
        let methods = networks.iter().flat_map(|network| of_network(network)).chain([threedgs.clone()]).collect();
        let mut store = results_over(vec![preset("re10k-2v-256")], methods, 4);
        for timing in &mut store.timings {
            timing.encode = vec![0.5; 5];
            if timing.key.method == "b + 10" {
                timing.load.others = Some(0.4);
            }
        }
        curves(&store, &[&store.provenance.presets[0]]).unwrap().unwrap()
    };
    let drawn = |plot: &OptimisationCurves| -> Vec<(String, usize)> {
        plot.panels[0].curves.iter().map(|(label, points)| (label.clone(), points.len())).collect()
    };
    let one = plot(&["a"]);
    let names = ["ATSplat + refinement", "3DGS", "Mip-Splatting", "3DGS-MCMC"];
    assert_eq!((one.palette.as_slice(), drawn(&one)[0].1), (&names.map(str::to_owned)[..], 3));
    assert!(!one.note.contains('§') && one.subtitle.contains("; a + 10: times of 2 of 4 trials"), "{}", one.subtitle);
    let both = plot(&["a", "b"]);
    let [first, second] = ["a", "b"].map(|name| format!("ATSplat + refinement, {name}"));
    assert_eq!(drawn(&both), [(first.clone(), 3), ("3DGS".to_owned(), 1), (second.clone(), 3)]);
    assert_eq!((&both.palette[0], &both.palette[1..4], &both.palette[4]), (&first, &one.palette[1..], &second));
    assert!(both.subtitle.contains("; § the machine was busy") && both.note.contains("§ b + 10."), "{}", both.note);
}
