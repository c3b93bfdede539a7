//! Short forms of hashes.

/// The first 12 characters of a hash.
pub(crate) fn short(hash: &str) -> String {
    hash.chars().take(12).collect()
}

/// The first 12 characters of a commit, and the mark of uncommitted changes, if there is one.
pub(crate) fn short_commit(commit: &str) -> String {
    let changes = commit.split_once('+').map_or_else(String::new, |(_, changes)| format!("+{changes}"));
    short(commit) + &changes
}
