use super::*;
use crate::config::{DinoSize, RatioRounding, SelectionRatio};

const PAPER: &str = include_str!("../../tests/fixtures/paper_budget.csv");

fn preset(name: &str) -> ModelConfig {
    ModelConfig::named(name).unwrap()
}

fn fixed(config: &ModelConfig, views: usize, height: usize, width: usize) -> (usize, usize, usize) {
    let range = budget(config, views, ImageSize::new(height, width)).unwrap();
    let budget = range.fixed().expect("ratios are fixed");
    (budget.initial_tokens, budget.final_tokens, budget.gaussians)
}

#[test]
fn the_papers_table_is_reproduced() {
    let mut rows = 0;
    for line in PAPER.lines().skip(1) {
        let fields: Vec<&str> = line.split(',').collect();
        let [dataset, resolution, views, initial, last, gaussians] = fields[..] else { panic!("{line}") };
        let (height, width) = resolution.trim_end_matches('*').split_once('x').unwrap();
        let name = match (dataset, resolution.ends_with('*')) {
            ("RE10K", false) => "paper-re10k",
            ("DL3DV", false) => "paper-dl3dv",
            ("DL3DV", true) => "paper-dl3dv-hr",
            other => panic!("{other:?}"),
        };
        let number = |text: &str| text.parse::<usize>().unwrap();
        let found = fixed(&preset(name), number(views), number(height), number(width));
        assert_eq!(found, (number(initial), number(last), number(gaussians)), "{line}");
        rows += 1;
    }
    assert_eq!(rows, 5);
}

#[test]
fn the_one_setting_with_a_fractional_number_of_tokens() {
    let mut config = preset("paper-dl3dv-224");
    assert_eq!(fixed(&config, 6, 224, 224), (1176, 3308, 52_928));
    config.expansion.ratio_rounding = RatioRounding::Floor;
    assert_eq!(fixed(&config, 6, 224, 224), (1176, 3307, 52_912));
}

#[test]
fn nominal_budgets_of_the_presets_are_the_papers() {
    for (name, gaussians) in [
        ("paper-re10k", 23_040),
        ("paper-dl3dv", 120_960),
        ("paper-dl3dv-224", 52_928),
        ("paper-dl3dv-hr", 311_040),
        ("mini", 23_040),
        ("micro", 23_040),
        ("nano", 23_040),
    ] {
        let config = preset(name);
        let (_, _, found) = fixed(&config, config.views, config.resolution.height, config.resolution.width);
        assert_eq!(found, gaussians, "{name}");
    }
}

#[test]
fn thresholds_span_the_papers_dynamic_budgets() {
    let config = preset("paper-re10k").with_thresholds(&[0.1, 0.1, 0.4]).unwrap();
    let range = budget(&config, 2, ImageSize::new(256, 256)).unwrap();
    assert!(range.fixed().is_none());
    assert_eq!((range.min.gaussians, range.max.gaussians), (8192, 65_536));
    assert!(preset("paper-re10k").with_thresholds(&[0.1]).is_err());
}

#[test]
fn expansion_is_enabled_from_the_first_block() {
    let config = preset("paper-re10k");
    let sizes: Vec<usize> =
        (0..=4).map(|blocks| fixed(&config.with_expansion_in_first(blocks), 2, 256, 256).1).collect();
    assert_eq!(sizes, [512, 768, 1152, 1440, 1440]);
}

#[test]
fn the_papers_sweep_of_gaussians_per_token_is_reproduced() {
    for (k, gaussians) in [(4, 5760), (8, 11_520), (16, 23_040), (32, 46_080), (64, 92_160)] {
        let mut config = preset("paper-re10k");
        config.head.gaussians_per_token = k;
        assert_eq!(fixed(&config, 2, 256, 256).2, gaussians);
    }
}

#[test]
fn ratios_are_exact_unlike_floats() {
    let ratio = |value| SelectionRatio::new(value).unwrap();
    assert!(std::hint::black_box(0.55) * 100.0 > 55.0f64, "floats round up");
    assert_eq!(ratio(0.55).of(100, RatioRounding::Ceil), 55);
    assert_eq!(ratio(0.8).of(5760, RatioRounding::Ceil), 4608);
    assert_eq!(ratio(1.0).of(7, RatioRounding::Floor), 7);
    assert_eq!(ratio(0.0).of(7, RatioRounding::Ceil), 0);
    for wrong in [-0.1, 1.1, f64::NAN, f64::INFINITY, 1.0 / 3.0] {
        assert!(SelectionRatio::new(wrong).is_none(), "{wrong}");
    }
}

#[test]
fn the_formula_agrees_with_counted_selections() {
    let config = preset("paper-re10k");
    let counted = Budget::from_selections(&config, 512, &[0, 256, 384, 288]).unwrap();
    assert_eq!(Some(&counted), budget(&config, 2, ImageSize::new(256, 256)).unwrap().fixed());
    assert_eq!(counted.tokens, [512, 768, 1152, 1440]);
    let error = Budget::from_selections(&config, 512, &[0, 600, 0, 0]).unwrap_err().to_string();
    assert!(error.contains("block 1") && error.contains("512") && error.contains("600"), "{error}");
    assert!(Budget::from_selections(&config, 512, &[0]).is_err());
}

#[test]
fn rejects_images_that_patches_do_not_divide() {
    let error = budget(&preset("paper-re10k"), 2, ImageSize::new(250, 256)).unwrap_err().to_string();
    assert!(error.contains("divisible by 16") && error.contains("250x256"), "{error}");
    assert!(budget(&preset("paper-dl3dv-hr"), 2, ImageSize::new(272, 256)).is_err(), "half of it has no whole patches");
}

#[test]
fn memory_is_linear_in_views_and_includes_the_weights() {
    let config = preset("paper-re10k");
    let two = memory(&config, 2, ImageSize::new(256, 256)).unwrap();
    let four = memory(&config, 4, ImageSize::new(256, 256)).unwrap();
    assert_eq!(two.weight_bytes, four.weight_bytes);
    assert_eq!(2 * two.activation_bytes, four.activation_bytes, "every stage is linear in the views");
    let weights: usize = parameters(&config).iter().map(Parameter::elements).sum();
    assert_eq!(two.weight_bytes, 4 * weights as u64);
    assert_eq!(two.peak_bytes(), two.weight_bytes + two.activation_bytes);
    assert!(two.peak_bytes() < 1 << 30, "{two:?}");
}

#[test]
fn the_class_token_and_the_registers_of_a_backbone_take_memory() {
    let mut config = preset("paper-re10k");
    config.backbone = BackboneConfig::DinoV2 { size: DinoSize::Base, registers: true };
    // So narrow that the backbone takes more than any other stage.
    config.transformer.dim = 64;
    let found = memory(&config, 2, ImageSize::new(256, 256)).unwrap();
    // Of each token: input, normalised input, and the hidden channels of the feed-forward module.
    let (tokens, images) = (2 * (16 * 16 + 1 + 4), 2 * 256 * 256 * 3);
    assert_eq!(found.activation_bytes, 4 * (tokens * 768 * (1 + 1 + 4) + images));
}
