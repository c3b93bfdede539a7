use std::fmt;
use std::path::PathBuf;

use anyhow::bail;
use atsplat_scene::export::{ExportFormat, ExportSummary, export};
use atsplat_scene::torch::{ChunkScene, ChunkWriter, ChunksWritten};
use atsplat_scene::{SceneError, SceneSource as _, WarningKind, Warnings};
use clap::Args;
use serde::Serialize;

use crate::dataset_words::DatasetWords;
use crate::output::{print_report, print_warnings};
use crate::progress::Progress;

#[derive(Debug, Args)]
pub(crate) struct Words {
    #[command(flatten)]
    dataset: DatasetWords,

    /// A file that ends in .parquet, .arrow or .csv; or a folder, for `.torch` chunks.
    out: PathBuf,

    /// Write `.torch` chunks with pictures, as pixelSplat's loader reads them, into the folder OUT.
    #[arg(long)]
    chunks: bool,

    /// Bytes of pictures after which a chunk is full.
    #[arg(long, value_name = "BYTES", default_value_t = ChunkWriter::TARGET_BYTES, requires = "chunks")]
    chunk_bytes: u64,

    /// Print JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
#[serde(untagged)]
enum Report {
    Table(ExportSummary),
    Chunks { chunks: usize, scenes: usize, skipped: u64 },
}

pub(crate) fn run(words: &Words) -> anyhow::Result<bool> {
    let mut warnings = Warnings::new();
    let report = if words.chunks { write_chunks(words, &mut warnings)? } else { write_table(words, &mut warnings)? };
    print_report(&report, words.json)?;
    print_warnings(&warnings);
    Ok(match report {
        Report::Table(summary) => summary.skipped == 0,
        Report::Chunks { skipped, .. } => skipped == 0,
    })
}

fn write_table(words: &Words, warnings: &mut Warnings) -> anyhow::Result<Report> {
    let format = ExportFormat::of_path(&words.out)?;
    let mut found = Warnings::new();
    let dataset = words.dataset.open(&mut found)?;
    let progress = Progress::new("scenes", dataset.keys().len());
    let summary = export(&dataset, &words.out, format, &mut found, &|| progress.step())?;
    // A table holds cameras: what pictures there are does not matter.
    warnings.merge(found.about_cameras());
    Ok(Report::Table(summary))
}

fn write_chunks(words: &Words, warnings: &mut Warnings) -> anyhow::Result<Report> {
    if words.out.is_file() {
        bail!("chunks go into a folder, and {} is a file", words.out.display());
    }
    let dataset = words.dataset.open(warnings)?;
    let mut writer = ChunkWriter::create(&words.out, words.chunk_bytes)?;
    let progress = Progress::new("scenes", dataset.keys().len());
    let mut skipped = 0;
    for key in dataset.keys() {
        let loaded = dataset.load(key, warnings).and_then(|scene| ChunkScene::from_scene(&scene, warnings));
        let unreadable = loaded.is_err();
        let outcome = loaded.and_then(|scene| writer.push(scene));
        progress.step();
        match outcome {
            Ok(()) => {}
            Err(error) if unreadable || matches!(error, SceneError::Torch { .. }) => {
                skipped += 1;
                warnings.push(WarningKind::UnreadableScene, key, error.to_string());
            }
            Err(error) => return Err(error.into()),
        }
    }
    let ChunksWritten { chunks, scenes } = writer.finish()?;
    Ok(Report::Chunks { chunks: chunks.len(), scenes, skipped })
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let skipped = match self {
            Self::Table(summary) => {
                writeln!(f, "{} scenes, {} frames, {} bytes", summary.scenes, summary.frames, summary.bytes)?;
                summary.skipped
            }
            Self::Chunks { chunks, scenes, skipped } => {
                writeln!(f, "{scenes} scenes in {chunks} chunks")?;
                *skipped
            }
        };
        if skipped > 0 {
            writeln!(f, "{skipped} scenes skipped")?;
        }
        Ok(())
    }
}
