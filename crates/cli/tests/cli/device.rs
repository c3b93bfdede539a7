//! `--device`: what is an error, and what results say about a graphics adapter.

use std::path::Path;

use crate::common::{atsplat, printed_json, succeed};
use crate::evaluation::write_noise;
use atsplat_numeric::Tolerance;
use atsplat_results::Results;
use atsplat_splat::gpu::adapters;
use atsplat_tests::skip_without_graphics;

const TINY: [&str; 6] = ["tiny.toml", "--data", "data", "--out", "store", "--json"];
/// Optimises a few Gaussians, and renders them, on the device.
const OPTIMISED: [&str; 5] = ["--method", "3dgs:2", "--max-gaussians", "300", "--timing"];

fn run(more: &[&str]) -> Vec<String> {
    ["run"].iter().chain(&TINY).chain(more).map(|&text| text.to_owned()).collect()
}

fn texts(args: &[String]) -> Vec<&str> {
    args.iter().map(String::as_str).collect()
}

#[test]
fn a_device_is_spelled_in_one_way() {
    let folder = tempfile::tempdir().unwrap();
    for command in ["run", "score", "reproduce", "train", "reconstruct", "budget", "fit", "render"] {
        let expected = "expected cpu, wgpu or wgpu:N, N as `atsplat adapters` numbers them, found \"gpu:0\"";
        atsplat(folder.path(), &[command, "--device", "gpu:0"]).says(2, expected);
    }
}

#[test]
fn images_alone_need_no_device() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 1);
    let run = run(&["--method", "warp,nearest-view", "--device", "wgpu"]);
    let score = [&["score"], &TINY[..], &["--renders", "data", "--device", "wgpu"]].concat();
    for (args, expected) in
        [(texts(&run), "--device requires a method with a network or Gaussians"), (score, "--device requires --ply")]
    {
        atsplat(here, &args).says(2, expected);
    }
}

/// Before any adapter is opened, and before anything is written.
#[cfg(not(feature = "gpu-network"))]
#[test]
fn networks_on_an_adapter_need_a_build_for_them() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 1);
    std::fs::write(here.join("sweep.toml"), "title = 'one'\n[[settings]]\nlabel = 'as it is'\n").unwrap();
    let network = ["--weights", "random:1", "--device", "wgpu:0"];
    let sweep = [&["tradeoff", "sweep"], &TINY[..], &["--sweep", "sweep.toml"], &network].concat();
    let run = run(&[&["--method", "atsplat"], &network[..]].concat());
    let train = ["train", "--config", "none.toml", "--out", "store", "--device", "wgpu:0"];
    for args in [&texts(&run)[..], &sweep, &["reproduce", "--out", "store", "--device", "wgpu:0"], &train] {
        let expected = "--device wgpu:0: the network on wgpu:0: this build runs networks only on the CPU; `cargo install \
                        --path crates/cli --locked --features gpu-network` makes one for wgpu";
        atsplat(here, args).says(1, expected);
        assert!(!here.join("store").exists(), "{args:?}");
    }
}

#[test]
fn an_unknown_adapter_is_an_error_with_the_list_of_adapters() {
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 1);
    std::fs::create_dir(here.join("gaussians")).unwrap();
    let score = [&["score"], &TINY[..], &["--ply", "gaussians", "--device", "wgpu:77"]].concat();
    let run = run(&[&OPTIMISED[..], &["--device", "wgpu:77"]].concat());
    let listed: Vec<String> = adapters().iter().enumerate().map(|(at, adapter)| format!("{at} {adapter}")).collect();
    let listed = if listed.is_empty() { "none".to_owned() } else { listed.join(", ") };
    for args in [score, texts(&run)] {
        let rejected = atsplat(here, &args);
        let advice = "`atsplat adapters` lists and tests all adapters, `--device cpu` needs none";
        let expected = format!("graphics adapter: expected number 77, found {listed}; {advice}");
        let names_both = rejected.stderr.contains("error: --device wgpu:77: ") && rejected.stderr.contains(&expected);
        assert!(rejected.code == 1 && names_both, "{expected}: {}", rejected.stderr);
        assert!(!here.join("store").exists());
    }
}

