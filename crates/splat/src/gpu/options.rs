/// Execution options; images do not depend on them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GpuOptions {
    /// Limit on the bytes of one forward or backward pass on the device, including Gaussians and tile lists; tile lists
    /// are split to fit. Buffers are kept between passes, and freed when they and new ones would exceed it. One that is
    /// reused may be longer than the pass needs, usually by a quarter, so that a pass near the limit may take that much
    /// more. Not counted: up to 64 MiB of staging buffers, and other buffers of the caller, such as other scenes or
    /// earlier images.
    pub memory_limit: u64,
    /// For tests.
    #[doc(hidden)]
    pub overrides: GpuOverrides,
}

impl Default for GpuOptions {
    /// 8 GiB.
    fn default() -> Self {
        Self { memory_limit: 8 << 30, overrides: GpuOverrides::default() }
    }
}

/// Lower limits than the adapter has, and other choices than it calls for; for tests and benchmarks.
#[doc(hidden)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GpuOverrides {
    /// Limit on the bytes of a buffer, if smaller than the adapter's.
    pub binding_limit: u64,
    /// Limit on the workgroups along one dimension of a dispatch, if smaller than the adapter's.
    pub groups_limit: u32,
    /// Limit on the entries of a tile's list per dispatch, if smaller than the driver's.
    pub entries_limit: u32,
    /// Limit on the (tile, Gaussian) pairs that the first rendering of a scene has room for; it is repeated if there
    /// are more.
    pub first_pairs: u64,
    /// Number of pixels per thread.
    pub threads: Threads,
    /// Whether backward passes sum over pixels within subgroups, where the adapter has them; only the last bits of
    /// gradients depend on it.
    pub subgroups: bool,
}

impl Default for GpuOverrides {
    fn default() -> Self {
        Self {
            binding_limit: u64::MAX,
            groups_limit: u32::MAX,
            entries_limit: u32::MAX,
            first_pairs: u64::MAX,
            threads: Threads::Automatic,
            subgroups: true,
        }
    }
}

/// Number of pixels per thread; only the last bits of gradients depend on it.
#[doc(hidden)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Threads {
    /// Chosen by the kind of adapter.
    #[default]
    Automatic,
    /// Four pixels per thread: for GPUs.
    Many,
    /// Sixteen pixels per thread: for software adapters.
    Few,
}
