use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use super::adapters::AdapterDescription;
use super::counts::Counters;
use super::kernels::Kernel;
use super::panics::catch_panics;
use super::uniforms::most_views;
use super::{GpuError, GpuOptions, Threads};

/// A device with its limits and error state.
#[derive(Debug)]
pub(super) struct Context {
    pub(super) device: wgpu::Device,
    pub(super) queue: wgpu::Queue,
    pub(super) counters: Counters,
    /// Kept for the next reading.
    pub(super) staging: Mutex<Option<wgpu::Buffer>>,
    /// Display name.
    pub(super) name: String,
    /// Limit on the bytes of a binding, and of any buffer created here.
    pub(super) binding_limit: u64,
    /// Limit on the workgroups along one dimension of a dispatch.
    pub(super) groups_limit: u32,
    /// Limit on the views of a batch.
    pub(super) most_views: u32,
    pub(super) timestamps: bool,
    /// Limit on the bytes of pooled buffers.
    pub(super) memory_limit: u64,
    /// Rows of four pixels per thread, 1 or 4.
    thread_rows: u32,
    /// Least number of threads in a subgroup, if kernels sum within subgroups; at least 4.
    least_subgroup: Option<u32>,
    /// Limit on the entries of a tile's list per dispatch.
    pub(super) entries_per_dispatch: u32,
    /// Limit on the tiles of a window.
    pub(super) tiles_per_window: u64,
    /// Pairs that a first rendering has room for at most.
    pub(super) first_pairs: u64,
    /// Limit on the pixel columns summed per dispatch.
    pub(super) columns_per_dispatch: u32,
    /// Why the device was lost, if so.
    lost: Arc<Mutex<Option<String>>>,
    /// The first error of a command of others, until it is reported.
    uncaptured: Arc<Mutex<Option<String>>>,
    /// Whether a command failed, so that buffers kept for reuse may be invalid.
    has_failed: AtomicBool,
}

/// Storage buffers of the largest kernel.
const STORAGE_BUFFERS: u64 = 8;
/// Shared memory of the largest kernel's workgroup, in bytes.
const SHARED_BYTES: u64 = 14 << 10;
/// Bytes of a uniform buffer that Vulkan and OpenGL guarantee: enough for a batch of 40 views.
const UNIFORM_BYTES: u64 = 16 << 10;
/// Upper bound on the loop iterations per entry of a tile's list. The backward pass needs most if 16 threads have 16
/// pixels each and the driver unrolls nothing: 11 to clear sums, one for each thread that skips the entry separately, 4
/// rows of pixels, 11 to store sums, 12 to add those of all threads; about 40 in the worst case.
pub(super) const ITERATIONS_PER_ENTRY: u32 = 64;

