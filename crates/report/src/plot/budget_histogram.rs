use super::axes::{Axes, AxisText};
use super::font::shortened;
use super::scale::{Scale, bounds, count_label};
use super::shape::{Drawing, Extent, Fill, Side, Stroke, TextLine};
use super::theme::{GRID, INK, MUTED, colour};

/// The distribution of Gaussians per scene under uncertainty thresholds: one row per setting.
#[derive(Clone, Debug)]
pub struct BudgetHistogram {
    /// Title.
    pub title: String,
    /// Protocol, scenes.
    pub subtitle: String,
    /// One per setting.
    pub series: Vec<BudgetSeries>,
    /// The number of Gaussians under fixed ratios, as a line through all rows.
    pub fixed: Option<f64>,
}

/// One setting.
#[derive(Clone, Debug)]
pub struct BudgetSeries {
    /// Its thresholds or ratios.
    pub label: String,
    /// Gaussians of each scene.
    pub gaussians: Vec<f64>,
}

const COLUMNS: usize = 48;

impl BudgetHistogram {
    /// Draws it.
    pub fn draw(&self) -> Drawing {
        const ROW: f64 = 96.0;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few rows")]
        let mut drawing = Drawing::new(860, (150.0 + ROW * self.series.len() as f64) as u32);
        drawing.heading(&self.title, &self.subtitle);
        let counts = self.series.iter().flat_map(|series| series.gaussians.iter().copied()).chain(self.fixed);
        let bottom = 80.0 + ROW * self.series.len() as f64;
        let axes = Axes {
            inside: Extent::new(210.0, 90.0, 836.0, bottom),
            x: Scale::around(counts, 0.04),
            y: Scale::linear(0.0, 1.0),
        };
        let label = |count: f64, _: &[f64]| count_label(count);
        for tick in axes.x.ticks(6) {
            drawing.line([[axes.x_of(tick), 90.0], [axes.x_of(tick), bottom]], Stroke::new(GRID, 1.0));
        }
        axes.draw_x(&mut drawing, &AxisText { title: "Gaussians per scene", label: &label });
        for (at, series) in self.series.iter().enumerate() {
            let base = 90.0 + ROW * (at as f64 + 1.0) - 10.0;
            let columns = histogram(&series.gaussians, axes.x);
            let tallest = columns.iter().max().copied().unwrap_or(0).clamp(1, u64::MAX) as f64;
            for (column, count) in columns.iter().enumerate().filter(|(_, count)| **count > 0) {
                let width = axes.inside.width() / COLUMNS as f64;
                let left = axes.inside.left + width * column as f64;
                let height = (ROW - 26.0) * *count as f64 / tallest;
                drawing.rectangle(
                    Extent::new(left + 0.5, base - height, left + width - 0.5, base),
                    Fill::solid(colour(at)),
                );
            }
            drawing.line([[axes.inside.left, base], [axes.inside.right, base]], Stroke::new(MUTED, 1.0));
            let name = shortened(&series.label, 13.0, true, 178.0);
            drawing.text(TextLine::new(name, [196.0, base - 50.0]).bold().side(Side::Right));
            if let Some((low, high)) = bounds(series.gaussians.iter().copied()) {
                let mean = series.gaussians.iter().sum::<f64>() / series.gaussians.len() as f64;
                let range = format!("{} to {}", count_label(low), count_label(high));
                drawing.text(
                    TextLine::new(format!("mean {}", count_label(mean)), [196.0, base - 31.0])
                        .size(12.0)
                        .side(Side::Right),
                );
                drawing.text(TextLine::new(range, [196.0, base - 14.0]).size(12.0).muted().side(Side::Right));
                let x = axes.x_of(mean);
                drawing.line([[x, base - ROW + 22.0], [x, base + 6.0]], Stroke::new(INK, 2.0));
            }
        }
        if let Some(fixed) = self.fixed {
            let x = axes.x_of(fixed);
            let mut y = 90.0;
            while y < bottom {
                drawing.line([[x, y], [x, y + 5.0]], Stroke::new(MUTED, 1.5));
                y += 10.0;
            }
            let text =
                TextLine::new(format!("fixed ratios {}", count_label(fixed)), [x, 76.0]).size(12.0).side(Side::Middle);
            drawing.text(text);
        }
        drawing
    }
}

/// Number of scenes in each column of equal width.
fn histogram(values: &[f64], scale: Scale) -> Vec<u64> {
    let mut columns = vec![0; COLUMNS];
    for value in values.iter().filter(|value| value.is_finite()) {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the columns")]
        let column = (scale.share(*value) * COLUMNS as f64).clamp(0.0, (COLUMNS - 1) as f64) as usize;
        columns[column] += 1;
    }
    columns
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_scene_is_in_one_column() {
        let columns = histogram(&[0.0, 0.1, 47.0, 48.0, f64::NAN], Scale::linear(0.0, 48.0));
        assert_eq!((columns[0], columns[47], columns.iter().sum::<u64>()), (2, 2, 4));
    }
}
