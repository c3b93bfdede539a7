//! Time per stage of rendering frames.

use std::fmt;

use atsplat_numeric::median;
use atsplat_splat::Stage;
use atsplat_splat::gpu::GpuCounts;
use indexmap::IndexSet;
use serde::Serialize;

/// Time spent on a frame.
#[derive(Clone, Debug, Default)]
pub struct FrameTiming {
    /// Stages of planning and rendering.
    pub stages: Vec<Stage>,
    /// Seconds of planning and rendering.
    pub render_secs: f64,
    /// Seconds of encoding and writing.
    pub write_secs: f64,
    /// Submissions to the graphics processor, waits for it and transfers, if one rendered.
    pub device: Option<GpuCounts>,
}

/// Time per stage: medians over all frames but the first, which warms up caches and buffers.
#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct FrameTimings {
    reading_secs: f64,
    /// Number of frames in the medians.
    frames: usize,
    /// Inverse of the median of `render`; `None` for a single frame.
    frames_per_second: Option<f64>,
    /// Submissions to the graphics processor, waits for it and transfers, if one rendered; sums over all frames.
    #[serde(skip_serializing_if = "Option::is_none")]
    device: Option<GpuCounts>,
    rows: Vec<Row>,
}

#[derive(Debug, Serialize)]
#[serde(rename_all = "kebab-case")]
struct Row {
    stage: &'static str,
    /// Of the first frame; `None` if the stage is of later ones only.
    first_ms: Option<f64>,
    median_ms: Option<f64>,
    /// Median absolute deviation from the median.
    mad_ms: Option<f64>,
}

impl FrameTimings {
    /// Summarises the frames that were rendered, and the seconds of reading the scene.
    pub fn of<'a>(reading_secs: f64, rendered: impl IntoIterator<Item = &'a FrameTiming>) -> Self {
        let rendered: Vec<_> = rendered.into_iter().collect();
        // By name: the stages of a renderer may differ between frames.
        let names: IndexSet<&'static str> =
            rendered.iter().flat_map(|frame| &frame.stages).map(|stage| stage.name).collect();
        let mut rows: Vec<Row> = Vec::new();
        for name in names {
            let of_frame =
                |frame: &&FrameTiming| frame.stages.iter().find(|stage| stage.name == name).map(|stage| stage.secs);
            rows.extend(Row::of(name, rendered.iter().map(of_frame)));
        }
        let render = Row::of("render", rendered.iter().map(|frame| Some(frame.render_secs)));
        let frames_per_second = render.as_ref().and_then(|row| row.median_ms).map(|median| 1e3 / median);
        rows.extend(render);
        rows.extend(Row::of("encode, write", rendered.iter().map(|frame| Some(frame.write_secs))));
        let device = rendered.iter().filter_map(|frame| frame.device).reduce(|all, frame| all + frame);
        Self { reading_secs, frames: rendered.len().saturating_sub(1), frames_per_second, device, rows }
    }
}

impl Row {
    /// Of the seconds of every frame, `None` for a frame without the stage; `None` without a frame.
    fn of(stage: &'static str, secs: impl Iterator<Item = Option<f64>>) -> Option<Self> {
        let mut ms = secs.map(|secs| Some(1e3 * secs?));
        let first_ms = ms.next()?;
        let rest: Vec<f64> = ms.flatten().collect();
        let median_ms = median(rest.iter().copied());
        let mad_ms = median_ms.and_then(|middle| median(rest.iter().map(|ms| (ms - middle).abs())));
        Some(Self { stage, first_ms, median_ms, mad_ms })
    }
}

impl fmt::Display for FrameTimings {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "\n{:>12}  {:>10} {:>10} {:>8}   milliseconds per frame", "", "median", "MAD", "first")?;
        let shown = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |value| format!("{value:.2}"));
        for row in &self.rows {
            let [median, mad, first] = [row.median_ms, row.mad_ms, row.first_ms].map(shown);
            writeln!(f, "{:>13} {median:>10} {mad:>10} {first:>8}", row.stage)?;
        }
        write!(
            f,
            "{:>13} {:>10.2} s; medians over {} frames after the first",
            "reading", self.reading_secs, self.frames
        )?;
        match self.frames_per_second {
            Some(rate) => writeln!(f, ": {rate:.1} frames per second")?,
            None => writeln!(f)?,
        }
        match &self.device {
            Some(device) => writeln!(f, "{:>13} {device}; all frames together", "device"),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use atsplat_numeric::Tolerance;

    use super::*;

    fn frame(ms: f64) -> FrameTiming {
        let secs = ms / 1e3;
        FrameTiming {
            stages: vec![Stage { name: "sort", secs }],
            render_secs: 2.0 * secs,
            write_secs: 0.0,
            device: None,
        }
    }

    #[test]
    fn the_first_frame_is_reported_separately() {
        let timings = FrameTimings::of(0.5, &[frame(100.0), frame(4.0), frame(7.0), frame(5.0), frame(20.0)]);
        assert_eq!((timings.frames, timings.rows.len()), (4, 3));
        let row = &timings.rows[0];
        let found =
            [row.first_ms.unwrap(), row.median_ms.unwrap(), row.mad_ms.unwrap(), timings.frames_per_second.unwrap()];
        Tolerance::relative(1e-12).assert(found, [100.0, 6.0, 1.5, 1e3 / 12.0], "medians");
    }

    #[test]
    fn counts_of_a_device_are_summed() {
        let counts = |waits| Some(GpuCounts { submissions: 1, waits, bytes_down: 1 << 19, ..GpuCounts::default() });
        let frames = [1, 2].map(|waits| FrameTiming { device: counts(waits), ..frame(4.0) });
        let text = FrameTimings::of(0.5, &frames).to_string();
        assert!(
            text.contains("device 2 submissions, 3 waits, 0 dispatches, 0 repeats, 0.0 MiB up, 1.0 MiB down"),
            "{text}"
        );
        assert!(!FrameTimings::of(0.5, &[frame(4.0)]).to_string().contains("device"));
    }

    #[test]
    fn stages_are_matched_by_name() {
        let mut other = frame(7.0);
        other.stages.insert(0, Stage { name: "upload", secs: 1.0 });
        let timings = FrameTimings::of(0.5, &[frame(3.0), other, frame(7.0)]);
        let names: Vec<&str> = timings.rows.iter().map(|row| row.stage).collect();
        assert_eq!(names, ["sort", "upload", "render", "encode, write"]);
        Tolerance::relative(1e-12).assert(timings.rows[0].median_ms, [7.0], "sort alone");
        let upload = &timings.rows[1];
        assert_eq!(upload.first_ms, None, "the first frame had none");
        Tolerance::relative(1e-12).assert(upload.median_ms, [1000.0], "upload");
    }

    #[test]
    fn a_single_frame_is_warm_up() {
        let timings = FrameTimings::of(0.5, &[frame(3.0)]);
        assert_eq!((timings.frames, timings.frames_per_second, timings.rows[0].median_ms), (0, None, None));
        assert!(FrameTimings::of(0.5, &[]).rows.is_empty());
    }
}
