use atsplat_numeric::Extremes as _;

use super::super::shape::{Drawing, Extent, Item, Role, Shape};
use super::{FaultKind, PlotFault, Printed, bounds, fault};

/// Square pixels that two texts may share: the corners of their boxes are empty.
const TOUCH: f64 = 2.0;
/// The empty edge of a text's box.
const EMPTY: f64 = 1.5;

/// Texts over other texts, over marks and lines, and over images.
pub(super) fn faults(drawing: &Drawing, texts: &[Printed<'_>]) -> Vec<PlotFault> {
    let mut faults = Vec::new();
    let overprinted = |what: String| fault(FaultKind::Overprinted, what);
    for (at, Printed { line, extent, role }) in texts.iter().enumerate() {
        for other in texts.iter().skip(at + 1).filter(|other| extent.shared(other.extent) >= TOUCH) {
            faults.push(overprinted(format!("“{}” and “{}”", line.text, other.line.text)));
        }
        let ink = extent.inset(EMPTY);
        if let Some(item) = drawing.items.iter().find(|item| covers(item, ink, role)) {
            faults.push(overprinted(format!("“{}” and {:?}", line.text, item.role)));
        }
    }
    faults
}

/// Whether a shape that must stay free of text is under a text.
fn covers(item: &Item, ink: Extent, text: &Role) -> bool {
    match (&item.shape, &item.role) {
        (Shape::Text(_), _) => false,
        (Shape::Image { at, .. }, _) => at.shared(ink) > TOUCH,
        (Shape::Area { .. }, Role::Data(_)) if *text == Role::Inside => false,
        (shape, Role::Data(_) | Role::Frame | Role::Key(_)) => match shape {
            Shape::Line { points, .. } => points.windows(2).any(|pair| crosses(pair[0], pair[1], ink)),
            Shape::Disc { centre, radius, .. } | Shape::Ring { centre, radius, .. } => {
                let [x, y] = *centre;
                let near = [x.clamp(ink.left, ink.right), y.clamp(ink.top, ink.bottom)];
                (near[0] - x).hypot(near[1] - y) < radius - 0.5
            }
            _ => bounds(item).is_some_and(|extent| extent.shared(ink) > TOUCH),
        },
        _ => false,
    }
}

/// Whether a line segment passes through a box (Liang and Barsky's clipping).
fn crosses([x, y]: [f64; 2], [to_x, to_y]: [f64; 2], ink: Extent) -> bool {
    let (mut enter, mut leave) = (0.0, 1.0);
    let edges =
        [(x - to_x, x - ink.left), (to_x - x, ink.right - x), (y - to_y, y - ink.top), (to_y - y, ink.bottom - y)];
    for (step, room) in edges {
        if step.abs() < 1e-12 {
            if room < 0.0 {
                return false;
            }
        } else if step < 0.0 {
            enter = (room / step).maximum_of(enter);
        } else {
            leave = (room / step).minimum_of(leave);
        }
    }
    enter < leave
}
