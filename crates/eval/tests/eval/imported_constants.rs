//! Files of Gaussians under the constants of a rasterizer: drawn as that rasterizer draws the files, in the dataset's own frame
//! and unit, whatever world the protocol makes of them.

use crate::common;
use std::sync::Arc;

use crate::common::{Run, SIZE, Walls, dataset, entry, preset};
use atsplat_camera::{Camera, Similarity};
use atsplat_eval::GaussianFrame;
use atsplat_eval::method::{ChangedConstants, ConstantsChoice, Method, Ply, Splatting, TrialInput};
use atsplat_eval::runner::Dataset;
use atsplat_eval::sweep::ConstantChanges;
use atsplat_metrics::{DECIBEL_CAP, Pair, Values, psnr};
use atsplat_pixels::Image;
use atsplat_protocol::EvaluationIndex;
use atsplat_protocol::trial::{Prefetch, Trial, TrialRecipe, Trials};
use atsplat_scene::{Scene, SceneError, SceneSource, Warnings};
use atsplat_splat::effects::EffectSelection;
use atsplat_splat::files::{self, Encoding, Output};
use atsplat_splat::{
    GaussianParts, Gaussians, ReferenceRenderer, RenderOptions, Renderer, RendererConstants, View, sh_coefficients,
};
use glam::{DMat3, DVec3};

/// The walls in a world with other axes, so that the trial's world, whose axes are those of the mean camera, is turned.
struct Turned(Walls);

fn turn() -> Similarity {
    let rotation = DMat3::from_rotation_x(0.7) * DMat3::from_rotation_z(-1.1);
    Similarity { rotation, origin: DVec3::new(0.5, -0.25, 1.0), scale: 1.0 }
}

fn turned(camera: Camera) -> Camera {
    let pose = turn().new_pose_from_old(&camera.camera_from_world.inverse()).unwrap();
    Camera { camera_from_world: pose.inverse(), ..camera }
}

impl SceneSource for Turned {
    fn keys(&self) -> &[String] {
        self.0.keys()
    }

    fn load(&self, key: &str, warnings: &mut Warnings) -> Result<Scene, SceneError> {
        let mut scene = self.0.load(key, warnings)?;
        scene.frames.iter_mut().for_each(|frame| frame.camera = turned(frame.camera));
        Ok(scene)
    }
}

/// A trial of the walls whose target is frame 2.
fn trial() -> Trial {
    let index = EvaluationIndex { scenes: [("wall-0".to_owned(), vec![entry(&[0, 4], &[2])])].into_iter().collect() };
    let source = Arc::new(Turned(Walls::new(1, 8)));
    let mut trials = Trials::new(source, &index, TrialRecipe::of(&preset(), "ATSplat"), Prefetch::default());
    trials.next().unwrap().unwrap().0
}

/// A row of coloured Gaussians of a degree at these depths of the target's camera.
fn row(degree: u8, depths: &[f64]) -> Gaussians {
    let wave = |n: usize, phase: f32| (n as f32 * 1.37 + phase).sin();
    let from_camera = turned(common::camera(2)).camera_from_world.inverse();
    let count = depths.len();
    let place = |(n, depth): (usize, &f64)| {
        let across = (n as f64 + 0.5) / count as f64 - 0.5;
        from_camera.transform_point(DVec3::new(0.9 * across, 0.2 * across, 1.0) * *depth).as_vec3().to_array()
    };
    Gaussians::new(GaussianParts {
        means: depths.iter().enumerate().map(place).collect(),
        quaternions: (0..count).map(|n| [1.0, 0.3 * wave(n, 0.0), 0.3 * wave(n, 1.0), 0.3 * wave(n, 2.0)]).collect(),
        log_scales: depths.iter().map(|depth| DVec3::splat((0.08 * depth).ln()).as_vec3().to_array()).collect(),
        opacity_logits: vec![3.0; count],
        sh_degree: degree,
        sh: (0..count * sh_coefficients(degree)).map(|n| [3.0, 4.0, 5.0].map(|phase| 0.5 * wave(n, phase))).collect(),
        ..GaussianParts::default()
    })
    .unwrap()
}

/// The image of the target and the notes of a trial with these Gaussians as a file.
fn imported(
    trial: &Trial,
    gaussians: &Gaussians,
    constants: ConstantsChoice,
    frame: GaussianFrame,
) -> (Image, Vec<String>) {
    let folder = tempfile::tempdir().unwrap();
    let output = Output::Ply(Encoding::BinaryLittleEndian);
    files::write(&folder.path().join("wall-0.ply"), gaussians, output).unwrap();
    let splatting =
        Splatting { constants, background: Some([0.0; 3]), effects: EffectSelection::All, ..Splatting::default() };
    let ply = Ply::new(folder.path(), None, frame, false, splatting).unwrap();
    let preset = preset();
    let images: Vec<_> = trial.context().iter().map(|view| view.image().unwrap()).collect();
    let prediction = ply.predict(TrialInput { preset: &preset, trial, images: &images }).unwrap();
    (prediction.render(&[0]).remove(0).unwrap().image, prediction.cost().notes)
}

