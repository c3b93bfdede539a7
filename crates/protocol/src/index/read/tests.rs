use proptest::prelude::*;

use super::*;
use crate::IndexFile;

fn message(json: &str) -> String {
    IndexFile::parse(json.as_bytes()).unwrap_err().to_string()
}

#[test]
fn reads_null_objects_and_lists() {
    let file = IndexFile::parse(
        br#"{"a": null, "b": {"target": [4], "context": [1, 5]},
             "c": [{"context": [0], "target": [1]}, {"context": [2], "target": [3]}], "d": []}"#,
    )
    .unwrap();
    let counts: Vec<_> = file.index.scenes.values().map(Vec::len).collect();
    assert_eq!(counts, [0, 1, 2, 0]);
    let entry = IndexEntry { context: vec![1, 5], target: vec![4], overlap: None };
    assert_eq!(file.index.scenes["b"], [entry]);
    assert_eq!(file.layout, IndexLayout::PIXELSPLAT, "the first of each form decides");
}

#[test]
fn errors_for_frame_numbers_name_scene_field_and_element() {
    for (number, found) in [
        ("-3", "integer `-3`"),
        ("1.5", "floating point `1.5`"),
        ("2.0", "floating point `2.0`"),
        ("10000000", "integer `10000000`"),
        ("18446744073709551615", "integer `18446744073709551615`"),
        ("99999999999999999999", "floating point `1e+20`"),
        ("1e400", "\"0]}}\" (number out of range)"),
        ("\"7\"", "string \"7\""),
        ("null", "null"),
        ("[1]", "sequence"),
    ] {
        let json = format!("{{\n\"k\": {{\"context\": [1, 2], \"target\": [3, {number}]}}}}");
        let message = message(&json);
        assert!(
            message.starts_with("evaluation index: scene \"k\", field target, element 1, line 2 column "),
            "{message}"
        );
        assert!(message.ends_with(&format!(", found {found}")), "{message}");
    }
}

