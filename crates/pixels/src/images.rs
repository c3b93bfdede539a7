use crate::PixelError;

/// An RGB image of 8-bit samples, as in files. Row-major, height × width × 3.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub struct ImageU8 {
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) samples: Vec<u8>,
}

/// An RGB image of f32 display-referred (sRGB-encoded) values, nominally in [0, 1], as in every paper of the field.
/// Row-major, height × width × 3.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    pub(crate) width: u32,
    pub(crate) height: u32,
    pub(crate) samples: Vec<f32>,
}

macro_rules! image_methods {
    ($image:ident, $sample:ty) => {
        impl $image {
            /// An image from row-major interleaved RGB samples.
            ///
            /// # Errors
            /// [`PixelError::SampleCount`] if there are not `width · height · 3` samples.
            pub fn new(width: u32, height: u32, samples: Vec<$sample>) -> Result<Self, PixelError> {
                let expected = u64::from(width) * u64::from(height) * 3;
                if samples.len() as u64 != expected {
                    return Err(PixelError::SampleCount { width, height, expected, found: samples.len() });
                }
                Ok(Self { width, height, samples })
            }

            /// Columns.
            pub const fn width(&self) -> u32 {
                self.width
            }

            /// Rows.
            pub const fn height(&self) -> u32 {
                self.height
            }

            /// Row-major interleaved RGB samples.
            pub fn samples(&self) -> &[$sample] {
                &self.samples
            }

            /// Converts the image into its samples.
            pub fn into_samples(self) -> Vec<$sample> {
                self.samples
            }

            /// The three samples of one pixel; `None` outside the image.
            pub fn pixel(&self, column: u32, row: u32) -> Option<[$sample; 3]> {
                if column >= self.width || row >= self.height {
                    return None;
                }
                let start = (row as usize * self.width as usize + column as usize) * 3;
                self.samples.get(start..start + 3).and_then(|s| s.try_into().ok())
            }
        }
    };
}

image_methods!(ImageU8, u8);
image_methods!(Image, f32);
