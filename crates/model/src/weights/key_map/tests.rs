use atsplat_pickle::SharedBytes;

use super::*;
use crate::config::{BackboneConfig, DinoSize, ModelConfig};
use crate::parameters::{Parameter, parameters};
use crate::weights::{
    DType, MismatchCounts, MismatchReason, Missing, OtherSets, StoredTensor, StoredTensors, UnusedTensor, generated,
};

/// Name and shape of a tensor.
type Named = (&'static str, &'static [usize]);

fn dino(size: DinoSize, registers: bool) -> Vec<Parameter> {
    let mut config = ModelConfig::named("paper-re10k").unwrap();
    config.backbone = BackboneConfig::DinoV2 { size, registers };
    let all = parameters(&config).into_iter();
    all.filter(|parameter| !parameter.trained).collect()
}

fn stored(tensors: &[(&str, &[usize])]) -> StoredTensors {
    let tensor = |shape: &[usize]| {
        let values: Vec<f32> = (0u16..).map(f32::from).take(shape.iter().product()).collect();
        StoredTensor::from_f32(shape.to_vec(), &values).unwrap()
    };
    StoredTensors {
        tensors: tensors.iter().map(|(name, shape)| ((*name).to_owned(), tensor(shape))).collect(),
        ..Default::default()
    }
}

fn parameter(name: &str, shape: &[usize]) -> Parameter {
    Parameter { name: name.to_owned(), shape: shape.to_vec(), trained: true }
}

#[test]
fn dinov2_round_trips_through_both_naming_schemes() {
    for (size, registers) in [(DinoSize::Tiny, false), (DinoSize::Tiny, true), (DinoSize::Small, true)] {
        let expected = dino(size, registers);
        let ours = generated(&expected, 5);
        for map in ["dinov2-official", "dinov2-hugging-face"] {
            let map = KeyMap::resolve(map).unwrap();
            let foreign = map.export(&ours).unwrap();
            let (imported, report) = map.import(&foreign, &expected).unwrap();
            assert_eq!(imported.digest(), ours.digest(), "{report}");
            assert!(report.left_over.is_empty() && report.ignored.is_empty(), "{report}");
            let (found, report) = BackboneConfig::in_file(&foreign).unwrap().unwrap();
            assert_eq!((found, &report.key_map), (BackboneConfig::DinoV2 { size, registers }, &map.name));
            let mut lacking = foreign.clone();
            lacking.tensors.pop();
            assert_eq!(BackboneConfig::in_file(&lacking).unwrap(), None);
        }
    }
}

#[test]
fn hugging_face_queries_keys_and_values_are_joined() {
    let expected = dino(DinoSize::Tiny, true);
    let foreign = KeyMap::resolve("dinov2-hugging-face").unwrap().export(&generated(&expected, 1)).unwrap();
    let shape = |name: &str| foreign.tensors.get(name).map(|tensor| tensor.shape().to_vec());
    assert_eq!(shape("encoder.layer.1.attention.attention.key.weight"), Some(vec![32, 32]));
    assert_eq!(shape("encoder.layer.0.attention.attention.value.bias"), Some(vec![32]));
    assert_eq!(shape("embeddings.register_tokens"), Some(vec![1, 4, 32]));
    assert!(foreign.tensors.keys().all(|name| !name.contains("qkv")));
    let mut shuffled = foreign.clone();
    shuffled.tensors.reverse();
    let import = |stored: &StoredTensors| {
        KeyMap::resolve("dinov2-hugging-face").unwrap().import(stored, &expected).unwrap().0.digest()
    };
    assert_eq!(import(&shuffled), import(&foreign), "the file's order does not matter");
}

#[test]
fn the_report_lists_missing_unused_and_mismatched_tensors() {
    let map = KeyMap::from_toml(
        r#"
        name = "test"
        roots = ["state_dict.", "module."]
        ignore = ["unneeded.**"]
        [[rules]]
        from = "**"
        to = "{1}"
        "#,
    )
    .unwrap();
    let file = stored(&[("state_dict.module.a", &[2, 3]), ("module.b", &[4]), ("c", &[1]), ("unneeded.x.y", &[1])]);
    let expected = [parameter("a", &[2, 3]), parameter("b", &[2, 2]), parameter("d", &[7])];
    let (found, report) = map.apply(&file, &expected);
    assert_eq!(found.tensors.keys().collect::<Vec<_>>(), ["a"]);
    assert_eq!(report.missing, [Missing { parameter: "d".to_owned(), shape: vec![7] }]);
    let left_over = UnusedTensor { tensor: "c".to_owned(), found: "float32 [1]".to_owned() };
    assert_eq!(report.left_over, [left_over]);
    let json = serde_json::to_value(&report).unwrap();
    assert_eq!(json["missing"], serde_json::json!([{ "parameter": "d", "shape": [7] }]));
    assert_eq!(json["left-over"], serde_json::json!([{ "tensor": "c", "found": "float32 [1]" }]));
    assert_eq!(report.ignored, ["unneeded.x.y"]);
    let error = map.import(&file, &expected).unwrap_err().to_string();
    for part in ["b: expected [2, 2], found [4] (module.b)", "missing: d [7]", "left over: c float32 [1]"] {
        assert!(error.contains(part), "{error}");
    }
}

