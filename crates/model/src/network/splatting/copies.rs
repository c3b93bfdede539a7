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
    held: Vec<Box<dyn Any>>,
}

impl<'a> Copies<'a> {
    pub(super) fn new(renderer: &'a GpuRenderer) -> Self {
        let encoder = renderer.device().create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        Self { renderer, encoder, held: Vec::new() }
    }

    /// Copies numbers of a flat tensor to a new buffer.
    pub(super) fn out_of(
        &mut self,
        tensor: &FloatTensor<Cube>,
        first: usize,
        count: usize,
    ) -> Result<wgpu::Buffer, SplatError> {
        let buffer = self.buffer(count);
        let (memory, offset) = self.memory(tensor)?;
        if count > 0 {
            self.encoder.copy_buffer_to_buffer(&memory, offset + 4 * first as u64, &buffer, 0, 4 * count as u64);
        }
        Ok(buffer)
    }

    /// Copies numbers of a buffer to a new one.
    pub(super) fn of_buffer(&mut self, from: &wgpu::Buffer, first: usize, count: usize) -> wgpu::Buffer {
        let buffer = self.buffer(count);
        if count > 0 {
            self.encoder.copy_buffer_to_buffer(from, 4 * first as u64, &buffer, 0, 4 * count as u64);
        }
        buffer
    }

    fn buffer(&self, count: usize) -> wgpu::Buffer {
        use wgpu::BufferUsages;
        self.renderer.device().create_buffer(&wgpu::BufferDescriptor {
            label: Some("tensor"),
            size: (4 * count as u64).max(16),
            usage: BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        })
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
        let memory = memory.map_err(|error| self.refused(&error))?;
        let place = (memory.resource().buffer.clone(), memory.resource().offset);
        self.held.push(Box::new(memory));
        Ok(place)
    }

    fn refused(&self, error: &dyn std::fmt::Debug) -> SplatError {
        GpuError::Refused { adapter: self.renderer.adapter().to_owned(), reason: format!("{error:?}") }.into()
    }

    /// Submits the copies after all work that burn queued for a tensor.
    pub(super) fn submit(self, tensor: &FloatTensor<Cube>) -> Result<(), SplatError> {
        tensor.client.flush().map_err(|error| self.refused(&error))?;
        self.renderer.queue().submit([self.encoder.finish()]);
        Ok(())
    }
}
