use std::fmt;
use std::io::Write;

use crate::{ImageFormat, ImageU8, PixelError};

/// Writes an animated PNG frame by frame: 8-bit RGB, lossless, infinite loop. The same frames give the same bytes.
/// Viewers without support for animation show the first frame.
pub struct AnimatedPng<W: Write> {
    writer: png::Writer<W>,
    size: (u32, u32),
    frames: u32,
    written: u32,
}

impl<W: Write> fmt::Debug for AnimatedPng<W> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { size: (width, height), frames, written, .. } = self;
        write!(f, "AnimatedPng({width}×{height}, {written} of {frames} frames)")
    }
}

impl<W: Write> AnimatedPng<W> {
    /// Writes the header for `frames` images of `width × height` at `per_second` frames per second.
    ///
    /// # Errors
    /// [`PixelError::Empty`] for an image without pixels, [`PixelError::Encode`], also for zero frames or zero frames
    /// per second.
    pub fn new(out: W, (width, height): (u32, u32), frames: u32, per_second: u16) -> Result<Self, PixelError> {
        if width == 0 || height == 0 {
            return Err(PixelError::Empty { what: "animation", width, height });
        }
        let mut encoder = png::Encoder::new(out, width, height);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
        encoder.set_animated(frames, 0).map_err(failed)?;
        if per_second == 0 {
            let source = "expected at least one frame per second, found 0".into();
            return Err(PixelError::Encode { format: ImageFormat::Png, source });
        }
        encoder.set_frame_delay(1, per_second).map_err(failed)?;
        Ok(Self { writer: encoder.write_header().map_err(failed)?, size: (width, height), frames, written: 0 })
    }

    /// Appends a frame.
    ///
    /// # Errors
    /// [`PixelError::FrameSize`] for an image of another size, [`PixelError::FrameCount`] beyond the last frame,
    /// [`PixelError::Encode`] if it cannot be written.
    pub fn push(&mut self, image: &ImageU8) -> Result<(), PixelError> {
        let found = (image.width(), image.height());
        if found != self.size {
            return Err(PixelError::FrameSize { expected: self.size, found });
        }
        if self.written == self.frames {
            return Err(PixelError::FrameCount { expected: self.frames, found: self.written + 1 });
        }
        self.writer.write_image_data(image.samples()).map_err(failed)?;
        self.written += 1;
        Ok(())
    }

    /// Completes the file.
    ///
    /// # Errors
    /// [`PixelError::FrameCount`] if frames are missing, [`PixelError::Encode`].
    pub fn finish(self) -> Result<(), PixelError> {
        if self.written < self.frames {
            return Err(PixelError::FrameCount { expected: self.frames, found: self.written });
        }
        self.writer.finish().map_err(failed)
    }
}

fn failed(source: png::EncodingError) -> PixelError {
    PixelError::Encode { format: ImageFormat::Png, source: source.into() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{DecodeLimits, decode};

    const SIZE: (u32, u32) = (5, 3);

    fn frame(seed: u8) -> ImageU8 {
        ImageU8::new(SIZE.0, SIZE.1, (0..45u8).map(|at| at.wrapping_mul(7).wrapping_add(seed)).collect()).unwrap()
    }

    fn animation(frames: &[ImageU8]) -> Vec<u8> {
        let mut file = Vec::new();
        let mut animation = AnimatedPng::new(&mut file, SIZE, u32::try_from(frames.len()).unwrap(), 24).unwrap();
        for frame in frames {
            animation.push(frame).unwrap();
        }
        animation.finish().unwrap();
        file
    }

    #[test]
    fn frames_round_trip_with_their_delay() {
        let frames = [frame(0), frame(90), frame(0)];
        let file = animation(&frames);
        let mut reader = png::Decoder::new(std::io::Cursor::new(&file)).read_info().unwrap();
        let control = reader.info().animation_control.unwrap();
        assert_eq!((control.num_frames, control.num_plays), (3, 0), "infinite loop");
        for expected in &frames {
            let mut samples = vec![0; reader.output_buffer_size().unwrap()];
            reader.next_frame(&mut samples).unwrap();
            assert_eq!(samples, expected.samples());
            let control = reader.info().frame_control.unwrap();
            assert_eq!((control.delay_num, control.delay_den), (1, 24));
        }
        assert_eq!(animation(&frames), file, "the same bytes");
    }

    #[test]
    fn a_decoder_without_animation_reads_the_first_frame() {
        let file = animation(&[frame(3), frame(4)]);
        assert_eq!(decode(&file, &DecodeLimits::default()).unwrap(), frame(3));
    }

    #[test]
    fn frame_sizes_and_counts_are_checked() {
        let mut file = Vec::new();
        let mut animation = AnimatedPng::new(&mut file, SIZE, 2, 24).unwrap();
        let other = ImageU8::new(3, 5, vec![0; 45]).unwrap();
        assert!(matches!(animation.push(&other), Err(PixelError::FrameSize { expected: SIZE, found: (3, 5) })));
        animation.push(&frame(0)).unwrap();
        animation.push(&frame(1)).unwrap();
        let extra = animation.push(&frame(2));
        assert!(matches!(extra, Err(PixelError::FrameCount { expected: 2, found: 3 })), "{extra:?}");
        let mut unfinished = AnimatedPng::new(Vec::new(), SIZE, 2, 24).unwrap();
        unfinished.push(&frame(0)).unwrap();
        assert!(matches!(unfinished.finish(), Err(PixelError::FrameCount { expected: 2, found: 1 })));
        assert!(matches!(AnimatedPng::new(Vec::new(), (0, 3), 1, 24), Err(PixelError::Empty { .. })));
        assert!(matches!(AnimatedPng::new(Vec::new(), SIZE, 0, 24), Err(PixelError::Encode { .. })));
        assert!(matches!(AnimatedPng::new(Vec::new(), SIZE, 1, 0), Err(PixelError::Encode { .. })));
    }
}