impl Context {
    /// Opens a device with all the limits of its adapter.
    pub(super) fn open(
        adapter: &wgpu::Adapter,
        description: &AdapterDescription,
        options: &GpuOptions,
    ) -> Result<Self, GpuError> {
        let name = description.to_string();
        let features = adapter.features() & (wgpu::Features::TIMESTAMP_QUERY | wgpu::Features::SUBGROUP);
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
        // Error scopes catch the errors of this crate's commands; wgpu's default handler would panic on all others.
        let uncaptured = Arc::clone(&context.uncaptured);
        context.device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            let mut first = uncaptured.lock().unwrap_or_else(PoisonError::into_inner);
            first.get_or_insert_with(|| error.to_string());
        }));
        Ok(context)
    }

    /// Wraps a device opened by the caller, without touching its error handlers.
    pub(super) fn with_device(
        device: wgpu::Device,
        queue: wgpu::Queue,
        name: String,
        options: &GpuOptions,
    ) -> Result<Self, GpuError> {
        let (limits, overrides) = (device.limits(), &options.overrides);
        let shortfalls: [(_, u64, u64); 4] = [
            ("storage buffers of a kernel", limits.max_storage_buffers_per_shader_stage.into(), STORAGE_BUFFERS),
            ("shared bytes of a workgroup", limits.max_compute_workgroup_storage_size.into(), SHARED_BYTES),
            ("threads of a workgroup", limits.max_compute_invocations_per_workgroup.into(), 128),
            ("bytes of a uniform buffer", limits.max_uniform_buffer_binding_size, UNIFORM_BYTES),
        ];
        for (what, found, expected) in shortfalls {
            if found < expected {
                let (expected, found) = (format!("at least {expected}"), found.to_string());
                return Err(GpuError::Unfit { adapter: name, what, expected, found });
            }
        }
        // Kernels index words with u32.
        let allowed = [limits.max_storage_buffer_binding_size, limits.max_buffer_size, overrides.binding_limit];
        let binding_limit = allowed.into_iter().fold(1 << 33, Ord::min) & !255;
        let groups_limit = limits.max_compute_workgroups_per_dimension.min(overrides.groups_limit).max(1);
        let timestamps = device.features().contains(wgpu::Features::TIMESTAMP_QUERY);
        let info = device.adapter_info();
        let is_software = info.device_type == wgpu::DeviceType::Cpu;
        let thread_rows = match overrides.threads {
            Threads::Automatic if is_software => 4,
            Threads::Few => 4,
            Threads::Automatic | Threads::Many => 1,
        };
        let has_subgroups = overrides.subgroups && device.features().contains(wgpu::Features::SUBGROUP);
        Ok(Self {
            device,
            queue,
            counters: Counters::default(),
            staging: Mutex::default(),
            name,
            binding_limit,
            groups_limit,
            most_views: most_views(limits.max_uniform_buffer_binding_size),
            timestamps,
            memory_limit: options.memory_limit,
            thread_rows,
            least_subgroup: has_subgroups.then_some(info.subgroup_min_size),
            entries_per_dispatch: overrides.entries_limit.max(1),
            tiles_per_window: u64::MAX,
            first_pairs: overrides.first_pairs,
            columns_per_dispatch: u32::MAX,
            lost: Arc::default(),
            uncaptured: Arc::default(),
            has_failed: AtomicBool::new(false),
        })
    }

    /// Constants that the kernels are compiled with.
    pub(super) fn constants(&self) -> String {
        let threads = 64 / self.thread_rows;
        let least = self.least_subgroup.map_or(threads, |least| least.min(threads));
        let (rows, views) = (self.thread_rows, self.most_views);
        format!("const ROWS: u32 = {rows}u;\nconst LEAST_SUBGROUP: u32 = {least}u;\nconst VIEWS: u32 = {views}u;\n")
    }

    /// The kernel that sums over the pixels of a tile.
    pub(super) const fn composite_backward(&self) -> Kernel {
        if self.least_subgroup.is_some() { Kernel::CompositeBackwardSubgroups } else { Kernel::CompositeBackward }
    }

    /// Limits the loops of kernels to the iterations that the driver allows, and to what finishes before the system
    /// considers the device hung.
    pub(super) fn limit_iterations(&mut self, iterations: u32) {
        self.entries_per_dispatch = self.entries_per_dispatch.min(iterations / ITERATIONS_PER_ENTRY).max(1);
        self.tiles_per_window = u64::from(iterations / 2).max(1);
        self.columns_per_dispatch = (iterations / 2).max(1);
    }

    /// Runs `work` and reports the errors that the driver raised during it.
    pub(super) fn guarded<T, E: From<GpuError>>(&self, work: impl FnOnce() -> Result<T, E>) -> Result<T, E> {
        let memory = self.device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let internal = self.device.push_error_scope(wgpu::ErrorFilter::Internal);
        let validation = self.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let result = work();
        let [validation, internal, memory] = [pop(validation), pop(internal), pop(memory)];
        let adapter = self.name.clone();
        if let Some(error) = root_cause(memory, internal, validation) {
            self.has_failed.store(true, Ordering::Relaxed);
            let reason = error.to_string();
            return Err(match error {
                wgpu::Error::OutOfMemory { .. } => GpuError::OutOfMemory { adapter, reason },
                _ => GpuError::Rejected { adapter, reason },
            }
            .into());
        }
        if let Some(reason) = self.lost.lock().unwrap_or_else(PoisonError::into_inner).clone() {
            return Err(GpuError::Device { adapter, reason }.into());
        }
        // Errors of this call take precedence.
        if result.is_ok()
            && let Some(reason) = self.uncaptured.lock().unwrap_or_else(PoisonError::into_inner).take()
        {
            let reason = format!("a command from outside this renderer: {reason}");
            return Err(GpuError::Rejected { adapter, reason }.into());
        }
        result
    }

    /// Whether a command failed since the last time this was asked.
    pub(super) fn take_failure(&self) -> bool {
        self.has_failed.swap(false, Ordering::Relaxed)
    }

    pub(super) fn submit(&self, encoder: wgpu::CommandEncoder) {
        self.counters.submissions.add(1);
        self.queue.submit([encoder.finish()]);
    }

    /// Copies to the device with the next submission.
    pub(super) fn write(&self, buffer: &wgpu::Buffer, bytes: &[u8]) {
        if !bytes.is_empty() {
            self.counters.bytes_up.add(bytes.len() as u64);
            self.queue.write_buffer(buffer, 0, bytes);
        }
    }

    /// Waits for everything submitted.
    pub(super) fn wait(&self) -> Result<(), GpuError> {
        self.counters.waits.add(1);
        catch_panics(&self.name, || {
            let waited = self.device.poll(wgpu::PollType::wait_indefinitely());
            waited.map_err(|error| GpuError::Device { adapter: self.name.clone(), reason: error.to_string() })?;
            Ok(())
        })
    }

    /// Checks that kernels can bind the first `bytes` of a buffer of the caller.
    pub(super) fn check_binding(&self, what: &'static str, buffer: &wgpu::Buffer, bytes: u64) -> Result<(), GpuError> {
        let adapter = self.name.clone();
        if bytes > self.binding_limit {
            return Err(GpuError::TooLarge { adapter, what, unit: "bytes", needed: bytes, limit: self.binding_limit });
        }
        if !buffer.usage().contains(wgpu::BufferUsages::STORAGE) {
            let reason = format!("buffer of {what}: expected usage STORAGE, found {:?}", buffer.usage());
            return Err(GpuError::Rejected { adapter, reason });
        }
        Ok(())
    }

    pub(super) fn buffer(&self, label: &'static str, bytes: u64) -> Result<wgpu::Buffer, GpuError> {
        if bytes > self.binding_limit {
            let adapter = self.name.clone();
            let limit = self.binding_limit;
            return Err(GpuError::TooLarge { adapter, what: label, unit: "bytes", needed: bytes, limit });
        }
        Ok(self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(label),
            size: bytes.next_multiple_of(256).max(256).min(self.binding_limit.max(256)),
            usage: wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC,
            mapped_at_creation: false,
        }))
    }
}

fn pop(scope: wgpu::ErrorScopeGuard) -> Option<wgpu::Error> {
    pollster::block_on(scope.pop())
}

/// The error that causes the others: a buffer that could not be allocated is invalid wherever it is used.
fn root_cause(
    memory: Option<wgpu::Error>,
    internal: Option<wgpu::Error>,
    validation: Option<wgpu::Error>,
) -> Option<wgpu::Error> {
    memory.or(internal).or(validation)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn out_of_memory_takes_precedence_over_its_consequences() {
        let memory = || wgpu::Error::OutOfMemory { source: "none left".into() };
        let validation = || wgpu::Error::Validation { source: "buffer".into(), description: "is invalid".to_owned() };
        assert!(matches!(root_cause(Some(memory()), None, Some(validation())), Some(wgpu::Error::OutOfMemory { .. })));
        assert!(matches!(root_cause(None, None, Some(validation())), Some(wgpu::Error::Validation { .. })));
        assert!(root_cause(None, None, None).is_none());
    }
}
