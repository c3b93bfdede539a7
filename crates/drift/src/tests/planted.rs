//! A loss and a gain planted at every stage, including the data: each is found and attributed to its stage.

use std::collections::{BTreeMap, BTreeSet};

use atsplat_files::Sha256Digest;
use atsplat_pixels::{Image, ImageU8, encode_png};
use atsplat_splat::{Gaussians, RendererConstants};

use super::*;
use crate::probe::{Outputs, Stages, View};

/// The stages, one of which adds an amount to its output.
struct Planted<'a> {
    pipeline: &'a Pipeline,
    stage: Option<Stage>,
    amount: f32,
}

impl Planted<'_> {
    fn brighter(&self, image: &ImageU8, stage: Stage) -> ImageU8 {
        let by = if self.stage == Some(stage) { self.amount } else { 0.0 };
        brighter(image, by)
    }
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "kept within a byte")]
fn brighter(image: &ImageU8, by: f32) -> ImageU8 {
    let samples = image.samples().iter().map(|sample| (f32::from(*sample) + 255.0 * by).clamp(0.0, 255.0) as u8);
    ImageU8::new(image.width(), image.height(), samples.collect()).unwrap()
}

impl Stages for Planted<'_> {
    fn decode(&self, bytes: &[u8]) -> Result<ImageU8, DriftError> {
        Ok(self.brighter(&self.pipeline.decode(bytes)?, Stage::Decode))
    }

    fn resize(&self, view: &View) -> Result<View, DriftError> {
        let resized = self.pipeline.resize(view)?;
        Ok(View { image: self.brighter(&resized.image, Stage::Resize), ..resized })
    }

    fn model(&self, context: &[View]) -> Result<Gaussians, DriftError> {
        let base = self.pipeline.model(context)?;
        if self.stage != Some(Stage::Model) {
            return Ok(base);
        }
        let mut parts = base.parts().clone();
        parts.sh.as_flattened_mut().iter_mut().for_each(|coefficient| *coefficient += self.amount);
        Ok(Gaussians::new(parts).unwrap())
    }

    fn render(&self, gaussians: &Gaussians, target: &View) -> Result<Image, DriftError> {
        let render = self.pipeline.render(gaussians, target)?;
        let by = if self.stage == Some(Stage::Renderer) { self.amount } else { 0.0 };
        let samples = render.samples().iter().map(|sample| sample + by).collect();
        Ok(Image::new(render.width(), render.height(), samples).unwrap())
    }

    fn score(&self, render: &Image, truth: &ImageU8) -> Result<BTreeMap<String, f64>, DriftError> {
        let mut scores = self.pipeline.score(render, truth)?;
        if self.stage == Some(Stage::Metric) {
            for score in scores.values_mut() {
                *score *= 1.0 + f64::from(self.amount);
            }
        }
        Ok(scores)
    }
}

/// The rows of a run with these outputs.
fn rows(outputs: &Outputs) -> Results {
    let mut base = results("m", "psnr", &[("pattern", 0, vec![outputs.scores[0]["psnr"]])]);
    let digest = |view: &View| Sha256Digest::of(view.image.samples()).to_string();
    let digests: Vec<String> = outputs.views.iter().map(digest).collect();
    let [first, second, target] = &digests[..] else { panic!("two context views and a target") };
    (base.trials[0].context, base.trials[0].context_hashes) = (vec![4, 9], vec![first.clone(), second.clone()]);
    (base.targets[0].frame, base.targets[0].truth_hash) = (6, Some(target.clone()));
    add_method(&mut base, true);
    base
}

fn inputs() -> Inputs {
    Inputs::pattern(&RendererConstants::default()).unwrap()
}

/// Inputs in which the files of some views have another brightness.
fn other_files(pipeline: &Pipeline, views: &[usize], by: f32) -> Inputs {
    let mut inputs = inputs();
    for view in views {
        let image = pipeline.decode(&inputs.files[*view]).unwrap();
        inputs.files[*view] = encode_png(&brighter(&image, by)).unwrap();
    }
    inputs
}

