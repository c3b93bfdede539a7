//! `atsplat train` as a user runs it: killed at any moment, it resumes to identical bytes.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use crate::common::{atsplat, succeed};
use atsplat_model::weights::ModelWeights;
use atsplat_numeric::SplitMix64;
use tempfile::tempdir;

const TINY: &str = r#"
title = "tiny"
seed = 3
steps = 24
batch = 1

[model]
base = "nano"

[model.changes]
resolution = [32, 32]
transformer = { dim = 32, head-dim = 16 }
coarse.layers = 1
fine.layers = 1

[[data]]
[data.source.rooms]
scenes-of = "rooms"
scenes = 1
size = [32, 32]
samples = 1
stride = 30
views = { context = [2, 2], targets = 2, gaps = { min = 2, max = 3 } }

[evaluation]
every = 10
samples = 1

[evaluation.source.rooms]
scenes-of = "rooms"
split = "test"
scenes = 1
size = [32, 32]
samples = 1
stride = 30
views = { context = [2, 2], targets = 1, gaps = { min = 3, max = 3 }, inset = 1 }

[checkpoints]
every = 3
keep = 2
"#;

fn train(folder: &Path, out: &str, more: &[&str]) -> String {
    succeed(folder, &[&["train", "--config", "tiny.toml", "--out", out], more].concat())
}

/// The outputs of a run without wall-clock times.
fn outcome(folder: &Path, out: &str) -> (Vec<u8>, Vec<u8>, Vec<String>) {
    let folder = folder.join(out);
    let without_times = |line: &str| {
        let (before, after) = line.split_once("\"secs\"").unwrap_or((line, ""));
        format!("{before}{}", after.rsplit_once("\"fault\"").map_or("", |(_, fault)| fault))
    };
    let steps = std::fs::read_to_string(folder.join("steps.jsonl")).unwrap();
    (
        std::fs::read(folder.join("checkpoints/step-00000024.safetensors")).unwrap(),
        std::fs::read(folder.join("weights.safetensors")).unwrap(),
        steps.lines().map(without_times).collect(),
    )
}

#[test]
fn a_run_killed_at_random_moments_resumes_to_identical_bytes() {
    let folder = tempdir().unwrap();
    std::fs::write(folder.path().join("tiny.toml"), TINY).unwrap();
    train(folder.path(), "undisturbed", &[]);
    let expected = outcome(folder.path(), "undisturbed");
    assert_eq!(expected.2.len(), 24);

    let mut args = vec!["train", "--config", "tiny.toml", "--out", "killed"];
    let steps =
        || std::fs::read_to_string(folder.path().join("killed/steps.jsonl")).unwrap_or_default().lines().count();
    let mut random = SplitMix64::new(1);
    let mut killed_within = 0;
    for _ in 0..10 {
        let mut run = Command::new(env!("CARGO_BIN_EXE_atsplat"))
            .args(&args)
            .current_dir(folder.path())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        // After some steps, at any point within a step or a checkpoint.
        let (before, further) = (steps(), random.within(0..=4).unwrap());
        while run.try_wait().unwrap().is_none() && steps() < before + further {
            std::thread::sleep(Duration::from_millis(1));
        }
        std::thread::sleep(Duration::from_secs_f64(0.02 * random.unit()));
        killed_within += usize::from(run.try_wait().unwrap().is_none());
        // SIGKILL.
        run.kill().unwrap();
        run.wait().unwrap();
        if args.len() == 5 && folder.path().join("killed/steps.jsonl").exists() {
            args.push("--resume");
        }
    }
    assert!(killed_within >= 5, "{killed_within} of 10 were killed on the way");
    train(folder.path(), "killed", &["--resume"]);
    assert!(outcome(folder.path(), "killed") == expected);
}

