//! Plots of single commands; those of results are `atsplat-report`'s, whose font and colours these share.

mod file;
mod overlap_histogram;
mod stress_errors;

pub(crate) use atsplat_report::plot::PlotFormat;
pub(crate) use file::PlotFile;
pub(crate) use overlap_histogram::{OverlapHistogram, draw_overlap_histogram};

pub(crate) use stress_errors::{StressErrors, draw_stress_errors};
