use serde::Serialize;
use serde_json::Value;

use crate::shortened;

/// Fields that are listed; the others are counted.
const LISTED: usize = 4;
/// Characters of a value that are shown.
const SHOWN: usize = 40;

/// The fields in which a record has changed, by their paths: `steps: 8, now 12; rates.means: 0.1, now 0.2`; empty if none has.
/// Elements of lists are numbered from 0, and a field that one of the records lacks is `none`.
///
/// # Errors
/// If a record cannot be represented in JSON.
pub fn changes(recorded: &impl Serialize, now: &impl Serialize) -> serde_json::Result<String> {
    let mut found = Vec::new();
    compare("", &serde_json::to_value(recorded)?, &serde_json::to_value(now)?, &mut found);
    let more = found.len().saturating_sub(LISTED);
    found.truncate(LISTED);
    if more > 0 {
        found.push(format!("{more} more fields"));
    }
    Ok(found.join("; "))
}

fn compare(path: &str, recorded: &Value, now: &Value, found: &mut Vec<String>) {
    match (recorded, now) {
        (recorded, now) if recorded == now => {}
        (Value::Object(old), Value::Object(new)) => {
            for name in old.keys().chain(new.keys().filter(|name| !old.contains_key(*name))) {
                let path = if path.is_empty() { name.clone() } else { format!("{path}.{name}") };
                let [old, new] = [old, new].map(|record| record.get(name).unwrap_or(&Value::Null));
                compare(&path, old, new, found);
            }
        }
        (Value::Array(old), Value::Array(new)) if old.len() == new.len() => {
            for (at, (old, new)) in old.iter().zip(new).enumerate() {
                compare(&format!("{path}[{at}]"), old, new, found);
            }
        }
        (recorded, now) => found.push(format!("{path}: {}, now {}", shown(recorded), shown(now))),
    }
}

fn shown(value: &Value) -> String {
    let text = match value {
        Value::Null => "none".to_owned(),
        Value::String(text) => text.clone(),
        other => other.to_string(),
    };
    shortened(&text, SHOWN)
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn changed_fields_are_listed_by_their_paths() {
        let recorded = json!({"same": 1, "deep": {"x": 1.5, "list": [{"y": "a"}, 2]}, "gone": true, "longer": [1]});
        let now = json!({"same": 1, "deep": {"x": 1.5, "list": [{"y": "b"}, 2]}, "longer": [1, 2], "new": "n"});
        let expected = "deep.list[0].y: a, now b; gone: true, now none; longer: [1], now [1,2]; new: none, now n";
        assert_eq!(changes(&recorded, &now).unwrap(), expected);
        assert_eq!(changes(&now, &now).unwrap(), "");
    }

    #[test]
    fn long_values_and_further_fields_are_cut() {
        let of = |value: &str| json!([1, 2, 3, 4, 5, 6].map(|at| format!("{at}{value}")));
        let text = changes(&of(&"x".repeat(500)), &of("")).unwrap();
        assert!(text.starts_with(&format!("[0]: 1{}…, now 1; [1]", "x".repeat(39))), "{text}");
        assert!(text.ends_with("; 2 more fields"), "{text}");
    }
}
