//! LPIPS and ST-LPIPS against their packages (`oracle/make_learned_golden.py`), with seeded networks, and with published
//! weights if they are found.

#![expect(clippy::unwrap_used, reason = "a fixture that does not parse fails the test")]

mod common;

use std::path::Path;
use std::sync::Arc;

use atsplat_metrics::learned::{
    FeatureCache, LoadError, Lpips, LpipsNetwork, WeightsAbsent, WeightsFolders, WeightsHashes, embedded_heads,
};
use atsplat_metrics::{Definition, MetricError, Networks, NotComputed, Score, Suite, definition, definitions};
use atsplat_numeric::Tolerance;
use atsplat_pixels::{DecodeLimits, Image, decode};
use atsplat_tensors::{StoredTensor, StoredTensors, TensorFile};
use atsplat_tests::{on_threads, shared_data, skip};
use common::{seeded, uniform};

/// For values of about 0.01, of f32 networks with different summation orders.
const SEEDED: Tolerance = Tolerance::absolute(1e-7);
const PUBLISHED: Tolerance = Tolerance::absolute(1e-5);

const VGG_CHANNELS: [usize; 14] = [3, 64, 64, 128, 128, 256, 256, 256, 512, 512, 512, 512, 512, 512];

/// Names and shapes of a network's convolutions, in order: channels out, channels in, kernel.
fn convolutions(network: LpipsNetwork) -> Vec<(String, [usize; 3])> {
    let names: &[&str] = match network {
        LpipsNetwork::LpipsVgg => &["0", "2", "5", "7", "10", "12", "14", "17", "19", "21", "24", "26", "28"],
        LpipsNetwork::LpipsAlex => &["0", "3", "6", "8", "10"],
        LpipsNetwork::StLpipsAlex => &["1.0", "2.5", "3.9", "4.11", "5.13"],
        LpipsNetwork::StLpipsVgg => {
            &["1.0", "1.2", "2.6", "2.8", "3.12", "3.14", "3.16", "4.20", "4.22", "4.24", "5.28", "5.30", "5.32"]
        }
    };
    let shapes: Vec<[usize; 3]> = if names.len() == 5 {
        vec![[64, 3, 11], [192, 64, 5], [384, 192, 3], [256, 384, 3], [256, 256, 3]]
    } else {
        VGG_CHANNELS.windows(2).map(|channels| [channels[1], channels[0], 3]).collect()
    };
    let prefix =
        if matches!(network, LpipsNetwork::LpipsVgg | LpipsNetwork::LpipsAlex) { "features." } else { "net.slice" };
    names.iter().map(|name| format!("{prefix}{name}")).zip(shapes).collect()
}

fn weights(network: LpipsNetwork) -> StoredTensors {
    let mut stored = StoredTensors::default();
    let mut add = |name: String, shape: Vec<usize>, values: &[f32]| {
        stored.tensors.insert(name, StoredTensor::from_f32(shape, values).unwrap());
    };
    for (position, (name, [channels_out, channels_in, kernel])) in convolutions(network).into_iter().enumerate() {
        let fan_in = channels_in * kernel * kernel;
        let weight = uniform(2 * position as u64, channels_out * fan_in, (6.0 / fan_in as f64).sqrt());
        add(format!("{name}.weight"), vec![channels_out, channels_in, kernel, kernel], &weight);
        add(format!("{name}.bias"), vec![channels_out], &uniform(2 * position as u64 + 1, channels_out, 0.1));
    }
    for (position, channels) in network.channels().into_iter().enumerate() {
        let head: Vec<f32> = uniform(1000 + position as u64, channels, 1.0).into_iter().map(f32::abs).collect();
        if matches!(network, LpipsNetwork::StLpipsAlex | LpipsNetwork::StLpipsVgg) {
            add(format!("lin{position}.model.1.weight"), vec![1, channels, 1, 1], &head);
        }
    }
    stored
}

/// Loads seeded weights through a file, as users do.
fn lpips(network: LpipsNetwork) -> Lpips {
    let folder = tempfile::tempdir().unwrap();
    weights(network).write(&folder.path().join(network.file())).unwrap();
    Lpips::find(network, &WeightsFolders::new(vec![folder.path().to_owned()])).unwrap()
}

fn distance(lpips: &Lpips, render: &Image, truth: &Image) -> f64 {
    let [render, truth] = [render, truth].map(|image| lpips.features(image).unwrap());
    lpips.distance(&render, &truth).unwrap()
}

