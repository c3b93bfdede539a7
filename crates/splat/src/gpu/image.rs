//! Images in the format that the host needs: what is not requested is not copied.

use atsplat_camera::ImageSize;

use super::kernels::Kernel;
use super::record::Recorder;
use super::sort::words;
use super::work::Work;
use super::{GpuError, GpuRenderer, GpuRendering, Pending};
use crate::{GaussianCounts, SplatError};

/// The numbers of an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImageNumbers {
    /// The nearest of 256 levels from 0 to 1.
    U8,
    /// The nearest f16, or its neighbour where the adapter rounds otherwise; at most 65 504 in magnitude.
    F16,
    /// As rendered.
    F32,
}

/// The format of an image: red, green, blue and perhaps alpha, pixel by pixel, row by row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ImageFormat {
    /// Its numbers.
    pub numbers: ImageNumbers,
    /// Whether alpha follows the colour of each pixel.
    pub alpha: bool,
}

/// An image on the host.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GpuImage {
    /// In pixels.
    pub size: ImageSize,
    /// Its format.
    pub format: ImageFormat,
    /// Its numbers, little-endian.
    pub bytes: Vec<u8>,
    /// Counts of drawn and culled Gaussians.
    pub counts: GaussianCounts,
}

impl ImageFormat {
    const fn channels(self) -> u64 {
        if self.alpha { 4 } else { 3 }
    }

    const fn bytes_of_number(self) -> u64 {
        match self.numbers {
            ImageNumbers::U8 => 1,
            ImageNumbers::F16 => 2,
            ImageNumbers::F32 => 4,
        }
    }

    /// Bytes of this number of pixels.
    const fn bytes(self, pixels: u64) -> u64 {
        pixels * self.channels() * self.bytes_of_number()
    }
}

impl GpuRenderer {
    /// Copies the colours of a rendering to the host, converted on the device, with one wait for it.
    ///
    /// # Errors
    /// [`SplatError::Gpu`].
    pub fn read_image(
        &mut self,
        rendering: &Pending<GpuRendering>,
        format: ImageFormat,
    ) -> Result<GpuImage, SplatError> {
        let GpuRendering { size, strips, .. } = rendering.unsettled();
        let pixels: Vec<u64> = strips.iter().map(|strip| u64::from(strip.rows) * u64::from(size.width)).collect();
        let bytes: Vec<u64> = pixels.iter().map(|pixels| format.bytes(*pixels)).collect();
        let Work { context, pool, .. } = self.work();
        let packed = context.guarded(|| {
            let packed = bytes.iter().enumerate().map(|(at, bytes)| pool.get(context, "packed", at, *bytes));
            packed.collect::<Result<Vec<_>, GpuError>>()
        })?;
        let pack = |recorder: &mut Recorder<'_>| -> Result<(), GpuError> {
            for ((strip, packed), (pixels, bytes)) in strips.iter().zip(&packed).zip(pixels.iter().zip(&bytes)) {
                let uniform = words(&[*pixels, format.channels(), format.bytes_of_number(), 0]);
                let groups = bytes.div_ceil(4).div_ceil(64);
                recorder.dispatch(Kernel::Pack, &uniform, &[&strip.colours, packed], groups)?;
            }
            Ok(())
        };
        let sources: Vec<_> =
            packed.iter().zip(&bytes).map(|(packed, bytes)| (packed, bytes.next_multiple_of(4))).collect();
        let (mut contents, counts) = self.complete(rendering, &sources, &pack)?;
        for (content, bytes) in contents.iter_mut().zip(&bytes) {
            content.truncate(usize::try_from(*bytes).unwrap_or(usize::MAX));
        }
        let bytes = if contents.len() == 1 { contents.remove(0) } else { contents.concat() };
        Ok(GpuImage { size: *size, format, bytes, counts })
    }
}
