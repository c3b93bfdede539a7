use std::collections::BTreeMap;

use super::GpuError;
use super::context::Context;
use super::layout::shared_constants;

/// A compute kernel; its source is in `shaders/`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Kernel {
    Project,
    Colour,
    Keys,
    SortCount,
    SortScatter,
    ScanSums,
    ScanApply,
    TileCount,
    Emit,
    Ranges,
    Needs,
    Composite,
    PixelGradients,
    RowSums,
    CompositeBackward,
    CompositeBackwardSubgroups,
    Gather,
    ColourBackward,
    ProjectBackward,
    Unpack,
    Probe,
    Reduce,
    Pack,
    ProjectBatch,
    ColourBatch,
    ColourBackwardBatch,
    ProjectBackwardBatch,
}

macro_rules! sources {
    ($($name:literal),+) => { concat!($(include_str!(concat!("shaders/", $name, ".wgsl")), "\n"),+) };
}

impl Kernel {
    /// Every kernel.
    pub(super) const ALL: [Self; 27] = [
        Self::Project,
        Self::Colour,
        Self::Keys,
        Self::SortCount,
        Self::SortScatter,
        Self::ScanSums,
        Self::ScanApply,
        Self::TileCount,
        Self::Emit,
        Self::Ranges,
        Self::Needs,
        Self::Composite,
        Self::PixelGradients,
        Self::RowSums,
        Self::CompositeBackward,
        Self::CompositeBackwardSubgroups,
        Self::Gather,
        Self::ColourBackward,
        Self::ProjectBackward,
        Self::Unpack,
        Self::Probe,
        Self::Reduce,
        Self::Pack,
        Self::ProjectBatch,
        Self::ColourBatch,
        Self::ColourBackwardBatch,
        Self::ProjectBackwardBatch,
    ];

    /// The kernel for splats of many views, if it has to know the view of each.
    pub(super) const fn of_batch(self, is_batch: bool) -> Self {
        match self {
            Self::Project if is_batch => Self::ProjectBatch,
            Self::Colour if is_batch => Self::ColourBatch,
            Self::ColourBackward if is_batch => Self::ColourBackwardBatch,
            Self::ProjectBackward if is_batch => Self::ProjectBackwardBatch,
            other => other,
        }
    }

    pub(super) const fn source(self) -> &'static str {
        match self {
            Self::Project => {
                sources!("view", "one_view", "double", "exponent", "lens", "geometry", "gaussians", "project")
            }
            Self::Colour => sources!("view", "one_view", "double", "exponent", "harmonics", "colour"),
            Self::Keys => sources!("view", "one_view", "keys"),
            Self::SortCount => sources!("counted", "sort_count"),
            Self::SortScatter => sources!("counted", "sort_scatter"),
            Self::ScanSums => sources!("counted", "scan", "scan_sums"),
            Self::ScanApply => sources!("counted", "scan", "scan_apply"),
            Self::TileCount => sources!("view", "one_view", "tiles", "ellipse", "tile_count"),
            Self::Emit => sources!("view", "one_view", "tiles", "ellipse", "emit"),
            Self::Ranges => sources!("view", "one_view", "tiles", "ranges"),
            Self::Needs => sources!("view", "one_view", "needs"),
            Self::Composite => sources!("view", "one_view", "tiles", "raster", "composite"),
            Self::PixelGradients => sources!("view", "one_view", "pixel_gradients"),
            Self::RowSums => sources!("view", "one_view", "row_sums"),
            Self::CompositeBackward => {
                sources!("view", "one_view", "tiles", "raster", "pixel_sums", "composite_backward")
            }
            Self::CompositeBackwardSubgroups => {
                sources!("view", "one_view", "tiles", "raster", "pixel_sums", "composite_backward_subgroups")
            }
            Self::Gather => sources!("view", "one_view", "gather"),
            Self::ColourBackward => sources!("view", "one_view", "double", "exponent", "harmonics", "colour_backward"),
            Self::ProjectBackward => {
                sources!("view", "one_view", "double", "exponent", "lens", "geometry", "gaussians", "project_backward")
            }
            Self::Unpack => sources!("unpack"),
            Self::Probe => sources!("probe"),
            Self::Reduce => sources!("reduce"),
            Self::Pack => sources!("pack"),
            Self::ProjectBatch => {
                sources!("view", "many_views", "double", "exponent", "lens", "geometry", "gaussians", "project")
            }
            Self::ColourBatch => sources!("view", "many_views", "double", "exponent", "harmonics", "colour"),
            Self::ColourBackwardBatch => {
                sources!("view", "many_views", "double", "exponent", "harmonics", "colour_backward")
            }
            Self::ProjectBackwardBatch => {
                sources!(
                    "view",
                    "many_views",
                    "double",
                    "exponent",
                    "lens",
                    "geometry",
                    "gaussians",
                    "project_backward"
                )
            }
        }
    }
}