#[test]
fn distances_agree_with_the_packages() {
    let golden = common::fixture("learned_golden.json");
    let networks = [
        ("lpips-vgg", LpipsNetwork::LpipsVgg),
        ("lpips-alex", LpipsNetwork::LpipsAlex),
        ("st-lpips-alex", LpipsNetwork::StLpipsAlex),
        ("st-lpips-vgg", LpipsNetwork::StLpipsVgg),
    ];
    for network in definitions().iter().filter_map(Definition::network) {
        assert!(networks.iter().any(|(_, compared)| *compared == network), "{network:?}");
    }
    for (name, network) in networks {
        let lpips = lpips(network);
        let cases: Vec<_> = golden.as_array().unwrap().iter().filter(|case| case["network"] == name).collect();
        assert_eq!(cases.len(), 2, "cases of {name}");
        for case in cases {
            let truth = common::truth(case);
            let render = common::render(&truth, case["seed"].as_u64().unwrap());
            let found = distance(&lpips, &render, &truth);
            SEEDED.assert([found], case["value_f64"].as_f64(), &format!("{name} of {}", case["image"]));
        }
    }
}

/// The features of the truth are cached: those of one metric must not be used for the other.
#[test]
fn lpips_of_gaussian_splatting_agrees_with_its_formula() {
    let golden = common::fixture("learned_golden.json");
    let mut networks = Networks::default();
    networks.add(Arc::new(lpips(LpipsNetwork::LpipsVgg)));
    let metrics = ["lpips", "lpips-inria-8bit-rounded"].map(|id| definition(id).unwrap());
    let suite = Suite::new(metrics.to_vec(), networks, 1 << 26);
    let cases_of = |network: &str| {
        let cases: Vec<_> = golden.as_array().unwrap().iter().filter(|case| case["network"] == network).collect();
        assert_eq!(cases.len(), 2, "cases of {network}");
        cases
    };
    for (scaled, unscaled) in cases_of("lpips-vgg").into_iter().zip(cases_of("lpips-vgg-inria")) {
        let truth = common::truth(unscaled);
        let render = common::render(&truth, unscaled["seed"].as_u64().unwrap());
        let scores = suite.score(&render, &truth).scores;
        let found = scores.iter().filter_map(|(_, score)| score.value());
        let expected = [scaled, unscaled].map(|case| case["value_f64"].as_f64().unwrap());
        SEEDED.assert(found, expected, unscaled["image"].as_str().unwrap());
    }
}

#[test]
fn distances_are_independent_of_threads_and_caches() {
    let lpips = lpips(LpipsNetwork::LpipsAlex);
    let (a, b) = (seeded(71, 64, 1), seeded(71, 64, 2));
    let distance_on = |threads| on_threads(threads, || distance(&lpips, &a, &b));
    let value = distance_on(1);
    Tolerance::EXACT.assert([distance_on(2), distance_on(5)], [value; 2], "any threads");
    Tolerance::EXACT.assert([distance(&lpips, &a, &a)], [0.0], "itself");
    Tolerance::EXACT.assert([distance(&lpips, &b, &a)], [value], "symmetric");

    let cache = FeatureCache::new(lpips.features(&a).unwrap().bytes() * 2);
    let first = cache.features(&lpips, &a).unwrap();
    assert!(Arc::ptr_eq(&first, &cache.features(&lpips, &a).unwrap()), "cached");
    for image in [&b, &seeded(71, 64, 3)] {
        cache.features(&lpips, image).unwrap();
    }
    let again = cache.features(&lpips, &a).unwrap();
    assert!(!Arc::ptr_eq(&first, &again), "the oldest went");
    assert_eq!(first, again, "computed again");
}

