//! Short forms of hashes.

/// The first 12 characters of a hash.
pub(crate) fn short(hash: &str) -> String {
    hash.chars().take(12).collect()
}

/// The first 12 characters of a commit, and the mark of uncommitted changes, if there is one; `sources+` and the hash of a build
/// without a commit.
pub(crate) fn short_commit(commit: &str) -> String {
    match commit.split_once('+') {
        Some((commit, changes)) => format!("{}+{changes}", short(commit)),
        None => short(commit),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_commit_is_shortened_before_its_mark() {
        let long = "0123456789abcdef0123456789abcdef01234567";
        assert_eq!(short_commit(long), "0123456789ab");
        assert_eq!(short_commit(&format!("{long}+76543210fedc")), "0123456789ab+76543210fedc");
        assert_eq!(short_commit("sources+0123456789abcdef"), "sources+0123456789abcdef");
    }
}
