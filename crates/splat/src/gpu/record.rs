use super::GpuError;
use super::context::Context;
use super::kernels::{Kernel, Pipelines, UNIFORM_BYTES};
use super::read::Reading;
use super::status::{self, Status};

/// Offset alignment that every adapter accepts.
const UNIFORM_STEP: usize = 256;
/// Timed runs of stages: two timestamps each, up to wgpu's limit per query set.
const MAX_RUNS: u32 = 2048;

/// Records commands for the device, for a single submission: dispatches within named stages.
#[derive(Debug)]
pub(super) struct Recorder<'a> {
    context: &'a Context,
    pipelines: &'a mut Pipelines,
    encoder: wgpu::CommandEncoder,
    pass: Option<wgpu::ComputePass<'static>>,
    /// Uniform blocks, one list of bytes for each buffer.
    uniforms: Vec<Vec<u8>>,
    clock: Option<wgpu::QuerySet>,
    stage: Option<&'static str>,
    /// The stage of each timed run.
    timed: Vec<&'static str>,
    /// Whether some run was not timed.
    is_incomplete: bool,
}

/// What a submission wrote for the host: the contents of each buffer, and the time of each stage's runs if the device
/// could time them all.
pub(super) struct Finished {
    pub(super) contents: Vec<Vec<u8>>,
    pub(super) timings: Vec<(&'static str, f64)>,
}

impl<'a> Recorder<'a> {
    pub(super) fn new(context: &'a Context, pipelines: &'a mut Pipelines) -> Self {
        let descriptor = wgpu::CommandEncoderDescriptor { label: Some("atsplat") };
        Self {
            context,
            pipelines,
            encoder: context.device.create_command_encoder(&descriptor),
            pass: None,
            uniforms: Vec::new(),
            clock: None,
            stage: None,
            timed: Vec::new(),
            is_incomplete: false,
        }
    }

    /// Times stages, if the adapter can.
    pub(super) fn timed(mut self) -> Self {
        self.clock = self.context.timestamps.then(|| {
            self.context.device.create_query_set(&wgpu::QuerySetDescriptor {
                label: None,
                ty: wgpu::QueryType::Timestamp,
                count: 2 * MAX_RUNS,
            })
        });
        self
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
        let [across, down] = grid(groups, self.context)?;
        let (pipeline, layout) = self.pipelines.get(self.context, kernel);
        let (uniform_buffer, offset) = self.place_uniform(uniform);
        let block = wgpu::BindingResource::Buffer(wgpu::BufferBinding {
            buffer: &uniform_buffer,
            offset,
            size: wgpu::BufferSize::new(uniform.len() as u64),
        });
        let storage = buffers.iter().map(|buffer| self.bound(buffer));
        let entries: Vec<_> = (0..)
            .zip(std::iter::once(block).chain(storage))
            .map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource })
            .collect();
        let bind_group = self.context.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout: &layout,
            entries: &entries,
        });
        self.context.counters.dispatches.add(1);
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

    /// Submits all commands.
    pub(super) fn submit(mut self) {
        self.pass = None;
        for (at, blocks) in self.uniforms.iter().enumerate() {
            self.context.write(&self.pipelines.uniforms(self.context, at), blocks);
        }
        self.context.submit(self.encoder);
    }

    /// As [`Self::submit_and_read`], and reads the report of the rendering too.
    #[expect(clippy::expect_used, reason = "every source has contents")]
    pub(super) fn submit_and_read_with_status(
        self,
        sources: &[(&wgpu::Buffer, u64)],
        report: &wgpu::Buffer,
    ) -> Result<(Finished, Status), GpuError> {
        let context = self.context;
        let sources: Vec<_> = sources.iter().copied().chain([(report, status::BYTES)]).collect();
        let mut finished = self.submit_and_read(&sources)?;
        let report = finished.contents.pop().expect("the report is the last source");
        let status = Status::parse(&context.name, &report)?;
        Ok((finished, status))
    }

    /// Submits all commands, waits for the device, and returns the first bytes of buffers.
    #[expect(clippy::expect_used, reason = "every source has contents")]
    pub(super) fn submit_and_read(mut self, sources: &[(&wgpu::Buffer, u64)]) -> Result<Finished, GpuError> {
        self.pass = None;
        let context = self.context;
        let stamps = self.resolve_clock();
        let timed = std::mem::take(&mut self.timed);
        let sources: Vec<_> =
            sources.iter().copied().chain(stamps.iter().map(|stamps| (stamps, stamps.size()))).collect();
        let reading = Reading::begin(context, &mut self.encoder, &sources);
        self.submit();
        let mut contents = reading.finish(context)?;
        let stamps =
            if stamps.is_some() { contents.pop().expect("time stamps are the last source") } else { Vec::new() };
        let period = f64::from(context.queue.get_timestamp_period()) * 1e-9;
        let ticks: Vec<u64> = stamps.as_chunks().0.iter().map(|word| u64::from_le_bytes(*word)).collect();
        let lengths = ticks.as_chunks::<2>().0.iter().map(|[from, to]| to.saturating_sub(*from) as f64 * period);
        Ok(Finished { contents, timings: timed.into_iter().zip(lengths).collect() })
    }

    /// The timestamps in a buffer, unless some are missing.
    fn resolve_clock(&mut self) -> Option<wgpu::Buffer> {
        let clock = self.clock.take().filter(|_| !self.timed.is_empty() && !self.is_incomplete)?;
        let marks = u32::try_from(2 * self.timed.len()).unwrap_or(2 * MAX_RUNS);
        let resolved = self.context.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("timestamps"),
            size: 8 * u64::from(marks),
            usage: wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        });
        self.encoder.resolve_query_set(&clock, 0..marks, &resolved, 0);
        Some(resolved)
    }

    /// Binds as much of a buffer as possible; buffers of the caller may be too long, or end within a word.
    fn bound<'b>(&self, buffer: &'b wgpu::Buffer) -> wgpu::BindingResource<'b> {
        let size = buffer.size().min(self.context.binding_limit.max(256)) & !3;
        wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer, offset: 0, size: wgpu::BufferSize::new(size) })
    }

    /// Stores a uniform block, unless the last one was the same; returns its buffer and offset.
    fn place_uniform(&mut self, uniform: &[u8]) -> (wgpu::Buffer, u64) {
        let fits = |blocks: &Vec<u8>| blocks.len().next_multiple_of(UNIFORM_STEP) + uniform.len() <= UNIFORM_BYTES;
        let is_last = self.uniforms.last().is_some_and(|blocks| {
            blocks.ends_with(uniform) && (blocks.len() - uniform.len()).is_multiple_of(UNIFORM_STEP)
        });
        if !is_last && !self.uniforms.last().is_some_and(fits) {
            self.uniforms.push(Vec::new());
        }
        let mut offset = 0;
        if let Some(blocks) = self.uniforms.last_mut() {
            if !is_last {
                blocks.resize(blocks.len().next_multiple_of(UNIFORM_STEP), 0);
                blocks.extend_from_slice(uniform);
            }
            offset = blocks.len() - uniform.len();
        }
        (self.pipelines.uniforms(self.context, self.uniforms.len() - 1), offset as u64)
    }
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
