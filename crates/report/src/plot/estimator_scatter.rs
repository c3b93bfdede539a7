use atsplat_numeric::Extremes as _;

use super::drawing::axes::Axes;
use super::drawing::labels::names_above;
use super::drawing::scale::Scale;
use super::drawing::series::number_axis;
use super::drawing::shape::{Drawing, Extent, Fill, Role, Side, Stroke, TextLine};
use super::drawing::theme::{GREY, GRID, MUTED, colour};
use crate::numbers::{fixed, with_minus_sign};

/// Estimates against the truth, both in [0, 1], with a panel per estimator.
#[derive(Clone, Debug)]
pub struct EstimatorScatter {
    /// Title.
    pub title: String,
    /// What was measured, on how many pairs.
    pub subtitle: String,
    /// Kinds of scenes, in the order of their colours.
    pub kinds: Vec<String>,
    /// Names of the bins.
    pub bins: Vec<String>,
    /// Edges of the bins, one more than bins, increasing, in [0, 1].
    pub edges: Vec<f64>,
    /// One per estimator.
    pub panels: Vec<EstimatorPanel>,
}

/// One estimator.
#[derive(Clone, Debug)]
pub struct EstimatorPanel {
    /// Its name.
    pub estimator: String,
    /// A point per pair of views that it could measure.
    pub points: Vec<EstimatePoint>,
    /// Spearman's rank correlation with the truth for each kind.
    pub rank_correlations: Vec<Option<f64>>,
}

/// A pair of views.
#[derive(Clone, Copy, Debug)]
pub struct EstimatePoint {
    /// Position in [`EstimatorScatter::kinds`].
    pub kind: usize,
    /// The true overlap.
    pub truth: f64,
    /// The estimate.
    pub estimate: f64,
}

const SIDE: f64 = 292.0;
const PITCH: f64 = SIDE + 40.0;
const LEFT: f64 = 64.0;

impl EstimatorScatter {
    /// Draws it: on the diagonal, estimate and truth are equal; in a tinted square, they fall in the same bin.
    pub fn draw(&self) -> Drawing {
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few panels")]
        let width = (LEFT + PITCH * self.panels.len() as f64).clamp(640.0, 4000.0) as u32;
        let (mut drawing, head) = Drawing::titled(width, &self.title, &self.subtitle);
        let captions = self
            .panels
            .iter()
            .enumerate()
            .map(|(at, panel)| self.draw_caption(&mut drawing, panel, [LEFT + PITCH * at as f64, head + 16.0]));
        let top = 46.0 + captions.fold(head, f64::maximum_of);
        let mut below = top + SIDE;
        for (at, panel) in self.panels.iter().enumerate() {
            let left = LEFT + PITCH * at as f64;
            let scale = Scale::linear(0.0, 1.0);
            let axes = Axes { inside: Extent::new(left, top, left + SIDE, top + SIDE), x: scale, y: scale };
            self.draw_bins(&mut drawing, axes);
            below = below.maximum_of(self.draw_axes(&mut drawing, axes));
            for point in interleaved(&panel.points, self.kinds.len()) {
                if (0.0..=1.0).contains(&point.truth) && (0.0..=1.0).contains(&point.estimate) {
                    let fill = Fill::faint(colour(point.kind), 0.6);
                    let place = axes.place(point.truth, point.estimate);
                    drawing.data(&self.kinds[point.kind], |drawing| drawing.disc(place, 2.75, fill));
                }
            }
        }
        drawing.end_at(below + 14.0);
        drawing
    }

    /// The edges in both directions, the squares of equal bins, and the bins' names above their columns.
    fn draw_bins(&self, drawing: &mut Drawing, axes: Axes) {
        let mut names = Vec::new();
        for (name, pair) in self.bins.iter().zip(self.edges.windows(2)) {
            let (low, high) = (pair[0], pair[1]);
            let ([left, bottom], [right, top]) = (axes.place(low, low), axes.place(high, high));
            drawing.rectangle(Extent::new(left, top, right, bottom), Fill::faint(GRID, 0.6));
            names.push((name.clone(), [left, right]));
        }
        names_above(drawing, axes.inside.top - 11.0, &names, [axes.inside.left, axes.inside.right]);
        for edge in &self.edges {
            drawing.line([axes.place(*edge, 0.0), axes.place(*edge, 1.0)], Stroke::new(GRID, 1.0));
            drawing.line([axes.place(0.0, *edge), axes.place(1.0, *edge)], Stroke::new(GRID, 1.0));
        }
        drawing.with(Role::Frame, |drawing| {
            drawing.line([axes.place(0.0, 0.0), axes.place(1.0, 1.0)], Stroke::new(GREY, 1.5));
        });
    }

