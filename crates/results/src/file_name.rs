use std::fmt::Write as _;

use atsplat_files::Sha256Digest;

/// Names are truncated to this many bytes; most file systems allow 255.
const MAX_BYTES: usize = 120;
/// Hexadecimal digits of the hash that is appended to ambiguous names.
const HASH_DIGITS: usize = 12;

/// A readable file or folder name that is unique to a text, also on file systems that ignore case or normalise accents.
///
/// ASCII bytes other than letters, digits and `-_.+ ` are percent-encoded (`%2F`), as is a dot or space at either end. For a
/// text with capital or non-ASCII letters, or a long one, `~` and the first digits of its SHA-256 are appended.
pub fn file_name(text: &str) -> String {
    let last = text.chars().count().saturating_sub(1);
    let mut name = String::with_capacity(text.len());
    let mut is_unambiguous = true;
    for (at, letter) in text.chars().enumerate() {
        let at_end = at == 0 || at == last;
        let is_plain = letter.is_ascii_alphanumeric() || "-_+".contains(letter) || (!at_end && ". ".contains(letter));
        is_unambiguous &= !letter.is_ascii_uppercase() && letter.is_ascii() && name.len() < MAX_BYTES;
        if name.len() >= MAX_BYTES {
            break;
        } else if is_plain || (!letter.is_ascii() && letter.is_alphanumeric()) {
            name.push(letter);
        } else {
            let mut bytes = [0; 4];
            for byte in letter.encode_utf8(&mut bytes).bytes() {
                // Writing to a string cannot fail.
                write!(name, "%{byte:02X}").ok();
            }
        }
    }
    if !is_unambiguous {
        name.push('~');
        name.extend(Sha256Digest::of(text.as_bytes()).to_string().chars().take(HASH_DIGITS));
    }
    name
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn plain_names_are_unchanged() {
        for text in ["000c3ab189999a83", "wall-0", "my scene 2", "a_b", "v1.5", "nearest-view"] {
            assert_eq!(file_name(text), text);
        }
        assert_eq!(file_name("a/b"), "a%2Fb");
        assert_eq!(file_name(".."), "%2E%2E");
    }

    #[test]
    fn names_are_unique_and_stay_inside_the_folder() {
        let long = "x".repeat(300);
        let ambiguous = "a/b|a_b|a\\b|a%2Fb|a-b|A_B|a_B|a%2fb|Ab|aB|ab|a.|a|a |a:b|ab~";
        let special = "\u{e9}|e\u{301}|%C3%A9|..|.|| |aux/|\0";
        let texts = ambiguous.split('|').chain(special.split('|')).chain([&long, &long[1..], &long[..120]]);
        let texts: Vec<&str> = texts.collect();
        let names: BTreeSet<String> = texts.iter().map(|text| file_name(text).to_lowercase()).collect();
        assert_eq!(names.len(), texts.len(), "{names:?}");
        for name in names {
            assert!(
                name.len() <= 255 && !name.contains(['/', '\\', ':', '\0']) && !name.ends_with(['.', ' ']),
                "{name:?}"
            );
        }
    }
}
