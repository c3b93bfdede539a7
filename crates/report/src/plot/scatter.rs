use atsplat_numeric::Extremes as _;

use super::drawing::axes::Axes;
use super::drawing::labels::Labels;
use super::drawing::scale::Scale;
use super::drawing::series::{QualityMetric, note, number_axis};
use super::drawing::shape::{Drawing, Extent, Fill, MARGIN, Role, Side, Stroke, TextLine};
use super::drawing::theme::{COLOURS, GREY, INK};

/// A method against each of several others, scene by scene: a small panel for each.
#[derive(Clone, Debug)]
pub struct SceneScatter {
    /// Title.
    pub title: String,
    /// Protocol, data, scenes.
    pub subtitle: String,
    /// The metric.
    pub quality: QualityMetric,
    /// Name of the method on the y axes.
    pub y: String,
    /// A panel for each other method.
    pub panels: Vec<ScatterPanel>,
    /// How many of the scenes farthest from the diagonal are labelled in each panel.
    pub named: usize,
}

/// Another method.
#[derive(Clone, Debug)]
pub struct ScatterPanel {
    /// Its name, on the x axis.
    pub x: String,
    /// The paired difference and its interval.
    pub difference: String,
    /// A point per scene.
    pub points: Vec<ScatterPoint>,
}

/// A scene.
#[derive(Clone, Debug)]
pub struct ScatterPoint {
    /// Its key.
    pub scene: String,
    /// The metric of the method on the x axis.
    pub x: f64,
    /// The metric of the method on the y axis.
    pub y: f64,
}

const ACROSS: usize = 3;
const SIDE: f64 = 290.0;
const PITCH: f64 = SIDE + 62.0;
const LEFT: f64 = 64.0;
/// A scene in which the method on the y axis is better, worse, or equal.
const KINDS: [(&str, plotters::style::RGBColor); 3] = [("better", COLOURS[0]), ("worse", COLOURS[1]), ("equal", GREY)];

impl SceneScatter {
    /// Draws it, with the same scale on both axes of a panel.
    pub fn draw(&self) -> Drawing {
        let across = self.panels.len().clamp(1, ACROSS) as f64;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most three panels")]
        let width = (LEFT + PITCH * across).clamp(480.0, 2000.0) as u32;
        let (mut drawing, head) = Drawing::titled(width, &self.title, &self.subtitle);
        let points = || self.panels.iter().flat_map(|panel| &panel.points);
        let names: Vec<String> = KINDS.iter().map(|(kind, _)| format!("{} {kind}", self.y)).collect();
        let used: Vec<usize> =
            (0..KINDS.len()).filter(|kind| points().any(|point| self.kind(point) == *kind)).collect();
        let legend: Vec<&str> = used.iter().map(|kind| names[*kind].as_str()).collect();
        let mut below = drawing.legend(MARGIN, head + 12.0, &legend, |drawing, at, place| {
            drawing.disc(place, 4.0, Fill::solid(KINDS[used[at]].1));
        });
        for row in self.panels.chunks(ACROSS) {
            let captions: Vec<TextLine> = row.iter().enumerate().map(|(at, panel)| caption(panel, at, below)).collect();
            let head = captions.iter().map(|text| text.extent().bottom).fold(below, f64::maximum_of);
            for text in captions {
                drawing.text(text);
            }
            let top =
                head + 22.0 + TextLine::new(self.title_of(&self.y), [0.0; 2]).small().within(SIDE + 40.0).height();
            for (at, panel) in row.iter().enumerate() {
                let left = LEFT + PITCH * at as f64;
                let edge =
                    self.draw_panel(&mut drawing, panel, Extent::new(left, top, left + SIDE, top + SIDE), &names);
                below = below.maximum_of(edge);
            }
        }
        let side = if self.quality.better(1.0, 0.0) { "Above" } else { "Below" };
        let bottom = note(&mut drawing, below, &format!("{side} the diagonal, {} is better.", self.y));
        drawing.end_at(bottom + 14.0);
        drawing
    }

