//! Plots, drawn with a bundled font so that they look alike everywhere.

mod file;
mod font;
mod overlap_histogram;
mod palette;
mod stress_errors;

pub(crate) use file::{PlotFile, PlotFormat};
pub(crate) use font::{FONT, register};
pub(crate) use overlap_histogram::{OverlapHistogram, draw_overlap_histogram};
pub(crate) use palette::{COLOURS, GREY};
pub(crate) use stress_errors::{StressErrors, draw_stress_errors};
