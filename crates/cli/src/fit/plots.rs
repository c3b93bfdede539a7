//! The plots of a run: its learning curve, and a contact sheet.

use std::path::Path;

use atsplat_fit::loss::Terms;
use atsplat_fit::{Fit, TrainingView, nearest_view_psnr};
use atsplat_numeric::counted;
use atsplat_pixels::{Image, Rounding};
use atsplat_report::plot::{ContactRow, ContactSheet, LearningCurve, PlotFormat};

use crate::paths::PendingFile;
use crate::plot::write_both;

/// Views on the contact sheet.
const SHEET_VIEWS: usize = 6;

/// Writes the learning curve and a contact sheet: images above, renders below.
pub(super) fn draw(
    folder: &Path,
    fit: &mut Fit,
    training: &[TrainingView],
    held_out: &[TrainingView],
) -> anyhow::Result<()> {
    let title = format!("{}, {}", fit.config().strategy.name(), counted(fit.step_count(), "step"));
    draw_curve(folder, &title, fit, training, held_out)?;
    let (kind, shown) = if held_out.is_empty() { ("training", training) } else { ("held-out", held_out) };
    let rows = rows(fit, shown, held_out.is_empty())?;
    let subtitle = format!("{} of {} {kind} views", rows.len(), shown.len());
    let sheet = ContactSheet { title, subtitle, rows }.draw().encode(PlotFormat::Png)?;
    PendingFile::open(&folder.join("contact-sheet.png"))?.finish(&sheet)
}

fn draw_curve(
    folder: &Path,
    title: &str,
    fit: &Fit,
    training: &[TrainingView],
    held_out: &[TrainingView],
) -> anyhow::Result<()> {
    let nearest = nearest_view_psnr(held_out, training);
    let history = fit.history();
    let evaluations = history.evaluations.iter();
    let evaluations: Vec<_> =
        evaluations.filter_map(|evaluation| Some((evaluation.step, evaluation.score.psnr?, nearest))).collect();
    let steps: Vec<u64> = (1..=fit.step_count()).collect();
    let losses_by = |term: fn(&Terms) -> f64| history.losses.iter().map(|terms| Some(term(terms))).collect::<Vec<_>>();
    let losses = [
        ("total", losses_by(|terms| terms.total)),
        ("L1", losses_by(|terms| terms.l1)),
        ("D-SSIM", losses_by(|terms| terms.d_ssim)),
    ];
    let curve = LearningCurve {
        title,
        subtitle: &format!("{} training and {}", training.len(), counted(held_out.len() as u64, "held-out view")),
        steps: &steps,
        losses: &losses,
        evaluations: &evaluations,
    };
    write_both(folder, "learning-curve", &curve.draw()).map(drop)
}

/// The first of these views with their renders; training views have their optimised cameras and exposures.
fn rows(fit: &mut Fit, views: &[TrainingView], are_training_views: bool) -> anyhow::Result<Vec<ContactRow>> {
    let mut rows = Vec::new();
    for (number, view) in views.iter().take(SHEET_VIEWS).enumerate() {
        let size = view.view.size;
        let image =
            |rgb: Vec<[f32; 3]>| Image::new(size.width, size.height, rgb.into_flattened())?.to_u8(Rounding::Nearest);
        let as_trained = if are_training_views { fit.render_training(number)? } else { None };
        let (rendering, score) = match as_trained {
            Some(rendered) => rendered,
            None => (fit.render(&view.view)?, fit.score(view)?),
        };
        let targets = vec![[image(rendering.rgb)?, image(view.rgb.clone())?]];
        let label = format!("{}, {score}", view.name);
        rows.push(ContactRow { label, context: Vec::new(), targets });
    }
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use atsplat_camera::{Camera, CameraFromWorld, ImageSize, NormalizedIntrinsics};
    use atsplat_fit::start::in_frustums;
    use atsplat_fit::{FitConfig, Rates, Strategy};
    use atsplat_numeric::Tolerance;
    use atsplat_splat::View;
    use glam::{DMat3, DVec3};

    use super::*;

    fn view(x: f64, side: u32, grey: f32) -> TrainingView {
        let pose = CameraFromWorld::new(DMat3::IDENTITY, DVec3::new(-x, 0.0, 0.0)).unwrap();
        let intrinsics = NormalizedIntrinsics::new(1.0, 1.0, 0.5, 0.5).unwrap();
        let view = View { camera: Camera::pinhole(pose, intrinsics), size: ImageSize { width: side, height: side } };
        TrainingView { name: format!("x = {x}"), rgb: vec![[grey; 3]; view.pixels()], view }
    }

    /// The next step renders its view as the sheet shows it, before it changes all cameras and exposures.
    #[test]
    fn training_views_are_shown_with_their_cameras_and_exposures() {
        let training = vec![view(0.0, 24, 0.5), view(0.5, 24, 0.75)];
        let start = in_frustums(&training, 50, Some([1.0, 4.0]), 0.01, 0, Strategy::Fixed).unwrap();
        let (means, final_means, colours, opacities, scales, rotations) = (1e-9, 1e-9, 1e-9, 1e-9, 1e-9, 1e-9);
        let rates = Rates { means, final_means, colours, opacities, scales, rotations };
        for (pose_rate, exposure_rate) in [(Some(0.02), None), (None, Some(0.02))] {
            let config = FitConfig { rates, pose_rate, exposure_rate, ..FitConfig::new(Strategy::Fixed, 100) };
            let mut fit = Fit::new(config, training.clone(), &start).unwrap();
            for _ in 0..60 {
                fit.step().unwrap();
            }
            let as_given: Vec<f64> = training.iter().map(|view| fit.score(view).unwrap().psnr().unwrap()).collect();
            for _ in &training {
                let rows = rows(&mut fit, &training, true).unwrap();
                let step = fit.step().unwrap();
                let label = rows[step.view].label.strip_prefix(&format!("{}, ", training[step.view].name)).unwrap();
                let shown: f64 = label.strip_suffix(" dB").unwrap().parse().unwrap();
                // Shown with two decimals.
                Tolerance::absolute(0.0051).assert([shown], [step.psnr()], label);
                let given = as_given[step.view];
                assert!((shown - given).abs() > 0.02, "{shown} dB, {given} dB with camera and exposure as given");
            }
        }
    }

    #[test]
    fn held_out_photos_of_another_size_are_on_the_curve() {
        let training = vec![view(0.0, 24, 0.5), view(0.5, 24, 0.75)];
        for (side, has_baseline) in [(24, true), (16, false)] {
            let held_out = [view(0.125, side, 0.625)];
            let start = in_frustums(&training, 50, Some([1.0, 4.0]), 0.01, 0, Strategy::Fixed).unwrap();
            let mut fit = Fit::new(FitConfig::new(Strategy::Fixed, 1), training.clone(), &start).unwrap();
            fit.step().unwrap();
            assert!(fit.evaluate(&held_out).unwrap().is_some());
            let folder = tempfile::tempdir().unwrap();
            draw(folder.path(), &mut fit, &training, &held_out).unwrap();
            let curve = std::fs::read_to_string(folder.path().join("learning-curve.svg")).unwrap();
            let is_drawn = |series: &str| curve.contains(&format!("data-role=\"data\" data-series=\"{series}\""));
            let drawn = (is_drawn("renders"), is_drawn("nearest context view"));
            assert_eq!(drawn, (true, has_baseline), "held-out photos of {side}×{side} pixels");
        }
    }
}