    /// Both axes, with ticks at the edges of the bins; returns the lower edge.
    fn draw_axes(&self, drawing: &mut Drawing, axes: Axes) -> f64 {
        let ticks: Vec<f64> = self.edges.iter().copied().chain([1.0]).collect();
        let Extent { left, top, bottom, .. } = axes.inside;
        let below = axes.draw_x_at(drawing, &number_axis("true co-visibility"), &ticks);
        let stroke = Stroke::new(MUTED, 1.0);
        drawing.with(Role::Frame, |drawing| drawing.line([[left, top], [left, bottom]], stroke));
        let axis = drawing.next_axis();
        for tick in &ticks {
            let y = axes.y_of(*tick);
            drawing.with(Role::Frame, |drawing| drawing.line([[left - 5.0, y], [left, y]], stroke));
            let label = TextLine::new(super::drawing::scale::label(*tick, &ticks), [left - 8.0, y]).small().muted();
            drawing.with(Role::Tick(axis), |drawing| drawing.text(label.side(Side::Right)));
        }
        let title = TextLine::new("estimate", [left - 36.0, top - 28.0]).small().muted();
        drawing.with(Role::Axis(axis), |drawing| drawing.text(title));
        below
    }

    /// The estimator's name, and the colour, correlation and number of pairs of each kind; returns the lower edge.
    fn draw_caption(&self, drawing: &mut Drawing, panel: &EstimatorPanel, [left, top]: [f64; 2]) -> f64 {
        let name = TextLine::new(&*panel.estimator, [left, 0.0]).bold().within(SIDE).below(top);
        let mut y = name.extent().bottom + 6.0;
        drawing.text(name);
        for (kind, name) in self.kinds.iter().enumerate() {
            let count = panel.points.iter().filter(|point| point.kind == kind).count();
            let rank = panel.rank_correlations.get(kind).copied().flatten();
            let rank = rank.map_or("-".to_owned(), |rank| with_minus_sign(&fixed(rank, 3)));
            let caption = format!("{name}: rank correlation {rank} of {count} pairs");
            let text = TextLine::new(caption, [left + 15.0, 0.0]).small().within(SIDE - 16.0).below(y);
            drawing.key(name, |drawing| {
                drawing.disc([left + 5.0, y + 6.0], 4.5, Fill::solid(colour(kind)));
                y = text.extent().bottom + 5.0;
                drawing.text(text);
            });
        }
        y
    }
}

/// The points of all kinds in turns, so that no kind covers another.
fn interleaved(points: &[EstimatePoint], kinds: usize) -> Vec<EstimatePoint> {
    let of_kind = |kind| points.iter().filter(move |point| point.kind == kind).enumerate();
    let mut order: Vec<(usize, EstimatePoint)> =
        (0..kinds).flat_map(of_kind).map(|(turn, point)| (turn, *point)).collect();
    order.sort_by_key(|(turn, point)| (*turn, point.kind));
    order.into_iter().map(|(_, point)| point).collect()
}

#[cfg(test)]
mod tests {
    use super::super::drawing::shape::Shape;
    use super::*;

    #[test]
    fn every_measured_pair_is_one_point_and_kinds_take_turns() {
        let point = |kind, truth, estimate| EstimatePoint { kind, truth, estimate };
        let points = vec![
            point(0, 0.1, 0.2),
            point(0, 0.3, 0.2),
            point(1, 0.5, 1.0),
            point(1, f64::NAN, 0.5),
            point(7, 0.1, 0.1),
        ];
        let turns: Vec<usize> = interleaved(&points, 2).iter().map(|point| point.kind).collect();
        assert_eq!(turns, [0, 1, 0, 1], "a kind without a name has no colour");
        let panel = EstimatorPanel { estimator: "rays".to_owned(), points, rank_correlations: vec![Some(-0.5), None] };
        let scatter = EstimatorScatter {
            title: String::new(),
            subtitle: String::new(),
            kinds: vec!["rooms".to_owned(), "yards".to_owned()],
            bins: vec!["small".to_owned()],
            edges: vec![0.05, 0.3],
            panels: vec![panel],
        };
        let drawing = scatter.draw();
        let discs = drawing.items.iter().filter(|item| matches!(item.shape, Shape::Disc { .. })).count();
        assert_eq!(discs, 3 + 2, "three pairs with numbers, two kinds in the caption");
        let texts: Vec<&str> = drawing.texts().collect();
        assert!(texts.contains(&"rooms: rank correlation −0.500 of 2 pairs"), "{texts:?}");
        assert!(texts.contains(&"yards: rank correlation - of 2 pairs"), "{texts:?}");
    }
}
