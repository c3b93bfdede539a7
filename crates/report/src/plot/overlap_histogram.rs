use super::drawing::axes::{Axes, AxisText};
use super::drawing::scale::Scale;
use super::drawing::series::number_axis;
use super::drawing::shape::{Drawing, Extent, Fill, MARGIN};
use super::drawing::theme::{GREY, colour};

/// A histogram of overlaps, stacked by bin.
#[derive(Debug)]
pub struct OverlapHistogram<'a> {
    /// Title.
    pub title: &'a str,
    /// Index, data, estimator of overlap, number of context sets.
    pub subtitle: &'a str,
    /// Overlap of each context set, in \[0, 1\], with the position of its bin in `bins`; `None` is outside all bins.
    pub overlaps: &'a [(f64, Option<usize>)],
    /// Names of the bins, which take colours in order.
    pub bins: &'a [String],
}

/// One column per 0.025 of overlap: fine enough to see a bin's edge, coarse enough for 5 000 scenes.
const COLUMNS: usize = 40;

impl OverlapHistogram<'_> {
    /// Draws it.
    pub fn draw(&self) -> Drawing {
        let (mut drawing, head) = Drawing::titled(900, self.title, self.subtitle);
        let stacks = stack(self);
        let total = |bin: usize| stacks.iter().filter_map(|counts| counts.get(bin)).sum::<u64>();
        let used: Vec<usize> = (0..=self.bins.len()).filter(|bin| total(*bin) > 0).collect();
        let name = |bin: usize| {
            let name = self.bins.get(bin).map_or("outside the bins", String::as_str);
            format!("{name} ({})", total(bin))
        };
        let names: Vec<String> = used.iter().map(|bin| name(*bin)).collect();
        let legend: Vec<&str> = names.iter().map(String::as_str).collect();
        let bottom = drawing.legend(MARGIN, head + 12.0, &legend, |drawing, at, place| {
            drawing.swatch(place, Fill::solid(self.colour_of(used[at])));
        });
        let top = bottom + 34.0;
        let axes = Axes {
            inside: Extent::new(72.0, top, 876.0, top + 360.0),
            x: Scale::linear(0.0, 1.0),
            y: Scale::from_zero(stacks.iter().map(|column| column.iter().sum::<u64>() as f64)),
        };
        let whole = |count: f64, _: &[f64]| super::drawing::scale::single_label(count);
        axes.draw_y(&mut drawing, &AxisText { title: "context sets in each 0.025 of overlap", label: &whole });
        for (bin, name) in used.iter().zip(&names) {
            drawing.data(name, |drawing| {
                for (column, counts) in stacks.iter().enumerate() {
                    let base: u64 = counts.iter().take(*bin).sum();
                    let height = counts.get(*bin).copied().unwrap_or(0);
                    if height > 0 {
                        let place = |at: usize| axes.x_of(at as f64 / COLUMNS as f64);
                        let [low, high] = [base, base + height].map(|count| axes.y_of(count as f64));
                        let part = Extent::new(place(column) + 1.0, high, place(column + 1) - 1.0, low);
                        drawing.rectangle(part, Fill::solid(self.colour_of(*bin)));
                    }
                }
            });
        }
        let below = axes.draw_x(&mut drawing, &number_axis("overlap of the context views, as a share of the image"));
        drawing.end_at(below + 14.0);
        drawing
    }

    fn colour_of(&self, bin: usize) -> plotters::style::RGBColor {
        if bin < self.bins.len() { colour(bin) } else { GREY }
    }
}

/// Counts per column and bin; the last entry of a column counts overlaps outside every bin.
fn stack(histogram: &OverlapHistogram<'_>) -> Vec<Vec<u64>> {
    let (scale, outside) = (Scale::linear(0.0, 1.0), histogram.bins.len());
    let mut stacks = vec![vec![0u64; outside + 1]; COLUMNS];
    for (overlap, bin) in histogram.overlaps {
        if !(0.0..=1.0).contains(overlap) {
            continue;
        }
        let column = scale.column(*overlap, COLUMNS);
        let bin = bin.filter(|bin| *bin < outside).unwrap_or(outside);
        if let Some(count) = stacks.get_mut(column).and_then(|counts| counts.get_mut(bin)) {
            *count += 1;
        }
    }
    stacks
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
        let stacks = stack(&OverlapHistogram { title: "", subtitle: "", overlaps: &overlaps, bins: &bins });
        assert_eq!(stacks[4], [2, 0, 0]);
        assert_eq!(stacks[16], [0, 1, 0]);
        assert_eq!(stacks[COLUMNS - 1], [0, 0, 1], "an overlap of one belongs to the last column");
        assert_eq!(stacks.iter().flatten().sum::<u64>(), 4);
    }

    #[test]
    fn every_bin_has_its_colour_and_its_count() {
        let (overlaps, bins) = example();
        let title = "Overlap";
        let drawing = OverlapHistogram { title, subtitle: "an index; 5 sets", overlaps: &overlaps, bins: &bins }.draw();
        let texts: Vec<&str> = drawing.texts().collect();
        assert!(
            ["small (2)", "medium (1)", "outside the bins (1)"].iter().all(|name| texts.contains(name)),
            "{texts:?}"
        );
        let image = drawing.to_image().unwrap();
        for expected in [colour(0), colour(1), GREY] {
            let plotters::style::RGBColor(r, g, b) = expected;
            assert!(image.samples().chunks_exact(3).any(|pixel| pixel == [r, g, b]), "{expected:?}");
        }
    }
}