    /// The title of a method's axis.
    fn title_of(&self, method: &str) -> String {
        format!("{} of {method}", self.quality.name_with_unit())
    }

    /// Position in [`KINDS`].
    fn kind(&self, point: &ScatterPoint) -> usize {
        if point.x.total_cmp(&point.y).is_eq() { 2 } else { usize::from(!self.quality.better(point.y, point.x)) }
    }

    fn draw_panel(&self, drawing: &mut Drawing, panel: &ScatterPanel, inside: Extent, names: &[String]) -> f64 {
        let scale = Scale::around(panel.points.iter().flat_map(|point| [point.x, point.y]), 0.05);
        let axes = Axes { inside, x: scale, y: scale };
        axes.draw_y(drawing, &number_axis(&self.title_of(&self.y)));
        // The same ticks as on the y axis: readers compare the two.
        let bottom = axes.draw_x_at(drawing, &number_axis(&self.title_of(&panel.x)), &axes.y_ticks());
        let diagonal = [scale.low(), scale.high()].map(|value| axes.place(value, value));
        drawing.with(Role::Frame, |drawing| drawing.line(diagonal, Stroke::new(GREY, 1.5)));
        let mut labels = Labels::new(Extent { bottom: inside.bottom - 2.0, ..inside });
        labels.divide(diagonal);
        for point in &panel.points {
            let (kind, place) = (self.kind(point), axes.place(point.x, point.y));
            drawing.data(&names[kind], |drawing| drawing.disc(place, 3.5, Fill::faint(KINDS[kind].1, 0.75)));
            labels.avoid(place, 4.0);
        }
        let mut order: Vec<&ScatterPoint> = panel.points.iter().filter(|point| self.kind(point) < 2).collect();
        order.sort_by(|a, b| (b.x - b.y).abs().total_cmp(&(a.x - a.y).abs()).then_with(|| a.scene.cmp(&b.scene)));
        for point in order.into_iter().take(self.named) {
            let text = TextLine::new(&*point.scene, [0.0, 0.0]).small().muted().within(130.0);
            labels.place_if_free(drawing, &text, axes.place(point.x, point.y));
        }
        bottom
    }
}

/// The difference, and how many scenes are better and worse.
fn caption(panel: &ScatterPanel, at: usize, top: f64) -> TextLine {
    let text = TextLine::new(&*panel.difference, [LEFT + PITCH * at as f64, 0.0]).small().side(Side::Left);
    TextLine { colour: INK, ..text }.within(SIDE).below(top + 14.0)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use atsplat_metrics::definition;

    use super::super::drawing::shape::Shape;
    use super::*;

    fn plot(metric: &str) -> Drawing {
        let points = [(17.0, 18.0), (29.0, 26.0)].map(|(x, y)| ScatterPoint { scene: "room".to_owned(), x, y });
        let panel = ScatterPanel { x: "b".to_owned(), difference: String::new(), points: points.to_vec() };
        SceneScatter {
            title: "Scene by scene".to_owned(),
            subtitle: "RealEstate10K, 2 scenes".to_owned(),
            quality: definition(metric).unwrap().into(),
            y: "a".to_owned(),
            panels: vec![panel],
            named: 0,
        }
        .draw()
    }

    #[test]
    fn both_axes_have_the_same_ticks() {
        let mut ticks: BTreeMap<u32, Vec<String>> = BTreeMap::new();
        for item in &plot("psnr").items {
            if let (Role::Tick(axis), Shape::Text(text)) = (&item.role, &item.shape) {
                ticks.entry(*axis).or_default().push(text.text.clone());
            }
        }
        let of_axes: Vec<Vec<String>> = ticks.into_values().collect();
        assert_eq!(of_axes, [["18", "20", "22", "24", "26", "28"]; 2]);
    }

    #[test]
    fn the_better_side_of_the_diagonal_is_that_of_the_metric() {
        let says = |metric: &str, text: &str| plot(metric).texts().any(|said| said == text);
        assert!(says("psnr", "Above the diagonal, a is better."));
        assert!(says("lpips", "Below the diagonal, a is better."));
    }
}