#[test]
fn a_run_writes_all_its_outputs() {
    let folder = tempdir().unwrap();
    std::fs::write(folder.path().join("tiny.toml"), TINY).unwrap();
    let message = train(folder.path(), "out", &["--steps", "4"]);
    assert!(message.contains("4 of 24 steps, 0 skipped") && message.contains("--resume"), "{message}");
    assert!(message.ends_with("out/weights.safetensors\n"), "{message}");
    for file in
        ["steps.parquet", "evaluations.parquet", "learning-curve.png", "contact-sheet.png", "weights.safetensors"]
    {
        assert!(folder.path().join("out").join(file).metadata().unwrap().len() > 200, "{file}");
    }
    let message = succeed(folder.path(), &["weights", "inspect", "out/weights.safetensors"]);
    assert!(message.contains("rooms train 0 to 0 at 32x32"), "{message}");
    // The version, and in parentheses the commit.
    assert!(message.contains(&format!("builds = {} (", env!("CARGO_PKG_VERSION"))), "{message}");
    let again = atsplat(folder.path(), &["train", "--config", "tiny.toml", "--out", "out"]);
    assert_eq!(again.code, 1);
    let advice = "out: expected no run; choose another folder, or `--resume`, found one with checkpoints";
    assert!(again.stderr.contains(advice), "{}", again.stderr);
    train(folder.path(), "second", &["--steps", "1", "--init", "out/weights.safetensors"]);
    let message = succeed(folder.path(), &["weights", "inspect", "second/weights.safetensors"]);
    let views = "(2 views, gaps 2 to 3, targets 2, stride 30, generation 2)";
    let data = format!("at 32x32 {views}; before: 1 × rooms train 0 to 0 at 32x32 {views}");
    assert!(message.contains(&data), "{message}");
    let wrong = atsplat(folder.path(), &["train", "--config", "tiny.toml", "--out", "x", "--hours", "0"]);
    assert_eq!(wrong.code, 2);
}

/// The second training begins with weights that have seen the scenes of its evaluation.
#[test]
fn evaluation_targets_that_the_initial_weights_saw_are_not_called_held_out() {
    let folder = tempdir().unwrap();
    let of_test = TINY.replacen("scenes-of = \"rooms\"", "scenes-of = \"rooms\"\nsplit = \"test\"", 1);
    std::fs::write(folder.path().join("test.toml"), of_test).unwrap();
    std::fs::write(folder.path().join("tiny.toml"), TINY).unwrap();
    let train = |config: &str, out: &str, more: &[&str]| {
        let args = ["train", "--config", config, "--out", out, "--steps", "1"];
        let outcome = atsplat(folder.path(), &[&args[..], more].concat());
        assert_eq!(outcome.code, 0, "{}", outcome.stderr);
        outcome.stderr
    };
    train("test.toml", "test", &[]);
    let fresh = train("tiny.toml", "fresh", &[]);
    assert!(fresh.contains(" held-out targets"), "{fresh}");
    let seen = train("tiny.toml", "seen", &["--init", "test/weights.safetensors"]);
    assert!(seen.contains(" evaluation targets") && !seen.contains("held-out"), "{seen}");
    let unseen = train("tiny.toml", "unseen", &["--init", "fresh/weights.safetensors"]);
    assert!(unseen.contains(" held-out targets"), "{unseen}");
}

/// A checkpoint of a run with averages, from which an earlier state of the run is evaluated.
#[test]
fn checkpoints_are_described_verified_and_imported_and_are_no_weights_files() {
    let folder = tempdir().unwrap();
    let here = folder.path();
    let averaged = TINY.replacen("batch = 1\n", "batch = 1\naverage = 0.5\n", 1);
    std::fs::write(here.join("tiny.toml"), averaged).unwrap();
    train(here, "out", &["--steps", "6"]);
    let (older, last) = ("out/checkpoints/step-00000003.safetensors", "out/checkpoints/step-00000006.safetensors");
    let what = "a training checkpoint at step 3 of 24 of \"tiny\": weights of the model nano, their averages and the \
                optimiser's moments";
    atsplat(here, &["weights", "inspect", older]).prints(0, &format!("what      {what}\n"));
    atsplat(here, &["weights", "verify", older]).prints(0, &format!("complete: {what}; "));
    for args in [
        &["train", "--config", "tiny.toml", "--out", "second", "--init", older][..],
        &["weights", "export", older, "--key-map", "identity", "--out", "exported.safetensors"],
        &["reconstruct", "data", "--key", "a", "--views", "0,1", "--weights", older, "--out", "scene.ply"],
    ] {
        let rejected = atsplat(here, args);
        let expected =
            "found a training checkpoint: resume its run with --resume, or use weights.safetensors of its folder";
        rejected.says(1, expected);
    }
    let weights = |path: &str| ModelWeights::read(&here.join(path)).unwrap();
    for (checkpoint, out) in [(older, "older.safetensors"), (last, "last.safetensors")] {
        let import = ["weights", "import", checkpoint, "--precision", "f16", "--out", out];
        succeed(here, &import);
    }
    let (written, older_weights, last_weights) =
        (weights("out/weights.safetensors"), weights("older.safetensors"), weights("last.safetensors"));
    assert_eq!(last_weights.tensors.digest(), written.tensors.digest());
    assert_ne!(older_weights.tensors.digest(), written.tensors.digest());
    for (key, value) in &written.provenance {
        assert_eq!(last_weights.provenance.get(key), Some(value), "{key}");
    }
    assert_eq!(older_weights.provenance["steps"], "3 of 24");
    assert_eq!(written.provenance["data[0].source.rooms.generation"], "2");
    let mut damaged = std::fs::read(here.join(older)).unwrap();
    *damaged.last_mut().unwrap() ^= 1;
    std::fs::write(here.join("damaged.safetensors"), damaged).unwrap();
    let expected = "metadata tensors-sha256: expected the hash of the tensors";
    atsplat(here, &["weights", "verify", "damaged.safetensors"]).says(1, expected);
    let said = succeed(here, &["weights", "inspect", "damaged.safetensors"]);
    assert!(said.contains("a training checkpoint that cannot be read: ") && said.contains(expected), "{said}");
}

