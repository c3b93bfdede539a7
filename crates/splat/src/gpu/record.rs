use super::GpuError;
use super::context::Context;
use super::kernels::{Kernel, Pipelines};

/// Bytes of the uniform buffer of one submission.
const UNIFORM_BYTES: usize = 64 << 10;
/// Offset alignment that every adapter accepts.
const UNIFORM_STEP: usize = 256;
/// Timed runs of stages: two timestamps each, up to wgpu's limit per query set.
const MAX_RUNS: u32 = 2048;

/// Records commands for the device: dispatches within named stages.
#[derive(Debug)]
pub(super) struct Recorder<'a> {
    context: &'a Context,
    pipelines: &'a mut Pipelines,
    encoder: wgpu::CommandEncoder,
    pass: Option<wgpu::ComputePass<'static>>,
    uniforms: Vec<u8>,
    uniform_buffer: wgpu::Buffer,
    clock: Option<wgpu::QuerySet>,
    stage: Option<&'static str>,
    /// The stage of each timed run.
    timed: Vec<&'static str>,
    /// Whether some run was not timed.
    is_incomplete: bool,
}

impl<'a> Recorder<'a> {
    pub(super) fn new(context: &'a Context, pipelines: &'a mut Pipelines) -> Self {
        let clock = context.timestamps.then(|| {
            context.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: None,
                ty: wgpu::QueryType::Timestamp,
                count: 2 * MAX_RUNS,
            })
        });
        Self {
            context,
            pipelines,
            encoder: encoder(context),
            pass: None,
            uniforms: Vec::new(),
            uniform_buffer: uniform_buffer(context),
            clock,
            stage: None,
            timed: Vec::new(),
            is_incomplete: false,
        }
    }

    pub(super) const fn context(&self) -> &'a Context {
        self.context
    }

    /// Begins a stage.
    pub(super) fn stage(&mut self, name: &'static str) {
        self.pass = None;
        self.stage = Some(name);
    }

    /// The current compute pass, or a new one; commands other than dispatches end a pass.
    fn pass(&mut self) -> &mut wgpu::ComputePass<'static> {
        let Self { encoder, stage, clock, timed, is_incomplete, .. } = self;
        self.pass.get_or_insert_with(|| {
            let at = u32::try_from(timed.len()).unwrap_or(MAX_RUNS);
            let clock = clock.as_ref().filter(|_| at < MAX_RUNS);
            match (&clock, *stage) {
                (Some(_), Some(name)) => timed.push(name),
                _ => *is_incomplete = true,
            }
            let timestamp_writes =
                clock.filter(|_| stage.is_some()).map(|query_set| wgpu::ComputePassTimestampWrites {
                    query_set,
                    beginning_of_pass_write_index: Some(2 * at),
                    end_of_pass_write_index: Some(2 * at + 1),
                });
            encoder
                .begin_compute_pass(&wgpu::ComputePassDescriptor { label: *stage, timestamp_writes })
                .forget_lifetime()
        })
    }

    /// Dispatches a kernel over workgroups, with its uniform block at binding 0 and its buffers from binding 1 on.
    pub(super) fn dispatch(
        &mut self,
        kernel: Kernel,
        uniform: &[u8],
        buffers: &[&wgpu::Buffer],
        groups: u64,
    ) -> Result<(), GpuError> {
        if groups == 0 {
            return Ok(());
        }
        let device = &self.context.device;
        let pipeline = self.pipelines.get(self.context, kernel);
        let offset = self.place_uniform(uniform);
        let block = wgpu::BindingResource::Buffer(wgpu::BufferBinding {
            buffer: &self.uniform_buffer,
            offset: offset as u64,
            size: wgpu::BufferSize::new(uniform.len() as u64),
        });
        let storage = buffers.iter().map(|buffer| self.bound(buffer));
        let entries: Vec<_> = (0..)
            .zip(std::iter::once(block).chain(storage))
            .map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource })
            .collect();
        let bind_group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &pipeline.get_bind_group_layout(0),
            entries: &entries,
        });
        let [across, down] = grid(groups, self.context)?;
        let pass = self.pass();
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &bind_group, &[]);
        pass.dispatch_workgroups(across, down, 1);
        Ok(())
    }

    pub(super) fn clear(&mut self, buffer: &wgpu::Buffer, bytes: u64) {
        self.pass = None;
        self.encoder.clear_buffer(buffer, 0, Some(bytes.next_multiple_of(4)));
    }

    pub(super) fn copy(&mut self, from: (&wgpu::Buffer, u64), to: (&wgpu::Buffer, u64), bytes: u64) {
        self.pass = None;
        self.encoder.copy_buffer_to_buffer(from.0, from.1, to.0, to.1, bytes);
    }

    /// Submits all commands so far.
    pub(super) fn submit(&mut self) {
        self.pass = None;
        let encoder = std::mem::replace(&mut self.encoder, encoder(self.context));
        if !self.uniforms.is_empty() {
            self.context.queue.write_buffer(&self.uniform_buffer, 0, &self.uniforms);
            self.uniforms.clear();
        }
        self.context.queue.submit([encoder.finish()]);
    }

    /// Submits, and returns the time of each stage's runs if the device could time them all. Waits for the device.
    pub(super) fn finish(mut self) -> Result<Vec<(&'static str, f64)>, GpuError> {
        self.pass = None;
        let (Some(clock), false) = (self.clock.take(), self.timed.is_empty() || self.is_incomplete) else {
            self.submit();
            return Ok(Vec::new());
        };
        let marks = u32::try_from(2 * self.timed.len()).unwrap_or(2 * MAX_RUNS);
        let bytes = 8 * u64::from(marks);
        let resolved = self.context.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("timestamps"),
            size: bytes,
            usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        });
        self.encoder.resolve_query_set(&clock, 0..marks, &resolved, 0);
        self.submit();
        let read = self.context.read(&[(&resolved, bytes)])?;
        let period = f64::from(self.context.queue.get_timestamp_period()) * 1e-9;
        let ticks: Vec<u64> = read.concat().as_chunks().0.iter().map(|word| u64::from_le_bytes(*word)).collect();
        let lengths = ticks.as_chunks::<2>().0.iter().map(|[from, to]| to.saturating_sub(*from) as f64 * period);
        Ok(self.timed.iter().copied().zip(lengths).collect())
    }

    /// Binds as much of a buffer as possible; buffers of the caller may be too long, or end within a word.
    fn bound<'b>(&self, buffer: &'b wgpu::Buffer) -> wgpu::BindingResource<'b> {
        let size = buffer.size().min(self.context.binding_limit.max(256)) & !3;
        wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer, offset: 0, size: wgpu::BufferSize::new(size) })
    }

    /// Stores a uniform block and returns its offset; submits first if the buffer is full.
    fn place_uniform(&mut self, uniform: &[u8]) -> usize {
        if self.uniforms.len().next_multiple_of(UNIFORM_STEP) + uniform.len() > UNIFORM_BYTES {
            self.submit();
        }
        let offset = self.uniforms.len().next_multiple_of(UNIFORM_STEP);
        self.uniforms.resize(offset, 0);
        self.uniforms.extend_from_slice(uniform);
        offset
    }
}

fn encoder(context: &Context) -> wgpu::CommandEncoder {
    context.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some("atsplat") })
}

fn uniform_buffer(context: &Context) -> wgpu::Buffer {
    context.device.create_buffer(&wgpu::BufferDescriptor {
        label: Some("uniforms"),
        size: UNIFORM_BYTES as u64,
        usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
        mapped_at_creation: false,
    })
}

/// Grid of at least `groups` workgroups; kernels return early from excess ones.
fn grid(groups: u64, context: &Context) -> Result<[u32; 2], GpuError> {
    let limit = u64::from(context.groups_limit);
    let across = if groups < limit { groups } else { limit };
    let down = groups.div_ceil(across.max(1));
    match (u32::try_from(across), u32::try_from(down)) {
        (Ok(across), Ok(down)) if u64::from(down) <= limit => Ok([across, down]),
        _ => Err(GpuError::TooLarge {
            adapter: context.name.clone(),
            what: "threads of one dispatch",
            unit: "workgroups",
            needed: groups,
            limit: limit * limit,
        }),
    }
}
