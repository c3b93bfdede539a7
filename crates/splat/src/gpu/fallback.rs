use super::adapters::{AdapterChoice, AdapterDescription, Candidates, candidates, resolve};
use super::{GpuError, GpuOptions, GpuRenderer, SelfTestObserver};
use crate::Renderer;
use crate::cpu::{CpuOptions, CpuRenderer};

/// The chosen renderer, and why better candidates could not be used.
pub struct ChosenRenderer {
    /// On a GPU, or on the CPU.
    pub renderer: Box<dyn Renderer>,
    /// Its adapter; `None` for the CPU.
    pub adapter: Option<AdapterDescription>,
    /// Why each adapter before it cannot be used, best first, for a warning. A single [`GpuError::NoAdapter`] if there
    /// are no adapters.
    pub skipped: Vec<GpuError>,
}

impl std::fmt::Debug for ChosenRenderer {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter
            .debug_struct("ChosenRenderer")
            .field("renderer", &self.renderer.name())
            .field("adapter", &self.adapter)
            .field("skipped", &self.skipped)
            .finish()
    }
}

/// The renderer on the first adapter matching a choice that passes its self-test, or the CPU renderer if none does.
/// Several adapters may match, for example a GPU through both Vulkan and GL.
///
/// Falls back only on opening. An adapter that is later lost, runs out of memory or cannot hold a scene returns an
/// error, after which the caller may continue with [`CpuRenderer`]. Software adapters are not treated specially, and
/// are far slower than [`CpuRenderer`].
///
/// # Errors
/// [`GpuError::NoAdapter`] if an adapter was named, by the choice or by [`super::ADAPTER_VARIABLE`], and none matches.
pub fn with_fallback(
    choice: &AdapterChoice,
    options: GpuOptions,
    cpu: CpuOptions,
    observer: &dyn SelfTestObserver,
) -> Result<ChosenRenderer, GpuError> {
    let Candidates { adapters, none } = candidates(choice);
    if adapters.is_empty() && resolve(choice) != AdapterChoice::Automatic {
        return Err(none);
    }
    let none = if adapters.is_empty() { vec![none] } else { Vec::new() };
    let (opened, mut skipped) = first_success(adapters, |candidate| {
        GpuRenderer::open(&candidate, options, observer).map(|renderer| (renderer, candidate.1))
    });
    skipped.extend(none);
    for reason in &skipped {
        tracing::info!(%reason, "graphics adapter skipped");
    }
    let (opened, adapter) = opened.unzip();
    let renderer: Box<dyn Renderer> = match opened {
        Some(renderer) => Box::new(renderer),
        None => Box::new(CpuRenderer::new(cpu)),
    };
    tracing::info!(renderer = renderer.name(), "chose a renderer");
    Ok(ChosenRenderer { renderer, adapter, skipped })
}

/// The first candidate that opens, and the failures before it.
fn first_success<A, R, E>(
    candidates: impl IntoIterator<Item = A>,
    mut open: impl FnMut(A) -> Result<R, E>,
) -> (Option<R>, Vec<E>) {
    let mut failures = Vec::new();
    for candidate in candidates {
        match open(candidate) {
            Ok(opened) => return (Some(opened), failures),
            Err(failure) => failures.push(failure),
        }
    }
    (None, failures)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn candidates_are_tried_until_one_opens() {
        let even = |number: i32| if number % 2 == 0 { Ok(number) } else { Err(number) };
        assert_eq!(first_success([1, 3, 4, 5, 6], even), (Some(4), vec![1, 3]));
        assert_eq!(first_success([1, 3], even), (None, vec![1, 3]));
        assert_eq!(first_success([], even), (None, Vec::<i32>::new()));
    }
}
