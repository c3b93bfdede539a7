//! Scores of held-out views.

use atsplat_fit::{Fit, MeanScore, Strategy};
use atsplat_splat::RendererConstants;

use crate::common::{config, run, start, views};

/// Its PSNR is infinite, and so would the mean be.
#[test]
fn a_held_out_view_that_is_rendered_exactly_is_counted_and_left_out() {
    let (views, mut held_out) = views();
    let mut fit = Fit::new(config(Strategy::Fixed, 5), views, &start(Strategy::Fixed, 50)).unwrap();
    run(&mut fit, 2);
    let other = fit.mean_score(&held_out[1..]).unwrap();
    assert!(other.psnr.is_some() && other.ssim.is_some() && other.identical == 0, "{other:?}");
    let exact = fit.render(&held_out[0].view).unwrap().rgb;
    held_out[0].rgb = exact;
    let evaluation = fit.evaluate(&held_out).unwrap().unwrap();
    assert_eq!(evaluation.score, MeanScore { identical: 1, ..other });
    let record = serde_json::to_value(evaluation).unwrap();
    assert!(record["identical"] == 1 && record["psnr"].as_f64() == other.psnr, "{record}");
}

/// Renders of a finished run are what was optimised only with its constants.
#[test]
fn the_constants_of_mip_splatting_are_a_preset() {
    let fit = Fit::new(config(Strategy::MipSplatting, 5), views().0, &start(Strategy::MipSplatting, 50)).unwrap();
    let constants = fit.options().constants;
    let preset = RendererConstants::named("mip-splatting").unwrap();
    assert_eq!(RendererConstants { name: constants.name.clone(), ..preset }, constants);
}
