use std::path::PathBuf;

use clap::Args;

#[derive(Debug, Args)]
pub(crate) struct Words {
    /// Video that the trajectory was filmed in.
    video: PathBuf,

    /// RE10K trajectory whose timestamps are cut.
    trajectory: PathBuf,

    /// Folder under which `<key>/<timestamp>.jpg` are written.
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
pub(crate) fn run(_: &Words) -> anyhow::Result<bool> {
    Err(super::needs_opencv("data frames"))
}

#[cfg(feature = "opencv")]
pub(crate) fn run(words: &Words) -> anyhow::Result<bool> {
    use anyhow::Context as _;
    use atsplat_scene::opencv::{CutOptions, FrameFormat, cut_frames};
    use atsplat_scene::re10k::read_trajectory;

    use crate::output::print_report;
    use crate::progress::Progress;

    let trajectory = read_trajectory(&words.trajectory)?;
    let timestamps: Vec<i64> = trajectory.rows.iter().map(|row| row.timestamp_micros).collect();
    let of_file = || words.trajectory.file_stem()?.to_str().map(str::to_owned);
    let key =
        words.key.clone().or_else(of_file).context("the trajectory's file name makes no scene key; give --key")?;
    let format = if words.png { FrameFormat::Png } else { FrameFormat::Jpeg(words.quality) };
    let options = CutOptions { folder: words.out.clone(), format };
    let progress = Progress::new("frames", timestamps.len());
    let cut = cut_frames(&words.video, &key, &timestamps, &options, |decided| progress.reach(decided))?;
    drop(progress);
    print_report(&cut, words.json)?;
    Ok(cut.written() == timestamps.len())
}