fn results(here: &Path) -> Results {
    Results::read(&here.join("store")).unwrap()
}

/// Every row, every time and the provenance name the adapter; another device needs another name or folder.
#[test]
fn results_of_an_adapter_say_so_and_are_not_mixed_with_the_cpus() {
    if adapters().is_empty() {
        return skip_without_graphics("cli device", "none listed");
    }
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 1);
    let on_adapter = run(&[&OPTIMISED[..], &["--device", "wgpu:0"]].concat());
    let printed = printed_json(here, &texts(&on_adapter));
    let first = &adapters()[0];
    let adapter = format!("{first}, {}", first.driver);
    assert_eq!(printed["times"][0]["device"], format!("renderer on {adapter}"), "{printed}");

    let rejected = atsplat(here, &texts(&run(&OPTIMISED)));
    let expected = "methods 3dgs-2 of the two runs differ: ";
    let names_it = rejected.stderr.contains("renderer-adapter") && rejected.stderr.contains("cannot be resumed");
    assert!(rejected.code == 1 && rejected.stderr.contains(expected) && names_it, "{}", rejected.stderr);
    succeed(here, &texts(&run(&["--method", "cpu=3dgs:2", "--max-gaussians", "300"])));

    let found = results(here);
    assert_eq!(found.provenance.adapter.as_deref(), Some(adapter.as_str()));
    let (on_cpu, on_adapter): (Vec<_>, Vec<_>) = found.trials.iter().partition(|row| row.key.method == "cpu");
    for row in &on_adapter {
        assert_eq!((row.renderer_adapter.as_deref(), row.network_adapter.as_deref()), (Some(adapter.as_str()), None));
    }
    assert!(on_cpu.iter().all(|row| row.renderer_adapter.is_none()) && on_cpu.len() == on_adapter.len());
    assert!(found.timings.iter().all(|row| row.renderer_adapter.as_deref() == Some(adapter.as_str())));
    assert!(!found.timings.is_empty());
    let scores = |method: &str| -> Vec<f64> {
        found.targets.iter().filter(|row| row.key.method == method).map(|row| row.scores["psnr"]).collect()
    };
    Tolerance::absolute(0.02).assert(scores("3dgs-2"), scores("cpu"), "PSNR");
    let gaussians = |rows: &[&atsplat_results::TrialRow]| rows.iter().map(|row| row.gaussians).collect::<Vec<_>>();
    assert_eq!(gaussians(&on_adapter), gaussians(&on_cpu));
    let text = succeed(here, &["report", "store", "--out", "page"]);
    let page = std::fs::read_to_string(here.join("page/index.html")).unwrap();
    assert!(page.contains(&format!("<dt>Adapter</dt><dd>{adapter}</dd>")), "{text}");
}

#[cfg(feature = "gpu-network")]
#[test]
fn a_network_on_an_adapter_has_the_cpus_scores() {
    if adapters().is_empty() {
        return skip_without_graphics("cli device", "none listed");
    }
    let folder = tempfile::tempdir().unwrap();
    let here = folder.path();
    write_noise(here, 1);
    for (method, device) in [("card=atsplat", "wgpu:0"), ("cpu=atsplat", "cpu")] {
        succeed(here, &texts(&run(&["--method", method, "--weights", "random:1", "--device", device])));
    }
    let found = results(here);
    let [card, cpu] = ["card", "cpu"].map(|method| found.trials.iter().find(|row| row.key.method == method).unwrap());
    assert!(card.network_adapter.is_some() && card.network_adapter == card.renderer_adapter);
    assert_eq!((card.gaussians, cpu.gaussians, &cpu.network_adapter), (cpu.gaussians, card.gaussians, &None));
    let scores = |method: &str| -> Vec<f64> {
        found.targets.iter().filter(|row| row.key.method == method).map(|row| row.scores["psnr"]).collect()
    };
    Tolerance::absolute(0.02).assert(scores("card"), scores("cpu"), "PSNR");
}
