//! Determines how many loop iterations a driver allows: software Vulkan silently aborts loops after some ten thousand
//! iterations in total.

use super::GpuError;
use super::context::{Context, ITERATIONS_PER_ENTRY};
use super::kernels::{Kernel, Pipelines};
use super::record::Recorder;
use super::uniforms::MAX_VIEWS;
use crate::{MAX_SH_DEGREE, sh_coefficients};

/// Upper limit even for drivers without one: 2^16 entries of a tile's list per dispatch, which stays below the two
/// seconds after which Windows resets a device.
const MAX_ITERATIONS: u32 = ITERATIONS_PER_ENTRY << 16;
/// Least number: with fewer, splitting lists would cost more than rendering, and a thread could not sum the harmonics of a Gaussian
/// over the views of the largest batch (`unpack.wgsl`).
const MIN_ITERATIONS: u32 = ITERATIONS_PER_ENTRY << 8;
const _: () = assert!(MIN_ITERATIONS as usize >= 3 * sh_coefficients(MAX_SH_DEGREE) * MAX_VIEWS as usize);

/// Loop iterations that the driver allows.
pub(super) fn max_iterations(context: &Context, pipelines: &mut Pipelines) -> Result<u32, GpuError> {
    context.guarded(|| {
        let mut recorder = Recorder::new(context, pipelines);
        let result = context.buffer("probe", 8)?;
        recorder.dispatch(Kernel::Probe, bytemuck::bytes_of(&[MAX_ITERATIONS, 0, 0, 0]), &[&result], 1)?;
        let read = recorder.submit_and_read(&[(&result, 8)])?.contents.concat();
        let words: Vec<u32> = read.as_chunks().0.iter().map(|word| u32::from_le_bytes(*word)).collect();
        validated(&words).map_err(|found| GpuError::Unfit {
            adapter: context.name.clone(),
            what: "loop iterations",
            expected: format!("at least {MIN_ITERATIONS}"),
            found,
        })
    })
}

/// The allowed iterations from the probe's count and final state, or what is wrong with them.
fn validated(words: &[u32]) -> Result<u32, String> {
    let [made, state] = *words else { return Err("no result".to_owned()) };
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
    fn rejects_a_failed_probe() {
        let after =
            |iterations: u32| (0..iterations).fold(1u32, |s, _| s.wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
        assert_eq!(validated(&[MAX_ITERATIONS, after(MAX_ITERATIONS)]), Ok(MAX_ITERATIONS));
        assert_eq!(validated(&[65_535, after(65_535)]), Ok(65_535));
        for failed in [
            &[0, 0][..],
            &[MIN_ITERATIONS - 1, after(MIN_ITERATIONS - 1)],
            &[65_535, 0],
            &[MAX_ITERATIONS + 1, after(MAX_ITERATIONS + 1)],
            &[],
        ] {
            assert!(validated(failed).is_err(), "{failed:?}");
        }
    }
}
