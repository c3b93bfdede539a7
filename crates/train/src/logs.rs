//! Logs of steps and evaluations: lines of JSON, appended as they happen, and Parquet at the end.

use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

use atsplat_files::{AtomicFile, Malformed, Sha256Digest};
use polars::prelude::{Column, DataFrame, ParquetWriter};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use crate::TrainError;
use crate::objective::{PartSeconds, Terms};

/// One step.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct StepRecord {
    /// Counted from 0.
    pub step: u64,
    /// Mean over the step's samples; absent if the step was skipped.
    pub terms: Option<Terms>,
    /// Norm of the gradient before clipping; absent if the step was skipped.
    pub gradient_norm: Option<f64>,
    /// Learning rate.
    pub rate: f64,
    /// Wall-clock seconds of the whole step.
    pub secs: f64,
    /// Seconds of its parts, summed over samples, which run in parallel.
    pub parts: PartSeconds,
    /// Why the step was skipped, if it was.
    #[serde(rename = "fault")]
    pub skip_reason: Option<String>,
    /// Hash of the step's samples, in their order; absent if one of them could not be used, and in logs of earlier versions.
    #[serde(default)]
    pub samples_sha256: Option<Sha256Digest>,
    /// In the first step of a run that started from given weights, the SHA-256 of their file.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub initial_weights_sha256: Option<String>,
}

/// One evaluation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct EvaluationRecord {
    /// Number of steps done before it.
    pub step: u64,
    /// Mean PSNR of renders, in dB, clipped to [0, 1].
    pub psnr: f64,
    /// Mean SSIM of renders (scikit-image's, Gaussian window).
    pub ssim: f64,
    /// Mean PSNR of the nearest-view baseline, which copies the nearest context view, in dB.
    pub nearest_view_psnr: f64,
    /// Mean SSIM of the nearest-view baseline.
    pub nearest_view_ssim: f64,
    /// Number of target views that the means are over.
    pub targets: usize,
    /// Number of target views that equal their nearest context view or render; no mean counts them.
    #[serde(default)]
    pub identical: usize,
    /// Wall-clock seconds of the evaluation.
    pub secs: f64,
    /// Hash of the samples; absent in logs of earlier versions.
    #[serde(default)]
    pub samples_sha256: Option<Sha256Digest>,
}

impl EvaluationRecord {
    /// PSNR gain over the nearest-view baseline, in dB.
    pub const fn gain(&self) -> f64 {
        self.psnr - self.nearest_view_psnr
    }
}

/// A record of a log, dated by its step.
pub trait Record: Serialize + DeserializeOwned {
    /// Whether it belongs to a run with `steps` steps done.
    fn is_within(&self, steps: u64) -> bool;
}

impl Record for StepRecord {
    fn is_within(&self, steps: u64) -> bool {
        self.step < steps
    }
}

impl Record for EvaluationRecord {
    /// A run that restarts evaluates the initial weights again.
    fn is_within(&self, steps: u64) -> bool {
        steps > 0 && self.step <= steps
    }
}

/// A log file, one JSON record per line.
#[derive(Debug)]
pub struct LogFile {
    path: PathBuf,
    file: File,
}

impl LogFile {
    /// Opens the log of a run with `steps` steps done: later records, and a line that was cut off when the run was killed,
    /// are removed. Returns the records that were kept.
    ///
    /// # Errors
    /// As [`read`].
    pub fn open<R: Record>(path: &Path, steps: u64) -> Result<(Self, Vec<R>), TrainError> {
        let kept: Vec<R> = read(path)?.into_iter().filter(|record: &R| record.is_within(steps)).collect();
        let mut text = String::new();
        for record in &kept {
            text.push_str(&line(record)?);
        }
        atsplat_files::write(path, text.as_bytes()).map_err(TrainError::io("writing a log", path))?;
        let file = OpenOptions::new().append(true).open(path).map_err(TrainError::io("writing a log", path))?;
        Ok((Self { path: path.to_owned(), file }, kept))
    }

    /// Appends one line in one write.
    ///
    /// # Errors
    /// [`TrainError::Io`].
    pub fn append<R: Record>(&mut self, record: &R) -> Result<(), TrainError> {
        self.file.write_all(line(record)?.as_bytes()).map_err(TrainError::io("writing a log", &self.path))
    }
}