#[test]
fn a_run_starts_from_embedded_weights_by_their_name() {
    const MICRO: &str = r#"
title = "on from embedded weights"
seed = 1
steps = 8
batch = 1

[model]
base = "micro"

[[data]]
[data.source.rooms]
scenes-of = "rooms"
scenes = 1
size = [128, 128]
samples = 1
views = { context = [2, 2], targets = 1, gaps = { min = 2, max = 3 } }
"#;
    let folder = tempdir().unwrap();
    std::fs::write(folder.path().join("micro.toml"), MICRO).unwrap();
    let train = ["train", "--config", "micro.toml", "--out", "out", "--steps", "0", "--init"];
    let unknown = atsplat(folder.path(), &[&train[..], &["micro-gardens"]].concat());
    assert_eq!(unknown.code, 1);
    assert!(
        unknown.stderr.contains("micro-gardens") && unknown.stderr.contains("weights import"),
        "{}",
        unknown.stderr
    );
    // Weights of another network, and a folder of another use.
    std::fs::write(folder.path().join("tiny.toml"), TINY).unwrap();
    let other = atsplat(folder.path(), &["train", "--config", "tiny.toml", "--out", "out", "--init", "micro-rooms"]);
    assert_eq!(other.code, 1, "{}", other.stderr);
    assert!(!folder.path().join("out").exists(), "a failure leaves no folder");
    std::fs::create_dir(folder.path().join("store")).unwrap();
    std::fs::write(folder.path().join("store/provenance.json"), "{}").unwrap();
    atsplat(folder.path(), &["train", "--config", "tiny.toml", "--out", "store"])
        .says(1, "--out store: expected a folder for");
    succeed(folder.path(), &[&train[..], &["micro-rooms"]].concat());
    atsplat(folder.path(), &["weights", "inspect", "out/weights.safetensors"])
        .prints(0, "before: 6000 rooms of the train split");
}

/// Reported before a scene is simulated or a folder created.
#[test]
fn rejects_an_untrainable_configuration_with_file_and_field() {
    let folder = tempdir().unwrap();
    for (from, to, field, expected) in [
        ("size = [32, 32]", "size = [32, 30]", "data[0].source.rooms.size", "divisible by 16, the side of the"),
        ("min = 2, max = 3", "min = 3, max = 2", "data[0].source.rooms.views.gaps", "found 3 and 2"),
        ("min = 3, max = 3", "min = 5, max = 9", "evaluation.source.rooms.views", "the 5 frames of a clip"),
    ] {
        assert!(TINY.contains(from));
        std::fs::write(folder.path().join("tiny.toml"), TINY.replacen(from, to, 1)).unwrap();
        let outcome = atsplat(folder.path(), &["train", "--config", "tiny.toml", "--out", "out"]);
        let said = format!("training configuration: tiny.toml, field {field}");
        outcome.says(1, &said);
        assert!(outcome.stderr.contains(expected), "{}", outcome.stderr);
        assert!(!folder.path().join("out").exists());
    }
}

