//! Describes the fields in which two records differ.

use atsplat_files::shortened;
use serde::Serialize;
use serde_json::Value;

/// Number of fields that are listed; the rest is counted.
const MAX_FIELDS: usize = 4;
/// Number of characters of a value that are shown.
const MAX_LENGTH: usize = 72;
/// Fields that name an element of a list.
const NAMES: [&str; 2] = ["name", "id"];
/// The field with TOML text, which is compared field by field.
const TOML: &str = "toml";

/// A field that differs.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Difference {
    field: String,
    first: String,
    second: String,
}

/// `renderer.near: 0.01 and 0.2; seed: 0 and 7`: each differing field with the first and the second record's value; empty if
/// nothing differs.
pub fn differences<T: Serialize>(first: &T, second: &T) -> String {
    #[expect(clippy::expect_used, reason = "records are stored as JSON")]
    let [first, second] =
        [first, second].map(|record| serde_json::to_value(record).expect("a record is representable in JSON"));
    let mut found = Vec::new();
    compare(String::new(), &first, &second, &mut found);
    let more = found.len().saturating_sub(MAX_FIELDS);
    let listed = found.into_iter().take(MAX_FIELDS).map(|Difference { field, first, second }| {
        let field = if field.is_empty() { field } else { format!("{field}: ") };
        format!("{field}{first} and {second}")
    });
    let more = (more > 0).then(|| format!("{more} more fields"));
    listed.chain(more).collect::<Vec<_>>().join("; ")
}

fn compare(field: String, first: &Value, second: &Value, found: &mut Vec<Difference>) {
    match (first, second) {
        (first, second) if first == second => {}
        (Value::Object(a), Value::Object(b)) => {
            let names = a.keys().chain(b.keys().filter(|name| !a.contains_key(*name)));
            for name in names {
                let [first, second] = [a, b].map(|object| match object.get(name) {
                    Some(toml) if name == TOML => table(toml),
                    value => value.cloned().unwrap_or_default(),
                });
                compare(path_of(&field, name), &first, &second, found);
            }
        }
        (Value::Array(a), Value::Array(b)) if a.iter().chain(b).all(|item| name_of(item).is_some()) => {
            compare_named(&field, a, b, found);
        }
        (first, second) => {
            let [first, second] = excerpts([&text(first), &text(second)], MAX_LENGTH);
            found.push(Difference { field, first, second });
        }
    }
}

/// Compares two lists whose elements have names, whatever their order.
fn compare_named(field: &str, a: &[Value], b: &[Value], found: &mut Vec<Difference>) {
    let element = |list: &[Value], name: &str| list.iter().find(|item| name_of(item) == Some(name)).cloned();
    let mut seen: Vec<&str> = Vec::new();
    for name in a.iter().chain(b).filter_map(name_of) {
        if seen.contains(&name) {
            continue;
        }
        seen.push(name);
        let path = path_of(field, name);
        match (element(a, name), element(b, name)) {
            (Some(first), Some(second)) => compare(path, &first, &second, found),
            (first, second) => {
                let presence = |item: Option<Value>| if item.is_some() { "present" } else { "absent" }.to_owned();
                found.push(Difference { field: path, first: presence(first), second: presence(second) });
            }
        }
    }
}

/// Path of the field `name` of the record at `field`.
fn path_of(field: &str, name: &str) -> String {
    if field.is_empty() { name.to_owned() } else { format!("{field}.{name}") }
}

/// TOML text as a table; other values unchanged.
fn table(value: &Value) -> Value {
    let fields = value.as_str().and_then(|text| text.parse::<toml::Table>().ok());
    fields.and_then(|fields| serde_json::to_value(fields).ok()).unwrap_or_else(|| value.clone())
}

fn name_of(item: &Value) -> Option<&str> {
    NAMES.iter().find_map(|name| item.get(name)?.as_str())
}

fn text(value: &Value) -> String {
    match value {
        Value::Null => "none".to_owned(),
        Value::String(text) => text.clone(),
        other => other.to_string(),
    }
}

/// At most `characters` of two texts, with ellipses where some are missing. Long texts with the same beginning are shown from
/// shortly before their first difference.
pub fn excerpts(texts: [&str; 2], characters: usize) -> [String; 2] {
    let [first, second] = texts;
    let equal = first.chars().zip(second.chars()).take_while(|(a, b)| a == b).count();
    let is_long = texts.iter().any(|text| text.chars().nth(characters).is_some());
    // The difference itself needs room within the excerpt.
    let start = if is_long && equal > characters / 2 { equal - characters / 4 } else { 0 };
    texts.map(|text| {
        let before = if start > 0 { "…" } else { "" };
        let rest: String = text.chars().skip(start).collect();
        format!("{before}{}", shortened(&rest, characters))
    })
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn only_differing_fields_are_listed_by_path() {
        let first = json!({"name": "a", "same": 1, "deep": {"x": 1.5, "y": [1, 2]}, "gone": true});
        let second = json!({"name": "a", "same": 1, "deep": {"x": 1.5, "y": [2, 1]}, "new": "n"});
        assert_eq!(differences(&first, &second), "deep.y: [1,2] and [2,1]; gone: true and none; new: none and n");
        assert_eq!(differences(&first, &first), "");
        assert_eq!(differences(&1, &2), "1 and 2");
    }

    #[test]
    fn named_elements_and_toml_are_compared_field_by_field() {
        let first = json!([{"id": "psnr", "convention": "a"}, {"id": "ssim", "convention": "b"}]);
        let second = json!([{"id": "ssim", "convention": "c"}, {"id": "l1", "convention": "d"}]);
        assert_eq!(
            differences(&first, &second),
            "psnr: present and absent; ssim.convention: b and c; l1: absent and present"
        );
        let [first, second] = [1, 2].map(|far| json!({"toml": format!("[near-far]\nnear = 0\nfar = {far}")}));
        assert_eq!(differences(&first, &second), "toml.near-far.far: 1 and 2");
    }

    #[test]
    fn long_values_and_long_lists_are_truncated() {
        let many = |value: &str| -> Value {
            (0..9).map(|at| (format!("f{at}"), value.into())).collect::<serde_json::Map<_, _>>().into()
        };
        let text = differences(&many(&"x".repeat(500)), &many("y"));
        assert!(text.len() < 500 && text.contains("x… and y") && text.ends_with("; 5 more fields"), "{text}");
    }

    /// Without it, both would read the same.
    #[test]
    fn long_texts_are_shown_where_they_differ() {
        let of = |end: &str| json!({ "absent": format!("{}é; looked in {end}", "x".repeat(90)) });
        let found = differences(&of("/a"), &of("/home/b"));
        let [first, second] = ["/a", "/home/b"].map(|end| format!("…xxxxé; looked in {end}"));
        assert_eq!(found, format!("absent: {first} and {second}"));
        let tail = "y".repeat(100);
        let [first, second] = excerpts([&format!("{tail}1{tail}"), &format!("{tail}2{tail}")], 40);
        assert_eq!([first.chars().count(), second.chars().count()], [42, 42], "an ellipsis on either side");
        assert!(first.contains("y1y") && second.contains("y2y"), "{first} {second}");
        assert_eq!(excerpts(["ab", "ac"], 40), ["ab", "ac"]);
        assert_eq!(excerpts([&tail, &format!("{tail}z")], 8), ["…yy", "…yyz"]);
    }
}
