use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};

use atsplat_numeric::median;
use atsplat_scene::is_plain_name;
use serde::Serialize;

use ::opencv::core::{Mat, Vector};
use ::opencv::imgcodecs::{IMWRITE_JPEG_QUALITY, imencode};
use ::opencv::prelude::*;
use ::opencv::videoio::{CAP_FFMPEG, CAP_PROP_FPS, CAP_PROP_POS_MSEC, VideoCapture};

use super::{OpenCvError, called};

/// Format of the written frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FrameFormat {
    /// `<timestamp>.jpg` at this quality, 0 to 100.
    Jpeg(u8),
    /// `<timestamp>.png`, lossless.
    Png,
}

/// Outcome for one timestamp.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(tag = "outcome", rename_all = "kebab-case")]
pub enum ExtractionOutcome {
    /// The frame was written.
    Written {
        /// The file.
        path: PathBuf,
    },
    /// The nearest frame is over half a frame interval away.
    TooFar,
    /// The video has no frames.
    NoFrame,
}

/// One timestamp of a trajectory and the video's nearest frame.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ExtractedFrame {
    /// The requested timestamp, in microseconds.
    pub timestamp_micros: i64,
    /// Presentation time of the nearest frame, in microseconds; `None` if the video has no frames.
    pub presented_micros: Option<f64>,
    /// Whether that time was estimated from those of other frames.
    pub estimated: bool,
    /// Whether the frame was written.
    #[serde(flatten)]
    pub outcome: ExtractionOutcome,
}

impl ExtractedFrame {
    /// Presentation time minus timestamp, in microseconds.
    pub fn residual_micros(&self) -> Option<f64> {
        Some(self.presented_micros? - self.timestamp_micros as f64)
    }
}

/// The frames extracted from a video.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ExtractedFrames {
    /// Median interval between frames, in microseconds.
    pub interval_micros: f64,
    /// One entry per timestamp, in the requested order.
    pub frames: Vec<ExtractedFrame>,
    /// Images of the written timestamps in the other format that were there, and were removed.
    pub removed: usize,
}

impl ExtractedFrames {
    /// Number of frames written.
    pub fn written(&self) -> usize {
        self.frames.iter().filter(|frame| matches!(frame.outcome, ExtractionOutcome::Written { .. })).count()
    }
}

/// Options of [`extract_frames`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExtractionOptions {
    /// Frames are written to `<folder>/<key>/<timestamp>.<extension>`, the layout of RE10K
    /// (`real_estate_10k_tools` `src/convert.py:69-73`).
    pub folder: PathBuf,
    /// Their format.
    pub format: FrameFormat,
}

/// Extracts the frames at a trajectory's timestamps from a video.
///
/// Frames are selected by presentation time from the start of the video stream, not by number, because the frame rate
/// may vary. A timestamp gets the nearest frame, the earlier of two equally near ones, or none if that is more than half
/// the median frame interval away. Seeking is inexact in some containers, so the video is decoded from its start to the
/// last timestamp, once for the times and once for the images. Each file is written completely, then renamed into
/// place; one with its timestamp in the other format, which readers might prefer, is removed and counted. `progress` is
/// called with the number of timestamps done.
///
/// The times are OpenCV's `CAP_PROP_POS_MSEC`. In version 4.6 these are `FFmpeg`'s decoding times, which equal the
/// presentation times in MP4, Matroska and `WebM` files of the common encoders, but are late by the reordering delay in
/// AVI files with B-frames, and missing for the frames that a decoder still has at the end of the file. Missing times
/// are spaced evenly between known ones, after the last by the median interval, and marked
/// ([`ExtractedFrame::estimated`]).
///
/// # Errors
/// [`OpenCvError::Video`] for a video that cannot be opened, has no frame rate or runs backwards, or a `key` that is
/// not a plain folder name; [`OpenCvError::Io`] if a file cannot be written; [`OpenCvError::Call`].
pub fn extract_frames(
    video: &Path,
    key: &str,
    timestamps_micros: &[i64],
    options: &ExtractionOptions,
    mut progress: impl FnMut(usize),
) -> Result<ExtractedFrames, OpenCvError> {
    if !is_plain_name(key) {
        return Err(malformed(Path::new(key), "scene key", "a plain folder name", format!("{key:?}")));
    }
    let schedule = Schedule::read(video, timestamps_micros.iter().copied().max())?;
    let folder = options.folder.join(key);
    std::fs::create_dir_all(&folder).map_err(OpenCvError::io("creating a folder for frames", &folder))?;
    let (mut frames, selected) = select(&schedule, timestamps_micros);
    let mut stream = Stream::open(video)?;
    let mut decided = timestamps_micros.len() - selected.values().map(Vec::len).sum::<usize>();
    let (mut reached, mut removed) = (0, 0);
    for (number, indices) in selected {
        while reached <= number {
            if !stream.grab()? {
                let location = format!("frame {number}");
                return Err(malformed(video, location, "the frame found in the first pass", "the end"));
            }
            reached += 1;
        }
        let image = stream.image()?;
        for index in &indices {
            let Some(frame) = frames.get_mut(*index) else { continue };
            let (path, replaces_other) = write(&image, &folder, frame.timestamp_micros, options.format)?;
            removed += usize::from(replaces_other);
            frame.outcome = ExtractionOutcome::Written { path };
        }
        decided += indices.len();
        progress(decided);
    }
    progress(timestamps_micros.len());
    Ok(ExtractedFrames { interval_micros: schedule.interval_micros, frames, removed })
}

