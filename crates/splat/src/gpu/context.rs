use std::sync::{Arc, Mutex, PoisonError};

use super::adapters::AdapterDescription;
use super::{GpuError, GpuOptions, Threads};

/// A device, what it may be asked for, and what became of it.
#[derive(Debug)]
pub(super) struct Context {
    pub(super) device: wgpu::Device,
    pub(super) queue: wgpu::Queue,
    /// For people.
    pub(super) name: String,
    /// Bytes of a buffer that a kernel sees, and of any buffer here.
    pub(super) binding_limit: u64,
    /// Workgroups along a dimension of a dispatch.
    pub(super) groups_limit: u32,
    pub(super) timestamps: bool,
    /// Rows of four pixels that a thread composites, 1 or 4.
    pub(super) thread_rows: u32,
    /// Entries of a tile's list that one dispatch passes over.
    pub(super) entries_at_once: u32,
    /// Tiles of one window.
    pub(super) tiles_at_once: u64,
    lost: Arc<Mutex<Option<String>>>,
}

/// Buffers that the largest kernel sees.
const STORAGE_BUFFERS: u32 = 8;
/// Bytes that a workgroup of the largest kernel shares.
const SHARED_BYTES: u32 = 13 << 10;

impl Context {
    /// Opens an adapter with all that it has.
    pub(super) fn open(
        adapter: &wgpu::Adapter,
        description: &AdapterDescription,
        options: &GpuOptions,
    ) -> Result<Self, GpuError> {
        let name = description.to_string();
        let features = adapter.features() & wgpu::Features::TIMESTAMP_QUERY;
        let descriptor = wgpu::DeviceDescriptor {
            label: Some("atsplat"),
            required_features: features,
            required_limits: adapter.limits(),
            memory_hints: wgpu::MemoryHints::Performance,
            ..wgpu::DeviceDescriptor::default()
        };
        let (device, queue) = pollster::block_on(adapter.request_device(&descriptor))
            .map_err(|error| GpuError::Device { adapter: name.clone(), reason: error.to_string() })?;
        let context = Self::with_device(device, queue, name, options)?;
        let lost = Arc::clone(&context.lost);
        context.device.set_device_lost_callback(move |reason, message| {
            *lost.lock().unwrap_or_else(PoisonError::into_inner) = Some(format!("lost ({reason:?}): {message}"));
        });
        // Error scopes take what this crate causes; wgpu's own handler would panic on the rest.
        let uncaught = Arc::clone(&context.lost);
        context.device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            *uncaught.lock().unwrap_or_else(PoisonError::into_inner) = Some(error.to_string());
        }));
        Ok(context)
    }

    /// Takes a device that somebody else opened, and leaves its handlers alone.
    pub(super) fn with_device(
        device: wgpu::Device,
        queue: wgpu::Queue,
        name: String,
        options: &GpuOptions,
    ) -> Result<Self, GpuError> {
        let limits = device.limits();
        let shortfalls = [
            ("storage buffers of a kernel", limits.max_storage_buffers_per_shader_stage, STORAGE_BUFFERS),
            ("shared bytes of a workgroup", limits.max_compute_workgroup_storage_size, SHARED_BYTES),
            ("threads of a workgroup", limits.max_compute_invocations_per_workgroup, 64),
        ];
        for (what, found, expected) in shortfalls {
            if found < expected {
                let (expected, found) = (format!("at least {expected}"), found.to_string());
                return Err(GpuError::Unfit { adapter: name, what, expected, found });
            }
        }
        // Bindings end on words; u32 indexes them.
        let allowed = [limits.max_storage_buffer_binding_size, limits.max_buffer_size, options.binding_limit];
        let binding_limit = allowed.into_iter().fold(1 << 33, Ord::min) & !255;
        let groups_limit = limits.max_compute_workgroups_per_dimension.min(options.groups_limit).max(1);
        let timestamps = device.features().contains(wgpu::Features::TIMESTAMP_QUERY);
        let is_processor = device.adapter_info().device_type == wgpu::DeviceType::Cpu;
        let few = options.threads == Threads::Few || (options.threads == Threads::Automatic && is_processor);
        let thread_rows = if few { 4 } else { 1 };
        Ok(Self {
            device,
            queue,
            name,
            binding_limit,
            groups_limit,
            timestamps,
            thread_rows,
            entries_at_once: options.entries_limit.max(1),
            tiles_at_once: u64::MAX,
            lost: Arc::default(),
        })
    }

    /// Cuts what kernels loop over to what the driver allows. Differentiating takes most: for each entry of a list
    /// one turn for every thread beside it that passes over it at another time, and one for each sum.
    pub(super) fn allow_turns(&mut self, turns: u32) {
        if turns < u32::MAX {
            self.entries_at_once = self.entries_at_once.min(turns / 32).max(1);
            self.tiles_at_once = u64::from(turns / 2).max(1);
        }
    }

    /// Does something with the device and reports what the driver thinks of it.
    pub(super) fn guarded<T, E: From<GpuError>>(&self, work: impl FnOnce() -> Result<T, E>) -> Result<T, E> {
        let memory = self.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let internal = self.device.push_error_scope(wgpu::ErrorFilter::Internal);
        let validation = self.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let result = work();
        let found = [validation.pop(), internal.pop(), memory.pop()].into_iter().rev();
        let mut fault = None;
        for future in found {
            fault = pollster::block_on(future).or(fault);
        }
        let adapter = self.name.clone();
        if let Some(error) = fault {
            let reason = error.to_string();
            return Err(match error {
                wgpu::Error::OutOfMemory { .. } => GpuError::OutOfMemory { adapter, reason },
                _ => GpuError::Refused { adapter, reason },
            }
            .into());
        }
        if let Some(reason) = self.lost.lock().unwrap_or_else(PoisonError::into_inner).clone() {
            return Err(GpuError::Device { adapter, reason }.into());
        }
        result
    }

    pub(super) fn buffer(&self, label: &'static str, bytes: u64) -> Result<wgpu::Buffer, GpuError> {
        if bytes > self.binding_limit {
            let adapter = self.name.clone();
            return Err(GpuError::TooLarge { adapter, what: label, needed: bytes, limit: self.binding_limit });
        }
        Ok(self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size: bytes.next_multiple_of(256).max(256).min(self.binding_limit.max(256)),
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        }))
    }

    /// Waits for the device and reads the first bytes of buffers.
    pub(super) fn read(&self, wanted: &[(&wgpu::Buffer, u64)]) -> Result<Vec<Vec<u8>>, GpuError> {
        let fault = |reason: String| GpuError::Device { adapter: self.name.clone(), reason };
        let total: u64 = wanted.iter().map(|(_, bytes)| bytes).sum();
        if total == 0 {
            return Ok(wanted.iter().map(|_| Vec::new()).collect());
        }
        let staging = self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some("staging"),
            size: total,
            usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST,
            mapped_at_creation: false,
        });
        let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let mut at = 0;
        for (buffer, bytes) in wanted {
            if *bytes > 0 {
                encoder.copy_buffer_to_buffer(buffer, 0, &staging, at, *bytes);
            }
            at += bytes;
        }
        self.queue.submit([encoder.finish()]);
        let (sender, receiver) = std::sync::mpsc::channel();
        staging.map_async(wgpu::MapMode::Read, .., move |outcome| {
            // Nobody listens any more where waiting failed.
            sender.send(outcome).ok();
        });
        self.device.poll(wgpu::PollType::wait_indefinitely()).map_err(|error| fault(error.to_string()))?;
        let outcome = receiver.try_recv().map_err(|error| fault(format!("no answer when mapping: {error}")))?;
        outcome.map_err(|error| fault(error.to_string()))?;
        let view = staging.get_mapped_range(..).map_err(|error| fault(error.to_string()))?;
        let mut rest: &[u8] = &view;
        let mut read = Vec::new();
        for (_, bytes) in wanted {
            let length = usize::try_from(*bytes).map_err(|error| fault(error.to_string()))?;
            let (own, after) = rest.split_at_checked(length).unwrap_or((rest, &[]));
            read.push(own.to_vec());
            rest = after;
        }
        Ok(read)
    }
}
