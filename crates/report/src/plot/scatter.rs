use super::axes::Axes;
use super::font::shortened;
use super::labels::Labels;
use super::scale::Scale;
use super::series::{Figure, plain};
use super::shape::{Drawing, Extent, Fill, Side, Stroke, TextLine};
use super::theme::{COLOURS, GREY, MUTED};

/// Two methods scene by scene.
#[derive(Clone, Debug)]
pub struct SceneScatter {
    /// Title.
    pub title: String,
    /// Protocol; the paired difference and its interval.
    pub subtitle: String,
    /// The metric.
    pub quality: Figure,
    /// Name of the method on the x axis.
    pub x: String,
    /// Name of the method on the y axis.
    pub y: String,
    /// A point per scene.
    pub points: Vec<ScatterPoint>,
    /// How many of the scenes farthest from the diagonal are labelled.
    pub named: usize,
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

impl SceneScatter {
    /// Draws it, with the same scale on both axes.
    pub fn draw(&self) -> Drawing {
        let mut drawing = Drawing::new(640, 640);
        drawing.heading(&self.title, &self.subtitle);
        let scale = Scale::around(self.points.iter().flat_map(|point| [point.x, point.y]), 0.05);
        let axes = Axes { inside: Extent::new(72.0, 100.0, 552.0, 580.0), x: scale, y: scale };
        axes.draw_y(
            &mut drawing,
            &plain(&shortened(&format!("{} of {}", self.quality.name, self.y), 12.0, false, 440.0)),
        );
        axes.draw_x(
            &mut drawing,
            &plain(&shortened(&format!("{} of {}", self.quality.name, self.x), 12.5, false, 440.0)),
        );
        let corner = |value: f64| axes.place(value, value);
        drawing.line([corner(scale.low()), corner(scale.high())], Stroke::new(GREY, 1.5));
        let better = |point: &ScatterPoint| self.quality.better(point.y, point.x);
        for point in &self.points {
            let colour = if better(point) { COLOURS[0] } else { COLOURS[1] };
            let colour = if is_tie(point) { GREY } else { colour };
            drawing.disc(axes.place(point.x, point.y), 3.5, Fill::faint(colour, 0.75));
        }
        let (wins, ties) =
            (self.points.iter().filter(|p| better(p)).count(), self.points.iter().filter(|p| is_tie(p)).count());
        let above = self.quality.better(1.0, 0.0);
        let (first, second) =
            if above { (wins, self.points.len() - wins - ties) } else { (self.points.len() - wins - ties, wins) };
        let Extent { left, right, top, bottom } = axes.inside;
        let name = |y: bool| if y == above { &self.y } else { &self.x };
        let caption = |count: usize, name: &str| shortened(&format!("{name} better: {count}"), 12.5, true, 260.0);
        let mut labels = Labels::new(Extent::new(left, top, right + 70.0, bottom - 2.0));
        let upper = TextLine::new(caption(first, name(true)), [left + 12.0, top + 14.0]).size(12.5).bold();
        let lower = TextLine::new(caption(second, name(false)), [right - 4.0, bottom - 16.0])
            .size(12.5)
            .bold()
            .side(Side::Right);
        for text in [upper, lower] {
            labels.avoid_text(&text);
            drawing.text(text);
        }
        labels.avoid_line(&[corner(scale.low()), corner(scale.high())]);
        for point in &self.points {
            labels.avoid(axes.place(point.x, point.y), 4.0);
        }
        let mut order: Vec<&ScatterPoint> = self.points.iter().filter(|point| !is_tie(point)).collect();
        order.sort_by(|a, b| (b.x - b.y).abs().total_cmp(&(a.x - a.y).abs()).then_with(|| a.scene.cmp(&b.scene)));
        for point in order.into_iter().take(self.named) {
            let text = TextLine {
                colour: MUTED,
                ..TextLine::new(shortened(&point.scene, 11.5, false, 130.0), [0.0, 0.0]).size(11.5)
            };
            labels.place(&mut drawing, text, axes.place(point.x, point.y));
        }
        drawing
    }
}

/// Whether both methods have exactly the same score.
fn is_tie(point: &ScatterPoint) -> bool {
    point.x.total_cmp(&point.y).is_eq()
}
