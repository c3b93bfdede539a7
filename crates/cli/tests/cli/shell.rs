//! Completions and manual pages name every command.

use std::process::Command;

fn printed(folder: &std::path::Path, args: &[&str]) -> String {
    let output = Command::new(env!("CARGO_BIN_EXE_atsplat")).args(args).current_dir(folder).output().unwrap();
    assert!(output.status.success(), "{args:?}");
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn completions_and_manual_pages_name_every_command() {
    let folder = tempfile::tempdir().unwrap();
    let help = printed(folder.path(), &["--help"]);
    let listed = help.lines().skip_while(|line| !line.starts_with("Commands:")).skip(1);
    let commands: Vec<&str> =
        listed.take_while(|line| !line.is_empty()).filter_map(|line| line.split_whitespace().next()).collect();
    assert!(commands.contains(&"reconstruct") && commands.contains(&"drift"), "{commands:?}");
    for shell in ["bash", "zsh", "fish"] {
        let script = printed(folder.path(), &["completions", shell]);
        for command in ["reconstruct", "reproduce", "tradeoff"] {
            assert!(script.contains(command), "{shell}: {command}");
        }
    }
    printed(folder.path(), &["man", "--out", "pages"]);
    let page = |name: &str| std::fs::read_to_string(folder.path().join("pages").join(name)).unwrap();
    assert!(page("atsplat-run.1").contains("shard"));
    let main = printed(folder.path(), &["man"]);
    assert!(main.contains("reproduce") && main.starts_with(".ie"), "{}", &main[..40]);
}