/// Their maps have the same numbers of channels.
#[test]
fn features_of_other_networks_and_weights_are_not_compared() {
    let own = lpips(LpipsNetwork::LpipsAlex);
    let shifted = lpips(LpipsNetwork::StLpipsAlex);
    let heads = embedded_heads(LpipsNetwork::LpipsAlex).unwrap().unwrap();
    let hashes = WeightsHashes { network: "another file".to_owned(), heads: own.hashes().heads.clone() };
    let retrained =
        Lpips::from_tensors(LpipsNetwork::LpipsAlex, &weights(LpipsNetwork::LpipsAlex), &heads, hashes).unwrap();
    let image = seeded(64, 64, 1);
    let of_own = own.features(&image).unwrap();
    assert_eq!(own.distance(&of_own, &of_own), Ok(0.0));
    for (other, named) in
        [(shifted, "found those of ST-LPIPS (Alex) with"), (retrained, "with the weights another file")]
    {
        let of_other = other.features(&image).unwrap();
        for outcome in [own.distance(&of_other, &of_own), own.distance(&of_own, &of_other)] {
            let error = outcome.unwrap_err();
            assert!(matches!(error, MetricError::OtherFeatures { .. }), "{error}");
            assert!(error.to_string().contains(named), "{error}");
        }
    }
}

#[test]
fn invalid_images_and_weights_are_typed_errors() {
    let lpips = lpips(LpipsNetwork::LpipsAlex);
    let smallest = LpipsNetwork::LpipsAlex.smallest_side();
    assert!(lpips.features(&seeded(smallest, smallest, 1)).is_ok());
    let outcome = lpips.features(&seeded(smallest, smallest - 1, 1));
    assert!(matches!(outcome, Err(MetricError::TooSmall { .. })), "{outcome:?}");
    let broken = Image::new(64, 64, vec![f32::NAN; 64 * 64 * 3]).unwrap();
    assert!(matches!(lpips.features(&broken), Err(MetricError::NonFinite(_))));
    let (a, b) = (seeded(64, 64, 1), seeded(64, 65, 1));
    let features = [&a, &b].map(|image| lpips.features(image).unwrap());
    assert!(matches!(lpips.distance(&features[0], &features[1]), Err(MetricError::SizeMismatch { .. })));

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("alexnet-owt-7be5be79.pth");
    let from = |path: &Path| Lpips::from_file(LpipsNetwork::LpipsAlex, path);
    assert!(matches!(from(&path), Err(LoadError::Absent(_))));
    std::fs::write(&path, b"not weights").unwrap();
    assert!(matches!(from(&path), Err(LoadError::File(_))));
    let write = |stored: &StoredTensors| stored.write(&path).unwrap();
    let mut stored = weights(LpipsNetwork::LpipsAlex);
    stored.tensors.insert("features.3.bias".to_owned(), StoredTensor::from_f32(vec![192], &[f32::NAN; 192]).unwrap());
    write(&stored);
    assert!(from(&path).unwrap_err().to_string().contains("192 that are NaN"));
    stored.tensors.insert("features.3.bias".to_owned(), StoredTensor::from_f32(vec![1], &[0.0]).unwrap());
    write(&stored);
    assert!(from(&path).unwrap_err().to_string().contains("features.3.bias: expected shape [192]"));
    stored.tensors.shift_remove("features.3.bias");
    write(&stored);
    assert!(matches!(from(&path), Err(LoadError::Mismatch { .. })));
    let unpublished = lpips.unpublished().expect("seeded weights are not the published ones");
    for part in ["LPIPS (Alex)", "7be5be79…", &lpips.hashes().network] {
        assert!(unpublished.contains(part), "{part}: {unpublished}");
    }
}

#[test]
fn a_suite_reports_metrics_that_cannot_be_computed() {
    let all: Vec<_> = definitions().iter().collect();
    let nowhere = WeightsFolders::new(vec!["/nonexistent".into()]);
    let mut networks = Networks::for_definitions(&all, &nowhere).unwrap();
    networks.add(Arc::new(lpips(LpipsNetwork::StLpipsAlex)));
    let suite = Suite::new(all, networks, 1 << 24);
    let (a, b) = (seeded(40, 40, 1), seeded(40, 40, 2));
    let scored = suite.score(&a, &b);
    for (id, score) in &scored.scores {
        let absent = matches!(score, Score::NotComputed(NotComputed::WeightsAbsent(WeightsAbsent { .. })));
        let expected = id.contains("lpips") && *id != "st-lpips";
        assert_eq!(absent, expected, "{id}: {score:?}");
        assert_eq!(score.value().is_some(), !expected, "{id}: {score:?}");
    }
    let json = serde_json::to_string(&scored).unwrap();
    assert!(json.contains("not computed: weights absent: LPIPS (VGG) needs vgg16-397923af.pth"), "{json}");
    let same = suite.score(&a, &a);
    assert!(same.identical);
    assert_eq!(same.scores[0], (definition("psnr").unwrap().id, Score::Identical));
    let mut samples = b.samples().to_vec();
    samples[7] = f32::NAN;
    let broken = suite.score(&Image::new(40, 40, samples).unwrap(), &a);
    assert_eq!((broken.non_finite.render, broken.non_finite.first), (1, Some([2, 0, 1])));
    assert!(broken.scores.iter().all(|(_, score)| matches!(score, Score::NotComputed(NotComputed::Images(_)))));
}

