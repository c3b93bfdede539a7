use super::shape::{Drawing, Extent, Side, Stroke, TextLine};
use super::theme::GREY;

/// Places labels next to marks so that none covers a mark or another label.
#[derive(Debug)]
pub(super) struct Labels {
    bounds: Extent,
    taken: Vec<Extent>,
}

const GAPS: [f64; 5] = [11.0, 17.0, 28.0, 44.0, 64.0];
/// A label farther than this from its mark gets a connecting line.
const NEAR: f64 = 17.0;

impl Labels {
    pub(super) const fn new(bounds: Extent) -> Self {
        Self { bounds, taken: Vec::new() }
    }

    /// Keeps labels off a mark.
    pub(super) fn avoid(&mut self, [x, y]: [f64; 2], radius: f64) {
        self.taken.push(Extent::new(x - radius, y - radius, x + radius, y + radius));
    }

    /// Keeps labels off a line, in steps of a few pixels.
    pub(super) fn avoid_line(&mut self, points: &[[f64; 2]]) {
        for pair in points.windows(2) {
            let (from, to) = (pair[0], pair[1]);
            let steps = ((to[0] - from[0]).hypot(to[1] - from[1]) / 8.0).ceil().clamp(1.0, 500.0);
            let mut step = 0.0;
            while step <= steps {
                let share = step / steps;
                self.avoid([from[0] + share * (to[0] - from[0]), from[1] + share * (to[1] - from[1])], 2.0);
                step += 1.0;
            }
        }
    }

    /// Keeps labels off another text.
    pub(super) fn avoid_text(&mut self, text: &TextLine) {
        self.taken.push(text.extent());
    }

    /// Draws a label as near to its mark as there is room; its position and side are replaced.
    #[expect(clippy::needless_pass_by_value, reason = "callers create the label for this call")]
    pub(super) fn place(&mut self, drawing: &mut Drawing, text: TextLine, mark: [f64; 2]) {
        let candidates = GAPS.iter().flat_map(|gap| around(mark, *gap).map(|(at, side)| (*gap, at, side)));
        let placed = candidates.map(|(gap, at, side)| {
            let text = TextLine { at, side, ..text.clone() };
            let extent = text.extent();
            let covered: f64 = self.taken.iter().map(|other| extent.shared(*other)).sum();
            let outside = if self.bounds.contains(extent) { 0.0 } else { 1e6 };
            (covered * 100.0 + outside + gap, gap, text)
        });
        let best = placed.min_by(|a, b| a.0.total_cmp(&b.0));
        let Some((_, gap, text)) = best else { return };
        let extent = text.extent();
        if gap > NEAR {
            let [x, y] = mark;
            let end = [x.clamp(extent.left, extent.right), y.clamp(extent.top, extent.bottom)];
            drawing.line([mark, end], Stroke::new(GREY, 1.0));
        }
        self.taken.push(extent);
        drawing.text(text);
    }
}

/// Eight positions around a mark, in order of preference.
fn around([x, y]: [f64; 2], gap: f64) -> [([f64; 2], Side); 8] {
    let slanted = 0.75 * gap;
    [
        ([x + gap, y], Side::Left),
        ([x, y - gap - 5.0], Side::Middle),
        ([x, y + gap + 5.0], Side::Middle),
        ([x - gap, y], Side::Right),
        ([x + slanted, y - slanted - 3.0], Side::Left),
        ([x + slanted, y + slanted + 3.0], Side::Left),
        ([x - slanted, y - slanted - 3.0], Side::Right),
        ([x - slanted, y + slanted + 3.0], Side::Right),
    ]
}

/// Heights of labels at the ends of lines: at least `gap` apart, near `wanted`, and inside `low..high` if there is room; in
/// the order of `wanted`.
pub(super) fn spread(wanted: &[f64], gap: f64, low: f64, high: f64) -> Vec<f64> {
    let mut order: Vec<usize> = (0..wanted.len()).collect();
    order.sort_by(|a, b| wanted[*a].total_cmp(&wanted[*b]));
    let mut placed = wanted.to_vec();
    let mut least = low;
    for &at in &order {
        placed[at] = if placed[at] > least { placed[at] } else { least };
        least = placed[at] + gap;
    }
    let mut most = high;
    for &at in order.iter().rev() {
        placed[at] = if placed[at] < most { placed[at] } else { most };
        most = placed[at] - gap;
    }
    placed
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_of_the_same_mark_do_not_overlap() {
        let bounds = Extent::new(0.0, 0.0, 400.0, 300.0);
        let (mut labels, mut drawing) = (Labels::new(bounds), Drawing::new(400, 300));
        for name in ["one", "two", "three", "four", "five", "six"] {
            labels.place(&mut drawing, TextLine::new(name, [0.0, 0.0]), [200.0, 150.0]);
        }
        for (at, extent) in labels.taken.iter().enumerate() {
            assert!(bounds.contains(*extent));
            assert!(labels.taken[at + 1..].iter().all(|other| extent.shared(*other) == 0.0), "{extent:?}");
        }
    }

    #[test]
    fn spreading_keeps_order_and_distance() {
        let placed = spread(&[50.0, 10.0, 12.0, 49.0], 15.0, 0.0, 60.0);
        assert_eq!(placed, [60.0, 10.0, 25.0, 45.0]);
        assert_eq!(spread(&[], 15.0, 0.0, 60.0), Vec::<f64>::new());
    }
}
