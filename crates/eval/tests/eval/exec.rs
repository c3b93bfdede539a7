//! Methods that run as separate processes: shell scripts that answer with files made before.

#![cfg(unix)]

use std::collections::BTreeSet;
use std::fs;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use crate::common::shell::{exec, run_of, script, settings, write_images};
use crate::common::{Run, SIZE, Walls, dataset, entry, image};
use atsplat_eval::method::{Exec, ExecSettings, Method, Ply, Renders, Splatting};
use atsplat_eval::runner::KeepImages;
use atsplat_eval::timing::TimingPlan;
use atsplat_eval::{EvalError, GaussianFrame};
use atsplat_numeric::Tolerance;
use atsplat_pixels::{DecodeLimits, Image, decode};
use atsplat_results::{Results, TargetRow, TargetStatus, TrialStatus};
use atsplat_splat::files::{Encoding, Output, write};
use atsplat_splat::{GaussianParts, Gaussians};
use atsplat_tests::on_threads;

fn results_of(scenes: usize, method: Arc<dyn Method>) -> Results {
    let folder = tempfile::tempdir().unwrap();
    run_of(scenes, method).run(&folder.path().join("store")).unwrap().0
}

/// The error of a run that stops, and what its store has then.
fn stopped(here: &Path, scenes: usize, method: Arc<dyn Method>) -> (String, Results) {
    let store = here.join("stopped");
    let error = on_threads(1, || run_of(scenes, method).run(&store)).map(drop).unwrap_err();
    assert!(matches!(error, EvalError::Io(_)), "{error:?}");
    (error.to_string(), Results::read(&store).unwrap())
}

/// Scores and renders, by scene and target.
fn outcomes(results: &Results) -> Vec<(String, u32, Option<String>, Option<f64>)> {
    let outcome =
        |row: &TargetRow| (row.key.scene.clone(), row.target, row.render_hash.clone(), row.scores.get("psnr").copied());
    results.targets.iter().map(outcome).collect()
}

/// Images of the warp below `here/warp`, and as arrays `here/wall-0.npy`; their scores as a folder of renders.
fn prepared(here: &Path, scenes: usize) -> Results {
    write_images(here, scenes);
    for scene in 0..scenes {
        let frames = [1, 3].map(|frame| {
            let path = here.join(format!("warp/wall-{scene}-0/{frame:06}.png"));
            Image::from_u8(&decode(&fs::read(path).unwrap(), &DecodeLimits::default()).unwrap())
        });
        fs::write(here.join(format!("wall-{scene}.npy")), array(&frames)).unwrap();
        let [first, second] = frames;
        fs::write(here.join(format!("swapped-wall-{scene}.npy")), array(&[second, first.clone()])).unwrap();
        fs::write(here.join(format!("few-wall-{scene}.npy")), array(&[first])).unwrap();
    }
    results_of(scenes, Arc::new(Renders::new(&here.join("warp"), Some("shell")).unwrap()))
}

/// A `.npy` file of `<f4`, as `numpy.save` writes it except for the padding of its header.
fn array(images: &[Image]) -> Vec<u8> {
    let shape = format!("({}, {}, {}, 3)", images.len(), SIZE.height, SIZE.width);
    let header = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}\n");
    let length = u16::try_from(header.len()).unwrap().to_le_bytes();
    let samples = images.iter().flat_map(Image::samples).flat_map(|sample| sample.to_le_bytes());
    [b"\x93NUMPY\x01\x00".as_slice(), &length, header.as_bytes(), &samples.collect::<Vec<u8>>()].concat()
}

