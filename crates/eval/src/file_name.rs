use std::fmt::Write as _;

use sha2::{Digest, Sha256};

use atsplat_files::hexadecimal;

/// Bytes beyond which a name is cut; most file systems take 255.
const LONGEST: usize = 120;
/// Hexadecimal digits that tell names apart whose text does not.
const TAIL: usize = 12;

/// The name of a file or folder for a text: readable, and never that of another text, on file systems that take `A` for
/// `a` or compose accents as well.
///
/// Bytes of ASCII other than letters, digits and `-_.+ ` become `%2F` and the like, as does a dot or space at either end.
/// Where a text has capital or foreign letters, or is long, `~` and a piece of its SHA-256 follow.
pub(crate) fn file_name(text: &str) -> String {
    let last = text.chars().count().saturating_sub(1);
    let mut name = String::with_capacity(text.len());
    let mut is_telling = true;
    for (at, letter) in text.chars().enumerate() {
        let at_end = at == 0 || at == last;
        let is_plain = letter.is_ascii_alphanumeric() || "-_+".contains(letter) || (!at_end && ". ".contains(letter));
        is_telling &= !letter.is_ascii_uppercase() && letter.is_ascii() && name.len() < LONGEST;
        if name.len() >= LONGEST {
            break;
        } else if is_plain || (!letter.is_ascii() && letter.is_alphanumeric()) {
            name.push(letter);
        } else {
            let mut bytes = [0; 4];
            for byte in letter.encode_utf8(&mut bytes).bytes() {
                write!(name, "%{byte:02X}").ok();
            }
        }
    }
    if !is_telling {
        name.push('~');
        name.extend(hexadecimal(&Sha256::digest(text)).chars().take(TAIL));
    }
    name
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn plain_names_stay_as_they_are() {
        for text in ["000c3ab189999a83", "wall-0", "my scene 2", "a_b", "v1.5", "nearest-view"] {
            assert_eq!(file_name(text), text);
        }
        assert_eq!(file_name("a/b"), "a%2Fb");
        assert_eq!(file_name(".."), "%2E%2E");
    }

    #[test]
    fn no_two_texts_share_a_file_and_none_leads_elsewhere() {
        let long = "x".repeat(300);
        let texts = [
            "a/b",
            "a_b",
            "a\\b",
            "a%2Fb",
            "a-b",
            "A_B",
            "a_B",
            "a%2fb",
            "Ab",
            "aB",
            "ab",
            "\u{e9}",
            "e\u{301}",
            "%C3%A9",
            "..",
            ".",
            "",
            " ",
            "a.",
            "a",
            "a ",
            "a:b",
            "ab~",
            &long,
            &long[1..],
            &long[..120],
            "aux/",
            "\0",
        ];
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