fn line<R: Record>(record: &R) -> Result<String, TrainError> {
    let text = serde_json::to_string(record)
        .map_err(|error| TrainError::malformed("log", "record", "values that JSON can represent", error))?;
    Ok(text + "\n")
}

/// The records of a log without a last line that was cut off when the run was killed; none if there is no file.
///
/// # Errors
/// [`TrainError::Io`]; [`TrainError::Malformed`] with the number of a whole line that is not a record.
pub fn read<R: Record>(path: &Path) -> Result<Vec<R>, TrainError> {
    let bytes = atsplat_files::read_if_exists(path).map_err(TrainError::io("reading a log", path))?.unwrap_or_default();
    let mut records = Vec::new();
    for (number, line) in (1_u64..).zip(bytes.split_inclusive(|byte| *byte == b'\n')) {
        match serde_json::from_slice(line) {
            Ok(record) => records.push(record),
            Err(_cut_off) if !line.ends_with(b"\n") => {}
            Err(error) => {
                let found = Malformed::new("log", format!("line {number}"), "a record of this log", error);
                return Err(found.in_file(path).into());
            }
        }
    }
    Ok(records)
}

/// Writes steps as Parquet, one row each; values that a skipped step lacks are null.
///
/// # Errors
/// [`TrainError::Io`], [`TrainError::Columns`].
pub fn write_steps(path: &Path, records: &[StepRecord]) -> Result<(), TrainError> {
    let numbers = |name: &str, number: &dyn Fn(&StepRecord) -> Option<f64>| {
        Column::new(name.into(), records.iter().map(number).collect::<Vec<Option<f64>>>())
    };
    let mut columns = vec![Column::new("step".into(), records.iter().map(|record| record.step).collect::<Vec<u64>>())];
    for (position, (name, _)) in Terms::default().named().into_iter().enumerate() {
        columns.push(numbers(name, &|record| Some(record.terms?.named().get(position)?.1)));
    }
    columns.push(numbers("gradient-norm", &|record| record.gradient_norm));
    columns.push(numbers("rate", &|record| Some(record.rate)));
    columns.push(numbers("secs", &|record| Some(record.secs)));
    columns.push(numbers("sample-secs", &|record| Some(record.parts.sample)));
    columns.push(numbers("forward-secs", &|record| Some(record.parts.forward)));
    columns.push(numbers("splat-secs", &|record| Some(record.parts.splat)));
    columns.push(numbers("losses-secs", &|record| Some(record.parts.losses)));
    columns.push(numbers("backward-secs", &|record| Some(record.parts.backward)));
    let reasons = records.iter().map(|record| record.skip_reason.clone()).collect::<Vec<Option<String>>>();
    columns.push(Column::new("fault".into(), reasons));
    write_frame(path, columns)
}

/// Writes evaluations as Parquet, one row each.
///
/// # Errors
/// [`TrainError::Io`], [`TrainError::Columns`].
pub fn write_evaluations(path: &Path, records: &[EvaluationRecord]) -> Result<(), TrainError> {
    let numbers = |name: &str, number: fn(&EvaluationRecord) -> f64| {
        Column::new(name.into(), records.iter().map(number).collect::<Vec<f64>>())
    };
    let counts = |name: &str, count: fn(&EvaluationRecord) -> usize| {
        Column::new(name.into(), records.iter().map(|record| count(record) as u64).collect::<Vec<u64>>())
    };
    let columns = vec![
        Column::new("step".into(), records.iter().map(|record| record.step).collect::<Vec<u64>>()),
        numbers("psnr", |record| record.psnr),
        numbers("ssim", |record| record.ssim),
        numbers("nearest-view-psnr", |record| record.nearest_view_psnr),
        numbers("nearest-view-ssim", |record| record.nearest_view_ssim),
        counts("targets", |record| record.targets),
        counts("identical", |record| record.identical),
        numbers("secs", |record| record.secs),
    ];
    write_frame(path, columns)
}

