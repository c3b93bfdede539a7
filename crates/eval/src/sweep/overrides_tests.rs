//! What overrides change, and which sweeps are rejected.

use atsplat_model::ModelConfig;
use atsplat_model::budget::budget;
use atsplat_protocol::{EvaluationIndex, IndexEntry, Preset};
use atsplat_splat::RendererConstants;

use super::*;

#[test]
fn overrides_change_token_budgets() {
    let nano = ModelConfig::named("nano").unwrap();
    let most =
        |overrides: &Overrides| budget(&overrides.model(&nano).unwrap(), 2, nano.resolution).unwrap().max.gaussians;
    assert_eq!(Overrides::default().model(&nano).unwrap(), nano);
    assert_eq!(most(&Overrides { gaussians_per_token: Some(4), ..Overrides::default() }), 5760);
    assert_eq!(most(&Overrides { ratios: Some(vec![1.0, 0.5, 0.0]), ..Overrides::default() }), 24_576);
    assert_eq!(most(&Overrides { thresholds: Some(vec![0.1, 0.1, 0.4]), ..Overrides::default() }), 65_536);
    assert_eq!(most(&Overrides { expand_first: Some(0), ..Overrides::default() }), 8192);
    for broken in [
        Overrides { gaussians_per_token: Some(0), ..Overrides::default() },
        Overrides { ratios: Some(vec![0.5]), ..Overrides::default() },
        Overrides { ratios: Some(vec![0.5, 2.0, 0.5]), ..Overrides::default() },
        Overrides { ratios: Some(vec![0.5; 3]), thresholds: Some(vec![0.1; 3]), ..Overrides::default() },
        Overrides { thresholds: Some(vec![0.1]), ..Overrides::default() },
    ] {
        assert!(broken.model(&nano).is_err(), "{broken:?}");
    }
}

#[test]
fn renderer_overrides_are_listed_in_the_name() {
    let exact = RendererConstants::default();
    let overrides = ConstantChanges { min_alpha: Some(0.0625), ..ConstantChanges::default() };
    let changed = overrides.applied(&exact).unwrap();
    assert_eq!(
        changed,
        RendererConstants { min_alpha: 0.0625, name: "exact, min-alpha 0.0625".to_owned(), ..exact.clone() }
    );
    assert!(ConstantChanges { min_alpha: Some(2.0), ..ConstantChanges::default() }.applied(&exact).is_err());
    assert!(
        ConstantChanges { constants: Some("none".to_owned()), ..ConstantChanges::default() }.applied(&exact).is_err()
    );
}

#[test]
fn views_are_spread_evenly() {
    let entry = IndexEntry { context: vec![0, 10, 20, 30, 40, 49], target: vec![5], overlap: Some(0.5.into()) };
    let index = EvaluationIndex { scenes: [("a".to_owned(), vec![entry])].into_iter().collect() };
    let context = |views| {
        let index = Overrides { views: Some(views), ..Overrides::default() }.index(&index, "rooms")?;
        let entry = &index.scenes["a"][0];
        assert_eq!(entry.overlap.is_some(), views == 6, "the overlap is that of all six views");
        Ok::<_, crate::EvalError>(entry.context.clone())
    };
    assert_eq!(context(1).unwrap(), [0]);
    assert_eq!(context(2).unwrap(), [0, 49]);
    assert_eq!(context(4).unwrap(), [0, 20, 30, 49]);
    assert_eq!(context(6).unwrap(), [0, 10, 20, 30, 40, 49]);
    assert!(context(0).is_err());
    let error = context(7).unwrap_err().to_string();
    assert!(error.contains("from 1 to 6, found 7 (scene a of rooms)"), "{error}");
}

