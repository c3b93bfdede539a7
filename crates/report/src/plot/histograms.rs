use atsplat_numeric::median;

use super::axes::{Axes, AxisText};
use super::font::shortened;
use super::scale::{Scale, label};
use super::shape::{Drawing, Extent, Fill, Stroke, TextLine};
use super::theme::colour;

/// Groups compared by several measures: a small histogram per measure, with the first group filled, the others outlined.
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
const MARGIN: f64 = 24.0;
const TOP: f64 = 68.0;
const LINE: f64 = 16.0;
/// Groups of at most this size also get a mark per value, because a histogram of few values says little.
const FEW: usize = 40;

impl Histograms {
    /// Draws it. Heights are fractions of a group, so that groups of different sizes are comparable.
    pub fn draw(&self) -> Drawing {
        let (across, down) = (self.panels.len().clamp(1, ACROSS), self.panels.len().div_ceil(ACROSS));
        let head = 26.0 + LINE * self.groups.len() as f64;
        let pitch = head + HEIGHT + 40.0;
        let width = 2.0 * MARGIN + (WIDTH + GAP) * across as f64 - GAP;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few panels")]
        let mut drawing = Drawing::new(width.clamp(640.0, 4000.0) as u32, (TOP + 8.0 + pitch * down as f64) as u32);
        drawing.heading(&self.title, &self.subtitle);
        for (at, panel) in self.panels.iter().enumerate() {
            let left = MARGIN + (WIDTH + GAP) * (at % ACROSS) as f64;
            let top = TOP + pitch * (at / ACROSS) as f64;
            self.draw_caption(&mut drawing, panel, [left, top + 10.0]);
            let inside = Extent::new(left, top + head, left + WIDTH, top + head + HEIGHT);
            self.draw_columns(&mut drawing, panel, inside);
        }
        drawing
    }

    /// The measure, and the legend with each group's median.
    fn draw_caption(&self, drawing: &mut Drawing, panel: &HistogramPanel, [left, y]: [f64; 2]) {
        let measure = shortened(&panel.measure, 13.0, true, WIDTH);
        drawing.text(TextLine::new(measure, [left, y]).size(13.0).bold());
        for (group, name) in self.groups.iter().enumerate() {
            let y = y + LINE * (group as f64 + 1.0);
            let values = finite(panel.values.get(group).map_or(&[][..], Vec::as_slice));
            let median = median(values.iter().copied()).map_or("-".to_owned(), three_digits);
            if group == 0 {
                drawing.rectangle(Extent::new(left, y - 4.5, left + 12.0, y + 4.5), filled(group));
            } else {
                drawing.line([[left, y], [left + 12.0, y]], Stroke::new(colour(group), 2.0));
            }
            let caption = shortened(&format!("{name}: median {median}"), 12.0, false, WIDTH - 18.0);
            drawing.text(TextLine::new(caption, [left + 18.0, y]).size(12.0));
        }
    }

    fn draw_columns(&self, drawing: &mut Drawing, panel: &HistogramPanel, inside: Extent) {
        let groups: Vec<&[f64]> = panel.values.iter().take(self.groups.len()).map(Vec::as_slice).collect();
        let x = Scale::around(groups.iter().flat_map(|values| values.iter().copied()), 0.02);
        let shares: Vec<[f64; COLUMNS]> = groups.iter().map(|values| shares(values, x)).collect();
        let axes = Axes { inside, x, y: Scale::from_zero(shares.iter().flatten().copied()) };
        for (group, (shares, values)) in shares.iter().zip(&groups).enumerate() {
            let steps = steps(shares, axes);
            if group == 0 {
                drawing.area(steps, filled(group));
            } else {
                drawing.line(steps, Stroke::new(colour(group), 2.0));
            }
            let few = values.len() <= FEW && group > 0;
            for value in values.iter().filter(|value| few && value.is_finite()) {
                let x = axes.x_of(*value);
                drawing.line([[x, inside.bottom - 8.0], [x, inside.bottom]], Stroke::new(colour(group), 1.5));
            }
        }
        axes.draw_x_at(drawing, &AxisText { title: "", label: &label }, &x.ticks(4));
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
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the columns")]
        let column = (scale.share(*value) * COLUMNS as f64).clamp(0.0, (COLUMNS - 1) as f64) as usize;
        shares[column] += 1.0 / finite.len() as f64;
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

fn three_digits(value: f64) -> String {
    let decimals = match value.abs() {
        size if size >= 99.95 => 0,
        size if size >= 9.995 => 1,
        size if size >= 0.9995 => 2,
        _ => 3,
    };
    format!("{value:.decimals$}").replace('-', "−")
}

#[cfg(test)]
mod tests {
    use atsplat_numeric::Tolerance;

    use super::*;

    #[test]
    fn shares_of_a_group_sum_to_one_without_nan() {
        let shares = shares(&[0.0, 0.1, 13.0, 14.0, f64::NAN], Scale::linear(0.0, 14.0));
        Tolerance::F64.assert([shares[0], shares[13], shares.iter().sum()], [0.5, 0.5, 1.0], "shares");
        assert_eq!([0.0471, 0.4166, 5.82, 15.243, 178.0].map(three_digits), ["0.047", "0.417", "5.82", "15.2", "178"]);
    }
}
