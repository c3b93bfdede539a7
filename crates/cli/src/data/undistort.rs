use std::path::PathBuf;

use clap::ValueEnum;

use crate::dataset_args::DatasetArgs;

#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    dataset: DatasetArgs,

    /// Folder for `<key>/images/<frame>.png` and `<key>/transforms.json`.
    #[arg(long, short, value_name = "FOLDER")]
    out: PathBuf,

    /// Pinhole camera of the new images.
    #[arg(long, value_enum, default_value_t = Mode::KeepK)]
    mode: Mode,

    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// Pinhole camera of the undistorted images.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub(crate) enum Mode {
    /// The same intrinsics; the border may be black.
    KeepK,
    /// New intrinsics without a black border, as Long-LRM and iLRM-wide undistort DL3DV; portrait captures, which Long-LRM's own
    /// script skips, are undistorted too.
    LongLrm,
}

#[cfg(not(feature = "opencv"))]
pub(crate) fn run(_: &Args) -> anyhow::Result<bool> {
    Err(super::needs_opencv("data undistort"))
}

#[cfg(feature = "opencv")]
pub(crate) use with_opencv::run;

#[cfg(feature = "opencv")]
mod with_opencv {
    use std::fmt;
    use std::path::Path;

    use anyhow::{bail, ensure};
    use atsplat_files::canonical_path;
    use atsplat_numeric::{counted, noun};
    use atsplat_opencv::{OpenCvError, UndistortMode, UndistortedFrames, undistort_scene, undistorted_files};
    use atsplat_scene::inspect::left_out;
    use atsplat_scene::{SceneSource as _, WarningKind, Warnings, is_plain_name};
    use serde::Serialize;

    use super::{Args, Mode};
    use crate::output_lock::OutputLock;
    use crate::overwrite::{Input, InputFile, check_output, check_outputs, photos};
    use crate::paths::NewFolders;
    use crate::print::print_report;
    use crate::progress::Progress;
    use crate::warnings::print_warnings;

    #[derive(Serialize)]
    #[serde(rename_all = "kebab-case")]
    struct Report {
        /// Images.
        written: u64,
        /// Scenes, and single frames of other scenes.
        skipped: u64,
    }

    impl fmt::Display for Report {
        fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            let [scenes, frames] = ["scene", "frame"].map(|what| noun(self.skipped, what));
            writeln!(f, "{} written, {} {scenes} or {frames} skipped", counted(self.written, "image"), self.skipped)
        }
    }

    pub(crate) fn run(args: &Args) -> anyhow::Result<bool> {
        let mode = match args.mode {
            Mode::KeepK => UndistortMode::KeepK,
            Mode::LongLrm => UndistortMode::LongLrm,
        };
        let mut warnings = Warnings::new();
        let dataset = args.dataset.open(&mut warnings)?;
        let opening = warnings.clone();
        // Before anything is written: the key of a capture is its folder's name, so that its own folder may be that of the output.
        for key in dataset.keys().iter().filter(|key| is_plain_name(key)) {
            let folder = args.out.join(key);
            check_output("--out", &folder.join("transforms.json"), &[Input::Dataset(&args.dataset.data)])?;
            check_apart(&folder, dataset.files(key)?.iter().map(|file| ("file", file.as_path())))?;
        }
        let _lock = OutputLock::of(&args.out)?;
        let mut report = Report { written: 0, skipped: 0 };
        for key in dataset.keys() {
            let loaded = if is_plain_name(key) {
                dataset.load(key, &mut warnings).map_err(|error| error.to_string())
            } else {
                Err("its key is not a folder name".to_owned())
            };
            let undistorted = match loaded {
                Ok(scene) => {
                    let progress = Progress::new("frames", scene.frames.len());
                    let folder = args.out.join(key);
                    check_apart(&folder, photos(&scene.frames))?;
                    check_outputs("--out", undistorted_files(&scene, &folder), photos(&scene.frames))?;
                    // A scene that is skipped leaves no empty folder.
                    let _folders = NewFolders::of(&folder.join("images"))?;
                    match undistort_scene(&scene, mode, &folder, &mut warnings, &|| progress.step()) {
                        Ok(frames) => Ok(frames),
                        Err(error @ OpenCvError::Lens { .. }) => Err(format!("it cannot be undistorted: {error}")),
                        Err(error) => return Err(error.into()),
                    }
                }
                Err(why) => {
                    dataset.check_fetched()?;
                    Err(why)
                }
            };
            match undistorted {
                Ok(UndistortedFrames { written, skipped }) => {
                    report.written += written;
                    report.skipped += skipped;
                }
                Err(why) => {
                    report.skipped += 1;
                    warnings.push(WarningKind::UnreadableScene, key, why);
                }
            }
        }
        report.skipped += left_out(&opening, &warnings);
        print_report(&report, args.json)?;
        print_warnings(&warnings);
        ensure!(report.written > 0, "no image of {} could be undistorted", args.dataset.data.display());
        Ok(report.skipped == 0)
    }

    /// Rejects a folder that contains files of its scene: the new cameras would be read instead of the scene's, or the photos
    /// instead of the new images.
    fn check_apart<'a>(folder: &Path, files: impl Iterator<Item = InputFile<'a>>) -> anyhow::Result<()> {
        let canonical = canonical_path(folder)?;
        for (what, file) in files {
            let parent = canonical_path(file.parent().unwrap_or_else(|| Path::new("")))?;
            if parent.starts_with(&canonical) {
                let (folder, file) = (folder.display(), file.display());
                bail!("--out: {folder} contains the {what} {file} of its scene; choose another folder");
            }
        }
        Ok(())
    }
}