/// In any order, and more than once.
#[test]
fn roots_are_removed_as_long_as_one_matches() {
    let map = KeyMap::resolve("identity").unwrap();
    let file =
        stored(&[("_orig_mod.module.a", &[2]), ("module._orig_mod.module.b", &[3]), ("model.state_dict.c", &[1])]);
    let expected = [parameter("a", &[2]), parameter("b", &[3]), parameter("c", &[1])];
    let (found, report) = map.import(&file, &expected).unwrap();
    assert_eq!(found.tensors.keys().collect::<Vec<_>>(), ["a", "b", "c"], "{report}");
    let endless = KeyMap { roots: vec![String::new(), "x.".to_owned()], ..KeyMap::identity() };
    assert_eq!(endless.without_roots("x.x.y.x."), "y.x.", "an empty root ends");
}

/// Averaged weights next to the raw ones: which set was used is not a matter of chance.
#[test]
fn further_complete_sets_are_reported() {
    let map = KeyMap::resolve("identity").unwrap();
    let expected = [parameter("a", &[2, 3]), parameter("b.c", &[4])];
    let sets = |tensors: &[Named]| map.import(&stored(tensors), &expected).unwrap().1;
    let raw: [Named; 2] = [("model.a", &[2, 3]), ("model.b.c", &[4])];
    let averaged: [Named; 3] = [("ema.a", &[2, 3]), ("ema.b.c", &[4]), ("state.swa.b.c", &[4])];
    let file = [&raw[..], &averaged[..]].concat();
    let both = sets(&file);
    let found = OtherSets { used: "model.".to_owned(), others: vec!["ema.".to_owned()] };
    assert_eq!(both.other_sets, Some(found), "the third set lacks a");
    let text = both.to_string();
    let expected_text = "also contains a complete set under \"ema.\"; this import used \"model.\"; for another set, use a key \
                         map with its prefix: roots = [\"ema.\"]";
    assert!(text.ends_with(expected_text), "{text}");
    let others: [[Named; 2]; 3] = [
        [("ema.a", &[3, 2]), ("ema.b.c", &[4])],
        [("ema.a", &[2, 3]), ("ema.b", &[4])],
        [("ema-a", &[2, 3]), ("ema-b.c", &[4])],
    ];
    for other in others {
        assert_eq!(sets(&[raw, other].concat()).other_sets, None, "{other:?}");
    }
    let plain = sets(&[("ema.b.c", &[4]), ("b.c", &[4]), ("a", &[2, 3]), ("ema.a", &[2, 3])]);
    assert!(plain.to_string().contains("used names without a prefix; for another set, let `from`"), "{plain}");
    let ema = KeyMap { roots: vec!["ema.".to_owned()], ..KeyMap::identity() };
    let report = ema.import(&stored(&file), &expected).unwrap().1;
    assert_eq!(report.matched.first().map(|matched| matched.sources.clone()), Some(vec!["ema.a".to_owned()]));
}

#[test]
fn transposed_and_split_tensors_round_trip() {
    let map = KeyMap::from_toml(
        r#"
        name = "test"
        [[rules]]
        from = "*.kernel"
        to = "{1}.weight"
        transpose = true
        [[rules]]
        from = "*.kv"
        split = ["{1}.key", "{1}.value"]
        "#,
    )
    .unwrap();
    let file = stored(&[("fc.kernel", &[2, 3]), ("attn.kv", &[4, 2])]);
    let expected = [parameter("fc.weight", &[3, 2]), parameter("attn.key", &[2, 2]), parameter("attn.value", &[2, 2])];
    let (ours, report) = map.import(&file, &expected).unwrap();
    assert!(report.left_over.is_empty());
    assert_eq!(ours.tensors["fc.weight"].to_f32().unwrap()[1].to_bits(), 3f32.to_bits());
    assert_eq!(ours.tensors["attn.value"].to_f32().unwrap()[0].to_bits(), 4f32.to_bits());
    assert_eq!(map.export(&ours).unwrap().digest(), file.digest());
    let mut halved = ours.clone();
    halved.tensors.swap_remove("attn.value");
    assert!(map.export(&halved).is_err(), "half of a split cannot be exported");
    let unknown = stored(&[("other", &[1])]);
    assert!(map.export(&unknown).unwrap_err().to_string().contains("parameter other"));
}

