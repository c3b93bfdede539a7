//! Each method on a scene whose images are known in closed form.

use crate::common;
use std::path::Path;
use std::sync::Arc;

use crate::common::{Run, SIZE, Walls, dataset, entry, image, preset};
use atsplat_camera::Similarity;
use atsplat_eval::GaussianFrame;
use atsplat_eval::method::{Method, MethodError, NearestView, Ply, Renders, Splatting, TrialInput, Warp, constants_of};
use atsplat_eval::suspicious_notes::SuspiciousNote;
use atsplat_metrics::{DECIBEL_CAP, Pair, Values, psnr};
use atsplat_numeric::Tolerance;
use atsplat_pixels::{Image, ImageU8, encode_png, exr};
use atsplat_protocol::trial::{Prefetch, Trial, TrialRecipe, Trials};
use atsplat_protocol::{EvaluationIndex, IndexEntry, Preset};
use atsplat_results::GapKind;
use atsplat_splat::files::{Encoding, Output};
use atsplat_splat::{GaussianParts, Gaussians, ReferenceRenderer, RenderOptions, Renderer, View, files};

pub(crate) struct TestTrial {
    preset: Preset,
    trial: Trial,
    images: Vec<Arc<ImageU8>>,
}

pub(crate) fn test_trials(entries: &[IndexEntry]) -> Vec<TestTrial> {
    let preset = preset();
    let walls = Walls::new(1, 8);
    let index = EvaluationIndex { scenes: [("wall-0".to_owned(), entries.to_vec())].into_iter().collect() };
    let trials = Trials::new(Arc::new(walls), &index, TrialRecipe::of(&preset, "ATSplat"), Prefetch::default());
    let with_images = trials.map(|trial| {
        let (trial, _) = trial.unwrap();
        let images = trial.context().iter().map(|view| view.image().unwrap()).collect();
        TestTrial { preset: preset.clone(), trial, images }
    });
    with_images.collect()
}

impl TestTrial {
    pub(crate) fn input(&self) -> TrialInput<'_> {
        TrialInput { preset: &self.preset, trial: &self.trial, images: &self.images }
    }

    fn render(&self, method: &dyn Method, target: usize) -> Result<Image, String> {
        let prediction = method.predict(self.input()).map_err(|error| error.to_string())?;
        prediction.render(&[target]).remove(0).map(|rendered| rendered.image)
    }
}

fn decibels(render: &Image, frame: usize) -> f64 {
    between(render, &Image::from_u8(&image(0, frame)))
}

fn between(render: &Image, truth: &Image) -> f64 {
    psnr(&Pair::new(render, truth).unwrap(), Values::AsRendered).capped(DECIBEL_CAP).unwrap()
}

#[test]
fn nearest_view_is_copied_and_ties_go_to_the_first() {
    let trials = test_trials(&[entry(&[0, 4], &[1, 2, 3, 4, 7])]);
    let copied = |target| trials[0].render(&NearestView, target).unwrap();
    for (target, frame) in [(0, 0), (1, 0), (2, 4), (3, 4), (4, 4)] {
        assert_eq!(copied(target), Image::from_u8(&image(0, frame)), "target {target}");
    }
    let tied = test_trials(&[entry(&[4, 0], &[2])]).remove(0);
    assert_eq!(tied.render(&NearestView, 0).unwrap(), Image::from_u8(&image(0, 4)), "first in the trial's order");
}

#[test]
fn baselines_give_the_same_images_again_and_say_so() {
    let trial = test_trials(&[entry(&[0, 4], &[1])]).remove(0);
    for method in [&NearestView as &dyn Method, &Warp] {
        assert!(method.record().deterministic, "{}", method.record().name);
        assert_eq!(trial.render(method, 0).unwrap(), trial.render(method, 0).unwrap(), "{}", method.record().name);
    }
}

