use atsplat_numeric::Extremes as _;

use super::shape::{Drawing, Extent, Role, Side, Stroke, TextLine};
use super::theme::GREY;

/// Places labels next to marks so that none covers a mark or another label.
#[derive(Debug)]
pub(in crate::plot) struct Labels {
    bounds: Extent,
    /// Marks and labels.
    taken: Vec<Extent>,
    /// Pieces of lines, which a connection may cross but no label.
    lines: Vec<Extent>,
    /// Lines that a connection crosses only where there is no other room.
    walls: Vec<[[f64; 2]; 2]>,
}

const GAPS: [f64; 10] = [11.0, 17.0, 28.0, 44.0, 64.0, 90.0, 120.0, 150.0, 190.0, 240.0];
/// Square pixels that a label may cover.
const FREE: f64 = 0.5;
/// A label farther than this from its mark gets a connecting line.
const NEAR: f64 = 17.0;
/// As how many pixels of distance a connection counts that crosses a wall.
const WALL: f64 = 1000.0;

impl Labels {
    pub(in crate::plot) const fn new(bounds: Extent) -> Self {
        Self { bounds, taken: Vec::new(), lines: Vec::new(), walls: Vec::new() }
    }

    /// Keeps labels off a mark.
    pub(in crate::plot) fn avoid(&mut self, [x, y]: [f64; 2], radius: f64) {
        self.taken.push(Extent::new(x - radius, y - radius, x + radius, y + radius));
    }

    /// Keeps labels off a line, in steps of a few pixels.
    pub(in crate::plot) fn avoid_line(&mut self, points: &[[f64; 2]]) {
        for pair in points.windows(2) {
            let (from, to) = (pair[0], pair[1]);
            let steps = ((to[0] - from[0]).hypot(to[1] - from[1]) / 3.0).ceil().clamp(1.0, 1000.0);
            let mut step = 0.0;
            while step <= steps {
                let share = step / steps;
                let [x, y] = [0, 1].map(|axis| from[axis] + share * (to[axis] - from[axis]));
                self.lines.push(Extent::new(x - 2.0, y - 2.0, x + 2.0, y + 2.0));
                step += 1.0;
            }
        }
    }

    /// Keeps labels off a straight line, and on the side of their marks where there is room: a connection across it looks like another
    /// line of the plot.
    pub(in crate::plot) fn divide(&mut self, line: [[f64; 2]; 2]) {
        self.avoid_line(&line);
        self.walls.push(line);
    }

    /// Draws a label as near to its mark as there is room; its position and side are replaced. A far label is connected to
    /// its mark by a line, which keeps off other labels too.
    pub(in crate::plot) fn place(&mut self, drawing: &mut Drawing, text: &TextLine, mark: [f64; 2]) {
        let (_, placed) = self.best(text, mark, 0.0);
        self.draw(drawing, placed, mark);
    }

    /// Like [`Self::place`], unless the label would cover something; returns whether it is drawn.
    pub(in crate::plot) fn place_if_free(&mut self, drawing: &mut Drawing, text: &TextLine, mark: [f64; 2]) -> bool {
        self.place_apart_if_free(drawing, text, mark, 0.0)
    }

    /// The same with at least this distance from what is to its left and right: two numbers side by side would read as one.
    pub(in crate::plot) fn place_apart_if_free(
        &mut self,
        drawing: &mut Drawing,
        text: &TextLine,
        mark: [f64; 2],
        apart: f64,
    ) -> bool {
        let (covered, placed) = self.best(text, mark, apart);
        let is_free = covered < FREE;
        if is_free {
            self.draw(drawing, placed, mark);
        }
        is_free
    }

    /// The nearest place where a label, made wider by `apart` on both sides, covers least: how much it covers there, its distance, and
    /// the label.
    fn best(&self, text: &TextLine, mark: [f64; 2], apart: f64) -> (f64, (f64, TextLine)) {
        let half = text.height() / 2.0;
        let candidates = GAPS.iter().flat_map(|gap| around(mark, *gap, half).map(|(at, side)| (*gap, at, side)));
        let placed = candidates.map(|(gap, at, side)| {
            let text = TextLine { at, side, ..text.clone() };
            let extent = text.extent();
            let wide = Extent { left: extent.left - apart, right: extent.right + apart, ..extent };
            let covered: f64 = self.taken.iter().chain(&self.lines).map(|other| wide.shared(*other)).sum();
            let line = connection(mark, extent);
            let is_connected = gap > NEAR;
            let crossed = if is_connected { self.crossed(line) } else { 0.0 };
            let outside = if self.bounds.contains(extent) { 0.0 } else { 1e4 };
            let is_across = is_connected && self.walls.iter().any(|wall| intersect(line, *wall));
            (covered + crossed + outside, (if is_across { gap + WALL } else { gap }, text))
        });
        let cost = |(covered, (gap, _)): &(f64, (f64, TextLine))| covered * 100.0 + gap;
        let best = placed.min_by(|a, b| cost(a).total_cmp(&cost(b)));
        best.unwrap_or_else(|| (f64::INFINITY, (0.0, text.clone())))
    }