/// Earlier versions started such runs, in which inset and outside had reduced each other.
#[test]
fn windows_that_a_new_run_must_not_have_are_those_of_a_run_that_is_resumed() {
    let folder = tempdir().unwrap();
    let views = "gaps = { min = 2, max = 3 }";
    assert!(TINY.contains(views));
    let config = TINY.replacen(&format!("{views} }}"), &format!("{views}, inset = 1, outside = 2 }}"), 1);
    std::fs::write(folder.path().join("tiny.toml"), config).unwrap();
    let train = ["train", "--config", "tiny.toml", "--out", "out", "--steps", "1"];
    let problem = "data[0].source.rooms.views.outside: expected 0 with an inset, which keeps targets inside the window, \
                   found 2";
    let rejected = atsplat(folder.path(), &train);
    let said = rejected.stderr.contains(&format!("error: training configuration: {problem}"));
    assert!(rejected.code == 1 && said, "{}", rejected.stderr);
    assert!(!folder.path().join("out").exists());
    std::fs::create_dir(folder.path().join("out")).unwrap();
    std::fs::write(folder.path().join("out/steps.jsonl"), "").unwrap();
    let notice = format!("a new one would be rejected: training configuration: {problem}");
    atsplat(folder.path(), &[&train[..], &["--resume"]].concat()).says(0, &notice);
}

#[test]
fn data_that_cannot_be_read_are_named_with_file_and_field() {
    const VIEWS: &str = "views = { context = [2, 2], targets = 1, gaps = { min = 2, max = 3 } }";
    let folder = tempdir().unwrap();
    let (start, _) = TINY.split_once("[[data]]").unwrap();
    let start = start.replace("resolution = [32, 32]", "resolution = [64, 64]");
    let rooms = format!("scenes-of = 'rooms'\nscenes = 1\nsize = [64, 64]\nsamples = 1\nstride = 30\n{VIEWS}");
    let evaluation = "[evaluation]\nevery = 10\nsamples = 1\n[evaluation";
    let of_evaluation = format!("[[data]]\n[data.source.rooms]\n{rooms}\n{evaluation}");
    let (of_data, of_evaluation) = ("[[data]]\n[data", of_evaluation.as_str());
    for (table, preset, field, cause) in [
        (of_data, "rooms-2v-64", "data[0].source.dataset.path: opening a dataset: ", "(absent) (tiny.toml)"),
        (of_data, "absent.toml", "data[0].source.dataset.preset: reading a preset: ", "(absent.toml) (tiny.toml)"),
        (of_evaluation, "rooms-2v-64", "evaluation.source.dataset.path: opening", "(absent) (tiny.toml)"),
    ] {
        let dataset = format!("path = 'absent'\npreset = '{preset}'\n{VIEWS}");
        let config = format!("{start}{table}.source.dataset]\n{dataset}\n");
        std::fs::write(folder.path().join("tiny.toml"), config).unwrap();
        let outcome = atsplat(folder.path(), &["train", "--config", "tiny.toml", "--out", "out"]);
        let said = outcome.stderr.contains(&format!("error: {field}")) && outcome.stderr.trim_end().ends_with(cause);
        assert!(outcome.code == 1 && said, "{}", outcome.stderr);
    }
}

#[test]
fn one_and_two_threads_give_identical_bytes() {
    let folder = tempdir().unwrap();
    std::fs::write(folder.path().join("tiny.toml"), TINY).unwrap();
    for threads in ["1", "2"] {
        succeed(folder.path(), &["--threads", threads, "train", "--config", "tiny.toml", "--out", threads]);
    }
    assert!(outcome(folder.path(), "1") == outcome(folder.path(), "2"));
}

#[test]
fn resuming_needs_an_existing_run() {
    let folder = tempdir().unwrap();
    std::fs::write(folder.path().join("tiny.toml"), TINY).unwrap();
    std::fs::create_dir(folder.path().join("empty")).unwrap();
    for out in ["empty", "absent"] {
        let rejected = atsplat(folder.path(), &["train", "--config", "tiny.toml", "--out", out, "--resume"]);
        let message = rejected.stderr.contains("expected a run to resume") && rejected.stderr.contains(out);
        assert!(rejected.code == 1 && message, "{}", rejected.stderr);
    }
    assert!(!folder.path().join("absent").exists());
    assert_eq!(std::fs::read_dir(folder.path().join("empty")).unwrap().count(), 0);
}

