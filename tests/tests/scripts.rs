//! The scripts of CI, of reports and of experiments decide rightly, on programs that stand in for the real ones, and name what exists.

#![cfg(target_os = "linux")]
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::collections::BTreeSet;
use std::fs;
use std::os::unix::fs::symlink;
use std::path::{Path, PathBuf};
use std::process::Command;

fn file(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(path)
}

/// A folder with stand-ins for these programs, in `bin/`.
struct Stage(tempfile::TempDir);

impl Stage {
    fn new(programs: &[&str]) -> Self {
        let stage = Self(tempfile::tempdir().unwrap());
        fs::create_dir(stage.path("bin")).unwrap();
        for name in programs {
            symlink(fs::canonicalize(file("tests/tests/fixtures/stand_in")).unwrap(), stage.path("bin").join(name))
                .unwrap();
        }
        stage
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn write(&self, name: &str, text: &str) {
        fs::create_dir_all(self.path(name).parent().unwrap()).unwrap();
        fs::write(self.path(name), text).unwrap();
    }

    /// Runs a script here, with stand-ins on the path that each do `does`. Returns whether it succeeded, and the calls.
    fn run(&self, script: &Path, args: &[&str], does: &str) -> (bool, Vec<String>) {
        let calls = self.path("calls");
        fs::write(&calls, "").unwrap();
        let path = format!("{}:{}", self.path("bin").display(), std::env::var("PATH").unwrap());
        let mut command = Command::new("bash");
        command.arg(script).args(args).current_dir(self.0.path());
        command.env("PATH", path).env("CALLS", &calls).env("DO", does);
        let succeeded = command.output().unwrap().status.success();
        (succeeded, fs::read_to_string(calls).unwrap().lines().map(str::to_owned).collect())
    }
}

/// Whether `.ci/skips` accepts a log, and what it prints.
fn skips(log: &str, data_is_required: &str) -> (bool, String) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("log");
    fs::write(&path, log).unwrap();
    let mut command = Command::new("bash");
    command.arg(file(".ci/skips")).arg(path).env("ATSPLAT_REQUIRE_SHARED_DATA", data_is_required);
    let output = command.output().unwrap();
    (output.status.success(), String::from_utf8(output.stdout).unwrap())
}

#[test]
fn tests_without_real_data_are_counted_and_other_skips_must_be_expected() {
    let data = "SKIPPED second: no real data (/a: b)\n\
                SKIPPED first: no real data (/a)\n\
                SKIPPED first: no real data (/a)\n";
    let others = "SKIPPED opengl_is_within_the_bound: ATSPLAT_TEST_OPENGL is not 1\n\
                  SKIPPED test_torch.py: could not import 'torch': No module named 'torch'\n";
    for not_required in ["", "0"] {
        let (accepted, text) = skips(&format!("{data}{others}"), not_required);
        assert!(accepted && text.starts_with("SKIPPED first: no real data (/a)\n"), "{text}");
        assert!(text.ends_with("2 tests are skipped for want of real data\n"), "{text}");
    }
    assert_eq!(skips(others, "1"), (true, others.to_owned()));
    let (accepted, text) = skips(data, "1");
    assert!(!accepted && text.contains("NOT EXPECTED: SKIPPED second: no real data (/a: b)\n"), "{text}");
    for line in [
        "SKIPPED opengl: a part of a name",
        "SKIPPED opengl_is_within_the_bound_too: another name",
        "SKIPPED splat::gpu: no graphics adapter: none",
        "SKIPPED third: it says no real data (at its end)",
    ] {
        assert_eq!(skips(line, ""), (false, format!("NOT EXPECTED: {line}\n")));
    }
}

/// `.ci/run` leaves them out where it checks what features change.
#[test]
fn packages_that_features_do_not_change_use_no_others() {
    let script = fs::read_to_string(file(".ci/run")).unwrap();
    let list = script.lines().find_map(|line| line.strip_prefix("without_features=(")?.strip_suffix(')')).unwrap();
    let listed: BTreeSet<&str> = list.split(' ').collect();
    for name in &listed {
        let manifest = fs::read_to_string(file(&format!("crates/{name}/Cargo.toml"))).unwrap();
        let manifest: toml::Table = toml::from_str(&manifest).unwrap();
        let keys =
            |table: &str| manifest.get(table).and_then(toml::Value::as_table).into_iter().flat_map(toml::Table::keys);
        let used =
            keys("dependencies").chain(keys("dev-dependencies")).filter_map(|name| name.strip_prefix("atsplat-"));
        let others: Vec<&str> = used.filter(|used| !listed.contains(used) && *used != "tests").collect();
        assert!(others.is_empty(), "{name} uses {others:?}");
        // What is on by default is on everywhere.
        let of_default = manifest.get("features").and_then(|features| features.get("default")?.as_array());
        let is_on = |feature: &str| of_default.is_some_and(|on| on.iter().any(|on| on.as_str() == Some(feature)));
        let to_choose: Vec<&String> = keys("features").filter(|name| *name != "default" && !is_on(name)).collect();
        assert!(to_choose.is_empty(), "{name} has the features {to_choose:?}");
    }
}

/// The workspace's test programs: files of a package's `tests/`, and folders there with a `main.rs`.
fn test_programs() -> Vec<PathBuf> {
    let crates = fs::read_dir(file("crates")).unwrap().map(|entry| entry.unwrap().path());
    let folders = crates.chain([file("tests")]).map(|package| package.join("tests"));
    let entries = folders.filter_map(|folder| fs::read_dir(folder).ok()).flatten().map(|entry| entry.unwrap().path());
    let is_program =
        |path: &PathBuf| path.extension().is_some_and(|extension| extension == "rs") || path.join("main.rs").is_file();
    entries.filter(is_program).collect()
}