#[test]
fn images_of_a_process_score_as_the_same_files_do() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let expected = prepared(here, 3);
    let array = r#"cp $scene.npy "$folder/a.npy"; answer "\"images\": \"$folder/a.npy\"""#;
    let found = results_of(3, exec(&script(here, "images", array)));
    assert_eq!(outcomes(&found), outcomes(&expected));
    let files = r#"cp -r warp/$scene-0 "$folder/out"; answer '"images": "out"'"#;
    assert_eq!(outcomes(&results_of(3, exec(&script(here, "images", files)))), outcomes(&expected));
    // Targets in another order are other results.
    let swapped = results_of(3, exec(&script(here, "images", &array.replace("cp ", "cp swapped-"))));
    for (found, expected) in outcomes(&swapped).iter().zip(outcomes(&expected)) {
        assert!(found.2 != expected.2 && found.3.unwrap() < expected.3.unwrap() - 1.0, "{found:?} {expected:?}");
    }
    let record = &found.provenance.methods[0];
    assert_eq!((record.kind.as_str(), &record.parameters["version"]), ("exec", &"1".into()));
    assert_eq!(record.parameters["files"].as_object().unwrap().len(), 1, "the script's hash");
}

/// The cameras stand side by side, 0.2 apart; a wall of 64×64 pixels is seen with a focal length of one width.
#[test]
fn a_process_is_given_cameras_in_pixels_and_the_context_in_order() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    prepared(here, 1);
    let body = r#"printf '%s' "$line" > seen.json; cp "$folder"/context-*.npy .
        cp $scene.npy "$folder/a.npy"; answer '"images": "a.npy"'"#;
    let method = exec(&script(here, "images\", \"setting\": \"MVSplat", body));
    let run = Run::new(vec![dataset(Walls::new(1, 8), &[entry(&[4, 0], &[1, 3])])], vec![method]);
    run.run(&here.join("other")).unwrap();
    let seen: serde_json::Value = serde_json::from_slice(&fs::read(here.join("seen.json")).unwrap()).unwrap();
    let numbers = |value: &serde_json::Value| -> Vec<f64> {
        let rows = value.as_array().unwrap().iter().flat_map(|row| row.as_array().unwrap());
        rows.map(|number| number.as_f64().unwrap()).collect()
    };
    for (views, frames) in [("context", [4, 0]), ("targets", [1, 3])] {
        for (at, frame) in frames.into_iter().enumerate() {
            let view = &seen[views][at];
            assert_eq!((view["frame"].as_u64(), view["width"].as_u64()), (Some(frame), Some(64)));
            let x = 0.2 * frame as f64;
            let pose = [1.0, 0.0, 0.0, x, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
            Tolerance::F64.assert(numbers(&view["world_from_camera"]), pose, "camera to world");
            let intrinsics = [64.0, 0.0, 32.0, 0.0, 64.0, 32.0, 0.0, 0.0, 1.0];
            Tolerance::F64.assert(numbers(&view["intrinsics"]), intrinsics, "pixels");
            assert_eq!(view["image"].is_string(), views == "context", "no target's image");
            if views == "context" {
                let bytes = fs::read(here.join(format!("context-{at}.npy"))).unwrap();
                assert!(bytes.ends_with(image(0, usize::try_from(frame).unwrap()).samples()), "{at}");
            }
        }
    }
    // MVSplat's planes under this protocol, which differ from ATSplat's.
    assert_eq!((seen["near"].as_f64(), seen["far"].as_f64()), (Some(1.0), Some(100.0)));
    assert_eq!(seen["preset"], "re10k-2v-256");
}

/// Answers with the files of [`write_gaussians`].
const COPIED: &str = r#"cp ply/$scene.ply "$folder/"; answer "\"gaussians\": \"$scene.ply\"""#;

/// Two Gaussians in front of the cameras for each of two scenes, below `here/ply`.
fn write_gaussians(here: &Path) {
    fs::create_dir(here.join("ply")).unwrap();
    for (scene, x) in [(0, 0.3), (1, -0.4)] {
        let parts = GaussianParts {
            means: vec![[x, 0.1, 4.0], [0.0, -0.5, 6.0]],
            log_scales: vec![[-1.5, -2.0, -1.0]; 2],
            quaternions: vec![[1.0, 0.0, 0.0, 0.0]; 2],
            opacity_logits: vec![2.0, 1.0],
            sh: vec![[0.9, -0.3, 0.2], [-0.5, 0.4, 1.0]],
            sh_degree: 0,
            scalars: None,
            filter_3d: None,
        };
        let path = here.join(format!("ply/wall-{scene}.ply"));
        write(&path, &Gaussians::new(parts).unwrap(), Output::Ply(Encoding::BinaryLittleEndian)).unwrap();
    }
}

