//! Parses JSON and rejects repeated keys.
//!
//! The standard does not define which value of a repeated key counts (RFC 8259, section 4). Most parsers silently use
//! the last, so that one of two focal lengths in a file would be ignored.

mod describe;

use std::fmt;
use std::marker::PhantomData;

use atsplat_files::without_byte_order_mark;
use indexmap::IndexMap;
use indexmap::map::Entry;
use serde::de::{Deserialize, Deserializer, Error, MapAccess, SeqAccess, Visitor};
use serde_json::error::Category;
use serde_json::{Map, Number, Value};

pub use describe::describe;
pub(crate) use describe::shown;

const ONCE: &str = "each key once";

/// Characters that an error shows of a file that is not JSON.
const SHOWN: usize = 20;

/// Parses any JSON, after an optional byte order mark.
///
/// # Errors
/// For invalid JSON and for a repeated key in an object, with line and column.
pub fn parse(text: &[u8]) -> serde_json::Result<Value> {
    serde_json::from_slice(without_byte_order_mark(text)).map(|Unique(value)| value)
}

/// Whether text starts with this bracket, after an optional byte order mark and white space.
pub(crate) fn starts_with_bracket(text: &[u8], bracket: u8) -> bool {
    without_byte_order_mark(text).trim_ascii_start().first() == Some(&bracket)
}

/// Whether an object has one of these keys, in text that may be cut off. Keys of objects within it do not count.
pub(crate) fn has_key(text: &[u8], keys: &[&str]) -> bool {
    let is_one = |quoted| serde_json::from_slice::<String>(quoted).is_ok_and(|key| keys.contains(&key.as_str()));
    // Where the string that is being read starts, and the last whole string.
    let (mut start, mut last): (Option<usize>, &[u8]) = (None, &[]);
    let mut depth = 0usize;
    let mut bytes = text.iter().copied().enumerate();
    while let Some((at, byte)) = bytes.next() {
        match (start, byte) {
            (Some(_), b'\\') => {
                // An escaped quote does not end the string.
                bytes.next();
            }
            (Some(from), b'"') => (start, last) = (None, text.get(from..=at).unwrap_or_default()),
            (None, b'"') => start = Some(at),
            (None, b'{' | b'[') => depth += 1,
            (None, b'}' | b']') => depth = depth.saturating_sub(1),
            (None, b':') if depth == 1 && is_one(last) => return true,
            _ => {}
        }
    }
    false
}

/// Parses a JSON object with values of type `V`, in the file's order.
///
/// # Errors
/// Those of [`parse`], and for a value that is not a `V`.
pub(crate) fn parse_object<V: for<'de> Deserialize<'de>>(text: &[u8]) -> serde_json::Result<IndexMap<String, V>> {
    serde_json::from_slice(without_byte_order_mark(text)).map(|Object(entries)| entries)
}

/// The numbers that Python's `json` writes, although they are not JSON.
const NON_FINITE: [&str; 3] = ["NaN", "Infinity", "-Infinity"];

/// The text with [`NON_FINITE`] numbers as strings, which [`number_of_python`] reads; `None` if there are none.
pub(crate) fn with_non_finite_as_text(text: &[u8]) -> Option<Vec<u8>> {
    let (mut rest, mut quoted) = (text, Vec::with_capacity(text.len()));
    let (mut is_in_string, mut found) = (false, false);
    while let Some(byte) = rest.first() {
        let number = NON_FINITE.into_iter().find(|number| !is_in_string && rest.starts_with(number.as_bytes()));
        let taken = match number {
            Some(number) => number.len(),
            None if is_in_string && *byte == b'\\' => 2,
            None => 1,
        };
        is_in_string ^= *byte == b'"';
        found |= number.is_some();
        let (token, behind) = rest.split_at_checked(taken).unwrap_or((rest, &[]));
        let mark: &[u8] = if number.is_some() { b"\"" } else { b"" };
        quoted.extend([mark, token, mark].into_iter().flatten());
        rest = behind;
    }
    found.then_some(quoted)
}

/// A number that may not be finite: then [`with_non_finite_as_text`] made it text, or another program null.
pub(crate) fn number_of_python(value: &Value) -> Option<f64> {
    match value {
        Value::Null => Some(f64::NAN),
        Value::String(text) if NON_FINITE.contains(&text.as_str()) => text.parse().ok(),
        other => other.as_f64(),
    }
}

