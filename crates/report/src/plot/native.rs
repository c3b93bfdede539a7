use atsplat_pixels::encode_png;
use plotters::coord::Shift;
use plotters::prelude::*;

use super::render::{PlotFormat, image_of, svg_of};
use crate::ReportError;

pub(super) type DrawResult = Result<(), Box<dyn std::error::Error>>;

/// A plot drawn with the elements of plotters instead of a [`Drawing`](super::Drawing).
pub(super) trait NativePlot {
    /// Width and height in pixels.
    fn size(&self) -> (u32, u32);

    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> DrawResult
    where
        B::ErrorType: 'static;
}

/// The bytes of the file; the same plot gives the same bytes.
pub(super) fn encode(plot: &impl NativePlot, format: PlotFormat) -> Result<Vec<u8>, ReportError> {
    let encoded = || -> Result<Vec<u8>, Box<dyn std::error::Error>> {
        match format {
            PlotFormat::Svg => Ok(svg_of(plot.size(), |area| plot.draw(area))?.into_bytes()),
            PlotFormat::Png => Ok(encode_png(&image_of(plot.size(), |area| plot.draw(area))?)?),
        }
    };
    encoded().map_err(|error| match error.downcast::<ReportError>() {
        Ok(error) => *error,
        Err(other) => ReportError::Plot(other.to_string()),
    })
}