#[test]
fn losses_and_gains_at_every_stage_are_found_and_named() {
    let (recipe, inputs) = (Recipe::default(), inputs());
    let pipeline = Pipeline::of(&recipe).unwrap();
    let then = run(&pipeline, &inputs).unwrap();
    let baseline = baseline_of(&rows(&then));
    let report = |stage: Option<Stage>, amount: f32| {
        let planted = Planted { pipeline: &pipeline, stage, amount };
        let rows = match stage {
            Some(Stage::Data) => rows(&run(&planted, &other_files(&pipeline, &[2], amount)).unwrap()),
            _ => rows(&run(&planted, &inputs).unwrap()),
        };
        compare(&rows, &baseline).with_probe(&planted, &then, true)
    };
    for stage in std::iter::once(Stage::Data).chain(Stage::PROBED) {
        let mut directions = BTreeSet::new();
        for amount in [-0.03, 0.03] {
            let report = report(Some(stage), amount);
            assert_eq!(
                (report.verdict, report.first_change()),
                (DriftVerdict::Drifted, Some(Cause::from(stage))),
                "{amount}: {report}"
            );
            let conclusion = format!("The first change is in the {}: ", stage.name());
            assert!(report.to_string().contains(&conclusion), "{stage:?} {amount}: {report}");
            let comparison = &report.comparisons[0];
            assert_eq!(comparison.verdict, DriftVerdict::Drifted, "{stage:?} {amount}: {report}");
            directions.insert(comparison.improved().unwrap());
        }
        assert_eq!(directions.len(), 2, "{stage:?}: one is a loss and one a gain");
    }
    for _ in 0..10 {
        let unchanged = report(None, 0.0);
        let found = (unchanged.verdict, unchanged.first_change(), unchanged.findings.len());
        assert_eq!(found, (DriftVerdict::Same, None, 0), "{unchanged}");
    }
}

/// Single images, then all of them: each is reported by its frame, and no stage of the probe has changed.
#[test]
fn changed_files_are_reported_by_frame_and_not_attributed_to_a_stage() {
    let pipeline = Pipeline::of(&Recipe::default()).unwrap();
    let then = run(&pipeline, &inputs()).unwrap();
    let baseline = baseline_of(&rows(&then));
    for (views, frames) in [(&[0][..], &[4][..]), (&[1], &[9]), (&[2], &[6]), (&[0, 1, 2], &[4, 6, 9])] {
        let now = run(&pipeline, &other_files(&pipeline, views, 0.02)).unwrap();
        let report = compare(&rows(&now), &baseline).with_probe(&pipeline, &then, true);
        let found: Vec<u64> = report.data.changed.iter().map(|image| image.frame).collect();
        assert_eq!((found, report.first_change()), (frames.to_vec(), Some(Cause::Data)), "{report}");
        assert_eq!(report.attribution.as_ref().unwrap().first(), None, "{report}");
    }
}

/// The stages, of which the renderer fails.
struct Failing<'a>(&'a Pipeline);

impl Stages for Failing<'_> {
    fn decode(&self, bytes: &[u8]) -> Result<ImageU8, DriftError> {
        self.0.decode(bytes)
    }

    fn resize(&self, view: &View) -> Result<View, DriftError> {
        self.0.resize(view)
    }

    fn model(&self, context: &[View]) -> Result<Gaussians, DriftError> {
        self.0.model(context)
    }

    fn render(&self, _: &Gaussians, _: &View) -> Result<Image, DriftError> {
        Err(DriftError::Stage { stage: Stage::Renderer.name(), reason: "no images".to_owned() })
    }

    fn score(&self, render: &Image, truth: &ImageU8) -> Result<BTreeMap<String, f64>, DriftError> {
        self.0.score(render, truth)
    }
}

#[test]
fn a_stage_that_fails_where_it_did_not_for_the_baseline_has_changed() {
    let pipeline = Pipeline::of(&Recipe::default()).unwrap();
    let then = run(&pipeline, &inputs()).unwrap();
    let same = compare(&rows(&then), &baseline_of(&rows(&then)));
    let report = same.clone().with_probe(&Failing(&pipeline), &then, true);
    assert_eq!((same.verdict, report.verdict), (DriftVerdict::Same, DriftVerdict::Drifted), "{report}");
    let said = report.to_string();
    for part in ["No attribution: the probe's stage renderer: no images\n", "; a stage of the probe failed.\n"] {
        assert!(said.contains(part), "{part}: {said}");
    }
}