#[test]
fn gaussians_of_a_process_score_as_the_same_file_does() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_gaussians(here);
    let found = results_of(2, exec(&script(here, "gaussians", COPIED)));
    let ply = Ply::new(&here.join("ply"), Some("shell"), GaussianFrame::Trial, false, Splatting::default()).unwrap();
    let expected = results_of(2, Arc::new(ply));
    assert_eq!(found.trials[0].gaussians, Some(2));
    let both = [&found, &expected].map(|results| (outcomes(results), results.trials[1].gaussians_drawn));
    assert_eq!(both[0], both[1]);
    assert!(found.trials[1].gaussians_drawn.unwrap() > 1.0, "they are seen");
}

/// iLRM renders on white and MVSplat, whose entry states no renderer, as the preset says: on black. A corner shows the background.
#[test]
fn gaussians_are_rendered_as_the_setting_states_or_else_the_preset() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_gaussians(here);
    let rendered = |setting: &str, splatting: Splatting| {
        let command = script(here, &format!("gaussians\", \"setting\": \"{setting}"), COPIED);
        let method = Exec::start(ExecSettings { splatting, ..settings(&command) }).unwrap();
        let mut run = run_of(1, Arc::new(method));
        run.images = KeepImages::All;
        let store = tempfile::tempdir().unwrap();
        let (results, _) = run.run(store.path()).unwrap();
        let path = store.path().join("images/walls/shell/wall-0-0/000001.png");
        let image = decode(&fs::read(path).unwrap(), &DecodeLimits::default()).unwrap();
        let corner: Vec<u8> = image.samples().iter().copied().take(3).collect();
        assert!(image.samples().chunks(3).any(|pixel| pixel != corner), "{setting}: the Gaussians are seen");
        (corner, results.targets[0].render_hash.clone())
    };
    let [(white, ilrm), (black, mvsplat)] = ["iLRM", "MVSplat"].map(|setting| rendered(setting, Splatting::default()));
    assert_eq!((white, black), (vec![255; 3], vec![0; 3]));
    assert_ne!(ilrm, mvsplat);
    let chosen = Splatting { background: Some([0.0; 3]), ..Splatting::default() };
    assert_eq!(rendered("iLRM", chosen).0, [0; 3], "a background that was chosen is used with every setting");
}

/// Logits and opacities are read from the same files, and give other renders.
#[test]
fn a_store_of_logits_is_not_resumed_with_opacities_as_stored() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_gaussians(here);
    let method = |gives: &str, opacities_as_stored| -> Arc<dyn Method> {
        let command = script(here, gives, COPIED);
        Arc::new(Exec::start(ExecSettings { opacities_as_stored, ..settings(&command) }).unwrap())
    };
    let [logits, opacities] = [false, true].map(|as_stored| method("gaussians", as_stored));
    let mut expected = logits.record();
    expected.parameters.insert("opacities-as-stored".to_owned(), true.into());
    assert_eq!(opacities.record(), expected, "and a record of logits is as it always was");
    let store = here.join("store");
    run_of(2, logits).run(&store).unwrap();
    let refused = run_of(2, opacities).run(&store).map(drop).unwrap_err().to_string();
    assert!(refused.contains("methods shell") && refused.contains("opacities-as-stored: none and true"), "{refused}");
    let (_, summary) = run_of(2, method("gaussians", false)).run(&store).unwrap();
    assert_eq!((summary.evaluated, summary.resumed), (0, 2));
    // Images have no opacities.
    let [without, with] = [false, true].map(|as_stored| method("images", as_stored).record());
    assert_eq!(without, with);
}