/// The wall is a plane that faces the cameras: the warp's only errors are its depth steps and its interpolation.
#[test]
fn the_warp_finds_the_wall() {
    let trials = test_trials(&[entry(&[0, 4], &[1, 2, 3, 6])]);
    for (target, frame, least) in [(0, 1, 35.0), (1, 2, 35.0), (2, 3, 35.0), (3, 6, 20.0)] {
        let warped = decibels(&trials[0].render(&Warp, target).unwrap(), frame);
        let copied = decibels(&trials[0].render(&NearestView, target).unwrap(), frame);
        assert!(warped > least && warped > copied + 3.0, "frame {frame}: warped {warped}, copied {copied}");
    }
    let single = test_trials(&[entry(&[3], &[3])]).remove(0);
    let alone = single.render(&Warp, 0).unwrap();
    assert!(alone.samples().iter().all(|sample| (0.0..=1.0).contains(sample)), "without parallax too");
}

/// Two images of one colour each. Where a pixel shows both, the weights are `1 / (d² + s²)` of the cameras' distances `d`,
/// with `s` a hundredth of the distance between the two, whatever plane was found.
#[test]
fn the_warp_weighs_views_by_their_inverse_squared_distance() {
    let mut trial = test_trials(&[entry(&[0, 4], &[1, 2, 3])]).remove(0);
    let plain = |colour: [u8; 3]| {
        let samples = colour.repeat((SIZE.width * SIZE.height) as usize);
        Arc::new(ImageU8::new(SIZE.width, SIZE.height, samples).unwrap())
    };
    let colours = [[255, 0, 51], [0, 255, 153]];
    trial.images = colours.map(plain).to_vec();
    // The cameras are side by side, four units of 0.2 apart; the common factor cancels.
    for (target, distances) in [(0, [1.0, 3.0]), (1, [2.0, 2.0]), (2, [3.0, 1.0])] {
        let weights = distances.map(|distance: f64| 1.0 / (distance * distance + (0.01 * 4.0f64).powi(2)));
        let share = |channel: usize| {
            let [a, b] = colours.map(|colour: [u8; 3]| f64::from(colour[channel]) / 255.0);
            (weights[0] * a + weights[1] * b) / (weights[0] + weights[1])
        };
        let render = trial.render(&Warp, target).unwrap();
        let expected = [0, 1, 2].map(share);
        let close = Tolerance::F32_ROUND_TRIP;
        let same = |pixel: &&[f32; 3]| {
            pixel.iter().zip(expected).all(|(&found, expected)| close.accepts(f64::from(found), expected))
        };
        let both = render.samples().as_chunks::<3>().0.iter().filter(same).count();
        let pixels = (SIZE.width * SIZE.height) as usize;
        // A plane is accepted only if two views see a quarter of the rays.
        assert!(both * 5 > pixels && both < pixels, "target {target}: {both} of {pixels} pixels show both views");
    }
}

fn write(path: &Path, bytes: &[u8]) {
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::fs::write(path, bytes).unwrap();
}

#[test]
fn renders_are_found_in_every_layout() {
    let png = encode_png(&image(0, 5)).unwrap();
    let trials = test_trials(&[entry(&[0, 4], &[5]), entry(&[0, 6], &[5])]);
    for layout in ["wall-0/color/000005.png", "wall-0/000005.png", "wall-0/5.png", "wall-0-0/00005.png"] {
        let folder = tempfile::tempdir().unwrap();
        write(&folder.path().join(layout), &png);
        let renders = Renders::new(folder.path(), Some("other")).unwrap();
        assert_eq!((renders.record().name.as_str(), renders.record().deterministic), ("other", false));
        assert!(renders.clone().deterministic(true).record().deterministic);
        let titles = [None, Some("Ours (K=8)")].map(|title| renders.clone().titled(title).record().title);
        assert_eq!(titles, ["other", "Ours (K=8)"]);
        assert_eq!(trials[0].render(&renders, 0), Ok(Image::from_u8(&image(0, 5))), "{layout}");
        let second = trials[1].render(&renders, 0).unwrap_err();
        assert!(second.contains("no file for frame 5"), "another entry of the scene has another folder: {second}");
        write(&folder.path().join("wall-0-1/color/5.png"), &png);
        assert!(trials[1].render(&renders, 0).is_ok());
    }
}

