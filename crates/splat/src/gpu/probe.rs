//! Software Vulkan ends all loops of a kernel together after some ten thousand iterations, and says nothing.

use super::GpuError;
use super::context::{Context, ITERATIONS_PER_ENTRY};
use super::kernels::{Kernel, Pipelines};
use super::record::Recorder;

/// Turns that loops take at most, also where drivers do not count them: a tile's list is passed over 2^16 entries at a
/// time, which keeps no device busy for the two seconds after which Windows resets it.
const MAX_ITERATIONS: u32 = ITERATIONS_PER_ENTRY << 16;
/// With fewer, cutting lists would cost more than rendering.
const MIN_ITERATIONS: u32 = ITERATIONS_PER_ENTRY << 6;

/// Turns that loops may take together.
pub(super) fn max_iterations(context: &Context, pipelines: &mut Pipelines) -> Result<u32, GpuError> {
    context.guarded(|| {
        let mut recorder = Recorder::new(context, pipelines);
        let result = context.buffer("probe", 8)?;
        recorder.dispatch(Kernel::Probe, bytemuck::bytes_of(&[MAX_ITERATIONS, 0, 0, 0]), &[&result], 1)?;
        recorder.submit();
        let read = context.read(&[(&result, 8)])?.concat();
        let words: Vec<u32> = read.as_chunks().0.iter().map(|word| u32::from_le_bytes(*word)).collect();
        usable(&words).map_err(|found| GpuError::Unfit {
            adapter: context.name.clone(),
            what: "iterations of a loop",
            expected: format!("at least {MIN_ITERATIONS}"),
            found,
        })
    })
}

/// What the probe's iterations and what they led to allow, or what is wrong with them.
fn usable(words: &[u32]) -> Result<u32, String> {
    let [made, state] = *words else { return Err("no answer".to_owned()) };
    if !(MIN_ITERATIONS..=MAX_ITERATIONS).contains(&made) {
        return Err(made.to_string());
    }
    let expected = (0..made).fold(1u32, |state, _| state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
    if state == expected { Ok(made) } else { Err(format!("{made} with a wrong result")) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_probe_that_failed_allows_nothing() {
        let after =
            |iterations: u32| (0..iterations).fold(1u32, |s, _| s.wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
        assert_eq!(usable(&[MAX_ITERATIONS, after(MAX_ITERATIONS)]), Ok(MAX_ITERATIONS));
        assert_eq!(usable(&[65_535, after(65_535)]), Ok(65_535));
        for failed in [
            &[0, 0][..],
            &[MIN_ITERATIONS - 1, after(MIN_ITERATIONS - 1)],
            &[65_535, 0],
            &[MAX_ITERATIONS + 1, after(MAX_ITERATIONS + 1)],
            &[],
        ] {
            assert!(usable(failed).is_err(), "{failed:?}");
        }
    }
}