/// Parameters have the order of the network, here key before value; and what a split gives is not exported under its own name too.
#[test]
fn targets_of_a_split_may_be_in_another_order_than_the_parameters() {
    let map = KeyMap::from_toml(
        r#"
        name = "test"
        [[rules]]
        from = "*.vk"
        split = ["{1}.value", "{1}.key"]
        [[rules]]
        from = "**"
        to = "{1}"
        "#,
    )
    .unwrap();
    let file = stored(&[("attn.vk", &[4, 2]), ("norm", &[3])]);
    let expected = [parameter("attn.key", &[2, 2]), parameter("norm", &[3]), parameter("attn.value", &[2, 2])];
    let (ours, _) = map.import(&file, &expected).unwrap();
    assert_eq!(ours.tensors["attn.key"].to_f32().unwrap()[0].to_bits(), 4f32.to_bits());
    let exported = map.export(&ours).unwrap();
    assert_eq!(exported.digest(), file.digest(), "{:?}", exported.tensors.keys());
    let mut halved = ours.clone();
    halved.tensors.swap_remove("attn.value");
    assert!(map.export(&halved).is_err(), "half of a split cannot be exported");
}

#[test]
fn inconsistent_parts_are_mismatches() {
    let map = KeyMap::from_toml(
        r#"
        name = "test"
        [[rules]]
        from = "q"
        to = "qk"
        part = [0, 2]
        [[rules]]
        from = "k"
        to = "qk"
        part = [1, 2]
        [[rules]]
        from = "third"
        to = "qk"
        part = [2, 3]
        [[rules]]
        from = "again*"
        to = "once{1}"
        "#,
    )
    .unwrap();
    let fault = |tensors: &[(&str, &[usize])], name: &str, shape: &[usize]| {
        let (found, report) = map.apply(&stored(tensors), &[parameter(name, shape)]);
        assert!(found.tensors.is_empty());
        report.mismatched.first().map(|mismatch| mismatch.found.clone()).unwrap_or_default()
    };
    assert_eq!(fault(&[("q", &[1, 2])], "qk", &[2, 2]), "1 of 2 parts");
    assert!(fault(&[("q", &[1, 2]), ("k", &[1, 3])], "qk", &[2, 2]).contains("parts of one type and width"));
    assert_eq!(fault(&[("q", &[1, 2]), ("third", &[1, 2])], "qk", &[2, 2]), "part 2 of 3, and parts of 2");
    let mut twice = stored(&[("again1", &[1])]);
    twice.tensors.insert("x.again1".to_owned(), twice.tensors["again1"].clone());
    let rooted = KeyMap { roots: vec!["x.".to_owned()], ..map.clone() };
    assert_eq!(rooted.apply(&twice, &[parameter("once1", &[1])]).1.mismatched[0].found, "two tensors");
    let mut infinite = StoredTensors::default();
    infinite.tensors.insert("again1".to_owned(), StoredTensor::from_f32(vec![2], &[f32::NAN, 1.0]).unwrap());
    let (_, report) = map.apply(&infinite, &[parameter("once1", &[2])]);
    assert_eq!(report.mismatched[0].found, "1 value that is not finite as f32");
}

