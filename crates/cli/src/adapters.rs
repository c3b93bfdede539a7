//! `atsplat adapters`: what `--device wgpu:N` can run on.

use std::fmt;

use atsplat_splat::gpu::{ExaminedAdapter, examine};
use serde::Serialize;

use crate::adapter_self_test::AdapterSelfTests;
use crate::print::print_report;

#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Repeat tests whose results are cached for the same driver and the same kernels.
    #[arg(long)]
    again: bool,

    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// Lists adapters; having none is not a failure.
pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let tests = AdapterSelfTests::new(args.again);
    let examined = examine(&tests);
    tests.finish();
    let rows = examined.into_iter().enumerate().map(|(number, adapter)| Row::of(number, adapter)).collect();
    print_report(&Report { adapters: rows }, args.json)
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
struct Report {
    adapters: Vec<Row>,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
struct Row {
    number: usize,
    name: String,
    backend: String,
    kind: String,
    driver: String,
    largest_binding_bytes: u64,
    /// `None` if image and gradients are correct.
    fault: Option<String>,
    /// Whether the result comes from an earlier test.
    cached: bool,
}

impl Row {
    fn of(number: usize, ExaminedAdapter { description, outcome, cached }: ExaminedAdapter) -> Self {
        Self {
            number,
            name: description.name,
            backend: description.backend,
            kind: description.kind.name().to_owned(),
            driver: description.driver,
            largest_binding_bytes: description.largest_binding,
            fault: outcome.err().map(|fault| fault.to_string()),
            cached,
        }
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.adapters.is_empty() {
            return writeln!(f, "no graphics adapter: only --device cpu can be used");
        }
        for Row { number, name, backend, kind, driver, largest_binding_bytes, fault, cached } in &self.adapters {
            let mebibytes = largest_binding_bytes >> 20;
            writeln!(f, "{number}  {name} ({backend}), {kind}, {driver}, buffers of {mebibytes} MiB")?;
            let result = fault.as_deref().unwrap_or("passes its test: an image and its gradients");
            let note = if *cached { " (tested before; --again tests it again)" } else { "" };
            writeln!(f, "   {result}{note}")?;
        }
        Ok(())
    }
}
