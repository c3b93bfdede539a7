/// A name that is valid on every file system.
pub(crate) fn plain(text: &str) -> String {
    text.chars()
        .map(|letter| if letter.is_ascii_alphanumeric() || ".-_".contains(letter) { letter } else { '-' })
        .collect()
}

/// The name, with a number if it is taken: two files of one name would overwrite each other.
pub(crate) fn unused(name: &str, is_taken: impl Fn(&str) -> bool) -> String {
    let mut number = 2;
    let mut candidate = name.to_owned();
    while is_taken(&candidate) {
        candidate = format!("{name}-{number}");
        number += 1;
    }
    candidate
}