/// What is known of each timestamp before images are decoded, and for each frame to write, its number and the positions of its
/// timestamps.
fn select(schedule: &Schedule, timestamps_micros: &[i64]) -> (Vec<ExtractedFrame>, BTreeMap<usize, Vec<usize>>) {
    let limit = 0.5 * schedule.interval_micros;
    let mut frames: Vec<ExtractedFrame> = Vec::new();
    let mut selected: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (index, timestamp) in timestamps_micros.iter().enumerate() {
        let nearest = schedule.nearest(*timestamp);
        let near = nearest.filter(|(_, time)| (time.micros - *timestamp as f64).abs() <= limit);
        if let Some((number, _)) = near {
            selected.entry(number).or_default().push(index);
        }
        let outcome = if nearest.is_none() { ExtractionOutcome::NoFrame } else { ExtractionOutcome::TooFar };
        let presented = nearest.map(|(_, time)| time);
        frames.push(ExtractedFrame {
            timestamp_micros: *timestamp,
            presented_micros: presented.map(|time| time.micros),
            estimated: presented.is_some_and(|time| time.estimated),
            outcome,
        });
    }
    (frames, selected)
}

/// The file that was written, and whether one in the other format was removed.
fn write(image: &Mat, folder: &Path, timestamp: i64, format: FrameFormat) -> Result<(PathBuf, bool), OpenCvError> {
    let ([extension, other], parameters) = match format {
        FrameFormat::Jpeg(quality) => {
            ([".jpg", ".png"], Vector::from_slice(&[IMWRITE_JPEG_QUALITY, i32::from(quality)]))
        }
        FrameFormat::Png => ([".png", ".jpg"], Vector::new()),
    };
    let mut bytes = Vector::<u8>::new();
    called("encoding a frame", imencode(extension, image, &mut bytes, &parameters))?;
    let path = folder.join(format!("{timestamp}{extension}"));
    atsplat_files::write_unsynced(&path, bytes.as_slice()).map_err(OpenCvError::io("writing a frame", &path))?;
    let other = folder.join(format!("{timestamp}{other}"));
    let replaces_other = other.symlink_metadata().is_ok();
    atsplat_files::remove_if_exists(&other).map_err(OpenCvError::io("removing an earlier frame", &other))?;
    Ok((path, replaces_other))
}

fn malformed(
    path: &Path,
    location: impl Into<String>,
    expected: impl Into<String>,
    found: impl Into<String>,
) -> OpenCvError {
    let (path, location, expected, found) = (path.to_owned(), location.into(), expected.into(), found.into());
    OpenCvError::Video { path, location, expected, found }
}

/// Presentation times of a video's frames, in increasing order.
struct Schedule {
    times: Vec<Time>,
    interval_micros: f64,
}

#[derive(Clone, Copy)]
struct Time {
    micros: f64,
    estimated: bool,
}

/// The times of all frames from the known ones, which increase: unknown times are spaced evenly between known ones, and by
/// `interval` after the last.
fn filled(known: &[Option<f64>], interval: f64) -> Vec<Time> {
    let estimated = |micros: f64| Time { micros, estimated: true };
    let mut times: Vec<Time> = Vec::new();
    let mut unknown = 0u32;
    for time in known {
        let Some(after) = *time else {
            unknown += 1;
            continue;
        };
        let step = times.last().map_or(interval, |before| (after - before.micros) / f64::from(unknown + 1));
        times.extend((1..=unknown).rev().map(|frames| estimated(after - step * f64::from(frames))));
        times.push(Time { micros: after, estimated: false });
        unknown = 0;
    }
    for _ in 0..unknown {
        let micros = times.last().map_or(0.0, |before| before.micros + interval);
        times.push(estimated(micros));
    }
    times
}