#[test]
fn resolution_replaces_the_last_scaling_step() {
    let preset = Preset::named("re10k-2v-256").unwrap();
    let smaller = Overrides { resolution: Some([128, 192]), ..Overrides::default() }.preset(&preset).unwrap();
    assert!(smaller.preprocessing.to_string().contains("rescale-and-crop 192×128"), "{}", smaller.preprocessing);
    assert_ne!(smaller.hash().unwrap(), preset.hash().unwrap());
    assert!(Overrides { resolution: Some([0, 8]), ..Overrides::default() }.preset(&preset).is_err());
    let simulated = Preset::named("rooms-2v-128").unwrap();
    let smaller = Overrides { resolution: Some([64, 96]), ..Overrides::default() }.preset(&simulated).unwrap();
    assert!(smaller.preprocessing.to_string().contains("rescale-and-crop 96×64"), "{}", smaller.preprocessing);
}

#[test]
fn rejects_invalid_sweeps() {
    let text = "title = 't'\n[[settings]]\nlabel = 'a'\n[[settings]]\nlabel = 'b'\noverrides = { views = 2 }";
    let sweep = Sweep::from_toml(text).unwrap();
    assert_eq!((sweep.settings.len(), sweep.settings[1].overrides.views), (2, Some(2)));
    assert_eq!(Sweep::from_toml(&toml::to_string(&sweep).unwrap()).unwrap(), sweep);
    assert_eq!(Sweep::from_toml(&text.replace("overrides", "knobs")).unwrap(), sweep, "the key of older files");
    for broken in [
        "title = 't'\nsettings = []".to_owned(),
        text.replace("'b'", "'a'"),
        text.replace("views", "viewz"),
        text.replace("label = 'b'", "label = 'b'\nviews = 2"),
        text.replace("= 2", "= 'two'"),
        text.replace("views = 2", "precision = 'half'"),
    ] {
        assert!(Sweep::from_toml(&broken).is_err(), "{broken}");
    }
    for (from, to, expected) in [
        ("= 2", "= 'two'", "sweep: line 6 column 23: expected a whole number of at least 0, found \"two\""),
        ("label = 'b'", "name = 'b'", "sweep: line 5 column 1: expected "),
    ] {
        let error = Sweep::from_toml(&text.replace(from, to)).unwrap_err().to_string();
        assert!(error.starts_with(expected), "{expected}: {error}");
    }
    for (overrides, expected) in [
        ("views = 0", "settings: expected \"b\", views: at least 1, found 0"),
        ("steps = 0", "\"b\", steps: at least 1, found 0"),
        ("seconds = -1.0", "\"b\", seconds: a positive number, found -1"),
        ("strategy = '3dgs'", "\"b\", strategy: steps or seconds with it, found neither"),
        ("strategy = '3dgs', steps = 9, ratios = [0.5]", "\"b\", strategy: no network setting: with `strategy`"),
        ("strategy = '3dgs', steps = 9, weights = 'w'", "found both weights and 3dgs"),
        ("thresholds = [0.1, -1.0, 0.2]", "\"b\", thresholds: numbers of at least 0, found -1"),
        ("ratios = [0.5, 1.5]", "\"b\", ratios: ratios from 0 to 1 with at most six decimals, found 1.5"),
        ("ratios = [0.5], thresholds = [0.5]", "ratios or thresholds, not both"),
        ("tolerance = -0.5", "\"b\", tolerance"),
        ("resolution = [64, 0]", "\"b\", resolution: sides of at least one pixel, found 64×0"),
        ("renderer = { min-alpha = 2.0 }", "\"b\", renderer"),
        ("gaussians-per-token = 0", "\"b\", gaussians-per-token: at least 1, found 0"),
    ] {
        let error = Sweep::from_toml(&text.replace("views = 2", overrides)).unwrap_err().to_string();
        assert!(error.contains(expected), "{overrides}: {error}");
    }
    let error = Overrides { expand_first: Some(4), ..Overrides::default() }
        .model(&ModelConfig::named("nano").unwrap())
        .unwrap_err()
        .to_string();
    assert!(error.contains("expand-first: expected at most 3") && error.ends_with("found 4"), "{error}");
}
