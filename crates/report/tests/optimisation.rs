//! What `reports/optimisation` says is what its stores contain.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use atsplat_results::Results;
use atsplat_results::statistics::{Identical, Leaked, MetricQuery, by_overlap, summary};

/// A column of the page's tables: a store, and a bin of overlap if it has several.
struct Column {
    store: &'static str,
    bin: Option<&'static str>,
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../reports/optimisation")
}

/// PSNR of held-out targets and, for optimised methods, of context views: `22.37 / 25.2`.
fn cell(results: &Results, method: &str, bin: Option<&str>) -> String {
    let preset = &results.provenance.presets[0];
    let protocol = preset.protocol().unwrap();
    let query = MetricQuery {
        preset: &preset.name,
        method,
        metric: "psnr",
        leaked: Leaked::Excluded,
        identical: Identical::Excluded,
    };
    let (held_out, bins) = match bin {
        None => (summary(results, &query, protocol.aggregation), None),
        Some(name) => {
            let bins = protocol.overlap_bins.unwrap();
            let by_name: BTreeMap<_, _> =
                by_overlap(results, &query, &bins, protocol.aggregation).bins.into_iter().collect();
            (by_name[name].clone(), Some(bins))
        }
    };
    let is_in_bin =
        |overlap: Option<f64>| bin.is_none_or(|bin| bins.as_ref().unwrap().name_of(overlap.unwrap()) == Some(bin));
    let trials = results.trials.iter().filter(|trial| trial.key.method == method && is_in_bin(trial.overlap));
    let context: Vec<f64> = trials.filter_map(|trial| trial.context_psnr).collect();
    let held_out = format!("{:.2}", held_out.mean.unwrap());
    if context.is_empty() {
        return held_out;
    }
    format!("{held_out} / {:.1}", context.iter().sum::<f64>() / context.len() as f64)
}

fn check(table: &str, columns: &[Column], rows: &[(&str, &[&str])]) {
    let readme = std::fs::read_to_string(folder().join("README.md")).unwrap().replace("**", "");
    let (_, text) = readme.split_once(&format!("\n| {table} |")).unwrap();
    let stores: Vec<Results> =
        columns.iter().map(|column| Results::read(&folder().join(column.store)).unwrap()).collect();
    for (label, methods) in rows {
        let line = text.lines().find(|line| line.starts_with(&format!("| {label} |"))).unwrap();
        let cells: Vec<&str> = line.split('|').map(str::trim).collect();
        // The last columns of a line, which ends with a bar.
        let cells = &cells[cells.len() - 1 - columns.len()..];
        let mut compared = 0;
        for ((Column { bin, store }, results), found) in columns.iter().zip(&stores).zip(cells) {
            let has = |method: &&str| results.trials.iter().any(|trial| trial.key.method == *method);
            let expected: Vec<String> =
                methods.iter().filter(|method| has(method)).map(|method| cell(results, method, *bin)).collect();
            let expected = expected.join(", ");
            assert!(found.starts_with(&expected), "{store}, {bin:?}, {line}: {expected}");
            compared += usize::from(!expected.is_empty());
        }
        assert!(compared > 0, "{line}");
    }
}

#[test]
fn tables_of_optimisation_are_those_of_the_stores() {
    let whole = |store| Column { store, bin: None };
    let refined: [(&str, &[&str]); 4] = [
        ("network", &["network"]),
        ("+ 10 steps", &["network + 10 steps"]),
        ("+ 100 steps", &["network + 100 steps"]),
        ("+ 1000 steps", &["network + 1000 steps"]),
    ];
    check("two views, `rooms-2v`", &[whole("rooms-2v")], &refined);
    let bins = ["small", "medium", "large"].map(|bin| Column { store: "rooms-overlap", bin: Some(bin) });
    check("by overlap, `rooms-overlap`", &bins, &refined);
    let scratch: [(&str, &[&str]); 2] =
        [("MCMC, 100 steps", &["MCMC 100 steps"]), ("MCMC, 1000 steps", &["MCMC 1000 steps"])];
    check("by overlap, `rooms-overlap`", &bins, &scratch);
    let real = "PSNR, held out / context";
    check(real, &[whole("re10k"), whole("desk"), whole("photos")], &refined);
    let seconds: [(&str, &[&str]); 4] = [
        ("3DGS, 1 and 10 s", &["3DGS 1 s", "3DGS 10 s"]),
        ("Mip-Splatting, 1 and 10 s", &["Mip-Splatting 1 s", "Mip-Splatting 10 s"]),
        ("MCMC, 1 and 10 s", &["MCMC 1 s", "MCMC 10 s"]),
        ("3DGS, Mip-Splatting, MCMC, 60 s", &["3DGS 60 s", "Mip-Splatting 60 s", "MCMC 60 s"]),
    ];
    check(real, &[whole("re10k"), whole("desk"), whole("photos")], &seconds);
    let minutes: (&str, &[&str]) = ("the same, 300 s", &["3DGS 300 s", "Mip-Splatting 300 s", "MCMC 300 s"]);
    check(real, &[whole("desk-300"), whole("photos")], &[minutes]);
}