impl Schedule {
    /// Decodes the video up to the first frame after `until`.
    fn read(path: &Path, until: Option<i64>) -> Result<Self, OpenCvError> {
        let mut stream = Stream::open(path)?;
        let mut known: Vec<Option<f64>> = Vec::new();
        let mut last = f64::NEG_INFINITY;
        while until.is_some_and(|until| last <= until as f64) && stream.grab()? {
            // OpenCV returns 0 for an unknown time; only the first frame is presented at 0.
            let time = stream.time()?;
            let unknown = !known.is_empty() && time == 0.0;
            let increases = time > last && time.is_finite();
            if !unknown && !increases {
                let expected = format!("a time after {last} µs");
                return Err(malformed(path, format!("frame {}", known.len()), expected, format!("{time} µs")));
            }
            last = if unknown { last } else { time };
            known.push((!unknown).then_some(time));
        }
        let gaps = known.windows(2).filter_map(|pair| match pair {
            [Some(before), Some(after)] => Some(after - before),
            _ => None,
        });
        let interval_micros = median(gaps).unwrap_or(stream.declared_interval_micros);
        Ok(Self { times: filled(&known, interval_micros), interval_micros })
    }

    /// The number and time of the frame nearest to a timestamp, the earlier of two equally near ones.
    fn nearest(&self, timestamp: i64) -> Option<(usize, Time)> {
        let target = timestamp as f64;
        let after = self.times.partition_point(|time| time.micros < target);
        let candidates = [after.checked_sub(1), Some(after)].into_iter().flatten();
        let timed = candidates.filter_map(|number| Some((number, *self.times.get(number)?)));
        timed.min_by(|(_, a), (_, b)| (a.micros - target).abs().total_cmp(&(b.micros - target).abs()))
    }
}

/// A video decoded sequentially from its start.
struct Stream {
    path: PathBuf,
    capture: VideoCapture,
    declared_interval_micros: f64,
}

impl Stream {
    fn open(path: &Path) -> Result<Self, OpenCvError> {
        std::fs::metadata(path).map_err(OpenCvError::io("opening a video", path))?;
        let name = path.to_str();
        let name = name.ok_or_else(|| malformed(path, "path", "UTF-8", path.to_string_lossy().into_owned()))?;
        let capture = called("opening a video", VideoCapture::from_file(name, CAP_FFMPEG))?;
        if !called("opening a video", capture.is_opened())? {
            return Err(malformed(path, "header", "a video that FFmpeg can decode", "something else"));
        }
        let rate = called("reading the frame rate", capture.get(CAP_PROP_FPS))?;
        if !(rate.is_finite() && rate > 0.0) {
            return Err(malformed(path, "frame rate", "a positive number", rate.to_string()));
        }
        Ok(Self { path: path.to_owned(), capture, declared_interval_micros: 1e6 / rate })
    }

    /// Advances to the next frame; `false` at the end.
    fn grab(&mut self) -> Result<bool, OpenCvError> {
        called("decoding a frame", self.capture.grab())
    }

    /// Presentation time of the current frame in microseconds; 0 if unknown to OpenCV.
    fn time(&self) -> Result<f64, OpenCvError> {
        Ok(1e3 * called("reading a presentation time", self.capture.get(CAP_PROP_POS_MSEC))?)
    }

    /// The image of the current frame.
    fn image(&mut self) -> Result<Mat, OpenCvError> {
        let mut image = Mat::default();
        let retrieved = called("retrieving a frame", self.capture.retrieve_def(&mut image))?;
        if retrieved && !image.empty() {
            return Ok(image);
        }
        Err(malformed(&self.path, "frame", "a decodable image", "none"))
    }
}

impl fmt::Display for ExtractedFrames {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { interval_micros, frames, removed } = self;
        let count = frames.len();
        writeln!(f, "{} of {count} frames written, frame interval {interval_micros:.0} µs", self.written())?;
        if *removed > 0 {
            writeln!(f, "{removed} earlier images of their timestamps in the other format removed")?;
        }
        for frame in frames {
            let residual = frame.residual_micros();
            let away = residual.map_or_else(|| "no frame".to_owned(), |micros| format!("{micros:+.0} µs"));
            let away = if frame.estimated { format!("{away} (estimated)") } else { away };
            let note = match frame.outcome {
                ExtractionOutcome::Written { .. } => "",
                ExtractionOutcome::TooFar => "  rejected: over half an interval",
                ExtractionOutcome::NoFrame => "  rejected: the video is empty",
            };
            writeln!(f, "  {}  {away}{note}", frame.timestamp_micros)?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use atsplat_numeric::Tolerance;

    /// Presentation times are stored in ticks of 1/90000 s or finer.
    const TICK: Tolerance = Tolerance::absolute(12.0);

    fn fixture(name: &str) -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/video").join(name)
    }

