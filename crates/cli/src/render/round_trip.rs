use std::fmt;
use std::fs;

use anyhow::Context as _;
use atsplat_camera::ImageSize;
use atsplat_numeric::Extremes as _;
use atsplat_splat::files::{self, Encoding, Output};
use atsplat_splat::{Gaussians, RasterMode, RenderOptions, Renderer, Rendering};
use clap::ValueEnum;
use serde::Serialize;

use super::views::Shot;
use crate::progress::Progress;

/// Minimum PSNR of lossless formats after a round trip; less is a bug.
const MIN_LOSSLESS_PSNR_DB: f64 = 60.0;
const CONVENTION: &str = "f32 RGB clipped to [0, 1]; squared differences averaged over all samples of all views";

/// A format of the round trip.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum RoundTripArg {
    Ply,
    PlyAscii,
    PlyBigEndian,
    Spz2,
    Spz3,
}

impl RoundTripArg {
    const fn output(self, antialiased: bool) -> Output {
        match self {
            Self::Ply => Output::Ply(Encoding::BinaryLittleEndian),
            Self::PlyAscii => Output::Ply(Encoding::Ascii),
            Self::PlyBigEndian => Output::Ply(Encoding::BinaryBigEndian),
            Self::Spz2 => Output::Spz2 { antialiased },
            Self::Spz3 => Output::Spz3 { antialiased },
        }
    }

    const fn is_lossless(self) -> bool {
        !matches!(self, Self::Spz2 | Self::Spz3)
    }
}

/// Image differences after export and import.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) struct RoundTrips {
    /// Definition of the numbers.
    convention: &'static str,
    views: usize,
    /// Why nothing was measured.
    #[serde(skip_serializing_if = "Option::is_none")]
    fault: Option<String>,
    rows: Vec<Row>,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
struct Row {
    format: RoundTripArg,
    /// Why there is no number.
    #[serde(skip_serializing_if = "Option::is_none")]
    fault: Option<String>,
    bytes: u64,
    /// Relative to a little-endian PLY.
    size_over_ply: f64,
    /// Whether all images are bit for bit the same.
    identical: bool,
    /// Over all views; `None` if no clipped value differs.
    psnr_db: Option<f64>,
    /// Over the view that differs most.
    worst_view_psnr_db: Option<f64>,
    largest_difference: f64,
}

/// Accumulates the differences of one format.
struct Trip {
    format: RoundTripArg,
    bytes: u64,
    back: Result<Gaussians, String>,
    identical: bool,
    squares: f64,
    samples: f64,
    worst_mse: f64,
    largest: f64,
}

fn measure(
    renderer: &mut dyn Renderer,
    (gaussians, shots): (&Gaussians, &[Shot]),
    options: &RenderOptions,
    formats: &[RoundTripArg],
) -> anyhow::Result<RoundTrips> {
    let temporary = std::env::temp_dir();
    let folder = tempfile::tempdir_in(&temporary)
        .with_context(|| format!("creating a folder for the round trip in {}", temporary.display()))?;
    let path = folder.path().join("gaussians");
    files::write(&path, gaussians, RoundTripArg::Ply.output(false))?;
    let ply_bytes = fs::metadata(&path)?.len();
    let mut trips = Vec::new();
    for format in formats {
        let antialiased = options.mode == RasterMode::Antialiased;
        trips.push(Trip::start(*format, gaussians, antialiased, &path)?);
    }
    let progress = Progress::new("views of the round trip", shots.len());
    let mut views = 0;
    for shot in shots {
        // A view that cannot be rendered is already reported with the frames.
        let options = shot.exposed(options);
        if let Ok(before) = renderer.render(gaussians, &shot.view, &options) {
            views += 1;
            for trip in &mut trips {
                trip.compare(renderer, &before, shot, &options);
            }
        }
        progress.step();
    }
    let rows = trips.into_iter().map(|trip| trip.row(ply_bytes)).collect();
    Ok(RoundTrips { convention: CONVENTION, views, fault: None, rows })
}

impl Trip {
    /// A format that cannot hold the Gaussians is reported, not an error.
    fn start(
        format: RoundTripArg,
        gaussians: &Gaussians,
        antialiased: bool,
        path: &std::path::Path,
    ) -> anyhow::Result<Self> {
        let written = files::write(path, gaussians, format.output(antialiased));
        let bytes = if written.is_ok() { fs::metadata(path)?.len() } else { 0 };
        let back = written.and_then(|()| files::read(path)).map(|(back, _)| back).map_err(|error| error.to_string());
        let (identical, squares, samples, worst_mse, largest) = (true, 0.0, 0.0, 0.0, 0.0);
        Ok(Self { format, bytes, back, identical, squares, samples, worst_mse, largest })
    }