/// Bytes of a buffer of uniform blocks.
pub(super) const UNIFORM_BYTES: usize = 64 << 10;

/// A kernel's pipeline, and the layout of its bind group.
type Compiled = (wgpu::ComputePipeline, wgpu::BindGroupLayout);

/// Pipelines, compiled on first use, and buffers for their uniform blocks.
#[derive(Clone, Debug, Default)]
pub(super) struct Pipelines {
    compiled: BTreeMap<Kernel, Compiled>,
    uniforms: Vec<wgpu::Buffer>,
}

impl Pipelines {
    /// A kernel's pipeline, and the layout of its bind group.
    pub(super) fn get(&mut self, context: &Context, kernel: Kernel) -> Compiled {
        self.compiled.entry(kernel).or_insert_with(|| compile(context, kernel, kernel.source())).clone()
    }

    /// Compiles a kernel with part of its source replaced, as a broken driver might.
    #[cfg(test)]
    pub(super) fn miscompile(&mut self, context: &Context, kernel: Kernel, [from, to]: [&str; 2]) {
        let source = kernel.source();
        assert!(source.contains(from), "{kernel:?}: {from}");
        self.compiled.insert(kernel, compile(context, kernel, &source.replace(from, to)));
    }

    /// A buffer for uniform blocks; a submission may need several.
    pub(super) fn uniforms(&mut self, context: &Context, at: usize) -> wgpu::Buffer {
        let make = || {
            context.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("uniforms"),
                size: UNIFORM_BYTES as u64,
                usage: wgpu::BufferUsages::UNIFORM | wgpu::BufferUsages::COPY_DST,
                mapped_at_creation: false,
            })
        };
        if self.uniforms.len() <= at {
            self.uniforms.resize_with(at + 1, make);
        }
        self.uniforms[at].clone()
    }

    /// Frees the buffers of uniform blocks.
    pub(super) fn free_uniforms(&mut self) {
        self.uniforms.clear();
    }
}

fn compile(context: &Context, kernel: Kernel, source: &str) -> Compiled {
    let label = format!("{kernel:?}");
    let source = format!("{}{}{source}", context.constants(), shared_constants());
    let module = context.device.create_shader_module(wgpu::ShaderModuleDescriptor {
        label: Some(&label),
        source: wgpu::ShaderSource::Wgsl(source.into()),
    });
    let pipeline = context.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
        label: Some(&label),
        layout: None,
        module: &module,
        entry_point: Some("main"),
        // Kernels write what they read of a workgroup's memory.
        compilation_options: wgpu::PipelineCompilationOptions {
            zero_initialize_workgroup_memory: false,
            ..wgpu::PipelineCompilationOptions::default()
        },
        cache: None,
    });
    let layout = pipeline.get_bind_group_layout(0);
    (pipeline, layout)
}

/// Buffers reused from frame to frame, by content and part.
#[derive(Debug, Default)]
pub(super) struct Pool {
    buffers: BTreeMap<(&'static str, usize), Pooled>,
    /// Number of frames begun.
    frames: u64,
}

#[derive(Debug)]
struct Pooled {
    buffer: wgpu::Buffer,
    /// The last frame that used it.
    frame: u64,
}

impl Pool {
    /// Begins a frame: buffers of earlier frames may be freed from now on.
    pub(super) const fn begin_frame(&mut self) {
        self.frames += 1;
    }

    /// A buffer of at least this many bytes; its contents are lost if it has to grow.
    pub(super) fn get(
        &mut self,
        context: &Context,
        name: &'static str,
        part: usize,
        bytes: u64,
    ) -> Result<wgpu::Buffer, GpuError> {
        let frame = self.frames;
        if let Some(kept) = self.buffers.get_mut(&(name, part))
            && kept.buffer.size() >= bytes
        {
            kept.frame = frame;
            return Ok(kept.buffer.clone());
        }
        self.buffers.remove(&(name, part));
        // A quarter larger, so that scenes of similar size can share it.
        let padded = (bytes + bytes / 4).min(context.binding_limit);
        if self.bytes().saturating_add(padded) > context.memory_limit {
            self.buffers.retain(|_, kept| kept.frame == frame);
        }
        let has_room = self.bytes().saturating_add(padded) <= context.memory_limit;
        let buffer = context.buffer(name, if has_room && padded > bytes { padded } else { bytes })?;
        self.buffers.insert((name, part), Pooled { buffer: buffer.clone(), frame });
        Ok(buffer)
    }

    /// Bytes of all pooled buffers.
    pub(super) fn bytes(&self) -> u64 {
        self.buffers.values().map(|kept| kept.buffer.size()).sum()
    }

    /// Frees all buffers.
    pub(super) fn clear(&mut self) {
        self.buffers.clear();
    }
}