    fn cut(name: &str, timestamps: &[i64]) -> (ExtractedFrames, tempfile::TempDir) {
        let folder = tempfile::tempdir().unwrap();
        let options = ExtractionOptions { folder: folder.path().to_owned(), format: FrameFormat::Png };
        let mut decided = 0;
        let cut = extract_frames(&fixture(name), "scene", timestamps, &options, |count| decided = count).unwrap();
        assert_eq!(decided, timestamps.len());
        (cut, folder)
    }

    /// The frame number that `make_videos.sh` drew: bit n is the brightness of the nth stripe of 8 columns.
    fn number_in(frame: &ExtractedFrame) -> Option<u32> {
        let ExtractionOutcome::Written { path } = &frame.outcome else { return None };
        let image = atsplat_pixels::decode(&std::fs::read(path).unwrap(), &atsplat_pixels::DecodeLimits::default());
        let image = image.unwrap();
        Some((0..8).map(|bit| u32::from(image.pixel(8 * bit + 4, 24).unwrap()[1] > 127) << bit).sum())
    }

    #[test]
    fn frames_at_a_constant_rate_are_found_by_time() {
        // 25 frames a second: frame n at n · 40 ms.
        let (cut, _folder) = cut("constant.mp4", &[0, 40_000, 1_200_000, 419_000]);
        assert_eq!(cut.frames.iter().map(number_in).collect::<Vec<_>>(), [Some(0), Some(1), Some(30), Some(10)]);
        assert!(TICK.accepts(cut.interval_micros, 40_000.0));
        let residuals = cut.frames.iter().map(|frame| frame.residual_micros().unwrap());
        TICK.assert(residuals, [0.0, 0.0, 0.0, -19_000.0], "residuals");
        assert_eq!(cut.written(), 4);
    }

    #[test]
    fn every_frame_is_found_at_its_time() {
        let times: Vec<i64> = (0..49).map(|n| n * 40_000).collect();
        let (cut, _folder) = cut("constant.mp4", &times);
        assert_eq!(cut.frames.iter().map(number_in).collect::<Vec<_>>(), (0..49).map(Some).collect::<Vec<_>>());
        TICK.assert(cut.frames.iter().map(|frame| frame.residual_micros().unwrap()), [0.0; 49], "residuals");
    }

    #[test]
    fn frames_at_a_variable_rate_are_found_by_time() {
        // make_videos.sh: frame n at n² · 4 ms.
        let times: Vec<i64> = (0..20).map(|n| n * n * 4_000).collect();
        let (cut, _folder) = cut("variable.mkv", &times);
        let numbers: Vec<_> = cut.frames.iter().map(number_in).collect();
        assert_eq!(numbers, (0..20).map(Some).collect::<Vec<_>>());
        for frame in &cut.frames {
            assert!(TICK.accepts(frame.residual_micros().unwrap(), 0.0), "{frame:?}");
        }
    }

    #[test]
    fn distant_timestamps_are_rejected_with_their_residual() {
        let (cut, folder) = cut("constant.mp4", &[-500_000, -19_000, 9_000_000]);
        assert_eq!(cut.frames.iter().map(number_in).collect::<Vec<_>>(), [None, Some(0), None]);
        assert!(cut.frames.iter().all(|frame| frame.residual_micros().is_some()));
        assert_eq!(cut.frames[2].outcome, ExtractionOutcome::TooFar);
        let names: Vec<_> =
            std::fs::read_dir(folder.path().join("scene")).unwrap().map(|e| e.unwrap().file_name()).collect();
        assert_eq!(names, ["-19000.png"], "no partial file is left");
        assert!(cut.to_string().contains("1 of 3 frames written"), "{cut}");
    }

    #[test]
    fn timestamps_may_be_unordered_and_repeated() {
        let (cut, _folder) = cut("constant.mp4", &[800_000, 0, 800_000, 400_000]);
        assert_eq!(cut.frames.iter().map(number_in).collect::<Vec<_>>(), [Some(20), Some(0), Some(20), Some(10)]);
    }