#[test]
fn exr_takes_precedence_and_two_files_for_a_frame_are_an_error() {
    let trial = test_trials(&[entry(&[0, 4], &[5])]).remove(0);
    let folder = tempfile::tempdir().unwrap();
    let renders = Renders::new(folder.path(), None).unwrap();
    let bright: Vec<f32> = Image::from_u8(&image(0, 5)).samples().iter().map(|sample| sample + 0.7).collect();
    let bright = Image::new(SIZE.width, SIZE.height, bright).unwrap();
    write(&folder.path().join("wall-0/000005.png"), &encode_png(&image(0, 5)).unwrap());
    write(&folder.path().join("wall-0/000005.exr"), &exr::write_rgb(&bright, &exr::Values::DisplayReferred).unwrap());
    assert_eq!(trial.render(&renders, 0), Ok(bright), "values above 1 stay");
    write(&folder.path().join("wall-0/05.png"), b"");
    assert!(trial.render(&renders, 0).unwrap_err().contains("two files for frame 5"));
    assert!(Renders::new(&folder.path().join("nowhere"), None).is_err());
}

/// Frames 5 and 7: one layout may contain both files, but not one frame in two places.
#[test]
fn a_frame_in_two_layouts_fails_alone() {
    let trial = test_trials(&[entry(&[0, 4], &[5, 7])]).remove(0);
    let folder = tempfile::tempdir().unwrap();
    let renders = Renders::new(folder.path(), None).unwrap();
    let png = encode_png(&image(0, 5)).unwrap();
    for file in ["wall-0/color/000005.png", "wall-0/color/000007.png", "wall-0/000007.png", "wall-1/000005.png"] {
        write(&folder.path().join(file), &png);
    }
    assert!(trial.render(&renders, 0).is_ok());
    let ambiguous = trial.render(&renders, 1).unwrap_err();
    assert!(
        ambiguous.starts_with("two files for frame 7: ") && ambiguous.contains("color/000007.png and "),
        "{ambiguous}"
    );
    assert_eq!(renders.files(&trial.trial).iter().filter(|file| file.is_some()).count(), 1);
    std::fs::remove_file(folder.path().join("wall-0/000007.png")).unwrap();
    assert!(trial.render(&renders, 1).is_ok());
    // A float image left by another run.
    write(&folder.path().join("wall-0/color/000007.exr"), b"");
    let stale = trial.render(&renders, 1).unwrap_err();
    assert!(stale.contains("000007.exr and ") && stale.contains("of another frame: "), "{stale}");
    assert!(trial.render(&renders, 0).is_ok());
    write(&folder.path().join("wall-0-0/5.png"), &png);
    let mixed = trial.render(&renders, 0).unwrap_err();
    assert!(mixed.contains("wall-0/color/000005.png and ") && mixed.ends_with("wall-0-0/5.png"), "{mixed}");
}

