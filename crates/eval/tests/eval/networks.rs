//! A network as a method: what its record and its costs state.

use atsplat_eval::method::{AtSplat, Method, Splatting, WeightsSource};
use atsplat_model::network::{Device, Network};
use atsplat_model::parameters::parameters;
use atsplat_model::weights::generated;
use atsplat_model::{ImageSize, ModelConfig};
use atsplat_splat::effects::EffectSelection;

use crate::common::{SIZE, entry};
use crate::methods::test_trials;

fn nano() -> Network {
    let config = ModelConfig::named("nano").unwrap();
    let network = Network::new(&config, &Device::flex()).unwrap();
    network.with_weights(&generated(&parameters(&config), 1)).unwrap()
}

#[test]
fn an_untrained_network_is_marked_and_counts_its_tokens() {
    let weights = WeightsSource::Random { seed: 1, backbone_sha256: None };
    let splatting = Splatting { effects: EffectSelection::Auto, ..Splatting::default() };
    let method = AtSplat::new("atsplat", nano(), &weights, 0, splatting).unwrap();
    let record = method.record();
    assert!(record.untrained && record.title.contains("untrained") && record.weights_sha256.is_none());
    assert_eq!(record.parameters["effects"], "auto");
    let trial = test_trials(&[entry(&[0, 4], &[2])]).remove(0);
    let prediction = method.predict(trial.input()).unwrap();
    let cost = prediction.cost();
    assert_eq!(cost.gaussians.unwrap() % cost.final_tokens.unwrap(), 0);
    assert_eq!(cost.stages.len(), 5);
    assert_eq!(cost.notes, [""; 0]);
    let rendered = prediction.render(&[0]).remove(0).unwrap();
    assert!(rendered.image.samples().iter().all(|sample| sample.is_finite()));
}

/// An image of 64×64 has 16 patches for a network trained at that size, and 4 for one trained at 32×32.
#[test]
fn a_network_sees_its_training_size_and_renders_the_protocols_size() {
    let weights = WeightsSource::File { sha256: "0".repeat(64) };
    let trial = test_trials(&[entry(&[0, 4], &[2])]).remove(0);
    let smaller = "the network saw context images of 64x64 at 32x32".to_owned();
    for (trained, tokens, notes) in [(32, 2 * 4, vec![smaller]), (64, 2 * 16, vec![])] {
        let network = nano().trained_at(ImageSize::new(trained, trained));
        let method = AtSplat::new("atsplat", network, &weights, 0, Splatting::default()).unwrap();
        assert_eq!(method.record().parameters["context-at-scale-of"], format!("{trained}x{trained}"));
        let prediction = method.predict(trial.input()).unwrap();
        assert_eq!((prediction.cost().initial_tokens, &prediction.cost().notes), (Some(tokens), &notes));
        let rendered = prediction.render(&[0]).remove(0).unwrap().image;
        assert_eq!((rendered.width(), rendered.height()), (SIZE.width, SIZE.height));
    }
    let any_size = AtSplat::new("atsplat", nano(), &weights, 0, Splatting::default()).unwrap();
    assert!(!any_size.record().parameters.contains_key("context-at-scale-of"));
}