/// What was expected and found where `text` could not be parsed, for messages that state the place themselves. `value`
/// is what valid JSON should have been.
pub fn problem(text: &[u8], error: &serde_json::Error, value: &str) -> (String, String) {
    let message = error.to_string();
    let place = format!(" at line {} column {}", error.line(), error.column());
    let message = message.strip_suffix(&place).unwrap_or(&message);
    match error.classify() {
        Category::Eof => ("complete JSON".to_owned(), "the end of the file: it is cut off".to_owned()),
        Category::Data => match message.strip_prefix(&format!("expected {ONCE}, found ")) {
            Some(repeated) => (ONCE.to_owned(), repeated.to_owned()),
            None => (value.to_owned(), message.to_owned()),
        },
        Category::Syntax | Category::Io => {
            let line = text.split(|byte| *byte == b'\n').nth(error.line().saturating_sub(1)).unwrap_or_default();
            let rest = line.get(error.column().saturating_sub(1)..).unwrap_or_default();
            let shown: String = String::from_utf8_lossy(rest).chars().take(SHOWN).collect();
            ("JSON".to_owned(), format!("{shown:?} ({message})"))
        }
    }
}

struct Unique(Value);

struct Object<V>(IndexMap<String, V>);

impl<'de> Deserialize<'de> for Unique {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(AnyValue)
    }
}

impl<'de, V: Deserialize<'de>> Deserialize<'de> for Object<V> {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_map(AnyObject(PhantomData))
    }
}

struct AnyValue;

impl<'de> Visitor<'de> for AnyValue {
    type Value = Unique;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("JSON")
    }

    fn visit_unit<E>(self) -> Result<Unique, E> {
        Ok(Unique(Value::Null))
    }

    fn visit_bool<E>(self, value: bool) -> Result<Unique, E> {
        Ok(Unique(Value::Bool(value)))
    }

    fn visit_i64<E>(self, value: i64) -> Result<Unique, E> {
        Ok(Unique(value.into()))
    }

    fn visit_u64<E>(self, value: u64) -> Result<Unique, E> {
        Ok(Unique(value.into()))
    }

    fn visit_f64<E: Error>(self, value: f64) -> Result<Unique, E> {
        let number = Number::from_f64(value).ok_or_else(|| E::custom("a number that is not finite"))?;
        Ok(Unique(Value::Number(number)))
    }

    fn visit_str<E>(self, value: &str) -> Result<Unique, E> {
        Ok(Unique(value.into()))
    }

    fn visit_string<E>(self, value: String) -> Result<Unique, E> {
        Ok(Unique(value.into()))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Unique, A::Error> {
        let mut list = Vec::new();
        while let Some(Unique(item)) = items.next_element()? {
            list.push(item);
        }
        Ok(Unique(Value::Array(list)))
    }

    fn visit_map<A: MapAccess<'de>>(self, entries: A) -> Result<Unique, A::Error> {
        let Object(entries) = AnyObject(PhantomData).visit_map(entries)?;
        let entries: Map<String, Value> = entries.into_iter().map(|(key, Unique(value))| (key, value)).collect();
        Ok(Unique(Value::Object(entries)))
    }
}

struct AnyObject<V>(PhantomData<V>);