/// What `atsplat render` shows: the file in its own frame, from the target's camera.
fn rendered(gaussians: &Gaussians, constants: RendererConstants) -> Image {
    let view = View { camera: turned(common::camera(2)), size: SIZE };
    let options = RenderOptions { constants, ..RenderOptions::default() };
    let rendering = ReferenceRenderer.render(gaussians, &view, &options).unwrap();
    Image::new(SIZE.width, SIZE.height, rendering.rgb.into_flattened()).unwrap()
}

fn decibels(render: &Image, truth: &Image) -> f64 {
    psnr(&Pair::new(render, truth).unwrap(), Values::AsRendered).capped(DECIBEL_CAP).unwrap()
}

fn named(preset: &str) -> RendererConstants {
    RendererConstants::named(preset).unwrap()
}

/// One Gaussian is between a near plane in the dataset's unit and the same number in the trial's, another between the far
/// planes.
#[test]
fn planes_of_constants_are_in_the_unit_of_the_dataset() {
    let trial = trial();
    let scale = trial.normalisation().new_from_old.scale;
    assert!(!(0.8..1.25).contains(&scale), "the trial's unit is another one: {scale}");
    let between = |plane: f64| plane / scale.sqrt();
    let gaussians = row(1, &[between(0.2), 2.0, 4.0, 6.0, between(8.0)]);
    let far = RendererConstants { far: 8.0, ..named("inria") };
    let overrides = ConstantChanges { constants: Some("inria".to_owned()), ..ConstantChanges::default() };
    let cases = [
        ("near", named("inria"), ConstantsChoice::Fixed(named("inria"))),
        ("near and far", far.clone(), ConstantsChoice::Fixed(far)),
        ("named", named("inria"), ConstantsChoice::Changed(ChangedConstants::new(overrides).unwrap())),
    ];
    for (what, constants, choice) in cases {
        let expected = rendered(&gaussians, constants.clone());
        let (found, _) = imported(&trial, &gaussians, choice, GaussianFrame::Dataset);
        let agreement = decibels(&found, &expected);
        assert!(agreement > 70.0, "{what}: {agreement} dB");
        let far = if constants.far.is_finite() { constants.far / scale } else { constants.far };
        let other = rendered(&gaussians, RendererConstants { near: constants.near / scale, far, ..constants });
        assert!(decibels(&other, &expected) < 40.0, "{what}: the unit matters");
    }
}

/// Gaussians in the trial's world have its unit.
#[test]
fn planes_are_in_the_trials_unit_for_gaussians_in_its_world() {
    let trial = trial();
    let similarity = trial.normalisation().new_from_old;
    let between = |plane: f64| plane / similarity.scale.sqrt();
    let gaussians = row(1, &[between(0.2), 2.0, 4.0]);
    let moved = gaussians.transformed(&similarity).unwrap();
    let choice = ConstantsChoice::Fixed(named("inria"));
    let (found, _) = imported(&trial, &moved, choice, GaussianFrame::Trial);
    let near = 0.2 / similarity.scale;
    let agreement = decibels(&found, &rendered(&gaussians, RendererConstants { near, ..named("inria") }));
    assert!(agreement > 70.0, "{agreement} dB");
}

#[test]
fn colours_turn_in_the_axes_of_the_constants() {
    let trial = trial();
    let gaussians = row(3, &[1.5, 2.0, 2.5, 3.0, 4.0]);
    let mut shown = Vec::new();
    for preset in ["inria", "pixelsplat-family"] {
        let expected = rendered(&gaussians, named(preset));
        let (found, _) = imported(&trial, &gaussians, ConstantsChoice::Fixed(named(preset)), GaussianFrame::Dataset);
        let agreement = decibels(&found, &expected);
        assert!(agreement > 70.0, "{preset}: {agreement} dB");
        shown.push(expected);
    }
    assert!(decibels(&shown[0], &shown[1]) < 40.0, "the axes matter");
}

