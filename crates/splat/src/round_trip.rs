//! Image differences after export to a file format and import from it.

use std::fmt;
use std::fs;
use std::path::Path;

use atsplat_camera::ImageSize;
use atsplat_files::FileError;
use atsplat_numeric::Extremes as _;
use serde::{Serialize, Serializer};

use crate::files::{self, Encoding, ExportReport, Output};
use crate::{Gaussians, RasterMode, RenderOptions, Renderer, Rendering, SplatError, View};

/// Minimum PSNR of lossless formats after a round trip; less is a bug.
const MIN_LOSSLESS_PSNR_DB: f64 = 60.0;
/// The format that sizes are compared with.
const PLY: Output = Output::Ply(Encoding::BinaryLittleEndian);
const CONVENTION: &str = "f32 RGB clipped to [0, 1]; squared differences averaged over all samples of all views";

/// Image differences after export and import.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct RoundTrips {
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
    #[serde(serialize_with = "by_name")]
    format: Output,
    /// Why there is no number.
    #[serde(skip_serializing_if = "Option::is_none")]
    fault: Option<String>,
    bytes: u64,
    /// Relative to a little-endian PLY.
    size_over_ply: f64,
    /// Whether all images are bit for bit the same.
    identical: bool,
    /// Over all views; `None` if no clipped value differs, NaN (`null` in JSON) if one is not a number.
    psnr_db: Option<f64>,
    /// Over the view that differs most.
    worst_view_psnr_db: Option<f64>,
    largest_difference: f64,
    /// What the format cannot store.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    warnings: Vec<String>,
}

/// Accumulates the differences of one format.
struct Trip {
    format: Output,
    bytes: u64,
    export: ExportReport,
    back: Result<Gaussians, String>,
    identical: bool,
    squares: f64,
    samples: f64,
    worst_mse: f64,
    largest: f64,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes a reference")]
fn by_name<S: Serializer>(format: &Output, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(format.name())
}

fn length(path: &Path) -> Result<u64, SplatError> {
    fs::metadata(path).map(|data| data.len()).map_err(FileError::during("reading the size", path))
}

impl Trip {
    /// A format that cannot store the Gaussians is reported, not an error.
    fn start(format: Output, gaussians: &Gaussians, antialiased: bool, path: &Path) -> Result<Self, SplatError> {
        let written = files::write(path, gaussians, format.with_antialiased(antialiased));
        let bytes = if written.is_ok() { length(path)? } else { 0 };
        let export = written.as_ref().copied().unwrap_or_default();
        let back = written.and_then(|_export| files::read(path)).map(|(back, _)| back);
        let back = back.map_err(|error| error.to_string());
        let (identical, squares, samples, worst_mse, largest) = (true, 0.0, 0.0, 0.0, 0.0);
        Ok(Self { format, bytes, export, back, identical, squares, samples, worst_mse, largest })
    }

    fn compare(&mut self, renderer: &mut dyn Renderer, before: &Rendering<f32>, view: &View, options: &RenderOptions) {
        let Ok(back) = &self.back else { return };
        let after = match renderer.render(back, view, options) {
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
            warnings: self.export.warnings(),
            fault: self.back.err(),
        }
    }
}

fn samples_of(size: ImageSize) -> f64 {
    3.0 * f64::from(size.width) * f64::from(size.height)
}

/// For a peak of 1; `None` if nothing differs, NaN if the difference is not a number.
fn psnr(mse: f64) -> Option<f64> {
    (mse != 0.0).then(|| -10.0 * mse.log10())
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
    /// Exports Gaussians to each format, imports them again, and renders the same views with all effects, into `scratch` for
    /// files. Views that cannot be rendered are skipped; if all are, the result is [`Self::failed`]. Calls `progress`
    /// after each view.
    ///
    /// # Errors
    /// [`SplatError::Io`] if the folder `scratch` cannot be written to.
    pub fn measure(
        renderer: &mut dyn Renderer,
        gaussians: &Gaussians,
        views: &[(View, RenderOptions)],
        formats: &[Output],
        scratch: &Path,
        progress: &mut dyn FnMut(),
    ) -> Result<Self, SplatError> {
        let path = scratch.join("gaussians");
        files::write(&path, gaussians, PLY)?;
        let ply_bytes = length(&path)?;
        let antialiased = views.iter().any(|(_, options)| options.mode == RasterMode::Antialiased);
        let trips = formats.iter().map(|format| Trip::start(*format, gaussians, antialiased, &path));
        let mut trips = trips.collect::<Result<Vec<_>, _>>()?;
        let mut rendered = 0;
        for (view, options) in views {
            if let Ok(before) = renderer.render(gaussians, view, options) {
                rendered += 1;
                for trip in &mut trips {
                    trip.compare(renderer, &before, view, options);
                }
            }
            progress();
        }
        if rendered == 0 {
            return Ok(Self::failed("the round trip compared nothing: no view could be rendered".to_owned()));
        }
        let rows = trips.into_iter().map(|trip| trip.row(ply_bytes)).collect();
        Ok(Self { convention: CONVENTION, views: rendered, fault: None, rows })
    }

    /// A record of a round trip that could not be measured.
    pub const fn failed(fault: String) -> Self {
        Self { convention: CONVENTION, views: 0, fault: Some(fault), rows: Vec::new() }
    }

    /// Why the round trip failed: nothing was measured, or a lossless format changed the images.
    pub fn failure(&self) -> Option<String> {
        if self.fault.is_some() {
            return self.fault.clone();
        }
        let is_broken = |row: &&Row| {
            let kept = row.identical || row.psnr_db.is_none_or(|psnr| psnr >= MIN_LOSSLESS_PSNR_DB);
            row.format.is_lossless() && (row.fault.is_some() || !kept || row.largest_difference.is_nan())
        };
        let row = self.rows.iter().find(is_broken)?;
        let name = row.format.name();
        Some(match &row.fault {
            Some(fault) => format!("the round trip through {name} failed: {fault}"),
            None => {
                format!("the round trip through {name} changed the images: expected {MIN_LOSSLESS_PSNR_DB} dB or more")
            }
        })
    }
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
            let name = row.format.name();
            if let Some(fault) = &row.fault {
                writeln!(f, "{name:>14} {fault}")?;
                continue;
            }
            let shown = |psnr: Option<f64>| match psnr {
                Some(psnr) if psnr.is_nan() => "not finite".to_owned(),
                Some(psnr) => format!("{psnr:.2} dB"),
                None if row.identical => "identical".to_owned(),
                None => "inf".to_owned(),
            };
            let (psnr, worst) = (shown(row.psnr_db), shown(row.worst_view_psnr_db));
            let (bytes, share, largest) = (row.bytes, 100.0 * row.size_over_ply, row.largest_difference);
            writeln!(f, "{name:>14} {bytes:>11} {share:>5.1} % {psnr:>10} {worst:>11} {largest:>10.2e}")?;
            for warning in &row.warnings {
                writeln!(f, "{:>14} {warning}", "")?;
            }
        }
        writeln!(f, "{:>14} {} views; {}", "", self.views, self.convention)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{GaussianParts, ReferenceRenderer};

