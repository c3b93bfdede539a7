//! Software Vulkan ends all loops of a kernel together after some ten thousand turns, and says nothing.

use super::GpuError;
use super::context::Context;
use super::kernels::{Kernel, Pipelines};
use super::record::Recorder;

/// More turns than any kernel takes whose lists were not cut.
const WANTED: u32 = 1 << 18;

/// Turns that loops may take together, `u32::MAX` where the driver does not count.
pub(super) fn turns(context: &Context, pipelines: &mut Pipelines) -> Result<u32, GpuError> {
    context.guarded(|| {
        let mut recorder = Recorder::new(context, pipelines);
        let result = context.buffer("probe", 8)?;
        recorder.dispatch(Kernel::Probe, bytemuck::bytes_of(&[WANTED, 0, 0, 0]), &[&result], 1)?;
        recorder.submit();
        let read = context.read(&[(&result, 8)])?.concat();
        let words: Vec<u32> = read.as_chunks().0.iter().map(|word| u32::from_le_bytes(*word)).collect();
        let state = (0..WANTED).fold(1u32, |state, _| state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223));
        let made = words.first().copied().unwrap_or_default();
        Ok(if words == [WANTED, state] { u32::MAX } else { made.min(WANTED) })
    })
}