/// One process, which does something else wrong in each scene.
#[test]
fn whatever_a_process_does_wrong_fails_its_trial_with_a_reason() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let expected = prepared(here, 15);
    let bright = vec![200.0; (SIZE.width * SIZE.height * 3) as usize];
    let bright = Image::new(SIZE.width, SIZE.height, bright).unwrap();
    fs::write(here.join("bright.npy"), array(&[bright.clone(), bright])).unwrap();
    let nan = vec![f32::NAN; (SIZE.width * SIZE.height * 3) as usize];
    let nan = Image::new(SIZE.width, SIZE.height, nan).unwrap();
    fs::write(here.join("nan.npy"), array(&[nan.clone(), nan])).unwrap();
    let body = r#"
      case $scene in
        wall-1) sleep 60 & echo $! > orphan; echo 'CUDA out of memory' >&2; exit 3;;
        wall-2) sleep 60 & echo $! > sleeper; echo thinking >&2; wait;;
        wall-3) echo 'Loading model ...';;
        wall-4) tail -c +3 nan.npy > "$folder/a.npy"; answer '"images": "a.npy"';;
        wall-5) cp few-wall-0.npy "$folder/a.npy"; answer '"images": "a.npy"';;
        wall-6) cp nan.npy "$folder/a.npy"; answer '"images": "a.npy"';;
        wall-7) answer '"error": "no parallax"';;
        wall-8) answer '"not_applicable": "two views are too few"';;
        wall-9) answer '"images": "b.npy"';;
        wall-10) kill -KILL $$;;
        wall-12) cp bright.npy "$folder/a.npy"; answer '"images": "a.npy"';;
        wall-13) answer '"gaussians": "a.ply"';;
        wall-14) answer '"images": "a.npy", "seconds": {"encode": 1000}';;
        *) cp $scene.npy "$folder/a.npy"; answer '"images": "a.npy"';;
      esac"#;
    let command = script(here, "images", body);
    let limit = Duration::from_secs(3);
    let method = Arc::new(Exec::start(ExecSettings { limit, ..settings(&command) }).unwrap());
    let found = results_of(15, method);
    let of = |scene: usize| {
        let key = format!("wall-{scene}");
        let trial = found.trials.iter().find(|trial| trial.key.scene == key).unwrap();
        let target = found.targets.iter().find(|row| row.key.scene == key).unwrap();
        (trial.status, target.status, trial.detail.clone().unwrap_or_default())
    };
    let reasons = [
        (1, "exit status: 3; its last lines on standard error: CUDA out of memory"),
        (2, "did not answer within 3 s and was killed; its last lines on standard error: thinking"),
        (3, "on its standard output, found \"Loading model ...\""),
        (4, "a.npy: expected a .npy file"),
        (5, "expected the shape (2, 64, 64, 3), found (1, 64, 64, 3)"),
        (7, "the method says: no parallax"),
        (9, "expected the file \"b.npy\""),
        (10, "signal: 9"),
        (12, "a.npy: image 0: expected samples in [0, 1], found 200.00…200.00, which seems to be 0…255"),
        (13, "expected images, as announced at its start, found gaussians"),
        (14, "expected at most the seconds that the answer took, found more: \"seconds\" are seconds, not "),
    ];
    for (scene, reason) in reasons {
        let (trial, target, detail) = of(scene);
        assert_eq!((trial, target), (TrialStatus::Failed, TargetStatus::Failed), "{scene}: {detail}");
        assert!(detail.contains(reason), "{scene}: {detail}");
    }
    assert_eq!(of(6).1, TargetStatus::NonFinite);
    let (status, _, why) = of(8);
    assert_eq!((status, why.as_str()), (TrialStatus::NotApplicable, "two views are too few"));
    let good = |results: &Results| -> Vec<_> {
        let is_good = |scene: &str| scene == "wall-0" || scene == "wall-11";
        outcomes(results).into_iter().filter(|(scene, ..)| is_good(scene)).collect()
    };
    assert_eq!(good(&found), good(&expected));
    if Path::new("/proc/self").exists() {
        for started in ["sleeper", "orphan"] {
            let id = fs::read_to_string(here.join(started)).unwrap();
            let status = fs::read_to_string(format!("/proc/{}/status", id.trim())).unwrap_or_default();
            // One that nobody has waited for yet stays as a zombie.
            assert!(status.is_empty() || status.contains("State:\tZ"), "{started} is killed with what started it");
        }
    }
}

