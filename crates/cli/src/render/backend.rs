use anyhow::Context;
use atsplat_eval::AdapterRecord;
use atsplat_splat::cpu::{CpuOptions, CpuRenderer};
use atsplat_splat::gpu::{AdapterChoice, AdapterDescription, ChosenRenderer, GpuOptions, adapters, with_fallback};
use atsplat_splat::{ReferenceRenderer, Renderer};
use clap::ValueEnum;

use crate::adapter_self_test::AdapterSelfTests;

/// The renderer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum BackendArg {
    /// CPU, with all cores, vector instructions and f32 pixels.
    Cpu,
    /// GPU.
    Gpu,
    /// CPU, the slow and simple reference in f64.
    Reference,
}

/// A renderer, and why it is not the requested one.
pub(crate) struct Backend {
    pub(crate) renderer: Box<dyn Renderer>,
    /// The renderer's graphics adapter; `None` for the CPU.
    pub(crate) adapter: Option<AdapterRecord>,
    pub(crate) note: Option<String>,
}

/// Opens a renderer. If the requested adapter fails its test, another adapter or the CPU replaces it.
///
/// # Errors
/// If the requested adapter does not exist.
pub(crate) fn backend(arg: BackendArg, adapter: Option<&AdapterChoice>) -> anyhow::Result<Backend> {
    let requested = |renderer: Box<dyn Renderer>| Backend { renderer, adapter: None, note: None };
    Ok(match arg {
        BackendArg::Cpu => requested(Box::<CpuRenderer>::default()),
        BackendArg::Reference => requested(Box::new(ReferenceRenderer)),
        BackendArg::Gpu => {
            let choice = adapter.cloned().unwrap_or_default();
            let tests = AdapterSelfTests::new(false);
            let ChosenRenderer { renderer, skipped } =
                with_fallback(&choice, GpuOptions::default(), CpuOptions::default(), &tests).context("--adapter")?;
            tests.finish();
            let reasons: Vec<String> = skipped.iter().map(ToString::to_string).collect();
            let note = (!reasons.is_empty()).then(|| format!("{} renders: {}", renderer.name(), reasons.join("; ")));
            let is_used = |adapter: &AdapterDescription| renderer.name() == format!("gpu, {adapter}");
            let adapter = adapters().iter().find(|adapter| is_used(adapter)).map(AdapterRecord::from);
            Backend { renderer, adapter, note }
        }
    })
}

/// Parses `--adapter`.
pub(crate) fn adapter(text: &str) -> Result<AdapterChoice, String> {
    if text.is_empty() {
        return Err("expected a number or a part of a name; `atsplat adapters` lists the adapters".to_owned());
    }
    Ok(text.parse().map_or_else(|_| AdapterChoice::Name(text.to_owned()), AdapterChoice::Index))
}