#[test]
fn an_image_in_a_spelling_that_is_not_read_is_named_alone_and_ambiguous_with_another() {
    let trial = test_trials(&[entry(&[0, 4], &[5])]).remove(0);
    let folder = tempfile::tempdir().unwrap();
    let renders = Renders::new(folder.path(), None).unwrap();
    let png = encode_png(&image(0, 5)).unwrap();
    write(&folder.path().join("wall-0/000005.PNG"), &png);
    let alone = trial.render(&renders, 0).unwrap_err();
    let start = "no file for frame 5 ";
    assert!(alone.starts_with(start) && alone.contains("wall-0/000005.PNG, whose spelling "), "{alone}");
    write(&folder.path().join("wall-0/color/000005.png"), &png);
    let two = trial.render(&renders, 0).unwrap_err();
    assert!(two.starts_with("two files for frame 5: ") && two.ends_with("wall-0/000005.PNG"), "{two}");
    std::fs::remove_file(folder.path().join("wall-0/000005.PNG")).unwrap();
    std::fs::rename(folder.path().join("wall-0/color/000005.png"), folder.path().join("wall-0/000006.png")).unwrap();
    write(&folder.path().join("wall-0/000005.npy"), b"");
    write(&folder.path().join("wall-0/000007.png"), &png);
    let array = trial.render(&renders, 0).unwrap_err();
    assert!(array.contains("wall-0/000005.npy, which is read only without other images of the scene"), "{array}");
}

#[test]
fn float_renders_in_another_range_or_of_other_channels_are_rejected() {
    let trial = test_trials(&[entry(&[0, 4], &[5])]).remove(0);
    let folder = tempfile::tempdir().unwrap();
    let renders = Renders::new(folder.path(), None).unwrap();
    let file = folder.path().join("wall-0/000005.exr");
    let scaled = |scale: f32, offset: f32| {
        let samples = Image::from_u8(&image(0, 5)).into_samples();
        let samples = samples.into_iter().map(|sample| scale * sample + offset).collect();
        let image = Image::new(SIZE.width, SIZE.height, samples).unwrap();
        write(&file, &exr::write_rgb(&image, &exr::Values::Unstated).unwrap());
        trial.render(&renders, 0).map(drop)
    };
    assert_eq!(scaled(1.3, -0.2), Ok(()));
    let levels = scaled(255.0, 0.0).unwrap_err();
    assert!(levels.contains("seems to be 0…255") && levels.contains("000005.exr"), "{levels}");
    assert!(scaled(2.0, -1.0).unwrap_err().contains("seems to be −1…1"));
    let with = |names: &[&str]| {
        let samples = vec![0.5; (SIZE.width * SIZE.height) as usize];
        let plane = |name: &&str| exr::Channel {
            name: (*name).to_owned(),
            values: exr::Values::Unstated,
            samples: samples.clone(),
        };
        let planes = names.iter().map(plane).collect();
        write(&file, &exr::write(&exr::Channels::new(SIZE.width, SIZE.height, planes).unwrap()).unwrap());
        trial.render(&renders, 0).unwrap_err()
    };
    assert!(with(&["r", "g", "b"]).starts_with("expected the channels R, G and B, found b, g and r, without R ("));
    assert!(with(&["R", "G", "Z"]).starts_with("expected the channels R, G and B, found G, R and Z, without B ("));
    assert!(with(&["Y"]).starts_with("expected the channels R, G and B, found Y ("));
}

/// The colour of a transparent pixel is undefined; it must not be scored as black.
#[test]
fn rejects_a_transparent_render() {
    let trial = test_trials(&[entry(&[0, 4], &[5])]).remove(0);
    let folder = tempfile::tempdir().unwrap();
    let renders = Renders::new(folder.path(), None).unwrap();
    let rgba = include_bytes!("../../../pixels/tests/fixtures/images/colour6_8.png");
    write(&folder.path().join("wall-0/000005.png"), rgba);
    let error = trial.render(&renders, 0).unwrap_err();
    assert!(error.contains("transparent pixels, the first at column") && error.contains("000005.png"), "{error}");

    let plane = |name: &str, values: exr::Values, value: f32| exr::Channel {
        name: name.to_owned(),
        values,
        samples: vec![value; (SIZE.width * SIZE.height) as usize],
    };
    let composited = exr::Values::Named(exr::COMPOSITED.to_owned());
    for (alpha, of_alpha, is_read) in [
        (1.0, exr::Values::Unstated, true),
        (0.5, exr::Values::Unstated, false),
        (f32::NAN, exr::Values::Unstated, false),
        (0.5, composited, true),
    ] {
        let mut planes = ["R", "G", "B"].map(|name| plane(name, exr::Values::DisplayReferred, 0.5)).to_vec();
        planes.push(plane("A", of_alpha, alpha));
        let channels = exr::Channels::new(SIZE.width, SIZE.height, planes).unwrap();
        write(&folder.path().join("wall-0/000005.exr"), &exr::write(&channels).unwrap());
        assert_eq!(trial.render(&renders, 0).is_ok(), is_read, "alpha {alpha}");
    }
}

