use atsplat_numeric::Extremes as _;
use plotters::style::RGBColor;

use super::drawing::axes::Axes;
use super::drawing::scale::Scale;
use super::drawing::series::{Estimate, QualityMetric, bars, level_whisker, note, number_axis, sentences};
use super::drawing::shape::{Drawing, Extent, Fill, MARGIN, Role, Side, Stroke, TextLine};
use super::drawing::theme::{COLOURS, GREY, INK};
use crate::numbers::{signed, with_minus_sign};

/// The cost of each change relative to the full method, measured next to published: differences are comparable even if
/// absolute values are not.
#[derive(Clone, Debug)]
pub struct Ablation {
    /// Title.
    pub title: String,
    /// Protocol, scenes.
    pub subtitle: String,
    /// The metric.
    pub quality: QualityMetric,
    /// The full method, to which every bar shows the difference.
    pub reference: AblationRow,
    /// The variants.
    pub rows: Vec<AblationRow>,
    /// Below the plot, after the meaning of its lines.
    pub note: String,
}

/// A variant.
#[derive(Clone, Debug)]
pub struct AblationRow {
    /// Its name.
    pub label: String,
    /// The paper's number, or its text as an error, such as "Diverged".
    pub published: Option<Result<f64, String>>,
    /// The measured mean.
    pub measured: Option<f64>,
    /// Variant minus reference over the same scenes.
    pub gap: Option<Estimate>,
}

impl Ablation {
    /// Draws it.
    pub fn draw(&self) -> Drawing {
        const ROW: f64 = 58.0;
        let (mut drawing, head) = Drawing::titled(900, &self.title, &self.subtitle);
        let full = match &self.reference.published {
            Some(Ok(value)) => Some(*value),
            _ => None,
        };
        let with = |name: &str, value: Option<f64>| {
            value.map_or_else(|| name.to_owned(), |value| format!("{name}; full method {}", self.quality.print(value)))
        };
        let names = [with("measured", self.reference.measured), with("published", full)];
        let legend: Vec<&str> = names.iter().map(String::as_str).collect();
        let bottom = drawing.legend(MARGIN, head + 12.0, &legend, |drawing, at, place| {
            drawing.swatch(place, Fill::solid(BARS[at]));
        });
        let published_gap = |row: &AblationRow| match (&row.published, full) {
            (Some(Ok(value)), Some(full)) => Some(value - full),
            _ => None,
        };
        let gaps = self
            .rows
            .iter()
            .flat_map(|row| published_gap(row).into_iter().chain(row.gap.iter().flat_map(|gap| gap.extent())));
        let label = |row: &AblationRow| TextLine::new(&*row.label, [0.0; 2]).side(Side::Right).within(214.0);
        let heights: Vec<f64> = self.rows.iter().map(|row| (label(row).height() + 14.0).maximum_of(ROW)).collect();
        let top = bottom + 30.0;
        let axes = Axes {
            inside: Extent::new(250.0, top, 700.0, top + heights.iter().sum::<f64>()),
            x: Scale::around(gaps.chain([0.0]), 0.06),
            y: Scale::linear(0.0, 1.0),
        };
        let Extent { left, right, .. } = axes.inside;
        axes.draw_x_grid(&mut drawing, &axes.x_ticks());
        let title = format!("{}: difference to “{}”", self.quality.name_with_unit(), self.reference.label);
        let below = axes.draw_x(&mut drawing, &number_axis(&title));
        drawing.text(TextLine::new("value (difference)", [right + 16.0, top - 12.0]).small().muted());
        let mut upper = top;
        for (row, height) in self.rows.iter().zip(heights) {
            let middle = upper + height / 2.0;
            upper += height;
            drawing.text(TextLine { at: [left - 14.0, middle], ..label(row) });
            let values = [row.gap, published_gap(row).map(Estimate::exact)];
            for (at, (gap, y)) in values.into_iter().zip([middle - 10.0, middle + 10.0]).enumerate() {
                if let Some(gap) = gap {
                    drawing.data(&names[at], |drawing| bar(drawing, &axes, gap.value, y, BARS[at]));
                    drawing.with(Role::Frame, |drawing| interval(drawing, &axes, gap, y));
                }
                let numbers = |value: f64| match gap {
                    Some(gap) => format!("{} ({})", self.quality.print(value), change(self.quality, gap.value)),
                    None => self.quality.print(value),
                };
                let text = match (at, &row.published) {
                    (0, _) => Some(row.measured.map_or_else(|| "not measured".to_owned(), numbers)),
                    (_, Some(Ok(value))) => Some(numbers(*value)),
                    (_, Some(Err(text))) => Some(text.clone()),
                    (_, None) => None,
                };
                if let Some(text) = text {
                    let text = TextLine::new(text, [right + 16.0, y]).small();
                    drawing.text(if at == 0 { text } else { text.muted() });
                }
            }
        }
        let zero = axes.x_of(0.0);
        let line = [[zero, axes.inside.top], [zero, axes.inside.bottom]];
        drawing.with(Role::Frame, |drawing| drawing.line(line, Stroke::new(INK, 1.5)));
        let intervals = bars("Lines at the bars", self.rows.iter().filter_map(|row| row.gap.as_ref()), false);
        let bottom = note(&mut drawing, below, &sentences([&*intervals, &*self.note]));
        drawing.end_at(bottom + 14.0);
        drawing
    }
}

/// Colours of measured and published bars.
const BARS: [RGBColor; 2] = [COLOURS[0], GREY];

fn bar(drawing: &mut Drawing, axes: &Axes, gap: f64, y: f64, colour: RGBColor) {
    let (from, to) = (axes.x_of(0.0), axes.x_of(gap));
    let (from, to) = if from < to { (from, to) } else { (to, from) };
    drawing.rectangle(Extent::new(from, y - 8.0, to, y + 8.0), Fill::solid(colour));
}

fn interval(drawing: &mut Drawing, axes: &Axes, gap: Estimate, y: f64) {
    let Some(ends) = gap.interval else { return };
    level_whisker(drawing, y, ends.map(|value| axes.x_of(value)), Stroke::new(INK, 1.5));
}

fn change(quality: QualityMetric, gap: f64) -> String {
    with_minus_sign(&signed(gap, quality.decimals))
}

#[cfg(test)]
mod tests {
    use atsplat_metrics::definition;

    use super::*;

    #[test]
    fn a_difference_that_prints_as_zero_has_no_sign() {
        let psnr: QualityMetric = definition("psnr").unwrap().into();
        assert_eq!([-0.004, 0.004, -0.006, 0.126].map(|gap| change(psnr, gap)), ["0.00", "0.00", "−0.01", "+0.13"]);
    }
}
