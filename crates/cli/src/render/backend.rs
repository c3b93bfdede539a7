use atsplat_splat::cpu::{CpuOptions, CpuRenderer};
use atsplat_splat::gpu::{AdapterChoice, Fallback, GpuOptions, with_fallback};
use atsplat_splat::{ReferenceRenderer, Renderer};
use clap::ValueEnum;

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

/// The renderer that a word stands for. The processor takes over from an adapter that fails.
pub(crate) fn backend(word: BackendWord, adapter: Option<&AdapterChoice>) -> Backend {
    let here = |renderer: Box<dyn Renderer>| Backend { renderer, note: None };
    match word {
        BackendWord::Cpu => here(Box::<CpuRenderer>::default()),
        BackendWord::Reference => here(Box::new(ReferenceRenderer)),
        BackendWord::Gpu => {
            let choice = adapter.cloned().unwrap_or_default();
            let Fallback { renderer, reason } = with_fallback(&choice, GpuOptions::default(), CpuOptions::default());
            Backend { renderer, note: reason.map(|reason| format!("the processor renders: {reason}")) }
        }
    }
}

/// Parses `--adapter`.
pub(crate) fn adapter(word: &str) -> Result<AdapterChoice, String> {
    if word.is_empty() {
        return Err("expected a number or a part of a name; `atsplat adapters` tells those that there are".to_owned());
    }
    Ok(word.parse().map_or_else(|_| AdapterChoice::Name(word.to_owned()), AdapterChoice::Index))
}
