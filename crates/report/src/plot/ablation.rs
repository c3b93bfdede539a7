use super::axes::Axes;
use super::font::shortened;
use super::scale::Scale;
use super::series::{Estimate, Figure, plain};
use super::shape::{Drawing, Extent, Fill, Side, Stroke, TextLine};
use super::theme::{COLOURS, GREY, INK, MUTED};

/// The cost of each change relative to the full method, measured next to published: differences are comparable even if
/// absolute values are not.
#[derive(Clone, Debug)]
pub struct Ablation {
    /// Title.
    pub title: String,
    /// Protocol, scenes.
    pub subtitle: String,
    /// The metric.
    pub quality: Figure,
    /// The full method, to which every bar shows the difference.
    pub reference: AblationRow,
    /// The variants.
    pub rows: Vec<AblationRow>,
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
        let height = 150.0 + ROW * self.rows.len() as f64;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few rows")]
        let mut drawing = Drawing::new(900, height as u32);
        drawing.heading(&self.title, &self.subtitle);
        let reference = match &self.reference.published {
            Some(Ok(value)) => Some(*value),
            _ => None,
        };
        let published_gap = |row: &AblationRow| match (&row.published, reference) {
            (Some(Ok(value)), Some(reference)) => Some(value - reference),
            _ => None,
        };
        let gaps = self
            .rows
            .iter()
            .flat_map(|row| published_gap(row).into_iter().chain(row.gap.iter().flat_map(|gap| gap.extent())));
        let axes = Axes {
            inside: Extent::new(250.0, 92.0, 700.0, 92.0 + ROW * self.rows.len() as f64),
            x: Scale::around(gaps.chain([0.0]), 0.06),
            y: Scale::linear(0.0, 1.0),
        };
        let Extent { left, right, top, bottom } = axes.inside;
        for tick in axes.x.ticks(6) {
            drawing.line([[axes.x_of(tick), top], [axes.x_of(tick), bottom]], Stroke::new(super::theme::GRID, 1.0));
        }
        let unit = if self.quality.unit.is_empty() { String::new() } else { format!(" in {}", self.quality.unit) };
        axes.draw_x(
            &mut drawing,
            &plain(&format!("{}{unit}: difference to “{}”", self.quality.name, self.reference.label)),
        );
        self.key(&mut drawing, right);
        for (at, row) in self.rows.iter().enumerate() {
            let middle = top + ROW * (at as f64 + 0.5);
            drawing.text(
                TextLine::new(shortened(&row.label, 13.0, false, left - 36.0), [left - 14.0, middle]).side(Side::Right),
            );
            let bar = |drawing: &mut Drawing, gap: f64, y: f64, colour| {
                let (from, to) = (axes.x_of(0.0), axes.x_of(gap));
                let (from, to) = if from < to { (from, to) } else { (to, from) };
                drawing.rectangle(Extent::new(from, y - 8.0, to, y + 8.0), Fill::solid(colour));
            };
            let (own, paper) = (middle - 10.0, middle + 10.0);
            if let Some(gap) = row.gap {
                bar(&mut drawing, gap.value, own, COLOURS[0]);
                if let Some(interval) = gap.interval {
                    let [low, high] = interval.map(|value| axes.x_of(value));
                    drawing.line([[low, own], [high, own]], Stroke::new(INK, 1.5));
                    for x in [low, high] {
                        drawing.line([[x, own - 4.0], [x, own + 4.0]], Stroke::new(INK, 1.5));
                    }
                }
            }
            if let Some(gap) = published_gap(row) {
                bar(&mut drawing, gap, paper, GREY);
            }
            let print = |value: Option<f64>, gap: Option<f64>| match (value, gap) {
                (Some(value), Some(gap)) => {
                    Some(format!("{} ({})", self.quality.print(value), signed(self.quality, gap)))
                }
                (Some(value), None) => Some(self.quality.print(value)),
                _ => None,
            };
            let measured =
                print(row.measured, row.gap.map(|gap| gap.value)).unwrap_or_else(|| "not measured".to_owned());
            drawing.text(TextLine::new(measured, [right + 16.0, own]).size(12.5));
            let published = match &row.published {
                Some(Ok(value)) => print(Some(*value), published_gap(row)),
                Some(Err(text)) => Some(text.clone()),
                None => None,
            };
            if let Some(published) = published {
                drawing.text(TextLine::new(published, [right + 16.0, paper]).size(12.5).muted());
            }
        }
        drawing.line([[axes.x_of(0.0), top], [axes.x_of(0.0), bottom]], Stroke::new(INK, 1.5));
        drawing
    }

    /// The legend, with the numbers of the reference.
    fn key(&self, drawing: &mut Drawing, right: f64) {
        let own = self.reference.measured.map_or_else(String::new, |value| format!(" {}", self.quality.print(value)));
        let paper = match &self.reference.published {
            Some(Ok(value)) => format!(" {}", self.quality.print(*value)),
            _ => String::new(),
        };
        let mut x = 20.0;
        for (colour, text) in [(COLOURS[0], format!("measured; full{own}")), (GREY, format!("published; full{paper}"))]
        {
            drawing.rectangle(Extent::new(x, 66.0, x + 14.0, 78.0), Fill::solid(colour));
            let text = TextLine::new(text, [x + 20.0, 72.0]).size(12.0);
            x = text.extent().right + 24.0;
            drawing.text(text);
        }
        drawing
            .text(TextLine { colour: MUTED, ..TextLine::new("value (difference)", [right + 16.0, 78.0]).size(12.0) });
    }
}

fn signed(quality: Figure, gap: f64) -> String {
    let sign = if gap < 0.0 { "−" } else { "+" };
    format!("{sign}{}", quality.print(gap.abs()))
}