/// Finite samples that overflow the network: infinities of both signs add up to NaN, which no layer hides.
#[test]
fn a_distance_that_is_no_number_is_not_a_score() {
    let mut networks = Networks::default();
    for network in [LpipsNetwork::LpipsAlex, LpipsNetwork::StLpipsAlex] {
        networks.add(Arc::new(lpips(network)));
    }
    let metrics = ["lpips-alex", "st-lpips"].map(|id| definition(id).unwrap());
    let suite = Suite::new(metrics.to_vec(), networks, 1 << 24);
    let (usual, huge) = (seeded(40, 40, 1), Image::new(40, 40, vec![3e38; 40 * 40 * 3]).unwrap());
    for (render, truth) in [(&huge, &usual), (&usual, &huge)] {
        let scored = suite.score(render, truth);
        assert_eq!((scored.non_finite.total(), scored.scores.len()), (0, 2));
        for (id, score) in scored.scores {
            let Score::NotComputed(reason) = &score else { panic!("{id}: {score:?}") };
            assert!(matches!(reason, NotComputed::Images(MetricError::Overflow { .. })), "{id}: {reason}");
            assert!(reason.to_string().starts_with("not computed: ") && reason.to_string().contains("LPIPS (Alex): "));
        }
    }
}

fn read(path: &Path) -> Image {
    Image::from_u8(&decode(&std::fs::read(path).unwrap(), &DecodeLimits::default()).unwrap())
}

#[test]
fn golden_values_of_published_st_lpips() {
    let test = "golden_values_of_published_st_lpips";
    let Some(data) = shared_data(test).map(|data| data.join("lpips")) else { return };
    let golden: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(data.join("GOLDEN.json")).unwrap()).unwrap();
    let folders = WeightsFolders::new(vec![data.join("st_lpips")]).then(WeightsFolders::torch_hub());
    for (key, network) in
        [("st_lpips_vST0.0_alex", LpipsNetwork::StLpipsAlex), ("st_lpips_vST0.0_vgg", LpipsNetwork::StLpipsVgg)]
    {
        match Lpips::find(network, &folders) {
            Ok(lpips) => {
                assert_eq!(lpips.unpublished(), None);
                let truth = read(&data.join(golden[key]["a"].as_str().unwrap()));
                for (name, value) in golden[key]["b_to_value"].as_object().unwrap() {
                    let render = read(&data.join(name));
                    let found = distance(&lpips, &render, &truth);
                    PUBLISHED.assert([found], value.as_f64(), name);
                }
            }
            Err(LoadError::Absent(absent)) => skip(test, absent),
            Err(error) => panic!("{error}"),
        }
    }
}

#[test]
fn golden_value_of_published_lpips() {
    let test = "golden_value_of_published_lpips";
    let Some(data) = shared_data(test).map(|data| data.join("lpips")) else { return };
    match Lpips::find(LpipsNetwork::LpipsVgg, &WeightsFolders::torch_hub()) {
        Ok(lpips) => {
            let [a, b] = ["apple.png", "pear.png"].map(|name| read(&data.join("brush_golden").join(name)));
            let found = distance(&lpips, &a, &b);
            Tolerance::absolute(1e-4).assert([found], [0.657_101_988_792_419_4], "apple and pear");
        }
        Err(LoadError::Absent(absent)) => skip(test, absent),
        Err(error) => panic!("{error}"),
    }
}

#[test]
fn the_packages_heads_equal_the_embedded_ones() {
    let test = "the_packages_heads_equal_the_embedded_ones";
    let Some(data) = shared_data(test).map(|data| data.join("lpips/linear_heads/v0.1")) else { return };
    for (network, file) in [(LpipsNetwork::LpipsAlex, "alex.pth"), (LpipsNetwork::LpipsVgg, "vgg.pth")] {
        let embedded = embedded_heads(network).unwrap().unwrap();
        assert_eq!(TensorFile::open(&data.join(file)).unwrap().stored.digest(), embedded.digest(), "{file}");
    }
}
