use atsplat_numeric::{Extremes as _, median};

use super::drawing::axes::{Axes, AxisText};
use super::drawing::scale::{Scale, label};
use super::drawing::shape::{Drawing, Extent, Fill, MARGIN, Stroke, TextLine};
use super::drawing::theme::colour;
use crate::numbers::{to_three_digits, with_minus_sign};

/// Groups compared by several measures: a small histogram per measure, with the first group filled, the others
/// outlined, and groups of few values as single points.
#[derive(Clone, Debug)]
pub struct Histograms {
    /// Title.
    pub title: String,
    /// What the groups are, and what the heights mean.
    pub subtitle: String,
    /// Names of the groups, in the order of their colours.
    pub groups: Vec<String>,
    /// One per measure.
    pub panels: Vec<HistogramPanel>,
}

/// One measure.
#[derive(Clone, Debug)]
pub struct HistogramPanel {
    /// What is measured, with its unit.
    pub measure: String,
    /// Values of each group; values that are not finite are skipped.
    pub values: Vec<Vec<f64>>,
}

const COLUMNS: usize = 14;
const ACROSS: usize = 4;
const WIDTH: f64 = 232.0;
const HEIGHT: f64 = 110.0;
const GAP: f64 = 28.0;
const LINE: f64 = 17.0;
/// The height of a row of single values.
const STRIP: f64 = 14.0;
/// Groups of fewer values are shown value by value, because a histogram of few values says little.
const FEW: usize = 20;

impl Histograms {
    /// Draws it. Heights are fractions of a group, so that groups of different sizes are comparable.
    pub fn draw(&self) -> Drawing {
        let across = self.panels.len().clamp(1, ACROSS);
        let width = 2.0 * MARGIN + (WIDTH + GAP) * across as f64 - GAP;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few panels")]
        let (mut drawing, head) = Drawing::titled(width.clamp(640.0, 4000.0) as u32, &self.title, &self.subtitle);
        let mut below = head + 14.0;
        for row in self.panels.chunks(ACROSS) {
            let top = below;
            let mut upper = top;
            for (at, panel) in row.iter().enumerate() {
                let caption = self.draw_caption(&mut drawing, panel, [MARGIN + (WIDTH + GAP) * at as f64, top]);
                upper = upper.maximum_of(caption + 10.0);
            }
            for (at, panel) in row.iter().enumerate() {
                let left = MARGIN + (WIDTH + GAP) * at as f64;
                let edge = self.draw_panel(&mut drawing, panel, [left, upper]);
                below = below.maximum_of(edge + 22.0);
            }
        }
        drawing.end_at(below);
        drawing
    }

    /// The legend with each group's median and size; returns its lower edge.
    fn draw_caption(&self, drawing: &mut Drawing, panel: &HistogramPanel, [left, top]: [f64; 2]) -> f64 {
        let mut y = top;
        for (group, name) in self.groups.iter().enumerate() {
            let values = Self::of(panel, group);
            let median = median(values.iter().copied()).map_or("-".to_owned(), median_label);
            let caption = format!("{name}: median {median} of {}", values.len());
            let text = TextLine::new(caption, [left + 18.0, 0.0]).small().within(WIDTH - 18.0).below(y);
            y = text.extent().bottom + LINE - 12.0;
            let middle = text.extent().top + 6.0;
            drawing.key(name, |drawing| {
                drawing.text(text);
                if values.len() < FEW {
                    drawing.disc([left + 6.0, middle], 3.0, Fill::solid(colour(group)));
                } else if group == 0 {
                    drawing.rectangle(Extent::new(left, middle - 4.5, left + 12.0, middle + 4.5), filled(group));
                } else {
                    drawing.line([[left, middle], [left + 12.0, middle]], Stroke::new(colour(group), 2.0));
                }
            });
        }
        y
    }

    /// The single values of small groups, the histograms of the others below, and the axis; returns its lower edge.
    fn draw_panel(&self, drawing: &mut Drawing, panel: &HistogramPanel, [left, top]: [f64; 2]) -> f64 {
        let groups: Vec<(usize, Vec<f64>)> = (0..self.groups.len()).map(|at| (at, Self::of(panel, at))).collect();
        let x = Scale::around(groups.iter().flat_map(|(_, values)| values.iter().copied()), 0.02);
        let (few, many): (Vec<_>, Vec<_>) = groups.iter().partition(|(_, values)| values.len() < FEW);
        let shares: Vec<(usize, [f64; COLUMNS])> = many.iter().map(|(at, values)| (*at, shares(values, x))).collect();
        let upper = top + STRIP * self.groups.len() as f64;
        let axes = Axes {
            inside: Extent::new(left, upper, left + WIDTH, upper + HEIGHT),
            x,
            y: Scale::from_zero(shares.iter().flat_map(|(_, shares)| shares.iter().copied())),
        };
        for (row, (group, values)) in few.iter().enumerate() {
            let y = top + STRIP * (row as f64 + 0.5);
            drawing.data(&self.groups[*group], |drawing| {
                for value in values {
                    drawing.disc([axes.x_of(*value), y], 3.0, Fill::faint(colour(*group), 0.7));
                }
            });
        }
        for (group, shares) in &shares {
            drawing.data(&self.groups[*group], |drawing| match group {
                0 => drawing.area(steps(shares, axes), filled(*group)),
                _ => drawing.line(steps(shares, axes), Stroke::new(colour(*group), 2.0)),
            });
        }
        axes.draw_x_at(drawing, &AxisText { title: &panel.measure, label: &label }, &x.ticks(4))
    }

    /// The finite values of a group.
    fn of(panel: &HistogramPanel, group: usize) -> Vec<f64> {
        panel.values.get(group).map_or_else(Vec::new, |values| finite(values))
    }
}

fn filled(group: usize) -> Fill {
    Fill::faint(colour(group), 0.45)
}

/// The fraction of the values in each column of equal width.
fn shares(values: &[f64], scale: Scale) -> [f64; COLUMNS] {
    let mut shares = [0.0; COLUMNS];
    let finite = finite(values);
    for value in &finite {
        shares[scale.column(*value, COLUMNS)] += 1.0 / finite.len() as f64;
    }
    shares
}

/// The outline of the columns, starting and ending at the base.
fn steps(shares: &[f64; COLUMNS], axes: Axes) -> Vec<[f64; 2]> {
    let Extent { left, bottom, .. } = axes.inside;
    let width = axes.inside.width() / COLUMNS as f64;
    let mut corners = vec![[left, bottom]];
    for (column, share) in shares.iter().enumerate() {
        let y = axes.y_of(*share);
        corners.extend([[left + width * column as f64, y], [left + width * (column + 1) as f64, y]]);
    }
    corners.push([axes.inside.right, bottom]);
    corners
}

fn finite(values: &[f64]) -> Vec<f64> {
    values.iter().copied().filter(|value| value.is_finite()).collect()
}

fn median_label(value: f64) -> String {
    with_minus_sign(&to_three_digits(value))
}

#[cfg(test)]
mod tests {
    use atsplat_numeric::Tolerance;

    use super::*;

    #[test]
    fn shares_of_a_group_sum_to_one_without_nan() {
        let shares = shares(&[0.0, 0.1, 13.0, 14.0, f64::NAN], Scale::linear(0.0, 14.0));
        Tolerance::F64.assert([shares[0], shares[13], shares.iter().sum()], [0.5, 0.5, 1.0], "shares");
        let medians = [0.0471, 0.59, -5.82, 15.243, 178.0];
        assert_eq!(medians.map(median_label), ["0.047", "0.590", "−5.82", "15.2", "178"]);
    }
}