    #[test]
    fn unknown_times_lie_between_the_known_ones() {
        let micros = |known: &[Option<f64>]| {
            let times = filled(known, 33_000.0);
            let unknown = times.iter().map(|time| time.estimated).collect::<Vec<_>>();
            assert_eq!(unknown, known.iter().map(Option::is_none).collect::<Vec<_>>());
            times.into_iter().map(|time| time.micros).collect::<Vec<_>>()
        };
        let between = micros(&[Some(0.0), None, Some(10_000.0), Some(43_000.0)]);
        Tolerance::EXACT.assert(between, [0.0, 5_000.0, 10_000.0, 43_000.0], "less than two intervals");
        let two = micros(&[Some(0.0), Some(7_000.0), None, None, Some(100_000.0), None, None]);
        let expected = [0.0, 7_000.0, 38_000.0, 69_000.0, 100_000.0, 133_000.0, 166_000.0];
        Tolerance::EXACT.assert(two, expected, "more than two intervals, and the end");
        Tolerance::EXACT.assert(micros(&[None, None, Some(70_000.0)]), [4_000.0, 37_000.0, 70_000.0], "the start");
    }

    #[test]
    fn frames_are_found_by_time_between_known_ones() {
        let times = filled(&[Some(0.0), None, Some(10_000.0), Some(43_000.0)], 33_000.0);
        let schedule = Schedule { times, interval_micros: 33_000.0 };
        let nearest = [-1, 4_000, 9_000, 26_000, 50_000].map(|timestamp| schedule.nearest(timestamp).unwrap().0);
        assert_eq!(nearest, [0, 1, 2, 2, 3]);
    }

    #[test]
    fn jpeg_frames_are_written_as_jpeg() {
        let folder = tempfile::tempdir().unwrap();
        let options = ExtractionOptions { folder: folder.path().to_owned(), format: FrameFormat::Jpeg(95) };
        let cut = extract_frames(&fixture("constant.mp4"), "scene", &[120_000], &options, |_| ()).unwrap();
        assert_eq!(number_in(&cut.frames[0]), Some(3));
        let bytes = std::fs::read(folder.path().join("scene/120000.jpg")).unwrap();
        assert_eq!(bytes[..2], [0xff, 0xd8]);
    }

    #[test]
    fn frames_in_another_format_replace_those_of_their_timestamps() {
        let folder = tempfile::tempdir().unwrap();
        let cut = |format, timestamps: &[i64]| {
            let options = ExtractionOptions { folder: folder.path().to_owned(), format };
            let cut = extract_frames(&fixture("constant.mp4"), "scene", timestamps, &options, |_| ()).unwrap();
            let files = std::fs::read_dir(folder.path().join("scene")).unwrap();
            let files = files.map(|file| file.unwrap().file_name().into_string().unwrap());
            (cut.removed, files.collect::<BTreeSet<_>>())
        };
        let files = |names: [&str; 2]| BTreeSet::from(names.map(str::to_owned));
        assert_eq!(cut(FrameFormat::Jpeg(95), &[0, 40_000]), (0, files(["0.jpg", "40000.jpg"])));
        assert_eq!(cut(FrameFormat::Png, &[40_000]), (1, files(["0.jpg", "40000.png"])));
        assert_eq!(cut(FrameFormat::Jpeg(95), &[40_000, 40_000]), (1, files(["0.jpg", "40000.jpg"])));
    }

    #[test]
    fn invalid_videos_and_keys_are_errors() {
        let folder = tempfile::tempdir().unwrap();
        let options = ExtractionOptions { folder: folder.path().join("out"), format: FrameFormat::Png };
        let attempt = |video: &Path, key: &str| extract_frames(video, key, &[0], &options, |_| ()).err();
        let whole = std::fs::read(fixture("constant.mp4")).unwrap();
        for (name, bytes) in [("text.mp4", &b"not a video"[..]), ("empty.mp4", b""), ("cut.mp4", &whole[..40])] {
            let path = folder.path().join(name);
            std::fs::write(&path, bytes).unwrap();
            assert!(matches!(attempt(&path, "scene"), Some(OpenCvError::Video { .. })), "{name}");
        }
        assert!(matches!(attempt(&folder.path().join("none.mp4"), "scene"), Some(OpenCvError::Io(_))));
        for key in ["", ".", "..", "a/b", "/etc", "../up", "a/"] {
            assert!(matches!(attempt(&fixture("constant.mp4"), key), Some(OpenCvError::Video { .. })), "{key:?}");
        }
        let names = std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().file_name());
        let names = names.collect::<BTreeSet<_>>().into_iter().collect::<Vec<_>>();
        assert_eq!(names, ["cut.mp4", "empty.mp4", "text.mp4"], "rejected videos and keys leave no folder");
    }
}