/// Two dozen Gaussians in front of the cameras.
fn gaussians() -> Gaussians {
    let number = |at: usize, of: f32| ((at as f32 * 12.9898 + of).sin() * 43758.547).fract();
    let count = 24;
    let each = |of: f32| (0..count).map(move |at| number(at, of));
    let triples = |a: f32, b: f32, c: f32| each(a).zip(each(b)).zip(each(c)).map(|((x, y), z)| [x, y, z]);
    let parts = GaussianParts {
        means: triples(1.0, 2.0, 3.0).map(|[x, y, z]| [0.4 + 2.0 * x, 2.0 * y, 4.0 + z]).collect(),
        quaternions: triples(4.0, 5.0, 6.0).map(|[x, y, z]| [1.0, x, y, z]).collect(),
        log_scales: triples(7.0, 8.0, 9.0).map(|scales| scales.map(|scale| -1.5 + 0.5 * scale)).collect(),
        opacity_logits: each(10.0).map(|opacity| 2.0 * opacity).collect(),
        sh_degree: 1,
        sh: (0..4 * count).map(|at| [number(at, 11.0), number(at, 12.0), number(at, 13.0)]).collect(),
        scalars: None,
        filter_3d: None,
    };
    Gaussians::new(parts).unwrap()
}

/// Compares with the reference renderer in the dataset's own world, without pose normalisation and with the near plane in
/// the dataset's unit of length.
#[test]
fn imported_gaussians_are_in_the_dataset_frame() {
    let trial = test_trials(&[entry(&[0, 4], &[2])]).remove(0);
    let Similarity { scale, .. } = trial.trial.normalisation().new_from_old;
    assert!((scale - 1.0).abs() > 0.1, "the trial's world is another one: {scale}");
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("wall-0/gaussians.ply");
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    files::write(&path, &gaussians(), Output::Ply(Encoding::BinaryLittleEndian)).unwrap();
    let imported = |frame| Ply::new(folder.path(), None, frame, false, Splatting::default()).unwrap();
    let seen = trial.render(&imported(GaussianFrame::Dataset), 0).unwrap();
    let ply = imported(GaussianFrame::Dataset);
    assert_eq!(ply.clone().titled(Some("3DGS*")).record().title, "3DGS*");
    assert!(
        !ply.record().deterministic && ply.deterministic(true).record().deterministic,
        "nobody can tell it from files"
    );

    let mut planes = trial.trial.near_far();
    planes.near /= scale;
    let constants = constants_of(&trial.preset.renderer, planes);
    let options = RenderOptions { constants, ..RenderOptions::default() };
    let view = View { camera: common::camera(2), size: SIZE };
    let expected = ReferenceRenderer.render(&gaussians(), &view, &options).unwrap();
    let expected = Image::new(SIZE.width, SIZE.height, expected.rgb.into_flattened()).unwrap();
    assert!(expected.samples().iter().any(|sample| *sample > 0.2), "there is something to see");
    let agreement = between(&seen, &expected);
    assert!(agreement > 80.0, "{agreement} dB");
    let elsewhere = trial.render(&imported(GaussianFrame::Trial), 0).unwrap();
    assert!(between(&elsewhere, &expected) < 30.0, "the frame matters");
}