/// A parameter of each kind, and two of one.
#[test]
fn mismatches_are_counted_by_reason() {
    let map = KeyMap::from_toml(
        r#"
        name = "test"
        [[rules]]
        from = "half"
        to = "parts"
        part = [0, 2]
        [[rules]]
        from = "turned*"
        to = "turned{1}"
        transpose = true
        [[rules]]
        from = "**"
        to = "{1}"
        "#,
    )
    .unwrap();
    let mut file = stored(&[("good", &[2]), ("shape", &[3]), ("turned1", &[2]), ("half", &[1])]);
    let infinite = StoredTensor::from_f32(vec![2], &[f32::INFINITY, f32::NAN]).unwrap();
    file.tensors.insert("infinite".to_owned(), infinite);
    let integers = StoredTensor::new(DType::I64, vec![2], SharedBytes::new(vec![0; 16])).unwrap();
    file.tensors.insert("integers".to_owned(), integers);
    let expected = ["good", "shape", "turned1", "infinite", "integers", "parts"].map(|name| parameter(name, &[2]));
    let error = map.import(&file, &expected).unwrap_err().to_string();
    let (_, report) = map.apply(&file, &expected);
    let reasons: Vec<_> =
        report.mismatched.iter().map(|mismatch| (mismatch.parameter.as_str(), mismatch.reason)).collect();
    let [shape, wrong_type, not_finite, parts] =
        [MismatchReason::Shape, MismatchReason::Type, MismatchReason::NotFinite, MismatchReason::Parts];
    let expected =
        [("shape", shape), ("turned1", shape), ("infinite", not_finite), ("integers", wrong_type), ("parts", parts)];
    assert_eq!(reasons, expected);
    assert_eq!(report.mismatches, MismatchCounts { shape: 2, r#type: 1, not_finite: 1, parts: 1 });
    assert!(report.missing.is_empty() && !report.is_complete());
    for part in [
        "0 missing, 2 of another shape, 1 of another type, 1 not finite, 1 with wrong parts, 0 tensors left over",
        "another shape: shape: expected [2], found [3] (shape)",
        "not finite: infinite: 2 values that are not finite as f32 (infinite)",
        "another type: integers: ",
        "expected floating-point elements, found int64 (integers)",
        "wrong parts: parts: 1 of 2 parts (half)",
    ] {
        assert!(error.contains(part), "{part}: {error}");
    }
    let json = serde_json::to_value(&report).unwrap();
    assert_eq!(json["mismatches"], serde_json::json!({"shape": 2, "type": 1, "not-finite": 1, "parts": 1}));
    assert_eq!(
        (&json["mismatched"][2]["reason"], &json["mismatched"][3]["reason"]),
        (&"not-finite".into(), &"type".into())
    );
}

/// New names that the import ignores, or shortens by a root.
#[test]
fn names_that_an_import_does_not_read_back_are_not_exported() {
    let map = |text: &str| KeyMap::from_toml(&format!("name = \"test\"\n{text}")).unwrap();
    let rules = "[[rules]]\nfrom = \"old.**\"\nto = \"new.{1}\"\n[[rules]]\nfrom = \"**\"\nto = \"{1}\"\n";
    let weights = stored(&[("new.a", &[2]), ("head.b", &[3]), ("head.c", &[4])]);
    for (settings, parameter, found) in [
        ("ignore = [\"head.**\"]\n", "head.b", "head.b, which `ignore` matches"),
        ("roots = [\"x.\", \"head.\"]\n", "head.b", "head.b, which `roots` shorten to b"),
        ("ignore = [\"old.*\"]\n", "new.a", "old.a, which `ignore` matches"),
    ] {
        let error = map(&[settings, rules].concat()).export(&weights).unwrap_err().to_string();
        let expected = "a name under which the import reads it back";
        let expected = format!("parameter {parameter}: expected {expected}, found {found}");
        assert!(error.contains(&expected), "{settings}: {error}");
    }
    let error = map("ignore = [\"head.c\"]").export(&weights).unwrap_err().to_string();
    assert!(error.contains("parameter head.c: "), "a map without rules: {error}");
    let mut only = weights.clone();
    only.tensors.retain(|name, _| name.starts_with("new."));
    let of_new = map(&["ignore = [\"head.**\"]\n", rules].concat()).export(&only).unwrap();
    assert_eq!(of_new.tensors.keys().collect::<Vec<_>>(), ["old.a"], "nothing that is exported is ignored");
}

#[test]
fn errors_of_malformed_maps_name_their_location() {
    for (text, expected) in [
        ("name = 3", "key map: line 1 column 8"),
        ("name = \"x\"\nrule = []", "line 2 column 1: expected"),
        ("name = \"x\"\n[[rules]]\nfrom = \"a\"", "rules[0]: expected an invertible rule, found neither"),
        ("name = \"x\"\n[[rules]]\nfrom = \"a*\"\nto = \"b\"", "{1} does not occur exactly once"),
        ("name = \"x\"\n[[rules]]\nfrom = \"a\"\nto = \"b\"\npart = [3, 3]", "part 3 of 3"),
        ("name = \"x\"\n[[rules]]\nfrom = \"a\"\nsplit = [\"b\"]", "a split into fewer than two"),
        ("name = \"x\"\nignore = [\"\"]", "ignore[0]"),
    ] {
        let error = KeyMap::from_toml(text).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
    let error = KeyMap::resolve("dinov3").unwrap_err().to_string();
    assert!(error.contains("dinov2-hugging-face"), "{error}");
}
