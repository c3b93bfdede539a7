//! `atsplat adapters`: what `--backend gpu` can render on.

use std::fmt;

use atsplat_splat::gpu::{AdapterChoice, AdapterDescription, GpuOptions, GpuRenderer, adapters};
use clap::Args;
use serde::Serialize;

use crate::output::print_report;

#[derive(Debug, Args)]
pub(crate) struct Words {
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// Lists adapters; `true`, since none is no failure.
pub(crate) fn run(words: &Words) -> anyhow::Result<bool> {
    let rows = adapters().into_iter().enumerate().map(|(number, adapter)| Row::of(number, &adapter)).collect();
    print_report(&Report { adapters: rows }, words.json)?;
    Ok(true)
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
    /// `None` where the picture and its derivative are right.
    fault: Option<String>,
}

impl Row {
    fn of(number: usize, adapter: &AdapterDescription) -> Self {
        let tested = GpuRenderer::new(&AdapterChoice::Index(number), GpuOptions::default());
        Self {
            number,
            name: adapter.name.clone(),
            backend: adapter.backend.clone(),
            kind: format!("{:?}", adapter.kind).to_lowercase(),
            driver: adapter.driver.clone(),
            largest_binding_bytes: adapter.largest_binding,
            fault: tested.err().map(|fault| fault.to_string()),
        }
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.adapters.is_empty() {
            return writeln!(f, "no graphics adapter; the processor renders");
        }
        for Row { number, name, backend, kind, driver, largest_binding_bytes, fault } in &self.adapters {
            let mebibytes = largest_binding_bytes >> 20;
            writeln!(f, "{number}  {name} ({backend}), {kind}, {driver}, buffers of {mebibytes} MiB")?;
            writeln!(f, "   {}", fault.as_deref().unwrap_or("passes its test: a picture and its derivative"))?;
        }
        Ok(())
    }
}