    fn draw(&mut self, drawing: &mut Drawing, (gap, text): (f64, TextLine), mark: [f64; 2]) {
        let extent = text.extent();
        self.taken.push(extent);
        if gap > NEAR {
            let line = connection(mark, extent);
            drawing.with(Role::Frame, |drawing| drawing.line(line, Stroke::new(GREY, 1.0)));
            self.avoid_line(&line);
        }
        drawing.text(text);
    }

    /// How much of a line is over what is taken, apart from the mark where it begins.
    fn crossed(&self, [from, to]: [[f64; 2]; 2]) -> f64 {
        // The mark itself is within 18 pixels of its middle.
        let mark = (18.0 / (to[0] - from[0]).hypot(to[1] - from[1])).clamp(0.0, 1.0);
        let step = |at: u32| {
            let share = mark + (0.98 - mark) * f64::from(at) / 48.0;
            let [x, y] = [0, 1].map(|axis| from[axis] + share * (to[axis] - from[axis]));
            let place = Extent::new(x - 1.5, y - 1.5, x + 1.5, y + 1.5);
            self.taken.iter().map(|other| place.shared(*other)).sum::<f64>()
        };
        (0..=48).map(step).sum()
    }
}

/// Whether two pieces of lines cross.
fn intersect(one: [[f64; 2]; 2], other: [[f64; 2]; 2]) -> bool {
    let side = |[from, to]: [[f64; 2]; 2], [x, y]: [f64; 2]| {
        (to[0] - from[0]) * (y - from[1]) - (to[1] - from[1]) * (x - from[0])
    };
    let parts = |line: [[f64; 2]; 2], ends: [[f64; 2]; 2]| side(line, ends[0]) * side(line, ends[1]) < 0.0;
    parts(one, other) && parts(other, one)
}

/// From a mark to the nearest place of a label.
fn connection([x, y]: [f64; 2], label: Extent) -> [[f64; 2]; 2] {
    [[x, y], [x.clamp(label.left, label.right), y.clamp(label.top, label.bottom)]]
}

/// Positions around a mark for a label of this half height, in order of preference.
fn around([x, y]: [f64; 2], gap: f64, half: f64) -> [([f64; 2], Side); 12] {
    let slanted = 0.75 * gap;
    let (above, below) = (y - gap - half + 2.0, y + gap + half - 2.0);
    [
        ([x + gap, y], Side::Left),
        ([x, above], Side::Middle),
        ([x, below], Side::Middle),
        ([x - gap, y], Side::Right),
        ([x + slanted, above + gap - slanted + 2.0], Side::Left),
        ([x + slanted, below - gap + slanted - 2.0], Side::Left),
        ([x - slanted, above + gap - slanted + 2.0], Side::Right),
        ([x - slanted, below - gap + slanted - 2.0], Side::Right),
        ([x + gap, y - slanted / 2.0 - half], Side::Left),
        ([x + gap, y + slanted / 2.0 + half], Side::Left),
        ([x - gap, y - slanted / 2.0 - half], Side::Right),
        ([x - gap, y + slanted / 2.0 + half], Side::Right),
    ]
}

/// The middles of labels, given the wanted middle and the height of each: without overlap, near the wanted places, and
/// inside `low..high` if there is room; in the order of `wanted`.
pub(in crate::plot) fn spread(wanted: &[(f64, f64)], low: f64, high: f64) -> Vec<f64> {
    let mut order: Vec<usize> = (0..wanted.len()).collect();
    order.sort_by(|a, b| wanted[*a].0.total_cmp(&wanted[*b].0));
    let mut placed: Vec<f64> = wanted.iter().map(|(middle, _)| *middle).collect();
    let mut least = low;
    for &at in &order {
        let half = wanted[at].1 / 2.0;
        placed[at] = placed[at].maximum_of(least + half);
        least = placed[at] + half;
    }
    let mut most = high;
    for &at in order.iter().rev() {
        let half = wanted[at].1 / 2.0;
        placed[at] = placed[at].minimum_of(most - half);
        most = placed[at] - half;
    }
    placed
}

