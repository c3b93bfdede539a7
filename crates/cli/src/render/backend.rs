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

/// The renderer that a word stands for.
pub(crate) fn backend(word: BackendWord) -> anyhow::Result<Box<dyn Renderer>> {
    match word {
        BackendWord::Cpu => Ok(Box::new(CpuRenderer::default())),
        BackendWord::Reference => Ok(Box::new(ReferenceRenderer)),
        BackendWord::Gpu => bail!("this build renders on no GPU; --backend cpu draws the same pictures"),
    }
}
