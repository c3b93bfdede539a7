use plotters::coord::Shift;
use plotters::prelude::*;

use super::native::{self, DrawResult, NativePlot};
use super::{FONT, GREY, PlotFormat, colour};
use crate::ReportError;

/// A histogram of overlaps, stacked by bin.
#[derive(Debug)]
pub struct OverlapHistogram<'a> {
    /// Title above the plot.
    pub title: &'a str,
    /// Overlap of each context set, in \[0, 1\], with the position of its bin in `bins`; `None` is outside all bins.
    pub overlaps: &'a [(f64, Option<usize>)],
    /// Names of the bins, which take colours in order.
    pub bins: &'a [String],
}

const SIZE: (u32, u32) = (960, 540);
/// One column per 0.025 of overlap: fine enough to see a bin's edge, coarse enough for 5 000 scenes.
const COLUMNS: usize = 40;

impl OverlapHistogram<'_> {
    /// The bytes of the file; the same plot gives the same bytes.
    ///
    /// # Errors
    /// [`ReportError::Font`], [`ReportError::Plot`], [`ReportError::Picture`].
    pub fn encode(&self, format: PlotFormat) -> Result<Vec<u8>, ReportError> {
        native::encode(self, format)
    }
}

impl NativePlot for OverlapHistogram<'_> {
    fn size(&self) -> (u32, u32) {
        SIZE
    }

    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> DrawResult
    where
        B::ErrorType: 'static,
    {
        let stacks = stack(self);
        let tallest = stacks.iter().map(|column| column.iter().sum::<u64>()).max().unwrap_or(0).max(1);
        area.fill(&WHITE)?;
        let mut chart = ChartBuilder::on(area)
            .caption(self.title, (FONT, 22))
            .margin(16)
            .x_label_area_size(44)
            .y_label_area_size(64)
            .build_cartesian_2d(0.0..1.0, 0.0..(tallest as f64 * 1.08))?;
        chart
            .configure_mesh()
            .x_desc("overlap of the context views")
            .y_desc("context sets")
            .label_style((FONT, 15))
            .axis_desc_style((FONT, 17))
            .x_labels(11)
            .y_label_formatter(&|count| format!("{count:.0}"))
            .disable_x_mesh()
            .light_line_style(WHITE)
            .draw()?;

        for bin in 0..=self.bins.len() {
            let colour = colour_of(self, bin);
            let boxes = stacks.iter().enumerate().filter_map(|(column, counts)| {
                let height = *counts.get(bin)?;
                let base: u64 = counts.iter().take(bin).sum();
                (height > 0).then(|| {
                    let left = column as f64 / COLUMNS as f64;
                    let right = (column + 1) as f64 / COLUMNS as f64;
                    Rectangle::new(
                        [(left + 0.001, base as f64), (right - 0.001, (base + height) as f64)],
                        colour.filled(),
                    )
                })
            });
            let total: u64 = stacks.iter().filter_map(|counts| counts.get(bin)).sum();
            let series = chart.draw_series(boxes)?;
            if total > 0 {
                let name = self.bins.get(bin).map_or("outside the bins", String::as_str);
                series
                    .label(format!("{name} ({total})"))
                    .legend(move |(x, y)| Rectangle::new([(x, y - 6), (x + 14, y + 6)], colour.filled()));
            }
        }
        chart
            .configure_series_labels()
            .label_font((FONT, 16))
            .background_style(WHITE.mix(0.85))
            .border_style(BLACK.mix(0.3))
            .position(SeriesLabelPosition::UpperRight)
            .draw()?;
        area.present()?;
        Ok(())
    }
}

/// Counts per column and bin; the last entry of a column counts overlaps outside every bin.
fn stack(histogram: &OverlapHistogram<'_>) -> Vec<Vec<u64>> {
    let outside = histogram.bins.len();
    let mut stacks = vec![vec![0u64; outside + 1]; COLUMNS];
    for (overlap, bin) in histogram.overlaps {
        if !(0.0..=1.0).contains(overlap) {
            continue;
        }
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "inside 0..=COLUMNS by the check above"
        )]
        let column = ((overlap * COLUMNS as f64) as usize).min(COLUMNS - 1);
        let bin = bin.filter(|bin| *bin < outside).unwrap_or(outside);
        if let Some(count) = stacks.get_mut(column).and_then(|counts| counts.get_mut(bin)) {
            *count += 1;
        }
    }
    stacks
}

fn colour_of(histogram: &OverlapHistogram<'_>, bin: usize) -> RGBColor {
    if bin < histogram.bins.len() { colour(bin) } else { GREY }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn example() -> (Vec<(f64, Option<usize>)>, Vec<String>) {
        let overlaps = vec![(0.1, Some(0)), (0.11, Some(0)), (0.4, Some(1)), (1.0, None), (f64::NAN, None)];
        (overlaps, vec!["small".to_owned(), "medium".to_owned()])
    }

    #[test]
    fn counts_every_overlap_in_one_column_and_nan_in_none() {
        let (overlaps, bins) = example();
        let stacks = stack(&OverlapHistogram { title: "", overlaps: &overlaps, bins: &bins });
        assert_eq!(stacks[4], [2, 0, 0]);
        assert_eq!(stacks[16], [0, 1, 0]);
        assert_eq!(stacks[COLUMNS - 1], [0, 0, 1], "an overlap of one belongs to the last column");
        assert_eq!(stacks.iter().flatten().sum::<u64>(), 4);
    }

    #[test]
    fn the_same_histogram_gives_the_same_svg() {
        let (overlaps, bins) = example();
        let histogram = OverlapHistogram { title: "overlap", overlaps: &overlaps, bins: &bins };
        let svg = || String::from_utf8(histogram.encode(PlotFormat::Svg).unwrap()).unwrap();
        let first = svg();
        assert_eq!(first, svg());
        assert!(first.contains("small (2)"), "the legend counts: {first}");
    }

    #[test]
    fn a_png_has_the_colours_of_its_bins() {
        let (overlaps, bins) = example();
        let histogram = OverlapHistogram { title: "overlap", overlaps: &overlaps, bins: &bins };
        let bytes = histogram.encode(PlotFormat::Png).unwrap();
        let picture = atsplat_pixels::decode(&bytes, &atsplat_pixels::DecodeLimits::default()).unwrap();
        assert_eq!((picture.width(), picture.height()), SIZE);
        for colour in [colour(0), colour(1), GREY] {
            let RGBColor(r, g, b) = colour;
            assert!(picture.samples().chunks_exact(3).any(|pixel| pixel == [r, g, b]), "{colour:?}");
        }
    }
}