#[test]
fn rendering_views_together_is_bit_identical_to_one_by_one() {
    let trial = test_trials(&[entry(&[0, 4], &[1, 2, 3, 5, 6])]).remove(0);
    let folder = tempfile::tempdir().unwrap();
    files::write(&folder.path().join("wall-0.ply"), &gaussians(), Output::Ply(Encoding::Ascii)).unwrap();
    let ply = Ply::new(folder.path(), None, GaussianFrame::Dataset, false, Splatting::default()).unwrap();
    let prediction = ply.predict(trial.input()).unwrap();
    let together = prediction.render(&[0, 1, 2, 3, 4]);
    for (at, both) in together.into_iter().enumerate() {
        let (together, alone) = (both.unwrap(), prediction.render(&[at]).remove(0).unwrap());
        assert_eq!((together.image, together.drawn), (alone.image, alone.drawn), "target {at}");
        assert_eq!(together.effects, alone.effects);
    }
    assert_eq!(prediction.cost().gaussians, Some(24));
    assert!(prediction.render(&[9]).remove(0).is_err(), "there is no such target");
}

#[test]
fn missing_and_malformed_gaussian_files_are_errors() {
    let trial = test_trials(&[entry(&[0, 4], &[1])]).remove(0);
    let folder = tempfile::tempdir().unwrap();
    let ply = Ply::new(folder.path(), None, GaussianFrame::Dataset, false, Splatting::default()).unwrap();
    assert!(trial.render(&ply, 0).unwrap_err().contains("expected wall-0.ply"));
    write(&folder.path().join("wall-0.ply"), b"ply\nnonsense");
    assert!(matches!(ply.predict(trial.input()).map(drop), Err(MethodError::Failed(_))));
}

/// `.spz` next to `.ply` contains the same Gaussians in less space; a file in another place may contain others.
#[test]
fn two_files_of_a_scenes_gaussians_are_ambiguous() {
    let trial = test_trials(&[entry(&[0, 4], &[1])]).remove(0);
    let folder = tempfile::tempdir().unwrap();
    let ply = Ply::new(folder.path(), None, GaussianFrame::Dataset, false, Splatting::default()).unwrap();
    std::fs::create_dir(folder.path().join("wall-0")).unwrap();
    files::write(&folder.path().join("wall-0.ply"), &gaussians(), Output::Ply(Encoding::Ascii)).unwrap();
    write(&folder.path().join("wall-0.spz"), b"");
    assert!(trial.render(&ply, 0).is_ok());
    write(&folder.path().join("wall-0/point_cloud.ply"), b"");
    let refused = trial.render(&ply, 0).unwrap_err();
    assert!(refused.starts_with("two files of Gaussians of scene wall-0: "), "{refused}");
    assert!(refused.contains("wall-0.ply and ") && refused.ends_with("wall-0/point_cloud.ply"), "{refused}");
    std::fs::rename(folder.path().join("wall-0/point_cloud.ply"), folder.path().join("wall-0-0.ply")).unwrap();
    let refused = trial.render(&ply, 0).unwrap_err();
    assert!(refused.contains("wall-0.ply and ") && refused.ends_with("wall-0-0.ply"), "{refused}");
}

