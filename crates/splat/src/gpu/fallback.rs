use super::adapters::{AdapterChoice, Candidates, candidates, named};
use super::{GpuError, GpuOptions, GpuRenderer, Watcher};
use crate::Renderer;
use crate::cpu::{CpuOptions, CpuRenderer};

/// A renderer, and why it is not the one that comes first.
pub struct Fallback {
    /// On an adapter, or on the processor.
    pub renderer: Box<dyn Renderer>,
    /// Why each adapter before it cannot be used, best first: for a warning. [`GpuError::NoAdapter`] alone where there
    /// is none at all.
    pub passed_over: Vec<GpuError>,
}

impl std::fmt::Debug for Fallback {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter
            .debug_struct("Fallback")
            .field("renderer", &self.renderer.name())
            .field("passed_over", &self.passed_over)
            .finish()
    }
}

/// The renderer on the first adapter of a choice that passes its test, or the processor's where none does. Several
/// adapters may fit: a card by way of Vulkan and of GL, one beside the main processor.
///
/// Only opening falls back. An adapter that is lost later, runs out of memory or cannot hold a scene answers with an
/// error, and the caller may go on with [`CpuRenderer`]. Software adapters are adapters like others, and far slower
/// than [`CpuRenderer`].
///
/// # Errors
/// [`GpuError::NoAdapter`] where an adapter was named, by the choice or by [`super::ADAPTER_VARIABLE`], and there is
/// none of that name.
pub fn with_fallback(
    choice: &AdapterChoice,
    options: GpuOptions,
    cpu: CpuOptions,
    watcher: &dyn Watcher,
) -> Result<Fallback, GpuError> {
    let Candidates { adapters, none } = candidates(choice);
    if adapters.is_empty() && named(choice) != AdapterChoice::Automatic {
        return Err(none);
    }
    let none = if adapters.is_empty() { vec![none] } else { Vec::new() };
    let (opened, mut passed_over) = first_success(adapters, |adapter| GpuRenderer::open(&adapter, options, watcher));
    passed_over.extend(none);
    let renderer: Box<dyn Renderer> = match opened {
        Some(renderer) => Box::new(renderer),
        None => Box::new(CpuRenderer::new(cpu)),
    };
    Ok(Fallback { renderer, passed_over })
}

/// The first success, and the failures before it.
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
    fn the_next_is_tried_and_none_after_it() {
        let even = |number: i32| if number % 2 == 0 { Ok(number) } else { Err(number) };
        assert_eq!(first_success([1, 3, 4, 5, 6], even), (Some(4), vec![1, 3]));
        assert_eq!(first_success([1, 3], even), (None, vec![1, 3]));
        assert_eq!(first_success([], even), (None, Vec::<i32>::new()));
    }
}