/// The protocol's rasterizer is a version of diff-gaussian-rasterization.
#[test]
fn harmonics_that_are_not_drawn_are_noted() {
    let trial = trial();
    let gaussians = row(4, &[2.0, 3.0]);
    let of = |gaussians: &Gaussians, choice| imported(&trial, gaussians, choice, GaussianFrame::Dataset);
    let (limited, notes) = of(&gaussians, ConstantsChoice::FromPreset);
    let name = preset().renderer.rasteriser;
    let note =
        format!("2 of 2 Gaussians have spherical harmonics above degree 3, which the constants {name} do not evaluate");
    assert_eq!(notes, [note]);
    let (all, notes) = of(&gaussians, ConstantsChoice::Fixed(named("exact")));
    assert_eq!(notes, [""; 0]);
    assert!(decibels(&limited, &all) < 50.0, "degree 4 shows");
    let (drawn, notes) = of(&gaussians.with_sh_degree(3), ConstantsChoice::FromPreset);
    assert_eq!(notes, [""; 0]);
    assert_eq!(limited, drawn);
}

/// One of three Gaussians has no harmonics of degree 3, in whatever axes.
#[test]
fn a_harmonic_that_the_rasterizer_evaluates_otherwise_is_noted() {
    let trial = trial();
    let mut parts = row(3, &[2.0, 3.0, 4.0]).into_parts();
    parts.sh[16 + 9..2 * 16].fill([0.0; 3]);
    let gaussians = Gaussians::new(parts).unwrap();
    let notes = |preset| imported(&trial, &gaussians, ConstantsChoice::Fixed(named(preset)), GaussianFrame::Dataset).1;
    let found = notes("pixelsplat-family");
    let expected = "2 of 3 Gaussians have a coefficient 14 of spherical harmonics, which the constants pixelsplat";
    assert!(matches!(&found[..], [note] if note.starts_with(expected)), "{found:?}");
    assert_eq!(notes("inria"), [""; 0]);
}

/// A Gaussian at a depth of 0.05: the near cull of `DepthSplat` is at 0.2 · 0.5 in the dataset's unit, and ATSplat's at 0.2 · 0.01 in the
/// trial's.
#[test]
fn files_are_drawn_under_the_setting_that_was_chosen() {
    let folder = tempfile::tempdir().unwrap();
    files::write(&folder.path().join("wall-0.ply"), &row(0, &[0.05]), Output::Ply(Encoding::Ascii)).unwrap();
    let drawn = |name: &str, setting: Option<&str>| {
        let ply = Ply::new(folder.path(), Some(name), GaussianFrame::Dataset, false, Splatting::default()).unwrap();
        let methods: Vec<Arc<dyn Method>> = vec![Arc::new(ply.with_setting(setting))];
        let walls = dataset(Walls::new(1, 8), &[entry(&[0, 4], &[2])]);
        let walls = Dataset { source: Arc::new(Turned(Walls::new(1, 8))), ..walls };
        let store = tempfile::tempdir().unwrap();
        let (results, _) = Run::new(vec![walls], methods).run(store.path()).unwrap();
        let recorded = results.provenance.methods[0].parameters.get("setting").cloned();
        let kinds = results.provenance.warnings.iter().map(|warning| warning.kind.clone());
        let kinds: Vec<String> = kinds.filter(|kind| kind.contains("poses and planes")).collect();
        (!results.trials[0].renders_nothing(), recorded, kinds)
    };
    assert_eq!(drawn("mine", None), (true, None, Vec::new()), "and a record as in older stores");
    assert_eq!(drawn("mine", Some("depthsplat")), (false, Some("depthsplat".into()), Vec::new()));
    // The preset lists other planes for its name, and nobody chose.
    let (is_drawn, _, kinds) = drawn("DEPTHSPLAT", None);
    assert!(is_drawn && kinds.len() == 1 && kinds[0].ends_with("for a method of their name: DEPTHSPLAT"), "{kinds:?}");
    assert_eq!(drawn("DEPTHSPLAT", Some("ATSplat")), (true, Some("ATSplat".into()), Vec::new()));
    assert_eq!(drawn("ATSplat", None).2, [""; 0], "the preset's poses and planes are those of ATSplat");
}

/// A store says in which unit the planes of its constants are.
#[test]
fn the_unit_of_planes_is_recorded() {
    let folder = tempfile::tempdir().unwrap();
    let recorded = |constants, frame| {
        let splatting = Splatting { constants, ..Splatting::default() };
        let record = Ply::new(folder.path(), None, frame, false, splatting).unwrap().record();
        record.parameters.get("planes").and_then(|planes| planes.as_str().map(str::to_owned))
    };
    let inria = || ConstantsChoice::Fixed(named("inria"));
    assert_eq!(recorded(inria(), GaussianFrame::Dataset).as_deref(), Some("in the dataset's unit"));
    assert_eq!(recorded(inria(), GaussianFrame::Trial), None);
    assert_eq!(recorded(ConstantsChoice::FromPreset, GaussianFrame::Dataset), None, "as in older stores");
}
