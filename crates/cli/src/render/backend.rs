use anyhow::Context;
use atsplat_eval::method;
use atsplat_results::AdapterRecord;
use atsplat_splat::cpu::{CpuOptions, CpuRenderer};
use atsplat_splat::gpu::{AdapterChoice, ChosenRenderer, GpuOptions, with_fallback};
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

impl Backend {
    /// The same for methods, which render on many threads. On the CPU each thread has a renderer of its own: a single one would
    /// wait for threads of the pool that wait for it.
    pub(crate) fn for_methods(self, arg: BackendArg) -> method::Backend {
        if arg != BackendArg::Reference && self.adapter.is_none() {
            return method::Backend::default();
        }
        method::Backend::shared(self.renderer, self.adapter)
    }
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
            let ChosenRenderer { renderer, adapter, skipped } =
                with_fallback(&choice, GpuOptions::default(), CpuOptions::default(), &tests).context("--adapter")?;
            tests.finish();
            let reasons: Vec<String> = skipped.iter().map(ToString::to_string).collect();
            let note = (!reasons.is_empty()).then(|| format!("{} renders: {}", renderer.name(), reasons.join("; ")));
            Backend { renderer, adapter: adapter.as_ref().map(atsplat_eval::adapter_record), note }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn methods_share_no_renderer_of_the_cpu() {
        let fallback = || Backend { renderer: Box::<CpuRenderer>::default(), adapter: None, note: None };
        for arg in [BackendArg::Gpu, BackendArg::Cpu] {
            assert!(matches!(fallback().for_methods(arg), method::Backend::Cpu(_)), "{arg:?}");
        }
        let reference = backend(BackendArg::Reference, None).unwrap().for_methods(BackendArg::Reference);
        assert_eq!(reference.name(), "reference");
        let adapter = Some(AdapterRecord::default());
        let on_adapter = Backend { adapter: adapter.clone(), ..fallback() }.for_methods(BackendArg::Gpu);
        assert_eq!(on_adapter.adapter(), adapter.as_ref());
    }
}
