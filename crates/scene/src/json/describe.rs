use serde_json::{Map, Value};

use crate::poses::is_list_of_poses;

/// Maximum number of keys listed.
const NAMED: usize = 6;

/// Common camera files that are not supported as datasets, by keys that identify them.
const KNOWN: [(&[&str], &str); 7] = [
    (&["camera_path", "render_height"], "a camera path of nerfstudio's viewer, which `atsplat render --cameras` reads"),
    (&["cameras", "shots"], "a reconstruction of OpenSfM"),
    (&["context", "target"], "an entry of an evaluation index, which --index takes"),
    (&["img_name", "position", "rotation"], "a camera of 3DGS' cameras.json"),
    (&["camera-from-world", "intrinsics"], "a view of the render.json that `atsplat render` writes"),
    (&["K", "W2C"], "a camera of NeRF++ (K and W2C)"),
    (&["views", "sfm_data_version"], "a scene of OpenMVG"),
];

/// Describes what an unsupported JSON file seems to contain, for an error message.
pub fn describe(value: &Value) -> String {
    match value {
        Value::Array(items) if is_list_of_poses(value) => {
            format!("a list of {} camera matrices without intrinsics, as in MotionCtrl's files", items.len())
        }
        Value::Array(items) => match items.first() {
            None => "an empty list".to_owned(),
            Some(first) => format!("a list of {}, the first of which is {}", items.len(), describe_part(first)),
        },
        Value::Object(fields) => describe_object(fields),
        other => format!("a bare {}", kind(other)),
    }
}

/// A value for an error message: its kind, or its text if that is short.
pub(crate) fn shown(value: &Value) -> String {
    match value {
        Value::Array(items) => format!("a list of {}", items.len()),
        Value::Object(_) => "an object".to_owned(),
        Value::String(text) if text.chars().count() > 40 => {
            format!("{:?}…", text.chars().take(40).collect::<String>())
        }
        other => other.to_string(),
    }
}

/// Describes an object, or, if it is a table by name, its first known value.
fn describe_object(fields: &Map<String, Value>) -> String {
    if let Some(known) = known(fields) {
        return known.to_owned();
    }
    let of_name = fields.iter().find_map(|(name, value)| Some((name, known(value_or_first(value)?)?)));
    match of_name {
        Some((name, known)) => format!("a table of {} entries, of which {name:.40?} is {known}", fields.len()),
        None => format!("an object with {}", keys(fields)),
    }
}

fn describe_part(value: &Value) -> String {
    match value {
        Value::Object(fields) => describe_object(fields),
        Value::Array(items) => match items.first() {
            Some(first) => format!("a list of {} that starts with a {}", items.len(), kind(first)),
            None => "an empty list".to_owned(),
        },
        other => format!("a {}", kind(other)),
    }
}

fn known(fields: &Map<String, Value>) -> Option<&'static str> {
    let has = |names: &[&str]| names.iter().all(|name| fields.contains_key(*name));
    KNOWN.iter().find(|(names, _)| has(names)).map(|(_, what)| *what)
}

/// latentSplat's indices have a list of entries instead of one.
fn value_or_first(value: &Value) -> Option<&Map<String, Value>> {
    value.as_object().or_else(|| value.as_array()?.first()?.as_object())
}

fn keys(fields: &Map<String, Value>) -> String {
    let named: Vec<String> = fields.keys().take(NAMED).map(|key| format!("{key:.40?}")).collect();
    match fields.len() {
        0 => "no keys".to_owned(),
        count if count > NAMED => format!("the keys {} and {} more", named.join(", "), count - NAMED),
        _ => format!("the keys {}", named.join(", ")),
    }
}

const fn kind(value: &Value) -> &'static str {
    match value {
        Value::Null => "null",
        Value::Bool(_) => "true or false",
        Value::Number(_) => "number",
        Value::String(_) => "text",
        Value::Array(_) => "list",
        Value::Object(_) => "object",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn describes_unsupported_files() {
        for (value, expected) in [
            (json!([]), "an empty list"),
            (json!(7), "a bare number"),
            (json!([[1, 2, 3]]), "a list of 1, the first of which is a list of 3 that starts with a number"),
            (json!([[1.0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]]), "a list of 1 camera matrices without intrinsics"),
            (json!({ "camera_path": [], "render_height": 9 }), "a camera path of nerfstudio's viewer"),
            (json!([{ "cameras": {}, "shots": {} }]), "a list of 1, the first of which is a reconstruction of OpenSfM"),
            (json!({ "0a": { "context": [1], "target": [2] } }), "\"0a\" is an entry of an evaluation index"),
            (
                json!({ "0a": null, "0b": [{ "context": [1], "target": [2] }] }),
                "a table of 2 entries, of which \"0b\" is an entry of an evaluation index, which --index takes",
            ),
            (json!({}), "an object with no keys"),
            (json!({ "fx": 1, "fy": 2 }), "an object with the keys \"fx\", \"fy\""),
            (json!({ "a": 1, "b": 1, "c": 1, "d": 1, "e": 1, "f": 1, "g": 1 }), "\"f\" and 1 more"),
        ] {
            let found = describe(&value);
            assert!(found.contains(expected), "{found}\ndoes not contain {expected}");
        }
    }
}
