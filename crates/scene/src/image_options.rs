use std::path::PathBuf;

use thiserror::Error;

use crate::{ColmapOptions, Format, ImageFolder, NerfstudioOptions, OpenOptions, Re10kOptions};

/// Where a dataset's images are, as users say it before the format is known.
#[derive(Clone, Debug, Default)]
pub struct ImageOptions {
    /// Which copy of a capture's images: 1 for `images`, 2, 4 or 8 for `images_2` and so on.
    pub images: Option<u32>,
    /// Folder of the frames, if they are not next to the poses.
    pub frames: Option<PathBuf>,
    /// Use DL3DV's undistorted `gaussian_splat/` in scenes that have it.
    pub prefer_undistorted: bool,
}

impl ImageOptions {
    /// The same as options of every format.
    pub fn open_options(&self) -> OpenOptions {
        let images = match self.images {
            None => ImageFolder::default(),
            Some(1) => ImageFolder::Listed,
            Some(factor) => ImageFolder::Downscaled(factor),
        };
        OpenOptions {
            re10k: Re10kOptions { frames_root: self.frames.clone() },
            nerfstudio: NerfstudioOptions {
                images,
                prefer_gaussian_splat: self.prefer_undistorted,
                ..NerfstudioOptions::default()
            },
            colmap: ColmapOptions { images, images_root: self.frames.clone() },
            ..OpenOptions::default()
        }
    }

    /// Rejects an option that data of this format would ignore; `None` stands for the output of `atsplat render`.
    ///
    /// # Errors
    /// The first such option.
    pub fn check(&self, format: Option<Format>) -> Result<(), UnreadOption> {
        let read = format.map(|format| format.reader().image_options).unwrap_or_default();
        let options = [
            ("images", self.images.is_some(), "captures of nerfstudio or COLMAP"),
            ("frames", self.frames.is_some(), "RE10K trajectories or a COLMAP model"),
            ("prefer-undistorted", self.prefer_undistorted, "captures of nerfstudio or DL3DV"),
        ];
        match options.into_iter().find(|(option, is_given, _)| *is_given && !read.contains(option)) {
            None => Ok(()),
            Some((option, _, expected)) => Err(UnreadOption { option, expected, format }),
        }
    }
}

/// An option that the data at hand do not read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("{option}: expected {expected}, found {}", described(*format))]
pub struct UnreadOption {
    /// Its name without prefix.
    pub option: &'static str,
    /// Data that read it.
    pub expected: &'static str,
    /// The dataset's format; `None` for the output of `atsplat render`.
    pub format: Option<Format>,
}

fn described(format: Option<Format>) -> String {
    format.map_or_else(
        || "the output of `atsplat render`".to_owned(),
        |format| format!("a dataset in the format {format}"),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn each() -> [ImageOptions; 3] {
        [
            ImageOptions { images: Some(8), ..ImageOptions::default() },
            ImageOptions { frames: Some("frames".into()), ..ImageOptions::default() },
            ImageOptions { prefer_undistorted: true, ..ImageOptions::default() },
        ]
    }

    /// `Debug` of the options of a format.
    fn shown(options: &OpenOptions, format: Format) -> String {
        match format {
            Format::Re10k => format!("{:?}", options.re10k),
            Format::TorchChunks => String::new(),
            Format::Nerfstudio => format!("{:?}", options.nerfstudio),
            Format::Colmap => format!("{:?}", options.colmap),
        }
    }

    #[test]
    fn an_option_is_rejected_exactly_where_it_changes_nothing() {
        for given in each() {
            for format in Format::ALL {
                let changes = shown(&given.open_options(), format) != shown(&OpenOptions::default(), format);
                assert_eq!(given.check(Some(format)).is_ok(), changes, "{given:?} {format}");
                assert_eq!(ImageOptions::default().check(Some(format)), Ok(()));
            }
            assert!(given.check(None).is_err(), "{given:?}");
        }
        assert_eq!(ImageOptions::default().check(None), Ok(()));
    }

    #[test]
    fn errors_name_the_formats_that_read_an_option_and_no_other() {
        for given in each() {
            let expected = given.check(None).unwrap_err().expected.to_lowercase();
            for format in Format::ALL {
                assert_eq!(expected.contains(format.name()), given.check(Some(format)).is_ok(), "{format}: {expected}");
            }
        }
    }

    #[test]
    fn the_error_names_option_and_format() {
        let [images, frames, undistorted] = each();
        for (given, format, expected) in [
            (
                &images,
                Some(Format::Re10k),
                "images: expected captures of nerfstudio or COLMAP, found a dataset in the format re10k",
            ),
            (
                &frames,
                None,
                "frames: expected RE10K trajectories or a COLMAP model, found the output of `atsplat render`",
            ),
            (
                &undistorted,
                Some(Format::Colmap),
                "prefer-undistorted: expected captures of nerfstudio or DL3DV, found a dataset in the format colmap",
            ),
        ] {
            let unread = given.check(format).unwrap_err();
            assert_eq!((unread.to_string(), unread.format), (expected.to_owned(), format));
        }
    }

    #[test]
    fn images_are_named_by_the_suffix_of_their_folder() {
        let folder = |images| {
            let options = ImageOptions { images, ..ImageOptions::default() }.open_options();
            (options.nerfstudio.images, options.colmap.images)
        };
        assert_eq!(folder(None), (ImageFolder::Listed, ImageFolder::Listed));
        assert_eq!(folder(Some(1)), (ImageFolder::Listed, ImageFolder::Listed));
        assert_eq!(folder(Some(4)), (ImageFolder::Downscaled(4), ImageFolder::Downscaled(4)));
    }
}
