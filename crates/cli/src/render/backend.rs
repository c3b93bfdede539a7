use anyhow::Context;
use atsplat_splat::cpu::{CpuOptions, CpuRenderer};
use atsplat_splat::gpu::{AdapterChoice, Fallback, GpuOptions, with_fallback};
use atsplat_splat::{ReferenceRenderer, Renderer};
use clap::ValueEnum;

use crate::adapter_tests::AdapterTests;

/// Who renders.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum BackendWord {
    /// Every core, vector instructions, f32 pixels.
    Cpu,
    /// A graphics card.
    Gpu,
    /// The slow, obvious f64.
    Reference,
}

/// A renderer, and why it is not the one that was asked for.
pub(crate) struct Backend {
    pub(crate) renderer: Box<dyn Renderer>,
    pub(crate) note: Option<String>,
}

/// The renderer that a word stands for. Another adapter or the processor takes over from one that fails.
///
/// # Errors
/// For an adapter that was asked for and does not exist.
pub(crate) fn backend(word: BackendWord, adapter: Option<&AdapterChoice>) -> anyhow::Result<Backend> {
    let here = |renderer: Box<dyn Renderer>| Backend { renderer, note: None };
    Ok(match word {
        BackendWord::Cpu => here(Box::<CpuRenderer>::default()),
        BackendWord::Reference => here(Box::new(ReferenceRenderer)),
        BackendWord::Gpu => {
            let choice = adapter.cloned().unwrap_or_default();
            let tests = AdapterTests::new(false);
            let Fallback { renderer, passed_over } =
                with_fallback(&choice, GpuOptions::default(), CpuOptions::default(), &tests).context("--adapter")?;
            tests.finish();
            let reasons: Vec<String> = passed_over.iter().map(ToString::to_string).collect();
            let note = (!reasons.is_empty()).then(|| format!("{} renders: {}", renderer.name(), reasons.join("; ")));
            Backend { renderer, note }
        }
    })
}

/// Parses `--adapter`.
pub(crate) fn adapter(word: &str) -> Result<AdapterChoice, String> {
    if word.is_empty() {
        return Err("expected a number or a part of a name; `atsplat adapters` tells those that there are".to_owned());
    }
    Ok(word.parse().map_or_else(|_| AdapterChoice::Name(word.to_owned()), AdapterChoice::Index))
}
