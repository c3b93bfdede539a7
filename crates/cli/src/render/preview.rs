use std::path::PathBuf;

use anyhow::{Context as _, bail};
use atsplat_camera::ImageSize;
use atsplat_eval::images::is_frame_file_name;
use atsplat_files::Writer;
use atsplat_pixels::{AnimatedPng, Filter, ImageU8, resize};

use super::views::Shot;
use crate::output::PendingFile;

/// Arguments of the animated preview.
#[derive(Debug, clap::Args)]
pub(crate) struct PreviewArgs {
    /// Write all frames as one animated PNG, .png or .apng.
    #[arg(long, value_name = "FILE", value_parser = animation_path)]
    pub(crate) preview: Option<PathBuf>,

    /// Maximum width of the preview in pixels; its height follows.
    #[arg(long, value_name = "PIXELS", default_value_t = 480, requires = "preview", value_parser = clap::value_parser!(u32).range(1..=4096))]
    preview_width: u32,

    /// Frames per second.
    #[arg(long, value_name = "N", default_value_t = 24, requires = "preview", value_parser = clap::value_parser!(u16).range(1..=240))]
    fps: u16,
}

fn animation_path(text: &str) -> Result<PathBuf, String> {
    let path = PathBuf::from(text);
    match path.extension().and_then(std::ffi::OsStr::to_str) {
        _ if path.file_name().and_then(std::ffi::OsStr::to_str).is_some_and(is_frame_file_name) => {
            Err(format!("frames have names of this form: expected another name, found {text:?}"))
        }
        Some("png" | "apng") => Ok(path),
        _ => Err(format!("expected a preview file that ends in .png or .apng, found {text:?}")),
    }
}

/// An animation in progress; its file appears when it is complete.
#[derive(Debug)]
pub(crate) struct Preview {
    animation: AnimatedPng<Writer>,
    file: PendingFile,
    size: ImageSize,
}

impl PreviewArgs {
    /// Opens the file, if requested.
    pub(crate) fn open(&self) -> anyhow::Result<Option<PendingFile>> {
        self.preview.as_deref().map(PendingFile::open).transpose()
    }

    /// Starts the animation of these shots.
    pub(crate) fn start(&self, file: PendingFile, shots: &[Shot]) -> anyhow::Result<Preview> {
        let full = shots.first().context("a preview needs a frame")?.view.size;
        if let Some(other) = shots.iter().map(|shot| shot.view.size).find(|size| *size != full) {
            bail!("--preview needs frames of one size, found {full} and {other}: set one with --size");
        }
        let size = self.size(full);
        let frames = u32::try_from(shots.len()).context("too many frames for an animation")?;
        let out = file.writer();
        let animation = AnimatedPng::new(out, (size.width, size.height), frames, self.fps)?;
        Ok(Preview { animation, file, size })
    }

    fn size(&self, full: ImageSize) -> ImageSize {
        if full.width <= self.preview_width {
            return full;
        }
        let width = self.preview_width;
        let height = (u64::from(full.height) * u64::from(width) + u64::from(full.width) / 2) / u64::from(full.width);
        ImageSize { width, height: u32::try_from(height).unwrap_or(full.height).clamp(1, full.height) }
    }
}

impl Preview {
    /// The size of its frames.
    pub(crate) const fn size(&self) -> ImageSize {
        self.size
    }

    /// Appends a frame of its size, or a crossed-out one for a frame that could not be rendered.
    pub(crate) fn push(&mut self, frame: Option<&ImageU8>) -> anyhow::Result<()> {
        if let Some(frame) = frame {
            return Ok(self.animation.push(frame)?);
        }
        Ok(self.animation.push(&crossed_out(self.size)?)?)
    }

    /// Moves the file to its target.
    pub(crate) fn finish(self) -> anyhow::Result<()> {
        self.animation.finish()?;
        self.file.commit()
    }
}

/// Red diagonals on black, which no scene shows by chance.
fn crossed_out(ImageSize { width, height }: ImageSize) -> anyhow::Result<ImageU8> {
    let pixel = |row: u32, column: u32| {
        let along = u64::from(row) * u64::from(width) / u64::from(height);
        let is_crossed = [along, u64::from(width - 1) - along].contains(&u64::from(column));
        [if is_crossed { 255 } else { 0 }, 0, 0]
    };
    let pixels = (0..height).flat_map(|row| (0..width).flat_map(move |column| pixel(row, column)));
    Ok(ImageU8::new(width, height, pixels.collect())?)
}

/// Scales a frame to the preview's size.
pub(crate) fn scaled(frame: &ImageU8, size: ImageSize) -> anyhow::Result<ImageU8> {
    Ok(resize(frame, size.width, size.height, Filter::Lanczos)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn previews_keep_their_shape_and_are_never_enlarged() {
        let args = PreviewArgs { preview: None, preview_width: 480, fps: 24 };
        let of = |width, height| {
            let size = args.size(ImageSize { width, height });
            (size.width, size.height)
        };
        assert_eq!(of(960, 540), (480, 270));
        assert_eq!(of(320, 4000), (320, 4000));
        assert_eq!(of(1000, 333), (480, 160));
        assert_eq!(of(60_000, 1), (480, 1));
    }

    #[test]
    fn accepts_only_animation_file_names() {
        assert!(animation_path("a/b.apng").is_ok() && animation_path("b.png").is_ok());
        assert!(animation_path("b.gif").is_err() && animation_path("png").is_err());
        assert!(animation_path("out/000000.png").is_err() && animation_path("out/000000.apng").is_ok());
    }

    #[test]
    fn a_failed_frame_is_crossed_out() {
        let failed = crossed_out(ImageSize { width: 3, height: 3 }).unwrap();
        let red: Vec<u8> = failed.samples().iter().step_by(3).copied().collect();
        assert_eq!(red, [255, 0, 255, 0, 255, 0, 255, 0, 255]);
        assert!(crossed_out(ImageSize { width: 1, height: 7 }).is_ok());
    }
}
