use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use anyhow::{bail, ensure};
use atsplat_files::canonical_path;
use atsplat_numeric::counted;
use atsplat_scene::export::{ExportFormat, ExportSummary, export};
use atsplat_scene::inspect::left_out;
use atsplat_scene::torch::{ChunkWriter, ChunksWritten, ExportedChunks, STAGES, export_chunks};
use atsplat_scene::{Dataset, FrameImage, Scene, SceneError, SceneSource, WarningKind, Warnings};
use serde::Serialize;

use crate::dataset_args::DatasetArgs;
use crate::objects::{has_copies, with_urls};
use crate::output_lock::{OutputFiles, OutputLock};
use crate::parse::usage_error;
use crate::print::print_report;
use crate::progress::Progress;
use crate::warnings::print_warnings;

#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    dataset: DatasetArgs,

    /// A file that ends in .parquet, .arrow or .csv; or a folder, for `.torch` chunks.
    out: PathBuf,

    /// Write `.torch` chunks with images, as read by pixelSplat's loader, into the folder OUT. Images are copied without
    /// decoding them: one that is cut short is stored with a warning, other damage in it is not found.
    #[arg(long)]
    chunks: bool,

    /// Bytes of images after which a chunk is full.
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

pub(crate) fn run(args: &Args) -> anyhow::Result<bool> {
    let mut warnings = Warnings::new();
    let report = if args.chunks { write_chunks(args, &mut warnings)? } else { write_table(args, &mut warnings)? };
    print_report(&report, args.json)?;
    print_warnings(&warnings);
    let (scenes, skipped) = match report {
        Report::Table(summary) => (summary.scenes, summary.skipped),
        Report::Chunks { scenes, skipped, .. } => (scenes as u64, skipped),
    };
    ensure!(scenes > 0, "no scene of {} could be exported", args.dataset.data.display());
    Ok(skipped == 0 && warnings.count(WarningKind::UnreadableImage) == 0)
}

fn write_table(args: &Args, warnings: &mut Warnings) -> anyhow::Result<Report> {
    let format = ExportFormat::of_path(&args.out).map_err(usage_error)?;
    let _outputs = OutputFiles::of([args.out.as_path()])?;
    let dataset = args.dataset.open(warnings)?;
    let opening = warnings.clone();
    let progress = Progress::new("scenes", dataset.keys().len());
    let mut summary = export(&NamedByUrls(&dataset), &args.out, format, warnings, &|| progress.step())?;
    summary.skipped += left_out(&opening, warnings);
    Ok(Report::Table(summary))
}

/// Scenes in which copies of images have the URLs of their objects in place of paths, as a table names them; they cannot be read.
struct NamedByUrls<'a>(&'a Dataset);

impl SceneSource for NamedByUrls<'_> {
    fn keys(&self) -> &[String] {
        self.0.keys()
    }

    fn load(&self, key: &str, warnings: &mut Warnings) -> Result<Scene, SceneError> {
        let mut scene = self.0.load(key, warnings)?;
        if has_copies() {
            for frame in &mut scene.frames {
                name_by_url(&mut frame.image);
            }
        }
        Ok(scene)
    }

    fn inner(&self) -> Option<&dyn SceneSource> {
        Some(self.0)
    }
}

fn name_by_url(image: &mut FrameImage) {
    match image {
        FrameImage::File(path) | FrameImage::Missing(path) => *path = with_urls(&path.to_string_lossy()).into(),
        FrameImage::Unposed { image, .. } => name_by_url(image),
        FrameImage::Absent | FrameImage::Ambiguous(_) | FrameImage::Encoded(_) | FrameImage::Generated(_) => {}
    }
}

fn write_chunks(args: &Args, warnings: &mut Warnings) -> anyhow::Result<Report> {
    if args.out.is_file() {
        bail!("expected a folder for the chunks, found the file {}", args.out.display());
    }
    if is_read_first(&args.out, &args.dataset.data)? {
        let (out, data) = (args.out.display(), args.dataset.data.display());
        bail!("{out}: chunks there would be read instead of the scenes of {data}; choose another folder");
    }
    let _lock = OutputLock::of(&args.out)?;
    let dataset = args.dataset.open(warnings)?;
    let opening = warnings.clone();
    let progress = Progress::new("scenes", dataset.keys().len());
    let ExportedChunks { written: ChunksWritten { chunks, scenes }, skipped } =
        export_chunks(&dataset, &args.out, args.chunk_bytes, warnings, &|| progress.step())?;
    let skipped = skipped + left_out(&opening, warnings);
    Ok(Report::Chunks { chunks: chunks.len(), scenes, skipped })
}

/// Whether chunks in `out` would be read instead of the dataset: `out` is its folder, or one of pixelSplat's stages in it.
fn is_read_first(out: &Path, data: &Path) -> io::Result<bool> {
    let folder = if data.is_dir() { data } else { data.parent().unwrap_or(data) };
    let out = canonical_path(out)?;
    let places = std::iter::once(folder.to_owned()).chain(STAGES.map(|stage| folder.join(stage)));
    let places = places.map(|place| canonical_path(&place)).collect::<io::Result<Vec<PathBuf>>>()?;
    Ok(places.contains(&out))
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let skipped = match self {
            Self::Table(ExportSummary { scenes, skipped, frames, bytes }) => {
                writeln!(f, "{}, {}, {bytes} bytes", counted(*scenes, "scene"), counted(*frames, "frame"))?;
                *skipped
            }
            Self::Chunks { chunks, scenes, skipped } => {
                writeln!(f, "{} in {}", counted(*scenes as u64, "scene"), counted(*chunks as u64, "chunk"))?;
                *skipped
            }
        };
        if skipped > 0 {
            writeln!(f, "{} skipped", counted(skipped, "scene"))?;
        }
        Ok(())
    }
}
