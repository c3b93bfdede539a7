use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Video of the trajectory.
    video: PathBuf,

    /// RE10K trajectory with the timestamps of the frames.
    trajectory: PathBuf,

    /// Folder for `<key>/<timestamp>.jpg`.
    #[arg(long, short, value_name = "FOLDER")]
    out: PathBuf,

    /// Scene key; the trajectory's file name without its extension by default.
    #[arg(long)]
    key: Option<String>,

    /// Write PNG instead of JPEG.
    #[arg(long)]
    png: bool,

    /// JPEG quality.
    #[arg(long, default_value_t = 95, value_parser = clap::value_parser!(u8).range(1..=100), conflicts_with = "png")]
    quality: u8,

    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[cfg(not(feature = "opencv"))]
pub(crate) fn run(_: &Args) -> anyhow::Result<bool> {
    Err(super::needs_opencv("data frames"))
}

#[cfg(feature = "opencv")]
pub(crate) fn run(args: &Args) -> anyhow::Result<bool> {
    use anyhow::{Context as _, ensure};
    use atsplat_opencv::{ExtractionOptions, FrameFormat, extract_frames};
    use atsplat_scene::is_plain_name;
    use atsplat_scene::re10k::read_trajectory;

    use crate::output_lock::OutputLock;
    use crate::print::print_report;
    use crate::progress::Progress;

    let trajectory = read_trajectory(&args.trajectory)?;
    let timestamps: Vec<i64> = trajectory.rows.iter().map(|row| row.timestamp_micros).collect();
    let file_stem = || args.trajectory.file_stem()?.to_str().map(str::to_owned);
    let key =
        args.key.clone().or_else(file_stem).context("the trajectory's file name is not a scene key; set --key")?;
    let format = if args.png { FrameFormat::Png } else { FrameFormat::Jpeg(args.quality) };
    let options = ExtractionOptions { folder: args.out.clone(), format };
    // Of the scene: frames of several videos may be cut into one folder at once. Another key is an error of the extraction.
    let _lock = is_plain_name(&key).then(|| OutputLock::of(&args.out.join(&key))).transpose()?;
    let progress = Progress::new("frames", timestamps.len());
    let extracted = extract_frames(&args.video, &key, &timestamps, &options, |decided| progress.reach(decided))?;
    drop(progress);
    print_report(&extracted, args.json)?;
    ensure!(extracted.written() > 0, "no frame of {} is at a timestamp of the trajectory", args.video.display());
    Ok(extracted.written() == timestamps.len())
}
