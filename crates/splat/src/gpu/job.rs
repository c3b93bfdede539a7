//! What is rendered: one view of Gaussians, or a batch.

use atsplat_camera::ImageSize;

use super::GpuError;
use super::context::Context;
use super::gaussians::{GpuGaussians, GpuPart};
use super::images;
use super::sort::word;
use super::uniforms::{ViewBlock, flag};
use crate::{RenderOptions, SplatError, View, sh_coefficients};

/// One view of Gaussians; or a batch: consecutive scenes with equal numbers of Gaussians and equal numbers of views, all views of one
/// size. A batch goes through every kernel once, in a single part, strip and window.
///
/// A splat is a Gaussian projected to one view, so a single view has one splat per Gaussian.
#[derive(Clone, Copy)]
pub(super) struct Job<'a> {
    pub(super) gaussians: &'a GpuGaussians,
    /// At least one; in a batch, those of the first scene first.
    pub(super) views: &'a [View],
    pub(super) scenes: u32,
    pub(super) options: &'a RenderOptions,
}

impl<'a> Job<'a> {
    pub(super) const fn of_view(gaussians: &'a GpuGaussians, view: &'a View, options: &'a RenderOptions) -> Self {
        Self { gaussians, views: std::slice::from_ref(view), scenes: 1, options }
    }

    pub(super) const fn is_batch(&self) -> bool {
        self.views.len() > 1
    }

    /// The first view, whose size all have.
    pub(super) const fn view(&self) -> &'a View {
        &self.views[0]
    }

    #[expect(clippy::cast_possible_truncation, reason = "checked to be at most `Context::most_views`")]
    pub(super) const fn images(&self) -> u32 {
        self.views.len() as u32
    }

    /// The size of the images below each other.
    pub(super) const fn size(&self) -> ImageSize {
        let ImageSize { width, height } = self.view().size;
        ImageSize { width, height: height.saturating_mul(self.images()) }
    }

    pub(super) fn pixels(&self) -> u64 {
        u64::from(self.size().width) * u64::from(self.size().height)
    }

    /// Gaussians of a scene.
    pub(super) fn gaussians_of_scene(&self) -> u64 {
        self.gaussians.len() / u64::from(self.scenes.max(1))
    }

    pub(super) fn splats(&self) -> u64 {
        self.gaussians_of_scene() * u64::from(self.images())
    }

    pub(super) const fn views_of_scene(&self) -> u32 {
        let scenes = if self.scenes > 1 { self.scenes } else { 1 };
        self.images() / scenes
    }

    pub(super) fn strips(&self, context: &Context) -> Result<Vec<[u32; 2]>, SplatError> {
        images::strips(context, self.view(), self.images())
    }

    /// Rejects jobs that cannot be rendered; does not check their size in memory.
    pub(super) fn check(&self, context: &Context) -> Result<(), SplatError> {
        self.options.check()?;
        self.views.iter().try_for_each(|view| view.optics(&self.options.constants).map(|_| ()))?;
        // A single view of several scenes is not a batch, and would show only some of the Gaussians.
        if !self.is_batch() && self.scenes <= 1 {
            return Ok(());
        }
        let (views, scenes) = (self.views.len(), self.scenes.max(1) as usize);
        let gaussians = usize::try_from(self.gaussians.len()).unwrap_or(usize::MAX);
        let of_one_size = self.views.iter().filter(|view| view.size == self.view().size).count();
        let whole = |count: usize| count / scenes * scenes;
        let lengths = [
            ("views of one size", views, of_one_size),
            ("views, the same number for every scene", whole(views).max(scenes), views),
            ("Gaussians, the same number for every scene", whole(gaussians), gaussians),
        ];
        if let Some((field, expected, found)) = lengths.into_iter().find(|(_, expected, found)| expected != found) {
            return Err(SplatError::Length { field, expected, found });
        }
        let size = self.view().size;
        let tiles = u64::from(size.width.div_ceil(super::forward::TILE))
            * u64::from(size.height.div_ceil(super::forward::TILE));
        let limits = [
            ("views of a batch", "views", views as u64, context.most_views.into()),
            ("parts of the Gaussians of a batch", "parts", self.gaussians.parts.len() as u64, 1),
            ("tiles of an image of a batch", "tiles", tiles, context.tiles_per_window),
        ];
        match limits.into_iter().find(|(.., needed, limit)| needed > limit) {
            Some((what, unit, needed, limit)) => {
                Err(GpuError::TooLarge { adapter: context.name.clone(), what, unit, needed, limit }.into())
            }
            None => Ok(()),
        }
    }

    /// The uniform block of each view, with these flags.
    pub(super) fn blocks(&self, flags: &[(u32, bool)]) -> Result<Vec<ViewBlock>, SplatError> {
        let block = |view: &View| {
            let optics = view.optics(&self.options.constants)?;
            let block = ViewBlock::new(view, &optics, self.options);
            let block = flags.iter().fold(block, |block, (flag, on)| block.with_flag(*flag, *on));
            Ok(if self.is_batch() {
                let splats = word(self.gaussians_of_scene());
                block.in_batch(splats, self.views_of_scene(), self.images())
            } else {
                block
            })
        };
        self.views.iter().map(block).collect()
    }

    /// Uniforms and number of threads of the kernels that see each splat's own view, for one part of the Gaussians.
    pub(super) fn launch(
        &self,
        context: &Context,
        blocks: &[ViewBlock],
        (part, first): (&GpuPart, u32),
    ) -> (Vec<u8>, u64) {
        let count = if self.is_batch() { self.splats() } else { part.count.into() };
        let sh_degree = self.gaussians.sh_degree;
        let degree = self.options.sh_degree(sh_degree);
        #[expect(clippy::cast_possible_truncation, reason = "at most 25 coefficients")]
        let stored = sh_coefficients(sh_degree) as u32;
        let mut bytes = Vec::new();
        for block in blocks {
            let mut block = block
                .with_flag(flag::HAS_FILTER, part.filter_3d.is_some())
                .with_flag(flag::HAS_SCALAR, part.scalars.is_some());
            block.part = [word(count), first, stored, degree.into()];
            bytes.extend_from_slice(block.bytes());
        }
        if self.is_batch() {
            bytes.resize(context.most_views as usize * size_of::<ViewBlock>(), 0);
        }
        (bytes, count)
    }
}
