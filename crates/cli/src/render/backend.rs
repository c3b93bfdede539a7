use anyhow::bail;
use atsplat_splat::cpu::CpuRenderer;
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

/// The renderer that a word stands for.
pub(crate) fn backend(word: BackendWord) -> anyhow::Result<Backend> {
    let renderer: Box<dyn Renderer> = match word {
        BackendWord::Cpu => Box::new(CpuRenderer::default()),
        BackendWord::Reference => Box::new(ReferenceRenderer),
        BackendWord::Gpu => bail!("this build renders on no GPU; --backend cpu draws the same pictures"),
    };
    Ok(Backend { renderer, note: None })
}
