//! The adapters in `eval/methods`, read as text: their own environments are not at hand.

use std::fs;
use std::path::Path;

const CLOCKS: [&str; 3] = ["perf_counter", "time.time", "monotonic"];

/// Lines of a Python function's body, without the documentation.
fn body<'a>(text: &'a str, function: &str) -> Vec<&'a str> {
    let head = format!("def {function}(");
    let lines = text.lines().skip_while(|line| !line.starts_with(&head)).skip(1);
    let lines = lines.take_while(|line| line.is_empty() || line.starts_with(' '));
    lines.map(str::trim).filter(|line| !line.is_empty() && !line.starts_with("\"\"\"")).collect()
}

/// CUDA computes while Python goes on: a clock that does not wait for it times the launch of its kernels.
#[test]
fn clocks_wait_for_the_device() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../eval/methods");
    let mut with_clocks = 0;
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|extension| extension != "py") {
            continue;
        }
        let text = fs::read_to_string(&path).unwrap();
        let clocks: usize = CLOCKS.iter().map(|clock| text.matches(clock).count()).sum();
        if !text.contains("torch") || clocks == 0 {
            continue;
        }
        with_clocks += 1;
        let place = path.display();
        assert_eq!(clocks, 1, "{place}: one clock, in now()");
        let waits = [
            "if torch.device(device).type == \"cuda\":",
            "torch.cuda.synchronize(device)",
            "return time.perf_counter()",
        ];
        assert_eq!(body(&text, "now"), waits, "{place}");
    }
    assert_eq!(with_clocks, 1, "pixelsplat_family.py states its seconds");
}

/// Reading images and writing Gaussians are in no published time.
#[test]
fn the_stated_seconds_are_those_of_the_encoder() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../eval/methods/pixelsplat_family.py");
    let text = fs::read_to_string(path).unwrap();
    let lines = body(&text, "gaussians_of");
    let begin = lines.iter().position(|line| *line == "begin = now(device)").unwrap();
    assert!(lines[begin + 1].starts_with("made = encoder("), "{lines:?}");
    assert_eq!(lines[begin + 2], "seconds = now(device) - begin");
    assert_eq!(text.matches("now(device)").count(), 3, "its definition, before and after");
}

/// The encoder would take a lens's images as those of a pinhole.
#[test]
fn trials_with_lenses_are_not_applicable() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../eval/methods/pixelsplat_family.py");
    let text = fs::read_to_string(path).unwrap();
    let lines = body(&text, "main");
    let question = "if any(\"lens\" in view for view in trial[\"context\"]):";
    let asked = lines.iter().position(|line| *line == question).unwrap();
    let [remedy, answered] = [lines[asked + 1], lines[asked + 2]];
    let is_complete = remedy.contains("`atsplat data undistort`") && remedy.contains("`--features opencv`");
    assert!(is_complete && answered.contains("not_applicable=") && answered.contains("remedy"), "{remedy} {answered}");
    assert_eq!(lines[asked + 3], "continue");
    let encoded = lines.iter().position(|line| line.contains("gaussians_of(encoder")).unwrap();
    assert!(asked < encoded);
}