    const SPZ: Output = Output::Spz3 { antialiased: false };

    /// Without a view there is no difference to be found, which does not make the images identical.
    #[test]
    fn comparing_nothing_is_a_failure() {
        let scratch = tempfile::tempdir().unwrap();
        let formats = [PLY];
        let gaussians = Gaussians::default();
        let of_nothing =
            RoundTrips::measure(&mut ReferenceRenderer, &gaussians, &[], &formats, scratch.path(), &mut || ()).unwrap();
        let failure = of_nothing.failure().unwrap();
        assert!(failure.contains("no view could be rendered"), "{failure}");
    }

    #[test]
    fn values_that_a_format_clamps_are_reported() {
        let scratch = tempfile::tempdir().unwrap();
        let parts = GaussianParts {
            means: vec![[0.0; 3]],
            quaternions: vec![[1.0, 0.0, 0.0, 0.0]],
            log_scales: vec![[-12.0, 7.0, 0.0]],
            opacity_logits: vec![1.0],
            sh: vec![[0.0, 0.0, -4.0]],
            ..GaussianParts::default()
        };
        let gaussians = Gaussians::new(parts).unwrap();
        let row = |format| Trip::start(format, &gaussians, false, &scratch.path().join("file")).unwrap().row(1);
        assert_eq!(row(PLY).warnings, Vec::<String>::new());
        let expected = [
            "log-scales clamped to SPZ's range [-10, 5.9375]: 2",
            "SH coefficients of degree 0 clamped to SPZ's range ±10/3: 1",
        ];
        let rows = vec![row(SPZ)];
        assert_eq!(rows[0].warnings, expected);
        assert_eq!(serde_json::to_value(&rows[0]).unwrap()["format"], "spz3");
        let trips = RoundTrips { convention: CONVENTION, views: 1, fault: None, rows };
        assert!(trips.to_string().contains(expected[1]), "{trips}");
    }

    /// Only a lossless format that was read back can have changed the images.
    #[test]
    fn the_failure_tells_a_fault_from_a_change() {
        let row = |format, fault: Option<&str>, psnr_db| Row {
            format,
            fault: fault.map(str::to_owned),
            bytes: 1,
            size_over_ply: 1.0,
            identical: false,
            psnr_db,
            worst_view_psnr_db: psnr_db,
            largest_difference: 0.0,
            warnings: Vec::new(),
        };
        let shown = |mse: f64| {
            let rows = vec![row(PLY, None, psnr(mse))];
            RoundTrips { convention: CONVENTION, views: 1, fault: None, rows }.to_string()
        };
        assert!(shown(0.01).contains("20.00 dB") && shown(0.0).contains(" inf "), "{}", shown(0.0));
        assert!(shown(f64::NAN).contains("not finite") && !shown(f64::NAN).contains("inf "), "{}", shown(f64::NAN));
        let failure = |row| RoundTrips { convention: CONVENTION, views: 1, fault: None, rows: vec![row] }.failure();
        let fault = failure(row(Output::Ply(Encoding::Ascii), Some("no space left"), None)).unwrap();
        assert_eq!(fault, "the round trip through ply-ascii failed: no space left");
        let changed = failure(row(PLY, None, Some(59.0))).unwrap();
        assert_eq!(changed, "the round trip through ply changed the images: expected 60 dB or more");
        assert_eq!(failure(row(PLY, None, psnr(f64::NAN))), Some(changed));
        assert_eq!(failure(row(PLY, None, Some(61.0))), None);
        assert_eq!(failure(row(PLY, None, psnr(0.0))), None, "equal once clipped");
        assert_eq!(failure(row(SPZ, Some("no scalars"), None)), None);
    }
}
