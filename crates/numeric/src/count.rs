/// A number of things, each of which is a `what`: `1 scene`, `2 scenes`, `3 entries`.
pub fn counted(count: u64, what: &str) -> String {
    format!("{count} {}", noun(count, what))
}

/// The word for so many of a `what`: `scene`, `scenes`, `entries`.
pub fn noun(count: u64, what: &str) -> String {
    match what.strip_suffix("ry") {
        _ if count == 1 => what.to_owned(),
        Some(stem) => format!("{stem}ries"),
        None => format!("{what}s"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_have_the_plural_of_their_noun() {
        assert_eq!([0, 1, 2].map(|count| counted(count, "scene")), ["0 scenes", "1 scene", "2 scenes"]);
        assert_eq!([0, 1, 2].map(|count| counted(count, "entry")), ["0 entries", "1 entry", "2 entries"]);
    }
}