fn write_frame(path: &Path, columns: Vec<Column>) -> Result<(), TrainError> {
    let mut frame = DataFrame::new_infer_height(columns)?;
    let file = AtomicFile::create(path).map_err(TrainError::io("writing a log", path))?;
    ParquetWriter::new(file.writer()).finish(&mut frame)?;
    file.commit().map(drop).map_err(TrainError::io("writing a log", path))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A run with four steps done has logged steps 0 to 3, and evaluations after 0 to 4 steps.
    #[test]
    fn records_of_later_steps_are_dropped() {
        let folder = tempfile::tempdir().unwrap();
        let step = |step| StepRecord {
            step,
            terms: None,
            gradient_norm: None,
            rate: 1e-3,
            secs: 2.0,
            parts: PartSeconds::default(),
            skip_reason: Some("a fault".to_owned()),
            samples_sha256: Some(Sha256Digest::of(b"samples")),
            initial_weights_sha256: (step == 0).then(|| "a hash".to_owned()),
        };
        let evaluation = |step| EvaluationRecord {
            step,
            psnr: 21.0,
            ssim: 0.7,
            nearest_view_psnr: 16.5,
            nearest_view_ssim: 0.4,
            targets: 3,
            identical: 1,
            secs: 1.0,
            samples_sha256: None,
        };
        assert!(evaluation(0).gain() > 4.4 && evaluation(0).gain() < 4.6, "21 dB against 16.5");
        let (steps, evaluations) = (folder.path().join("steps"), folder.path().join("evaluations"));
        let (mut step_log, _) = LogFile::open::<StepRecord>(&steps, 0).unwrap();
        let (mut evaluation_log, _) = LogFile::open::<EvaluationRecord>(&evaluations, 0).unwrap();
        for number in 0..7 {
            step_log.append(&step(number)).unwrap();
            evaluation_log.append(&evaluation(number)).unwrap();
        }
        let (_, kept) = LogFile::open::<StepRecord>(&steps, 4).unwrap();
        assert_eq!(kept, [0, 1, 2, 3].map(step));
        assert_eq!(read::<StepRecord>(&steps).unwrap(), kept, "in the file too");
        let (_, kept) = LogFile::open::<EvaluationRecord>(&evaluations, 4).unwrap();
        assert_eq!(kept, [0, 1, 2, 3, 4].map(evaluation));
    }

    #[test]
    fn only_a_last_line_without_its_end_is_dropped() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("evaluations.jsonl");
        let whole = r#"{"step":STEP,"psnr":21.0,"ssim":0.7,"nearest-view-psnr":16.5,"nearest-view-ssim":0.4,"targets":3,"secs":1.0}"#;
        let lines = [1, 2, 3].map(|step: u32| whole.replace("STEP", &step.to_string()) + "\n");
        let steps = |bytes: &[u8]| {
            std::fs::write(&path, bytes).unwrap();
            let records = read::<EvaluationRecord>(&path).map_err(|error| error.to_string())?;
            Ok::<Vec<u64>, String>(records.iter().map(|record| record.step).collect())
        };
        let text = lines.concat();
        assert_eq!(steps(text.as_bytes()).unwrap(), [1, 2, 3], "also without a count of identical targets");
        assert_eq!(steps(&text.as_bytes()[..text.len() - 1]).unwrap(), [1, 2, 3], "only its end is missing");
        assert_eq!(steps(&text.as_bytes()[..text.len() - 9]).unwrap(), [1, 2]);
        assert_eq!(
            steps(&[lines[0].as_bytes(), b"{\"fault\":\"\xe2\x80"].concat()).unwrap(),
            [1],
            "within a character"
        );
        for damaged in [lines[1].replace("0.7", "0,7"), lines[1].replace("21.0", "null"), "\n".to_owned()] {
            let error = steps([&lines[0], &damaged, &lines[2]].map(String::as_str).concat().as_bytes()).unwrap_err();
            assert!(error.contains("log: line 2: expected a record") && error.contains("evaluations.jsonl"), "{error}");
        }
        let reopened = LogFile::open::<EvaluationRecord>(&path, 9);
        assert!(
            reopened.is_err() && std::fs::read_to_string(&path).unwrap().lines().count() == 3,
            "nothing is dropped"
        );
        let restarted = [&lines[0], &lines[1]].map(String::as_str).concat();
        std::fs::write(&path, restarted).unwrap();
        let (_, kept) = LogFile::open::<EvaluationRecord>(&path, 0).unwrap();
        assert!(kept.is_empty(), "evaluated again before step 0");
    }
}