/// Whatever order the trials come in, a process that crashes at its third answers two: of seven, the third and sixth fail.
#[test]
fn a_process_is_started_again_after_each_crash() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let expected = prepared(here, 7);
    let body = r#"n=$((n + 1)); if [ $n = 3 ]; then exit 1; fi
        cp $scene.npy "$folder/a.npy"; answer '"images": "a.npy"'"#;
    let found = results_of(7, exec(&script(here, "images", body)));
    let failed = found.trials.iter().filter(|trial| trial.status == TrialStatus::Failed).count();
    assert_eq!(failed, 2, "{:?}", found.trials);
    let (found, expected) = (outcomes(&found), outcomes(&expected));
    let equal = found.iter().zip(&expected).filter(|(found, expected)| found == expected).count();
    assert_eq!(equal, 2 * 5);
}

#[test]
fn a_process_that_is_another_one_when_started_again_is_rejected() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let text = r#"n=$(($(cat starts 2>/dev/null) + 1)); echo $n > starts
echo '{"atsplat": 1, "name": "shell", "version": "v'$n'", "gives": "images"}'
read -r line; exit 1
"#;
    fs::write(here.join("method.sh"), format!("cd '{}'\n{text}", here.display())).unwrap();
    let (again, found) = stopped(here, 2, exec(&format!("sh '{}'", here.join("method.sh").display())));
    assert!(again.contains("after a restart") && again.contains("version: "), "{again}");
    assert!(again.contains("v1 and v2") && !again.contains('{'), "{again}");
    assert_eq!(found.trials.len(), 1, "the trial that it crashed on");
}

#[test]
fn a_program_that_was_edited_during_the_run_is_not_started_again() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    prepared(here, 3);
    let body = r#"if [ ! -e edited ]; then touch edited; echo '# edited' >> method.sh; exit 1; fi
        cp $scene.npy "$folder/a.npy"; answer '"images": "a.npy"'"#;
    let (error, found) = stopped(here, 3, exec(&script(here, "images", body)));
    let parts = ["files of its command have changed", "method.sh: ", " and "];
    assert!(parts.iter().all(|part| error.contains(part)), "{error}");
    let details: Vec<&str> = found.trials.iter().filter_map(|trial| trial.detail.as_deref()).collect();
    assert!(matches!(details.as_slice(), [one] if one.contains("exit status: 1")), "{details:?}");
}

/// The command of a method whose process crashes after its second answer. It does not start then until `found` is there, and runs
/// `refused` in place of that.
fn crashing_once(here: &Path, refused: &str) -> String {
    prepared(here, 5);
    let body = r#"n=$((n + 1)); if [ $n = 3 ] && [ ! -e lost ]; then touch lost; exit 1; fi
        cp $scene.npy "$folder/a.npy"; answer '"images": "a.npy"'"#;
    let command = script(here, "images", body);
    let path = here.join("method.sh");
    let is_lost = format!("cd '{}'; [ -e lost ] && [ ! -e found ]", here.display());
    let start = format!("if {is_lost}; then {refused}; fi\n{}", fs::read_to_string(&path).unwrap());
    fs::write(&path, start).unwrap();
    command
}