/// A run is killed before its first checkpoint: what is left is the checkpoint of the weights that it was given.
#[test]
fn resuming_keeps_the_given_weights() {
    let folder = tempdir().unwrap();
    std::fs::write(folder.path().join("tiny.toml"), TINY).unwrap();
    train(folder.path(), "first", &["--steps", "2"]);
    train(folder.path(), "whole", &["--steps", "2", "--init", "first/weights.safetensors"]);
    let given = folder.path().join("whole/checkpoints/step-00000000.safetensors");
    std::fs::create_dir_all(folder.path().join("killed/checkpoints")).unwrap();
    std::fs::copy(given, folder.path().join("killed/checkpoints/step-00000000.safetensors")).unwrap();
    train(folder.path(), "killed", &["--steps", "2", "--resume"]);
    let weights = |out: &str| std::fs::read(folder.path().join(out).join("weights.safetensors")).unwrap();
    assert!(weights("killed") == weights("whole"));
}

/// A run stopped before its first checkpoint restarts with a notice; a damaged checkpoint is skipped and named.
#[test]
fn resuming_reports_unusable_checkpoints() {
    let folder = tempdir().unwrap();
    std::fs::write(folder.path().join("tiny.toml"), TINY).unwrap();
    std::fs::create_dir_all(folder.path().join("out")).unwrap();
    std::fs::write(folder.path().join("out/steps.jsonl"), "").unwrap();
    let resumed = |steps: &str| {
        let args = ["train", "--config", "tiny.toml", "--out", "out", "--resume", "--steps", steps];
        let outcome = atsplat(folder.path(), &args);
        assert_eq!(outcome.code, 0, "{}", outcome.stderr);
        outcome.stderr
    };
    assert!(resumed("6").contains("no checkpoint was written: the run restarts at step 0"));
    std::fs::write(folder.path().join("out/checkpoints/step-00000006.safetensors"), "torn").unwrap();
    let message = resumed("7");
    assert!(message.contains("skipped a checkpoint") && message.contains("step-00000006"), "{message}");
}

#[test]
fn more_steps_than_those_of_the_configuration_are_noted() {
    let folder = tempdir().unwrap();
    std::fs::write(folder.path().join("tiny.toml"), TINY.replacen("steps = 24", "steps = 2", 1)).unwrap();
    let said = |out: &str, steps: &str| {
        let args = ["train", "--config", "tiny.toml", "--out", out, "--steps", steps];
        let outcome = atsplat(folder.path(), &args);
        assert_eq!(outcome.code, 0, "{}", outcome.stderr);
        outcome.stderr.contains("note: --steps 3 has no effect: the configuration ends at step 2\n")
    };
    assert_eq!((said("more", "3"), said("all", "2")), (true, false));
}

/// Without them, a finished run would restart from new weights and replace those that are left.
#[test]
fn resuming_without_the_checkpoints_of_a_run_keeps_its_weights() {
    let folder = tempdir().unwrap();
    std::fs::write(folder.path().join("tiny.toml"), TINY).unwrap();
    train(folder.path(), "out", &["--steps", "4"]);
    let read = |name: &str| std::fs::read(folder.path().join("out").join(name)).unwrap();
    let before = ["weights.safetensors", "steps.jsonl"].map(read);
    std::fs::rename(folder.path().join("out/checkpoints"), folder.path().join("out/old")).unwrap();
    let rejected =
        atsplat(folder.path(), &["train", "--config", "tiny.toml", "--out", "out", "--resume", "--steps", "1"]);
    let advice =
        "out: expected the run's checkpoints in `checkpoints`: put them back, or start a run in another folder";
    rejected.says(1, advice);
    assert!(rejected.stderr.contains("`--init out/weights.safetensors`"), "{}", rejected.stderr);
    assert!(["weights.safetensors", "steps.jsonl"].map(read) == before);
}

