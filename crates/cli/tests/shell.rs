//! Completions and manual pages name every command.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod common;

use common::atsplat;

#[test]
fn completions_and_manual_pages_name_every_command() {
    let folder = tempfile::tempdir().unwrap();
    let help = atsplat(folder.path(), &["--help"]).stdout;
    let listed = help.lines().skip_while(|line| !line.starts_with("Commands:")).skip(1);
    let commands: Vec<&str> =
        listed.take_while(|line| !line.is_empty()).filter_map(|line| line.split_whitespace().next()).collect();
    assert!(commands.contains(&"reconstruct") && commands.contains(&"drift"), "{commands:?}");
    for shell in ["bash", "zsh", "fish"] {
        let script = atsplat(folder.path(), &["completions", shell]).stdout;
        for command in ["reconstruct", "reproduce", "tradeoff"] {
            assert!(script.contains(command), "{shell}: {command}");
        }
    }
    let written = atsplat(folder.path(), &["man", "--out", "pages"]);
    assert_eq!(written.code, 0, "{}", written.stderr);
    let page = |name: &str| std::fs::read_to_string(folder.path().join("pages").join(name)).unwrap();
    assert!(page("atsplat-run.1").contains("shard"));
    let main = atsplat(folder.path(), &["man"]).stdout;
    assert!(main.contains("reproduce") && main.starts_with(".ie"), "{}", &main[..40]);
}