/// After its second answer it crashes, and it does not start until a file is there; then the same command asks the other trials.
#[test]
fn a_process_that_cannot_be_started_again_stops_the_run() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let command = crashing_once(here, "echo 'no GPU' >&2; exit 4");
    let (error, found) = stopped(here, 5, exec(&command));
    assert!(error.starts_with("starting a method's process: "), "{error}");
    assert!(error.ends_with("exit status: 4; its last lines on standard error: no GPU (sh)"), "{error}");
    let counts = |results: &Results| {
        let failed = results.trials.iter().filter(|trial| trial.status == TrialStatus::Failed);
        (results.trials.len(), failed.count())
    };
    assert_eq!(counts(&found), (3, 1), "the trial that killed it failed: {:?}", found.trials);
    fs::write(here.join("found"), "").unwrap();
    let (results, summary) = run_of(5, exec(&command)).run(&here.join("stopped")).unwrap();
    assert_eq!((summary.evaluated, counts(&results)), (2, (5, 1)));
}

/// After its second answer it crashes, and its next start fails, as while the memory of the process before is not free yet.
#[test]
fn a_process_that_does_not_start_once_is_started_once_more() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let found = results_of(5, exec(&crashing_once(here, "touch found; echo 'no GPU' >&2; exit 4")));
    let failed = found.trials.iter().filter(|trial| trial.status == TrialStatus::Failed).count();
    assert_eq!((found.trials.len(), failed), (5, 1), "the trial that killed it failed: {:?}", found.trials);
    assert!(here.join("found").is_file());
}

/// Two lines at once, for the trial that is asked first.
#[test]
fn an_extra_line_is_blamed_on_the_answer_before_it() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    prepared(here, 3);
    let body = r#"cp $scene.npy "$folder/a.npy"
        if [ -e first ]; then answer '"images": "a.npy"'; continue; fi
        echo $scene > first; printf '{"trial": %s, "images": "a.npy"}\ndone\n' $trial"#;
    let found = results_of(3, exec(&script(here, "images", body)));
    let first = fs::read_to_string(here.join("first")).unwrap();
    let failed: Vec<_> = found.trials.iter().filter(|trial| trial.status == TrialStatus::Failed).collect();
    assert_eq!(failed.len(), 1, "{failed:?}");
    assert_ne!(failed[0].key.scene, first.trim());
    let detail = failed[0].detail.as_deref().unwrap();
    let blamed = format!("(scene {:?}, entry 0): \"done\"", first.trim());
    assert!(detail.contains("an extra line after the answer to the previous trial, "), "{detail}");
    assert!(detail.contains(&blamed), "{detail}");
}

#[test]
fn two_processes_answer_at_once_with_the_same_results() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let expected = prepared(here, 6);
    let body = r#"echo $ATSPLAT_PROCESS >> numbers; sleep 0.2
        cp $scene.npy "$folder/a.npy"; answer '"images": "a.npy"'"#;
    let command = script(here, "images", body);
    let method = Arc::new(Exec::start(ExecSettings { processes: 2, ..settings(&command) }).unwrap());
    let found = on_threads(2, || results_of(6, method));
    assert_eq!(outcomes(&found), outcomes(&expected));
    let numbers = fs::read_to_string(here.join("numbers")).unwrap();
    assert_eq!(numbers.lines().collect::<BTreeSet<_>>(), BTreeSet::from(["0", "1"]));
}

#[test]
fn a_timing_pass_records_wall_time_stages_and_the_processes_own_memory() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    prepared(here, 1);
    let body = r#"sleep 0.02; cp $scene.npy "$folder/a.npy"
        answer '"images": "a.npy", "seconds": {"encode": 0.015625, "render": 0.00390625}'"#;
    let mut run = run_of(1, exec(&script(here, "images", body)));
    run.timing = Some(TimingPlan { trials: 1, ..TimingPlan::default() });
    let (results, _) = run.run(&here.join("timed")).unwrap();
    let row = &results.timings[0];
    assert!(row.encode.len() >= 5 && row.encode.iter().all(|secs| *secs >= 0.02), "{row:?}");
    assert!(row.render.is_empty(), "its images are finished");
    assert_eq!((row.stages["encode"][0], row.stages["render"][0]), (0.015_625, 0.003_906_25));
    if Path::new("/proc/self/status").exists() {
        // A shell needs far less memory than this process.
        assert!((1..50 << 20).contains(&row.peak_bytes.unwrap()), "{row:?}");
    }
    assert!(results.trials.iter().all(|trial| trial.peak_bytes.is_none()), "rows are the same in every run");
}

