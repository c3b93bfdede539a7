//! Copies between burn's tensors and the renderer's buffers, all within the device's memory.

use std::any::Any;

use atsplat_splat::SplatError;
use atsplat_splat::gpu::{GpuError, GpuRenderer};
use burn::backend::Cube;
use burn::backend::tensor::FloatTensor;
use burn::cubecl::wgpu::{AutoCompiler, WgpuServer};
use burn::tensor::wgpu::wgpu;

/// Copies in the order of the queue that burn and the renderer share.
pub(super) struct Copies<'a> {
    renderer: &'a GpuRenderer,
    encoder: wgpu::CommandEncoder,
    /// Memory that burn may neither free nor move until the copies are submitted.
    in_use: Vec<Box<dyn Any>>,
}

impl<'a> Copies<'a> {
    pub(super) fn new(renderer: &'a GpuRenderer) -> Result<Self, SplatError> {
        let descriptor = wgpu::CommandEncoderDescriptor::default();
        let encoder = renderer.guarded(|| Ok(renderer.device().create_command_encoder(&descriptor)))?;
        Ok(Self { renderer, encoder, in_use: Vec::new() })
    }

    /// Copies numbers of a flat tensor to a new buffer.
    pub(super) fn out_of(
        &mut self,
        tensor: &FloatTensor<Cube>,
        first: usize,
        count: usize,
    ) -> Result<wgpu::Buffer, SplatError> {
        let buffer = self.buffer(count)?;
        let (memory, offset) = self.memory(tensor)?;
        if count > 0 {
            self.encoder.copy_buffer_to_buffer(&memory, offset + 4 * first as u64, &buffer, 0, 4 * count as u64);
        }
        Ok(buffer)
    }

    /// Copies numbers of a buffer to a new one.
    pub(super) fn of_buffer(
        &mut self,
        from: &wgpu::Buffer,
        first: usize,
        count: usize,
    ) -> Result<wgpu::Buffer, SplatError> {
        let buffer = self.buffer(count)?;
        if count > 0 {
            self.encoder.copy_buffer_to_buffer(from, 4 * first as u64, &buffer, 0, 4 * count as u64);
        }
        Ok(buffer)
    }

    fn buffer(&self, count: usize) -> Result<wgpu::Buffer, SplatError> {
        use wgpu::BufferUsages;
        let descriptor = wgpu::BufferDescriptor {
            label: Some("tensor"),
            size: (4 * count as u64).max(16),
            usage: BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        };
        self.renderer.guarded(|| Ok(self.renderer.device().create_buffer(&descriptor)))
    }

    /// Copies the beginning of a buffer into a contiguous tensor.
    pub(super) fn fill_tensor(
        &mut self,
        buffer: &wgpu::Buffer,
        tensor: &FloatTensor<Cube>,
        first: usize,
        count: usize,
    ) -> Result<(), SplatError> {
        let (memory, offset) = self.memory(tensor)?;
        if count > 0 {
            self.encoder.copy_buffer_to_buffer(buffer, 0, &memory, offset + 4 * first as u64, 4 * count as u64);
        }
        Ok(())
    }

    /// The buffer of a tensor, and the byte offset of its first number.
    fn memory(&mut self, tensor: &FloatTensor<Cube>) -> Result<(wgpu::Buffer, u64), SplatError> {
        let memory = tensor.client.get_resource::<WgpuServer<AutoCompiler>>(tensor.handle.clone());
        let memory = memory.map_err(|error| self.failed(&error))?;
        let place = (memory.resource().buffer.clone(), memory.resource().offset);
        self.in_use.push(Box::new(memory));
        Ok(place)
    }

    fn failed(&self, error: &dyn std::fmt::Debug) -> SplatError {
        GpuError::Rejected { adapter: self.renderer.adapter().to_owned(), reason: format!("{error:?}") }.into()
    }

    /// Submits the copies after all work that burn queued for a tensor.
    pub(super) fn submit(self, tensor: &FloatTensor<Cube>) -> Result<(), SplatError> {
        tensor.client.flush().map_err(|error| self.failed(&error))?;
        let Self { renderer, encoder, in_use } = self;
        let submitted = renderer.guarded(|| {
            renderer.queue().submit([encoder.finish()]);
            Ok(())
        });
        drop(in_use);
        submitted
    }
}

#[cfg(test)]
mod tests {
    use atsplat_splat::gpu::{AdapterChoice, GpuOptions, SelfTestKey, SelfTestObserver, SelfTestResult};
    use atsplat_tests::skip_without_graphics;

    use super::*;

    /// No kernels run here.
    struct Trusting;

    impl SelfTestObserver for Trusting {
        fn cached(&self, _key: &SelfTestKey) -> Option<SelfTestResult> {
            Some(SelfTestResult { fault: None })
        }
    }

    /// Otherwise the next call of the renderer would report it, or wgpu would panic.
    #[test]
    fn a_buffer_that_cannot_be_allocated_is_an_error_at_once() {
        let opened = GpuRenderer::observed(&AdapterChoice::Automatic, GpuOptions::default(), &Trusting);
        let renderer = match opened {
            Ok(renderer) => renderer,
            Err(error @ GpuError::NoAdapter { .. }) => {
                skip_without_graphics("model copies", error);
                return;
            }
            Err(error) => panic!("{error}"),
        };
        let mut copies = Copies::new(&renderer).unwrap();
        let few = copies.buffer(7).unwrap();
        assert_eq!(few.size(), 28);
        for outcome in [copies.buffer(1 << 60), copies.of_buffer(&few, 0, 1 << 60)] {
            let reason = outcome.unwrap_err();
            let is_of_this_call = !reason.to_string().contains("outside");
            assert!(
                is_of_this_call
                    && matches!(reason, SplatError::Gpu(GpuError::Rejected { .. } | GpuError::OutOfMemory { .. })),
                "{reason}"
            );
        }
        assert_eq!(copies.of_buffer(&few, 2, 5).unwrap().size(), 20);
    }
}