impl<'de, V: Deserialize<'de>> Visitor<'de> for AnyObject<V> {
    type Value = Object<V>;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an object")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut access: A) -> Result<Object<V>, A::Error> {
        let mut entries = IndexMap::new();
        while let Some(key) = access.next_key::<String>()? {
            match entries.entry(key) {
                Entry::Occupied(entry) => {
                    let key: String = entry.key().chars().take(80).collect();
                    return Err(A::Error::custom(format_args!("expected {ONCE}, found {key:?} a second time")));
                }
                Entry::Vacant(entry) => entry.insert(access.next_value()?),
            };
        }
        Ok(Object(entries))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn repeated_keys_are_errors_at_any_depth() {
        for (text, line) in [
            (r#"{"a": 1, "a": 1}"#, 1),
            ("{\"frames\": [\n{\"w\": 1},\n{\"w\": 1, \"h\": 2,\n\"w\": 3}]}", 4),
            ("{\"\\u0061\": 1,\n\"a\": 2}", 2),
        ] {
            let error = parse(text.as_bytes()).unwrap_err();
            assert!(error.to_string().contains("a second time") && error.line() == line, "{text}: {error}");
        }
        assert!(parse_object::<u32>(br#"{"b": 1, "a": 2, "b": 1}"#).unwrap_err().to_string().contains("\"b\""));
    }

    #[test]
    fn a_byte_order_mark_is_no_part_of_the_text() {
        let text = "\u{feff}{\"a\": 1}";
        assert_eq!(parse(text.as_bytes()).unwrap()["a"], 1);
        assert_eq!(parse_object::<u32>(text.as_bytes()).unwrap()["a"], 1);
    }

    #[test]
    fn problems_are_told_apart() {
        for (text, expected, found) in [
            ("", "complete JSON", "the end of the file: it is cut off"),
            ("{\"a\": [1, 2", "complete JSON", "the end of the file: it is cut off"),
            ("{\n\"a\": [1, NaN, 2]}", "JSON", "\"NaN, 2]}\" (expected value)"),
            ("{\"a\": 1,\n \"a\": 2}", "each key once", "\"a\" a second time"),
            ("[1]", "a table", "invalid type: sequence, expected an object"),
        ] {
            let error = parse_object::<Unique>(text.as_bytes()).err().unwrap();
            assert_eq!(problem(text.as_bytes(), &error, "a table"), (expected.to_owned(), found.to_owned()), "{text}");
        }
    }

    #[test]
    fn numbers_that_python_writes_are_read_outside_of_strings() {
        let text = r#"{"NaN": [NaN,-Infinity, 1.5], "a\"NaN": "Infinity\\", "b": Infinity}"#;
        let quoted = with_non_finite_as_text(text.as_bytes()).unwrap();
        let value = parse(&quoted).unwrap();
        let [nan, low, finite] = [0, 1, 2].map(|at: usize| number_of_python(&value["NaN"][at]).unwrap());
        assert!(nan.is_nan() && low.is_infinite() && low < 0.0 && finite.is_finite());
        assert_eq!((&value["a\"NaN"], &value["b"]), (&Value::from("Infinity\\"), &Value::from("Infinity")));
        assert!(number_of_python(&Value::Null).unwrap().is_nan() && number_of_python(&Value::from("nan")).is_none());
        for finite in ["", "{\"a\": 1", r#"["NaN", "\\\"Infinity"]"#, "\"\\"] {
            assert_eq!(with_non_finite_as_text(finite.as_bytes()), None, "{finite}");
        }
    }

    #[test]
    fn keys_of_an_object_are_found_in_text_that_is_cut_off() {
        let has = |text: &str| has_key(text.as_bytes(), &["w", "frames"]);
        for text in [
            r#"{"frames": ["#,
            "\u{feff} {\n\"a\": {\"b\": [1, {}]}, \"frames\" :[",
            r#"{"a\\": "\"", "w": 1"#,
            r#"{"fr\u0061mes": [NaN]}"#,
            r#"{"a": [NaN, "}"], "w": "#,
        ] {
            assert!(has(text), "{text}");
        }
        for text in [
            "",
            r#"{"frames"#,
            r#"{"frames""#,
            r#"{"a": {"frames": []}}"#,
            r#"[{"frames": []}]"#,
            r#"{"a": "frames", "b": ["w"]}"#,
            r#"{"a": "\"frames\": []"}"#,
            r#"{"test_frames": [], "W": 1}"#,
        ] {
            assert!(!has(text), "{text}");
        }
    }

    #[test]
    fn one_key_in_two_objects_is_not_repeated() {
        parse(br#"{"a": {"a": 1}, "b": [{"a": 1}, {"a": 2}]}"#).unwrap();
        let ordered = parse_object::<u32>(br#"{"b": 1, "a": 2}"#).unwrap();
        assert_eq!(ordered.keys().collect::<Vec<_>>(), ["b", "a"]);
    }

    fn json() -> impl Strategy<Value = Value> {
        let leaf = prop_oneof![
            Just(Value::Null),
            any::<bool>().prop_map(Value::from),
            any::<i64>().prop_map(Value::from),
            any::<u64>().prop_map(Value::from),
            (-1e300..1e300f64).prop_map(Value::from),
            ".{0,8}".prop_map(Value::from),
        ];
        leaf.prop_recursive(4, 32, 4, |inner| {
            prop_oneof![
                prop::collection::vec(inner.clone(), 0..4).prop_map(Value::from),
                prop::collection::btree_map(".{0,3}", inner, 0..4).prop_map(|map| map.into_iter().collect()),
            ]
        })
    }

    proptest! {
        #[test]
        fn other_json_parses_as_with_serde_json(value in json()) {
            let text = value.to_string();
            prop_assert_eq!(parse(text.as_bytes()).unwrap(), serde_json::from_str::<Value>(&text).unwrap());
        }
    }
}
