use std::path::PathBuf;

use anyhow::{Context as _, bail};
use atsplat_eval::rendering::FrameRequest;
use atsplat_eval::rendering::is_frame_file_name;
use atsplat_files::Writer;
use atsplat_pixels::Preview;

use crate::paths::PendingFile;

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
            Err(format!("expected another name than that of a frame, found {text:?}"))
        }
        Some("png" | "apng") => Ok(path),
        _ => Err(format!("expected a preview file that ends in .png or .apng, found {text:?}")),
    }
}

/// An animation in progress; its file appears when it is complete.
#[derive(Debug)]
pub(crate) struct PendingPreview {
    pub(crate) preview: Preview<Writer>,
    file: PendingFile,
}

impl PreviewArgs {
    /// Opens the file, if requested.
    pub(crate) fn open(&self) -> anyhow::Result<Option<PendingFile>> {
        self.preview.as_deref().map(PendingFile::open).transpose()
    }

    /// Starts the animation of these requests.
    pub(crate) fn start(&self, file: PendingFile, requests: &[FrameRequest]) -> anyhow::Result<PendingPreview> {
        let full = requests.first().context("a preview requires a frame")?.view.size;
        if let Some(other) = requests.iter().map(|request| request.view.size).find(|size| *size != full) {
            bail!("--preview requires frames of one size, found {full} and {other}; set one with --size");
        }
        let frames = u32::try_from(requests.len()).context("too many frames for an animation")?;
        let preview = Preview::new(file.writer(), (full.width, full.height), self.preview_width, frames, self.fps)?;
        Ok(PendingPreview { preview, file })
    }
}

impl PendingPreview {
    /// Moves the file to its target.
    pub(crate) fn finish(self) -> anyhow::Result<()> {
        self.preview.finish()?;
        self.file.commit()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn accepts_only_animation_file_names() {
        assert!(animation_path("a/b.apng").is_ok() && animation_path("b.png").is_ok());
        assert!(animation_path("b.gif").is_err() && animation_path("png").is_err());
        assert!(animation_path("out/000000.png").is_err() && animation_path("out/000000.apng").is_ok());
    }
}