/// Cargo refuses the name of a program that does not exist, but runs no test of a module that does not, and succeeds.
#[test]
fn commands_name_tests_that_exist() {
    let programs = test_programs();
    let mut named = BTreeSet::new();
    for source in ["justfile", ".ci/run", "CONTRIBUTING.md", "crates/rooms/benches/README.md"] {
        let text = fs::read_to_string(file(source)).unwrap().replace("\\\n", " ").replace("just test-file", "--test");
        for line in text.lines() {
            let words: Vec<&str> = line.split_whitespace().map(|word| word.trim_matches(['`', '.', ','])).collect();
            let after_flag = words.windows(2).filter(|pair| pair[0] == "--test").map(|pair| pair[1]);
            // Others stand for a name.
            let is_name = |word: &&str| word.chars().all(|c| c.is_ascii_lowercase() || c == '_');
            let mut of_line = Vec::new();
            for name in after_flag.filter(is_name) {
                let found: Vec<&PathBuf> =
                    programs.iter().filter(|path| path.file_stem().is_some_and(|stem| stem == name)).collect();
                assert!(!found.is_empty(), "{source}: no test program {name}: {line}");
                of_line.extend(found);
                named.insert(name.to_owned());
            }
            for module in words.iter().filter_map(|word| word.strip_suffix("::")).filter(|_| !of_line.is_empty()) {
                let files = [format!("{module}.rs"), format!("{module}/mod.rs")];
                let exists = of_line.iter().any(|program| files.iter().any(|name| program.join(name).is_file()));
                assert!(exists, "{source}: no tests {module}: {line}");
            }
        }
    }
    assert!(["cli", "eval", "gpu", "simulation"].iter().all(|name| named.contains(*name)), "{named:?}");
}

#[test]
fn an_interrupted_simulation_of_the_claims_is_repeated_and_a_whole_one_kept() {
    let stage = Stage::new(&["atsplat"]);
    stage.write("data/rooms-64/train/left/over", "");
    for whole in ["test-rooms-128", "test-yards"] {
        stage.write(&format!("data/{whole}/manifest.json"), "{}");
    }
    // The script ends at the first weights, which are in no history here.
    let simulate = r#"mkdir -p "$3"; touch "$3/manifest.json""#;
    let (_, calls) = stage.run(&file("eval/experiments/claims/run"), &["atsplat", "out"], simulate);
    let simulated: Vec<&str> =
        calls.iter().filter_map(|call| call.strip_prefix("atsplat data simulate ")?.split(' ').next()).collect();
    assert_eq!(simulated, ["data/rooms-64", "data/test-rooms-64", "data/yards-64", "data/test-yards-64"]);
    let tests = |call: &&String| call.starts_with("atsplat data simulate data/test-");
    assert!(calls.iter().filter(tests).all(|call| call.ends_with(" --layout nerfstudio")), "lenses: {calls:?}");
    assert!(!stage.path("data/rooms-64/train").exists(), "the simulation begins from the start");
}

#[test]
fn a_baseline_is_replaced_only_if_a_number_moved() {
    let stage = Stage::new(&["cargo", "git"]);
    fs::create_dir_all(stage.path("target/release")).unwrap();
    symlink(stage.path("bin/git"), stage.path("target/release/atsplat")).unwrap();
    stage.write("reports/regenerate", &fs::read_to_string(file("reports/regenerate")).unwrap());
    for folder in ["reports/screenshots", "reports/optimisation"] {
        fs::create_dir_all(stage.path(folder)).unwrap();
    }
    symlink(stage.path("bin/git"), stage.path("reports/screenshots/make")).unwrap();
    // The other baseline does not exist yet.
    stage.write("eval/baselines/quick.json", "{}");
    for (status, succeeds, accepted) in [(0, true, "quick-yards"), (3, true, "quick quick-yards"), (1, false, "")] {
        let does = format!(
            r#"case "$(basename "$0") $1 $2" in
                "cargo metadata "*) echo '{{"target_directory":"{}"}}' ;;
                "atsplat report "*) mkdir -p "$4/plots"; echo "$2" > "$4/plots/optimisation-a.svg" ;;
                "atsplat drift accept") ;;
                "atsplat drift "*) exit {status} ;;
            esac"#,
            stage.path("target").display()
        );
        let (succeeded, calls) = stage.run(&stage.path("reports/regenerate"), &["why"], &does);
        assert_eq!(succeeded, succeeds, "drift exits with {status}: {calls:?}");
        let accepts = calls.iter().filter(|call| call.starts_with("atsplat drift accept"));
        let baselines: Vec<&str> =
            accepts.filter_map(|call| call.split("eval/baselines/").nth(1)?.split(".json").next()).collect();
        assert_eq!(baselines.join(" "), accepted, "drift exits with {status}");
    }
    // The longer optimisations of the desk do not replace the others.
    for (plot, store) in [("optimisation-a", "photos"), ("optimisation-a-five-minutes", "desk-300")] {
        let from = fs::read_to_string(stage.path(&format!("reports/optimisation/{plot}.svg"))).unwrap();
        assert_eq!(from, format!("reports/optimisation/{store}\n"));
    }
}