#[test]
fn reads_the_estimator_of_an_overlap() {
    let json = |more: &str| format!(r#"{{"k": {{"context": [1, 2], "target": [3]{more}}}}}"#);
    let overlap = |more: &str| {
        let index = IndexFile::parse(json(more).as_bytes()).unwrap().index;
        (index.scenes["k"][0].overlap.clone(), index.overlap_estimators())
    };
    let measured = Overlap { value: 0.5, estimator: Some("epipolar-ray".to_owned()) };
    let recorded = r#", "overlap_estimator": "epipolar-ray", "overlap": 0.5"#;
    assert_eq!(overlap(recorded), (Some(measured), vec!["epipolar-ray".to_owned()]));
    assert_eq!(overlap(r#", "overlap": 0.5"#), (Some(0.5.into()), Vec::new()));
    let alone = message(&json(r#", "overlap_estimator": "epipolar-ray""#));
    assert!(
        alone.contains("scene \"k\", field overlap_estimator") && alone.contains("expected the field overlap too"),
        "{alone}"
    );
}

#[test]
fn errors_name_the_location_and_what_was_expected_and_found() {
    for (json, expected) in [
        (
            r#"{"k": [{"context": [1], "target": [2]}, {"context": [1]}]}"#,
            r#"scene "k", entry 1, line 1 column 56: expected the field target, found an entry without it"#,
        ),
        (r#"{"k": {"context": [1], "context": [2]}}"#, ": expected the field context once, found it twice"),
        (r#"{"k": 7}"#, "expected null, an entry or a list of entries, found integer `7`"),
        (r#"{"k": [null]}"#, "expected an entry with the fields context and target, found null"),
        ("[]", ": expected an object from scene keys to entries, found sequence"),
        (r#"{"k": {"context": 3, "target": []}}"#, ": expected a list of frame numbers, found integer `3`"),
        (r#"{"k": null"#, "expected JSON, found EOF while parsing an object"),
        (r#"{"k": null} x"#, r#"expected JSON, found "x" (trailing characters)"#),
        ("\u{feff}{}", "line 1 column 1: expected JSON that does not begin with a byte order mark"),
        ("", "found EOF while parsing a value"),
        (
            r#"{"k": {"context": [], "target": [], "overlap": 1.2}}"#,
            ": expected a number from 0 to 1, null, or one of small medium large ignore, found floating point `1.2`",
        ),
        (
            r#"{"k": {"context": [], "target": [], "overlap": NaN}}"#,
            r#"field overlap, line 1 column 48: expected JSON, found "NaN}}" (expected value)"#,
        ),
        (r#"{"k": {"context": [], "target": [], "overlap": "0.4"}}"#, r#"found string "0.4""#),
    ] {
        let message = message(json);
        assert!(message.contains(expected), "{json}: {message}");
    }
}

#[test]
fn reads_overlap_words_as_noposplat_does() {
    let json = r#"{"a": {"context": [], "target": [], "overlap": "large"},
        "b": {"context": [], "target": [], "overlap": "medium"},
        "c": {"context": [], "target": [], "overlap": null},
        "d": {"context": [], "target": [], "overlap": 1}}"#;
    let file = IndexFile::parse(json.as_bytes()).unwrap();
    let overlaps: Vec<_> = file.index.entries().map(|(_, _, entry)| entry.overlap.clone()).collect();
    let expected = [Some(OVERLAP_OF_LARGE), Some(OVERLAP_OF_OTHER_WORDS), None, Some(1.0)];
    assert_eq!(overlaps, expected.map(|value| value.map(Overlap::from)));
    assert_eq!(file.notices.overlap_words, 2);
    let mismatch = file.notices.overlap_words_mismatch().unwrap();
    assert_eq!((mismatch.count, mismatch.example.as_str()), (2, "the first is \"large\", read as 0.75"));
    let ignored = IndexFile::parse(br#"{"a": {"context": [], "target": [], "overlap": "ignore"}}"#).unwrap();
    let mismatch = ignored.notices.overlap_words_mismatch().unwrap();
    assert_eq!((mismatch.count, mismatch.example.as_str()), (1, "the first is \"ignore\", read as 0.25"));
    assert_eq!(IndexFile::parse(b"{}").unwrap().notices.overlap_words_mismatch(), None);
}

/// The first entries of `MVSplat360`'s `re10k_inter_14_target_views_match.json` and of pixelSplat's index, shortened.
#[test]
fn scored_targets_are_those_that_mvsplat360_scores() {
    let rendered = br#"{"5aca87f95a9412c6":
        {"context": [58, 133], "target": [58, 63, 84, 102, 118, 129], "target_quantify": [84, 102, 129]},
        "e74ceac9043aa1b8": null, "whole": {"context": [1, 9], "target": [2, 3], "target_quantify": null}}"#;
    let scored = br#"{"5aca87f95a9412c6": {"context": [58, 133], "target": [84, 102, 129]}, "e74ceac9043aa1b8": null,
        "whole": {"context": [1, 9], "target": [2, 3]}}"#;
    let [rendered, scored] = [&rendered[..], &scored[..]].map(|json| IndexFile::parse(json).unwrap());
    assert_eq!(rendered.index, scored.index);
    assert_eq!(rendered.index.content_hash(), scored.index.content_hash(), "it is recognised as the published index");
    assert_eq!((rendered.notices.unscored_targets, rendered.notices.unknown_fields.len()), (3, 0));
    let mismatch = rendered.notices.unscored_targets_mismatch().unwrap();
    assert_eq!((mismatch.count, mismatch.kind.as_str()), (3, "frames of the field target that are no targets"));
    assert_eq!(scored.notices.unscored_targets_mismatch(), None);
    let other = message(r#"{"k": {"context": [1, 9], "target": [2, 3], "target_quantify": [3, 4]}}"#);
    assert!(other.contains("scene \"k\", field target_quantify, line 1 column "), "{other}");
    assert!(other.ends_with(": expected frames of the field target, found frame 4, which is no target"), "{other}");
}

/// NoPoSplat's index of `ScanNet++` has -1.0 in each entry.
#[test]
fn an_overlap_that_was_not_measured_is_none() {
    let json = r#"{"be2e10f16a_iphone": {"context": [184, 192], "target": [184, 187, 190], "overlap": -1.0},
        "b": {"context": [0, 9], "target": [3], "overlap": -1}, "c": {"context": [0, 9], "target": [3], "overlap": 1}}"#;
    let file = IndexFile::parse(json.as_bytes()).unwrap();
    let overlaps: Vec<_> = file.index.entries().map(|(_, _, entry)| entry.overlap.clone()).collect();
    assert_eq!(overlaps, [None, None, Some(Overlap::from(1.0))]);
    assert_eq!((file.notices.unmeasured_overlaps, file.notices.overlap_words), (2, 0));
    for value in ["-0.5", "-1.5", "-2"] {
        let message = message(&format!(r#"{{"k": {{"context": [], "target": [], "overlap": {value}}}}}"#));
        assert!(message.contains("expected a number from 0 to 1"), "{message}");
    }
}

#[test]
fn counts_unknown_fields_and_resolves_duplicate_keys_as_python_does() {
    let json = r#"{"a": {"context": [1], "target": [], "note": [[{}]], "z": 1},
        "b": null, "a": {"context": [2], "target": [], "note": 1}}"#;
    let file = IndexFile::parse(json.as_bytes()).unwrap();
    assert_eq!(file.notices.duplicate_keys, ["a"]);
    assert_eq!(file.notices.unknown_fields, [("note".to_owned(), 2), ("z".to_owned(), 1)].into());
    assert_eq!(file.index.scenes.keys().collect::<Vec<_>>(), ["a", "b"], "the first position is kept");
    assert_eq!(file.index.scenes["a"][0].context, [2], "the last value wins");
    let strict = EvaluationIndex::from_json(json.as_bytes()).unwrap_err().to_string();
    assert_eq!(strict, "evaluation index: scene \"a\": expected every scene key once, found it again");
}

#[test]
fn deep_nesting_and_long_keys_give_short_errors() {
    let deep = format!("{{\"k\": {}", "[".repeat(100_000));
    assert!(message(&deep).contains("expected"), "nested entries");
    let ignored = format!(r#"{{"k": {{"context": [], "target": [], "x": {}}}}}"#, "[".repeat(100_000));
    assert!(IndexFile::parse(ignored.as_bytes()).is_err(), "nested unknown field, unclosed");
    let long = format!(r#"{{"{}": 1}}"#, "é".repeat(10_000));
    assert!(message(&long).len() < 400, "long keys are shortened");
}

proptest! {
    #[test]
    fn any_bytes_give_a_value_or_an_error(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
        IndexFile::parse(&bytes).ok();
    }

    #[test]
    fn mutated_json_gives_a_value_or_an_error(at in 0usize..120, byte in any::<u8>(), cut in 0usize..120) {
        let mut json = br#"{"a": null, "b": [{"context": [1, 20], "target": [3], "overlap": 0.5}], "c": {"context": [], "target": []}}"#.to_vec();
        if let Some(place) = json.get_mut(at) {
            *place = byte;
        }
        json.truncate(json.len().saturating_sub(cut % 7));
        IndexFile::parse(&json).ok();
    }
}