/// Names above a plot, each over the middle of its part, moved sideways where they would touch.
pub(in crate::plot) fn names_above(drawing: &mut Drawing, y: f64, parts: &[(String, [f64; 2])], [low, high]: [f64; 2]) {
    let text = |name: &str, x: f64| TextLine::new(name, [x, y]).small().muted().side(Side::Middle);
    let wanted: Vec<(f64, f64)> = parts
        .iter()
        .map(|(name, [from, to])| (f64::midpoint(*from, *to), text(name, 0.0).extent().width() + 8.0))
        .collect();
    for ((name, _), x) in parts.iter().zip(spread(&wanted, low, high)) {
        drawing.text(text(name, x));
    }
}

#[cfg(test)]
mod tests {
    use super::super::shape::Shape;
    use super::*;

    /// The first number is to the right of its mark, and the second mark is there.
    #[test]
    fn numbers_side_by_side_keep_apart() {
        let between = |apart| {
            let mut drawing = Drawing::new(200, 40);
            let mut labels = Labels::new(Extent::new(0.0, 0.0, 200.0, 40.0));
            let [first, second] = ["3", "1"].map(|text| TextLine::new(text, [0.0, 0.0]).small());
            let end = 61.0 + first.extent().width();
            for (text, mark) in [(first, [50.0, 20.0]), (second, [end - 10.0, 20.0])] {
                assert!(labels.place_apart_if_free(&mut drawing, &text, mark, apart));
            }
            let texts = drawing.items.iter().filter_map(|item| match &item.shape {
                Shape::Text(text) => Some(text.extent()),
                _ => None,
            });
            let texts: Vec<Extent> = texts.collect();
            (texts[1].left - texts[0].right).maximum_of(texts[0].left - texts[1].right)
        };
        let [touching, apart] = [0.0, 4.0].map(between);
        assert!(touching < 4.0 && apart >= 4.0, "{touching} and {apart}");
    }

    #[test]
    fn labels_of_the_same_mark_do_not_overlap() {
        let bounds = Extent::new(0.0, 0.0, 400.0, 300.0);
        let (mut labels, mut drawing) = (Labels::new(bounds), Drawing::new(400, 300));
        for name in ["one", "two", "three", "four", "five", "six"] {
            labels.place(&mut drawing, &TextLine::new(name, [0.0, 0.0]), [200.0, 150.0]);
        }
        let names: Vec<Extent> = drawing
            .items
            .iter()
            .filter_map(|item| match &item.shape {
                Shape::Text(text) => Some(text.extent()),
                _ => None,
            })
            .collect();
        assert_eq!(names.len(), 6);
        for (at, extent) in names.iter().enumerate() {
            assert!(bounds.contains(*extent));
            assert!(names[at + 1..].iter().all(|other| extent.shared(*other) == 0.0), "{extent:?}");
        }
    }

    /// A mark near a diagonal, with room for its label only farther away: the first such place is beyond the diagonal.
    #[test]
    fn a_connection_stays_on_its_side_of_a_dividing_line() {
        let diagonal = [[0.0, 200.0], [200.0, 0.0]];
        let crosses = |divide: bool| {
            let (mut labels, mut drawing) = (Labels::new(Extent::new(0.0, 0.0, 200.0, 200.0)), Drawing::new(200, 200));
            if divide {
                labels.divide(diagonal);
            } else {
                labels.avoid_line(&diagonal);
            }
            let mark = [90.0, 100.0];
            for radius in [12.0, 17.0, 22.0, 27.0, 32.0, 37.0] {
                let corners = [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0]];
                labels.avoid_line(&corners.map(|[x, y]| [mark[0] + radius * x, mark[1] + radius * y]));
            }
            assert!(labels.place_if_free(&mut drawing, &TextLine::new("a", [0.0, 0.0]), mark));
            let mut lines = drawing.items.iter().filter_map(|item| match &item.shape {
                Shape::Line { points, .. } => Some([points[0], points[1]]),
                _ => None,
            });
            intersect(lines.next().unwrap(), diagonal)
        };
        assert_eq!([false, true].map(crosses), [true, false]);
    }

    #[test]
    fn spreading_keeps_order_and_distance() {
        let placed = spread(&[50.0, 10.0, 12.0, 49.0].map(|middle| (middle, 15.0)), 0.0, 60.0);
        assert_eq!(placed, [52.5, 7.5, 22.5, 37.5]);
        assert_eq!(
            spread(&[(10.0, 30.0), (12.0, 10.0)], 0.0, 90.0),
            [15.0, 35.0],
            "a label of two lines takes more room"
        );
        assert_eq!(spread(&[], 0.0, 60.0), Vec::<f64>::new());
    }
}