/// Steps on an adapter have nearly the CPU's losses; a run does not change its device.
#[cfg(feature = "gpu-network")]
#[test]
fn a_run_on_an_adapter_follows_the_cpu_and_resumes_there_only() {
    use atsplat_numeric::Tolerance;

    if atsplat_splat::gpu::adapters().is_empty() {
        return atsplat_tests::skip_without_graphics("cli train", "none listed");
    }
    let folder = tempdir().unwrap();
    std::fs::write(folder.path().join("tiny.toml"), TINY).unwrap();
    train(folder.path(), "cpu", &["--steps", "3"]);
    train(folder.path(), "card", &["--steps", "3", "--device", "wgpu"]);
    let losses = |out: &str| -> Vec<f64> {
        let steps = std::fs::read_to_string(folder.path().join(out).join("steps.jsonl")).unwrap();
        let record = |line: &str| serde_json::from_str::<serde_json::Value>(line).unwrap();
        steps.lines().map(|line| record(line)["terms"]["total"].as_f64().unwrap()).collect()
    };
    Tolerance::relative(5e-3).assert(losses("card"), losses("cpu"), "loss of each step");
    for (out, device) in [("card", "cpu"), ("cpu", "wgpu")] {
        let args = ["train", "--config", "tiny.toml", "--out", out, "--resume", "--device", device];
        atsplat(folder.path(), &args).says(1, "on which the run was started");
    }
    train(folder.path(), "card", &["--steps", "4", "--resume", "--device", "wgpu"]);
    assert_eq!(losses("card").len(), 4);
}

/// Of four scenes, two have no readable image; the notice gives an example of one.
#[test]
fn the_log_names_each_replaced_scene_with_its_reason_and_each_sample_with_its_step() {
    let folder = tempdir().unwrap();
    let here = folder.path();
    let simulate = ["data", "simulate", "data", "--split", "train", "--scenes", "4", "--frames", "12"];
    succeed(here, &[&simulate[..], &["--size", "64x64", "--samples", "1"]].concat());
    let broken = ["rooms-train-00000001", "rooms-train-00000003"];
    for key in broken {
        for entry in std::fs::read_dir(here.join("data/train").join(key)).unwrap() {
            std::fs::write(entry.unwrap().path(), "no image").unwrap();
        }
    }
    let (settings, _) = TINY.split_once("[[data]]").unwrap();
    let settings = settings.replace("resolution = [32, 32]", "resolution = [64, 64]").replace("batch = 1", "batch = 2");
    let dataset = "path = 'data/train'\npreset = 'rooms-2v-64'\n\
                   views = { context = [2, 2], targets = 1, gaps = { min = 2, max = 5 }, inset = 1 }";
    std::fs::write(here.join("tiny.toml"), format!("{settings}[[data]]\n[data.source.dataset]\n{dataset}\n")).unwrap();
    let log = |verbosity: &str, out: &str| {
        let outcome = atsplat(here, &[verbosity, "train", "--config", "tiny.toml", "--out", out, "--steps", "3"]);
        assert_eq!(outcome.code, 0, "{}", outcome.stderr);
        outcome.stderr
    };
    let advice = "`-v` logs the reason for each scene";
    let silent = log("--threads=1", "silent");
    assert!(silent.contains(advice) && !silent.contains("replaced a draw"), "{silent}");
    let brief = log("-v", "brief");
    assert!(
        brief.contains(" of 2 scenes replaced because they gave no sample, such as ") && !brief.contains(advice),
        "{brief}"
    );
    assert!(!brief.contains("drew a sample"), "{brief}");
    for key in broken {
        let scene = format!("replaced a draw that gave no sample scene=\"{key}\" reason=\"{key}, frames ");
        let lines: Vec<&str> = brief.lines().filter(|line| line.contains(&scene)).collect();
        // The first sample is also drawn when the dataset is opened, and its first draw is of one of these scenes.
        let [line] = lines.as_slice() else { panic!("{key}: {brief}") };
        assert!(line.contains("image-unreadable: frame "), "{line}");
    }
    let full = log("-vv", "full");
    for (step, number) in [(0, 0), (0, 1), (1, 2), (1, 3), (2, 4), (2, 5)] {
        let sample = format!("drew a sample step={step} number={number} sample=\"rooms-train-0000000");
        assert!(full.contains(&sample), "{full}");
    }
}
