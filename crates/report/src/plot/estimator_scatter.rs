use super::axes::Axes;
use super::font::shortened;
use super::scale::Scale;
use super::series::plain;
use super::shape::{Drawing, Extent, Fill, MARGIN, Side, Stroke, TextLine};
use super::theme::{GREY, GRID, INK, MUTED, colour};

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
const LINE: f64 = 18.0;

impl EstimatorScatter {
    /// Draws it: on the diagonal, estimate and truth are equal; in a tinted square, they fall in the same bin.
    pub fn draw(&self) -> Drawing {
        let top = 96.0 + LINE * (self.kinds.len() as f64 + 1.0);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a few panels, a few lines")]
        let size = ((LEFT + PITCH * self.panels.len() as f64).clamp(640.0, 4000.0) as u32, (top + SIDE + 56.0) as u32);
        let mut drawing = Drawing::new(size.0, size.1);
        drawing.heading(&self.title, &self.subtitle);
        for (at, panel) in self.panels.iter().enumerate() {
            let left = LEFT + PITCH * at as f64;
            let scale = Scale::linear(0.0, 1.0);
            let axes = Axes { inside: Extent::new(left, top, left + SIDE, top + SIDE), x: scale, y: scale };
            self.draw_bins(&mut drawing, axes);
            self.draw_axes(&mut drawing, axes, at == 0);
            for point in interleaved(&panel.points, self.kinds.len()) {
                if (0.0..=1.0).contains(&point.truth) && (0.0..=1.0).contains(&point.estimate) {
                    let fill = Fill::faint(colour(point.kind), 0.6);
                    drawing.disc(axes.place(point.truth, point.estimate), 2.75, fill);
                }
            }
            self.draw_caption(&mut drawing, panel, [left, top]);
        }
        drawing
    }

    /// The edges in both directions, the squares of equal bins, and the bins' names above their columns.
    fn draw_bins(&self, drawing: &mut Drawing, axes: Axes) {
        for (name, pair) in self.bins.iter().zip(self.edges.windows(2)) {
            let (low, high) = (pair[0], pair[1]);
            let ([left, bottom], [right, top]) = (axes.place(low, low), axes.place(high, high));
            drawing.rectangle(Extent::new(left, top, right, bottom), Fill::faint(GRID, 0.6));
            let name = shortened(name, 11.0, false, right - left);
            let place = [f64::midpoint(left, right), axes.inside.top - 9.0];
            drawing.text(TextLine::new(name, place).size(11.0).muted().side(Side::Middle));
        }
        for edge in &self.edges {
            drawing.line([axes.place(*edge, 0.0), axes.place(*edge, 1.0)], Stroke::new(GRID, 1.0));
            drawing.line([axes.place(0.0, *edge), axes.place(1.0, *edge)], Stroke::new(GRID, 1.0));
        }
        drawing.line([axes.place(0.0, 0.0), axes.place(1.0, 1.0)], Stroke::new(GREY, 1.5));
    }

    /// Both axes; the left axis is labelled in the first panel only.
    fn draw_axes(&self, drawing: &mut Drawing, axes: Axes, first: bool) {
        let ticks: Vec<f64> = self.edges.iter().copied().chain([1.0]).collect();
        let Extent { left, top, bottom, .. } = axes.inside;
        axes.draw_x_at(drawing, &plain("true co-visibility"), &ticks);
        drawing.line([[left, top], [left, bottom]], Stroke::new(MUTED, 1.0));
        for tick in &ticks {
            let y = axes.y_of(*tick);
            drawing.line([[left - 5.0, y], [left, y]], Stroke::new(MUTED, 1.0));
            if first {
                let label = super::scale::label(*tick, &ticks);
                drawing.text(TextLine::new(label, [left - 8.0, y]).size(12.0).muted().side(Side::Right));
            }
        }
        if first {
            drawing.text(TextLine::new("estimate", [MARGIN, top - 14.0]).size(12.0).muted());
        }
    }

    /// The estimator's name, and the colour, correlation and number of pairs of each kind.
    fn draw_caption(&self, drawing: &mut Drawing, panel: &EstimatorPanel, [left, top]: [f64; 2]) {
        let first = top - LINE * (self.kinds.len() as f64 + 1.0) - 14.0;
        drawing.text(TextLine::new(shortened(&panel.estimator, 14.0, true, SIDE), [left, first]).size(14.0).bold());
        for (kind, name) in self.kinds.iter().enumerate() {
            let y = first + LINE * (kind as f64 + 1.0);
            let count = panel.points.iter().filter(|point| point.kind == kind).count();
            let rank = panel.rank_correlations.get(kind).copied().flatten();
            let rank = rank.map_or("-".to_owned(), |rank| format!("{rank:.3}").replace('-', "−"));
            drawing.disc([left + 5.0, y], 4.5, Fill::solid(colour(kind)));
            let caption = format!("{name}: rank correlation {rank} of {count} pairs");
            let text = TextLine::new(shortened(&caption, 12.5, false, SIDE - 16.0), [left + 15.0, y]).size(12.5);
            drawing.text(TextLine { colour: INK, ..text });
        }
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
    use super::super::shape::Shape;
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
        let discs = drawing.shapes.iter().filter(|shape| matches!(shape, Shape::Disc { .. })).count();
        assert_eq!(discs, 3 + 2, "three pairs with numbers, two kinds in the caption");
        let texts: Vec<&str> = drawing.texts().collect();
        assert!(texts.contains(&"rooms: rank correlation −0.500 of 2 pairs"), "{texts:?}");
        assert!(texts.contains(&"yards: rank correlation - of 2 pairs"), "{texts:?}");
    }
}
