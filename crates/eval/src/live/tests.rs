use atsplat_numeric::Tolerance;

use super::*;
use crate::expansion::tests::{nano, network, subject, trial};

#[test]
fn tokens_carry_the_block_that_made_them_and_the_score_that_decides_on_them() {
    let trace = network(&nano()).trace(&subject(&[]).views, 0).unwrap();
    let (trial, _) = trial();
    let scene = LiveScene::of(&trace, &trial, &RenderOptions::default()).unwrap();
    let made = &trace.reconstruction;
    assert_eq!(scene.stages.iter().map(|stage| stage.blocks).collect::<Vec<_>>(), [0, 1, 2, 3, 4]);
    let final_stage = &scene.stages[4];
    assert_eq!(final_stage.all, made.gaussians.len());
    for stage in &scene.stages {
        let counted: usize = stage.tokens.iter().map(|token| usize::from(token.count)).sum();
        assert_eq!(counted * BYTES, stage.gaussians.bytes.len());
    }
    // Every expansion has two children; the last block's are all there, and those of block 3 unless block 4 expanded them.
    let with_block = |stage: &LiveStage, block| stage.tokens.iter().filter(|token| token.block == block).count();
    assert_eq!(with_block(final_stage, 4), 2 * made.budget.expanded[3]);
    assert_eq!(with_block(&scene.stages[3], 3), 2 * made.budget.expanded[2]);
    assert!(with_block(final_stage, 3) < 2 * made.budget.expanded[2] && with_block(&scene.stages[0], 0) > 0);
    assert_eq!(scene.stages[0].tokens.len(), with_block(&scene.stages[0], 0));

    let scores = made.blocks[2].scores.as_ref().unwrap();
    let [least, most] = scene.uncertainty.unwrap().map(f64::from);
    let shown =
        scene.stages[2].tokens.iter().map(|token| least + f64::from(token.uncertainty) / 255.0 * (most - least));
    Tolerance::absolute((most - least) / 500.0).assert(
        shown,
        scores.iter().copied().map(f64::from),
        "block 3 decides on them",
    );
    // Children inherit their parent's score.
    let last = made.blocks[3].scores.as_ref().unwrap();
    let parents = made.blocks[3].parents.iter().map(|&parent| f64::from(last[parent]));
    let shown = final_stage.tokens.iter().map(|token| least + f64::from(token.uncertainty) / 255.0 * (most - least));
    Tolerance::absolute((most - least) / 500.0).assert(shown, parents, "final tokens");
}

#[test]
fn the_view_turns_about_the_middle_of_what_the_first_camera_sees() {
    let trace = network(&nano()).trace(&subject(&[]).views, 0).unwrap();
    let (trial, _) = trial();
    let scene = LiveScene::of(&trace, &trial, &RenderOptions::default()).unwrap();
    let frames: Vec<(bool, usize)> = scene.cameras.iter().map(|camera| (camera.context, camera.frame)).collect();
    let context = trial.context().iter().map(|view| (true, view.frame));
    assert_eq!(frames, context.chain(trial.targets().iter().map(|view| (false, view.frame))).collect::<Vec<_>>());
    let seen = trial.context()[0].camera.project(DVec3::from(scene.focus)).unwrap();
    let k = &scene.cameras[0];
    let principal = seen.pixel(trial.context()[0].size).to_array();
    Tolerance::absolute(1e-6).assert(principal, k.principal, "on the optical axis");
    let nearer = |mean: &&[f32; 3]| {
        trial.context()[0].camera.camera_from_world.transform_point(DVec3::from(mean.map(f64::from))).z < seen.depth
    };
    let means = &trace.reconstruction.gaussians.parts().means;
    assert!((means.iter().filter(nearer).count() * 2).abs_diff(means.len()) < means.len() / 50, "half are nearer");
}