/// A file without Gaussians, one with other axes, whose Gaussians are behind the cameras, and a good one.
#[test]
fn gaussians_that_draw_nothing_are_noted() {
    let folder = tempfile::tempdir().unwrap();
    let write = |scene: usize, parts: GaussianParts| {
        let path = folder.path().join(format!("wall-{scene}.ply"));
        files::write(&path, &Gaussians::new(parts).unwrap(), Output::Ply(Encoding::BinaryLittleEndian)).unwrap();
    };
    let nothing = GaussianParts {
        means: vec![],
        quaternions: vec![],
        log_scales: vec![],
        opacity_logits: vec![],
        sh_degree: 0,
        sh: vec![],
        scalars: None,
        filter_3d: None,
    };
    write(0, nothing);
    let mut behind = gaussians().into_parts();
    behind.means.iter_mut().for_each(|[_, y, z]| (*y, *z) = (-*y, -*z));
    write(1, behind);
    write(2, gaussians().into_parts());
    let ply = Ply::new(folder.path(), None, GaussianFrame::Dataset, false, Splatting::default()).unwrap();
    let run = Run::new(vec![dataset(Walls::new(3, 8), &[entry(&[0, 4], &[1, 2])])], vec![Arc::new(ply)]);
    let (results, summary) = run.run(&folder.path().join("store")).unwrap();
    assert_eq!((summary.incomplete, summary.empty_renders), (0, 2), "scored, but empty");
    let gaps: Vec<_> = results.gaps().into_iter().map(|gap| (gap.kind, gap.count, gap.first)).collect();
    assert_eq!(gaps, [(GapKind::EmptyRender, 2, "scene wall-0, entry 0".to_owned())]);
    let notes: Vec<String> = results.trials.iter().map(|trial| trial.notes.join("; ")).collect();
    assert_eq!(notes[0], "no Gaussian is left: 2 of 2 renders show the background");
    assert!(notes[1].starts_with("no Gaussian is drawn: 2 of 2 renders show the background; do "), "{}", notes[1]);
    let flat = "no better than one flat colour: 2 of 2 (wrong poses, scale or axes?)";
    assert!(notes[2] == flat && SuspiciousNote::Flat.is(flat), "a few Gaussians on black: {}", notes[2]);
}

#[test]
fn scales_that_may_have_no_logarithm_are_noted() {
    let trial = test_trials(&[entry(&[0, 4], &[1])]).remove(0);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("wall-0.ply");
    let ply = Ply::new(folder.path(), None, GaussianFrame::Dataset, false, Splatting::default()).unwrap();
    let notes = |change: fn(f32) -> f32| {
        let mut parts = gaussians().into_parts();
        parts.log_scales.iter_mut().flatten().for_each(|log_scale| *log_scale = change(*log_scale));
        files::write(&path, &Gaussians::new(parts).unwrap(), Output::Ply(Encoding::BinaryLittleEndian)).unwrap();
        ply.predict(trial.input()).unwrap().cost().notes.clone()
    };
    assert_eq!(
        notes(f32::exp),
        ["every log-scale of the file lies in (0, 1]: they may be scales without their logarithm"]
    );
    assert_eq!(notes(|log_scale| log_scale), [""; 0]);
    assert_eq!(notes(|log_scale| log_scale + 4.0), [""; 0], "large Gaussians");
}

/// Gaussians that are not drawn affect the score, so the trial notes how many, which and in which file.
#[test]
fn broken_gaussians_are_noted() {
    let trial = test_trials(&[entry(&[0, 4], &[1])]).remove(0);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("wall-0.ply");
    let ply = Ply::new(folder.path(), None, GaussianFrame::Dataset, false, Splatting::default()).unwrap();
    let notes = |parts: GaussianParts| {
        files::write(&path, &Gaussians::new(parts).unwrap(), Output::Ply(Encoding::BinaryLittleEndian)).unwrap();
        ply.predict(trial.input()).unwrap().cost().notes.clone()
    };
    assert_eq!(notes(gaussians().into_parts()), [""; 0]);
    let mut broken = gaussians().into_parts();
    broken.means[17][1] = f32::NAN;
    broken.means[20][0] = f32::NAN;
    broken.log_scales[5] = [90.0; 3];
    let notes = notes(broken).concat();
    let outcomes = "3 of 24 (2 with NaN not drawn, 1 drawn only if the renderer can): ";
    assert!(notes.contains(outcomes), "{notes}");
    assert!(notes.contains("means not a number in 2, first 17"), "{notes}");
    assert!(notes.contains("log-scales out of range in 1, first 5") && notes.contains("wall-0.ply"), "{notes}");
}
