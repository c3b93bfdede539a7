use atsplat_numeric::Extremes as _;

use super::drawing::axes::{Axes, AxisText};
use super::drawing::scale::{Scale, bounds};
use super::drawing::shape::{Drawing, Extent, Fill, MARGIN, Side, Stroke, TextLine};
use super::drawing::theme::{INK, MUTED, colour};
use crate::numbers::count_label;

/// The distribution of Gaussians per scene under uncertainty thresholds: one row per setting.
#[derive(Clone, Debug)]
pub struct BudgetHistogram {
    /// Title.
    pub title: String,
    /// Protocol, scenes.
    pub subtitle: String,
    /// One per setting.
    pub series: Vec<BudgetSeries>,
    /// The numbers of Gaussians under fixed ratios, each as a line through all rows.
    pub fixed: Vec<f64>,
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
    /// Draws it: each column is as high as the number of scenes in it, on one scale for all rows.
    pub fn draw(&self) -> Drawing {
        const ROW: f64 = 96.0;
        let (mut drawing, head) = Drawing::titled(860, &self.title, &self.subtitle);
        let fixed: Vec<String> = self.fixed.iter().copied().map(count_label).collect();
        let fixed_name = (!fixed.is_empty()).then(|| format!("dashed: fixed ratios, {}", fixed.join(" and ")));
        let mut legend = vec!["mean"];
        legend.extend(fixed_name.as_deref());
        let top = 12.0
            + drawing.legend(MARGIN, head + 12.0, &legend, |drawing, at, [x, y]| match at {
                0 => drawing.line([[x, y - 7.0], [x, y + 7.0]], Stroke::new(INK, 2.0)),
                _ => dashed(drawing, x, [y - 7.0, y + 7.0]),
            });
        let counts =
            self.series.iter().flat_map(|series| series.gaussians.iter().copied()).chain(self.fixed.iter().copied());
        let name =
            |series: &BudgetSeries| TextLine::new(&*series.label, [0.0; 2]).bold().side(Side::Right).within(178.0);
        let heights: Vec<f64> =
            self.series.iter().map(|series| (name(series).height() + 48.0).maximum_of(ROW)).collect();
        let bottom = top + heights.iter().sum::<f64>();
        let axes = Axes {
            inside: Extent::new(210.0, top, 836.0, bottom),
            x: Scale::around(counts, 0.04),
            y: Scale::linear(0.0, 1.0),
        };
        axes.draw_x_grid(&mut drawing, &axes.x_ticks());
        let label = |count: f64, _: &[f64]| count_label(count);
        let rows: Vec<Vec<u64>> = self.series.iter().map(|series| histogram(&series.gaussians, axes.x)).collect();
        let tallest = rows.iter().flatten().max().copied().unwrap_or(0).clamp(1, u64::MAX);
        let title = format!("Gaussians per scene; columns: number of scenes, {tallest} in the highest");
        let text = AxisText { title: &title, label: &label };
        let below = axes.draw_x(&mut drawing, &text);
        let mut upper = top;
        for (at, ((series, columns), height)) in self.series.iter().zip(&rows).zip(heights).enumerate() {
            let base = upper + height - 8.0;
            drawing.line([[axes.inside.left, base], [axes.inside.right, base]], Stroke::new(MUTED, 1.0));
            drawing.key(&series.label, |drawing| {
                drawing.text(TextLine { at: [196.0, 0.0], ..name(series) }.below(upper + 8.0));
            });
            let width = axes.inside.width() / COLUMNS as f64;
            drawing.data(&series.label, |drawing| {
                for (column, count) in columns.iter().enumerate().filter(|(_, count)| **count > 0) {
                    let left = axes.inside.left + width * column as f64 + 0.5;
                    let top = base - (ROW - 26.0) * *count as f64 / tallest as f64;
                    drawing.rectangle(Extent::new(left, top, left + width - 1.0, base), Fill::solid(colour(at)));
                }
            });
            if let Some((low, high)) = bounds(series.gaussians.iter().copied()) {
                let mean = series.gaussians.iter().sum::<f64>() / series.gaussians.len() as f64;
                let lines = [
                    format!("mean {} of {}", count_label(mean), series.gaussians.len()),
                    format!("{} to {}", count_label(low), count_label(high)),
                ];
                for (text, y) in lines.into_iter().zip([base - 24.0, base - 7.0]) {
                    drawing.text(TextLine::new(text, [196.0, y]).small().muted().side(Side::Right));
                }
                let x = axes.x_of(mean);
                drawing.line([[x, base - ROW + 22.0], [x, base + 6.0]], Stroke::new(INK, 2.0));
            }
            upper += height;
        }
        for fixed in &self.fixed {
            dashed(&mut drawing, axes.x_of(*fixed), [top, bottom]);
        }
        drawing.end_at(below + 14.0);
        drawing
    }
}

fn dashed(drawing: &mut Drawing, x: f64, [from, to]: [f64; 2]) {
    let mut y = from;
    while y < to {
        drawing.line([[x, y], [x, (y + 4.0).minimum_of(to)]], Stroke::new(MUTED, 1.5));
        y += 8.0;
    }
}

/// Number of scenes in each column of equal width.
fn histogram(values: &[f64], scale: Scale) -> Vec<u64> {
    let mut columns = vec![0; COLUMNS];
    for value in values.iter().filter(|value| value.is_finite()) {
        columns[scale.column(*value, COLUMNS)] += 1;
    }
    columns
}

#[cfg(test)]
mod tests {
    use atsplat_numeric::Tolerance;

    use super::super::drawing::shape::{Role, Shape};
    use super::*;

    #[test]
    fn every_scene_is_in_one_column() {
        let columns = histogram(&[0.0, 0.1, 47.0, 48.0, f64::NAN], Scale::linear(0.0, 48.0));
        assert_eq!((columns[0], columns[47], columns.iter().sum::<u64>()), (2, 2, 4));
    }

    /// Four scenes in a column of one row, and one in that of the other.
    #[test]
    fn rows_share_a_scale_of_counts() {
        let series =
            |label: &str, gaussians: &[f64]| BudgetSeries { label: label.to_owned(), gaussians: gaussians.to_vec() };
        let plot = BudgetHistogram {
            title: String::new(),
            subtitle: String::new(),
            series: vec![series("a", &[100.0; 4]), series("b", &[200.0])],
            fixed: Vec::new(),
        };
        let drawing = plot.draw();
        let height = |label: &str| {
            let of_row = drawing.items.iter().filter(|item| item.role == Role::Data(label.into()));
            let corners = of_row.filter_map(|item| match &item.shape {
                Shape::Area { corners, .. } => Some(corners.clone()),
                _ => None,
            });
            let (top, base) = bounds(corners.flatten().map(|[_, y]| y)).unwrap();
            base - top
        };
        Tolerance::relative(1e-9).assert([height("a")], [4.0 * height("b")], "four scenes and one");
        assert!(drawing.texts().any(|text| text.ends_with("number of scenes, 4 in the highest")));
    }
}
