use std::collections::HashMap;

use super::context::Context;
use super::kernels::Kernel;

/// Recordings for which an unused bind group is kept: a forward and a backward pass, and the reading of both.
const KEPT: u64 = 4;

/// What a bind group depends on: the kernel, its uniform block and its buffers, from binding 1 on.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(super) struct Bindings {
    pub(super) kernel: Kernel,
    pub(super) uniforms: wgpu::Buffer,
    pub(super) offset: u64,
    pub(super) bytes: u64,
    pub(super) buffers: Vec<wgpu::Buffer>,
}

/// Bind groups of the last recordings, to be used again: to make them takes the host as long as all else about a picture.
/// They also keep their buffers alive.
#[derive(Clone, Debug, Default)]
pub(super) struct BindGroups {
    kept: HashMap<Bindings, Kept>,
    recordings: u64,
}

#[derive(Clone, Debug)]
struct Kept {
    group: wgpu::BindGroup,
    /// The last recording that used it.
    recording: u64,
}

#[expect(clippy::mutable_key_type, reason = "wgpu compares buffers by identity")]
impl BindGroups {
    /// Begins a recording: drops bind groups that were not used for long.
    pub(super) fn begin_recording(&mut self) {
        self.recordings += 1;
        self.kept.retain(|_, kept| kept.recording + KEPT >= self.recordings);
    }

    /// A bind group of this layout.
    pub(super) fn get(
        &mut self,
        context: &Context,
        layout: &wgpu::BindGroupLayout,
        bindings: Bindings,
    ) -> wgpu::BindGroup {
        let recording = self.recordings;
        let make = |bindings: &Bindings| Kept { group: make(context, layout, bindings), recording };
        let kept = self.kept.entry(bindings).or_insert_with_key(make);
        kept.recording = recording;
        kept.group.clone()
    }

    /// Drops all, and with them buffers that nothing else needs.
    pub(super) fn clear(&mut self) {
        self.kept.clear();
    }
}

fn make(context: &Context, layout: &wgpu::BindGroupLayout, bindings: &Bindings) -> wgpu::BindGroup {
    context.counters.bind_groups.add(1);
    let uniform = wgpu::BindingResource::Buffer(wgpu::BufferBinding {
        buffer: &bindings.uniforms,
        offset: bindings.offset,
        size: wgpu::BufferSize::new(bindings.bytes),
    });
    let storage = bindings.buffers.iter().map(|buffer| bound(context, buffer));
    let entries: Vec<_> = (0..)
        .zip(std::iter::once(uniform).chain(storage))
        .map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource })
        .collect();
    context.device.create_bind_group(&wgpu::BindGroupDescriptor { label: None, layout, entries: &entries })
}

/// Binds as much of a buffer as possible; buffers of the caller may be too long, or end within a word.
fn bound<'b>(context: &Context, buffer: &'b wgpu::Buffer) -> wgpu::BindingResource<'b> {
    let size = buffer.size().min(context.binding_limit.max(256)) & !3;
    wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer, offset: 0, size: wgpu::BufferSize::new(size) })
}
