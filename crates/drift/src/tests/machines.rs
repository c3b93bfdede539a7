//! On which machines results and probes give the same bits.

use atsplat_pixels::Image;
use atsplat_results::Provenance;
use atsplat_results::times::platform;
use atsplat_splat::cpu::processor;

use super::*;
use crate::probe::Stages;

/// No method of the baseline renders on the adapter.
#[test]
fn another_driver_does_not_loosen_the_comparison() {
    let with = |by: f64, driver: u32| {
        let mut run = moved(by);
        run.provenance.adapter = Some(format!("a card (Vulkan), driver {driver}"));
        run
    };
    let baseline = baseline_of(&with(0.0, 1));
    let report = compare(&with(5e-4, 2), &baseline);
    assert_eq!((report.verdict, report.comparisons[0].basis), (DriftVerdict::Drifted, Basis::Exact), "{report}");
    assert!(report.to_string().contains("adapter: was a card (Vulkan), driver 1, is now a card"), "{report}");
    assert_eq!(compare(&with(0.0, 2), &baseline).verdict, DriftVerdict::Same);
}

/// The probe's renders differ in the last bits from those of this machine.
#[test]
fn a_probe_is_judged_by_the_machine_that_ran_it() {
    let here = Provenance { platform: platform(), processor: processor(), ..Provenance::default() };
    let pipeline = Pipeline::of(&Recipe::default()).unwrap();
    let inputs = Inputs::pattern(&atsplat_splat::RendererConstants::default()).unwrap();
    let mut outputs = run(&pipeline, &inputs).unwrap();
    let render = &outputs.renders[0];
    let samples = render.samples().iter().map(|sample| sample + 1e-6).collect();
    outputs.renders[0] = Image::new(render.width(), render.height(), samples).unwrap();
    // The scores must belong to the modified render.
    outputs.scores = vec![pipeline.score(&outputs.renders[0], &outputs.views[2].image).unwrap()];

    let mut base = store(true, 4, 0.0, 1);
    (base.provenance.platform, base.provenance.processor) = (here.platform.clone(), here.processor.clone());
    let (of_rows, _) = baseline_of(&base).with_probe(Recipe::default(), &outputs).unwrap();
    let judged = |baseline: &Baseline| {
        let report = compare(&base, baseline);
        let report = report.with_probe(&pipeline, &outputs, baseline.was_probed_on(&here));
        (report.verdict, report.first_change())
    };
    let probed_on = |baseline: &Baseline, processor: &str| {
        let mut baseline = baseline.clone();
        let probe = baseline.probe.as_mut().unwrap();
        (probe.platform, probe.processor) = (Some(here.platform.clone()), Some(processor.to_owned()));
        baseline
    };
    assert_eq!(
        judged(&probed_on(&of_rows, "another")),
        (DriftVerdict::Same, None),
        "only the rows are of this machine"
    );
    let changed = (DriftVerdict::Drifted, Some(Cause::Renderer));
    assert_eq!(judged(&probed_on(&of_rows, &here.processor)), changed);
    assert_eq!(judged(&of_rows), changed, "of an older version, which knows the machine of the rows alone");
    let provenance = Provenance { processor: "another".to_owned(), ..of_rows.provenance.clone() };
    let elsewhere = Baseline { provenance, ..of_rows };
    assert_eq!(judged(&elsewhere), (DriftVerdict::Same, None));
    assert_eq!(judged(&probed_on(&elsewhere, &here.processor)), changed, "only the probe is of this machine");

    let (probed, _) = elsewhere.probed(Recipe::default()).unwrap();
    let probe = probed.probe.as_ref().unwrap();
    assert_eq!((probe.platform.as_ref(), probe.processor.as_ref()), (Some(&here.platform), Some(&here.processor)));
}

#[test]
fn rows_of_several_processors_are_of_no_known_machine() {
    let on = |processor: &str| Provenance { processor: processor.to_owned(), ..Provenance::default() };
    assert!(same_machine(&on("a"), &on("a")) && !same_machine(&on("a"), &on("b")));
    let both = on("a; b");
    assert!(!same_machine(&both, &both), "nobody knows which row was made where");
}