#[test]
fn what_does_not_start_as_a_method_is_rejected_before_the_run() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    let refused = |command: &str| {
        let limit = Duration::from_secs(20);
        let outcome = Exec::start(ExecSettings { limit, ..settings(command) });
        outcome.map(|_| ()).unwrap_err()
    };
    let text = |error: EvalError| error.to_string();
    assert!(text(refused("sh -c 'echo no such module >&2; exit 7'")).contains("exit status: 7"));
    assert!(text(refused("sh -c 'echo no such module >&2; exit 7'")).contains("no such module"));
    assert!(text(refused("echo ready")).contains("found \"ready\""));
    assert!(text(refused("'unclosed")).contains("quoted"));
    let missing = text(refused("/nowhere/method"));
    assert!(missing.contains("/nowhere/method") && !missing.contains("setpriv"), "{missing}");
    let other = script(here, "images", "exit").replace("method.sh", "no.sh");
    assert!(text(refused(&other)).contains("no.sh"));
    // A word is a word: no shell expands it.
    let literal = text(refused("sh -c 'echo \"$1\"' sh '$(id)'"));
    assert!(literal.contains("$(id)"), "{literal}");
    // Names are those that NAME= accepts.
    let named = |name: &str| {
        let hello = format!(r#"{{"atsplat": 1, "name": "{name}", "version": "1", "gives": "images"}}"#);
        fs::write(here.join("hello"), hello + "\n").unwrap();
        let command = format!("sh -c \"cat '{}'; read -r line\"", here.join("hello").display());
        Exec::start(settings(&command)).map(|method| method.record().name)
    };
    for name in ["a\\nb", "../../evil", "truth", " "] {
        let refused = text(named(name).unwrap_err());
        assert!(refused.contains("expected a name of letters") && refused.contains("NAME=exec:"), "{refused}");
    }
    assert_eq!(named(" x ").unwrap(), "x");
}

/// Results of a changed script or checkpoint do not join those of another one, as a word or in the text for a shell.
#[test]
fn a_changed_method_does_not_resume_a_store() {
    for in_shell in [false, true] {
        let folder = tempfile::tempdir().unwrap();
        let here = folder.path();
        prepared(here, 1);
        fs::write(here.join("w.bin"), "weights").unwrap();
        let method = |before: &str| {
            let body = format!(r#"{before}cp $scene.npy "$folder/a.npy"; answer '"images": "a.npy"'"#);
            let command = format!("{} --weights={}", script(here, "images", &body), here.join("w.bin").display());
            exec(&if in_shell { format!("sh -c \"NUMBER=$ATSPLAT_PROCESS exec {command}\"") } else { command })
        };
        let store = here.join("resumed");
        run_of(1, method("")).run(&store).unwrap();
        let (_, summary) = run_of(1, method("")).run(&store).unwrap();
        assert_eq!((summary.evaluated, summary.resumed), (0, 1));
        let refused = |before: &str| run_of(1, method(before)).run(&store).map(drop).unwrap_err().to_string();
        let message = refused("sleep 0; ");
        assert!(message.contains("methods shell of the two runs differ") && message.contains("method.sh"), "{message}");
        fs::write(here.join("w.bin"), "others").unwrap();
        let message = refused("");
        assert!(message.contains("w.bin") && !message.contains("method.sh"), "{message}");
    }
}
