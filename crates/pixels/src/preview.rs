use std::io::Write;

use crate::{AnimatedPng, Filter, ImageU8, PixelError, resize};

/// An animated PNG of frames of one size, scaled down to a maximum width.
#[derive(Debug)]
pub struct Preview<W: Write> {
    animation: AnimatedPng<W>,
    size: (u32, u32),
}

impl<W: Write> Preview<W> {
    /// Starts an animation of `frames` frames of the size `full` (width and height), at most `max_width` pixels wide.
    ///
    /// # Errors
    /// [`PixelError`] if the animation cannot be encoded or written.
    pub fn new(
        out: W,
        full: (u32, u32),
        max_width: u32,
        frames: u32,
        frames_per_second: u16,
    ) -> Result<Self, PixelError> {
        let size = preview_size(full, max_width);
        Ok(Self { animation: AnimatedPng::new(out, size, frames, frames_per_second)?, size })
    }

    /// Width and height in pixels.
    pub const fn size(&self) -> (u32, u32) {
        self.size
    }

    /// Appends a frame of [`Self::size`], or a crossed-out one for a frame that could not be rendered.
    ///
    /// # Errors
    /// [`PixelError`] if the frame has another size, or cannot be written.
    pub fn push(&mut self, frame: Option<&ImageU8>) -> Result<(), PixelError> {
        match frame {
            Some(frame) => self.animation.push(frame),
            None => self.animation.push(&crossed_out(self.size)?),
        }
    }

    /// Completes the file.
    ///
    /// # Errors
    /// [`PixelError`] if frames are missing, or the file cannot be written.
    pub fn finish(self) -> Result<(), PixelError> {
        self.animation.finish()
    }
}

/// Scales a frame to the size of a preview.
///
/// # Errors
/// [`PixelError`] for an empty size.
pub fn preview_frame(frame: &ImageU8, (width, height): (u32, u32)) -> Result<ImageU8, PixelError> {
    resize(frame, width, height, Filter::Lanczos)
}

/// Keeps the aspect ratio, and never enlarges.
fn preview_size((width, height): (u32, u32), max_width: u32) -> (u32, u32) {
    if width <= max_width {
        return (width, height);
    }
    let scaled = (u64::from(height) * u64::from(max_width) + u64::from(width) / 2) / u64::from(width);
    (max_width, u32::try_from(scaled).unwrap_or(height).clamp(1, height))
}

/// Red diagonals on black, which no scene shows by chance.
fn crossed_out((width, height): (u32, u32)) -> Result<ImageU8, PixelError> {
    let pixel = |row: u32, column: u32| {
        let along = u64::from(row) * u64::from(width) / u64::from(height);
        let is_crossed = [along, u64::from(width - 1) - along].contains(&u64::from(column));
        [if is_crossed { 255 } else { 0 }, 0, 0]
    };
    let pixels = (0..height).flat_map(|row| (0..width).flat_map(move |column| pixel(row, column)));
    ImageU8::new(width, height, pixels.collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn previews_keep_their_shape_and_are_never_enlarged() {
        assert_eq!(preview_size((960, 540), 480), (480, 270));
        assert_eq!(preview_size((320, 4000), 480), (320, 4000));
        assert_eq!(preview_size((1000, 333), 480), (480, 160));
        assert_eq!(preview_size((60_000, 1), 480), (480, 1));
    }

    #[test]
    fn a_failed_frame_is_crossed_out() {
        let failed = crossed_out((3, 3)).unwrap();
        let red: Vec<u8> = failed.samples().iter().step_by(3).copied().collect();
        assert_eq!(red, [255, 0, 255, 0, 255, 0, 255, 0, 255]);
        assert!(crossed_out((1, 7)).is_ok());
    }
}