    fn compare(&mut self, renderer: &mut dyn Renderer, before: &Rendering<f32>, shot: &Shot, options: &RenderOptions) {
        let Ok(back) = &self.back else { return };
        let after = match renderer.render(back, &shot.view, options) {
            Ok(after) => after,
            Err(error) => {
                self.back = Err(error.to_string());
                return;
            }
        };
        self.identical &= same_bits(before, &after);
        let pairs = before.rgb.as_flattened().iter().zip(after.rgb.as_flattened());
        let mut squares = 0.0;
        for (before, after) in pairs {
            let difference = f64::from(before.clamp(0.0, 1.0)) - f64::from(after.clamp(0.0, 1.0));
            squares += difference * difference;
            self.largest = self.largest.maximum_of(difference.abs());
        }
        let samples = samples_of(before.size);
        self.squares += squares;
        self.samples += samples;
        self.worst_mse = self.worst_mse.maximum_of(squares / samples);
    }

    fn row(self, ply_bytes: u64) -> Row {
        Row {
            format: self.format,
            bytes: self.bytes,
            size_over_ply: self.bytes as f64 / ply_bytes as f64,
            identical: self.identical && self.back.is_ok(),
            psnr_db: psnr(self.squares / self.samples),
            worst_view_psnr_db: psnr(self.worst_mse),
            largest_difference: self.largest,
            fault: self.back.err(),
        }
    }
}

fn samples_of(size: ImageSize) -> f64 {
    3.0 * f64::from(size.width) * f64::from(size.height)
}

/// For a peak of 1; `None` if nothing differs.
fn psnr(mse: f64) -> Option<f64> {
    (mse != 0.0 && mse.is_finite()).then(|| -10.0 * mse.log10())
}

fn same_bits(before: &Rendering<f32>, after: &Rendering<f32>) -> bool {
    let bits = |image: &[f32]| image.iter().map(|value| value.to_bits()).collect::<Vec<_>>();
    let same = |a: &[f32], b: &[f32]| bits(a) == bits(b);
    let optional = |a: &Option<Vec<f32>>, b: &Option<Vec<f32>>| match (a, b) {
        (Some(a), Some(b)) => same(a, b),
        (None, None) => true,
        _ => false,
    };
    same(before.rgb.as_flattened(), after.rgb.as_flattened())
        && same(&before.alpha, &after.alpha)
        && optional(&before.depth, &after.depth)
        && optional(&before.scalar, &after.scalar)
        && optional(&before.median_depth, &after.median_depth)
}

impl RoundTrips {
    /// Exports to each format, imports again, and renders the same views with all requested effects. The images are written
    /// before: a failure is reported together with them.
    pub(crate) fn measure(
        renderer: &mut dyn Renderer,
        scene: (&Gaussians, &[Shot]),
        options: &RenderOptions,
        formats: &[RoundTripArg],
    ) -> Self {
        measure(renderer, scene, options, formats).unwrap_or_else(|error| {
            let fault = Some(format!("--round-trip: {error:#}"));
            Self { convention: CONVENTION, views: 0, fault, rows: Vec::new() }
        })
    }

    /// Why the round trip failed: nothing was measured, or a lossless format changed the images.
    pub(crate) fn failure(&self) -> Option<String> {
        if self.fault.is_some() {
            return self.fault.clone();
        }
        let is_broken = |row: &&Row| {
            let kept = row.identical || row.psnr_db.is_none_or(|psnr| psnr >= MIN_LOSSLESS_PSNR_DB);
            row.format.is_lossless() && (row.fault.is_some() || !kept || row.largest_difference.is_nan())
        };
        let row = self.rows.iter().find(is_broken)?;
        Some(format!(
            "the round trip through {} changed the images: expected {MIN_LOSSLESS_PSNR_DB} dB or more",
            name(row.format)
        ))
    }
}

fn name(format: RoundTripArg) -> String {
    format.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
}

impl fmt::Display for RoundTrips {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(fault) = &self.fault {
            return writeln!(f, "\n{fault}");
        }
        let head = ["bytes", "of PLY", "PSNR", "worst view", "largest"];
        let [bytes, of_ply, psnr, worst, largest] = head;
        writeln!(f, "\n{:>14} {bytes:>11} {of_ply:>7} {psnr:>10} {worst:>11} {largest:>10}", "round trip")?;
        for row in &self.rows {
            let name = name(row.format);
            if let Some(fault) = &row.fault {
                writeln!(f, "{name:>14} {fault}")?;
                continue;
            }
            let shown = |psnr: Option<f64>| match psnr {
                Some(psnr) => format!("{psnr:.2} dB"),
                None if row.identical => "identical".to_owned(),
                None => "inf".to_owned(),
            };
            let (psnr, worst) = (shown(row.psnr_db), shown(row.worst_view_psnr_db));
            let (bytes, share, largest) = (row.bytes, 100.0 * row.size_over_ply, row.largest_difference);
            writeln!(f, "{name:>14} {bytes:>11} {share:>5.1} % {psnr:>10} {worst:>11} {largest:>10.2e}")?;
        }
        writeln!(f, "{:>14} {} views; {}", "", self.views, self.convention)
    }
}
