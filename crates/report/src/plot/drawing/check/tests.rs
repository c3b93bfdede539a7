//! A good plot has no fault, and each kind of fault is found where it is planted.

use super::super::axes::{Axes, AxisText};
use super::super::scale::Scale;
use super::super::series::{Curve, Estimate, draw_curves};
use super::super::shape::{Drawing, Extent, Fill, MARGIN, Role, Shape, Side, Stroke, TextLine};
use super::super::theme::{COLOURS, INK};
use super::FaultKind;

const SERIES: [&str; 2] = ["one", "two"];

/// Two curves with a legend.
fn good() -> Drawing {
    let (mut drawing, head) = Drawing::titled(600, "PSNR against overlap", "RealEstate10K, 2 views; 8 scenes");
    let top = head + 60.0;
    let inside = Extent::new(60.0, top, 380.0, top + 200.0);
    let axes = Axes { inside, x: Scale::linear(0.0, 1.0), y: Scale::linear(10.0, 30.0) };
    axes.draw_y(&mut drawing, &AxisText { title: "PSNR in dB", label: &super::super::scale::label });
    let bottom = axes.draw_x(&mut drawing, &AxisText { title: "overlap", label: &super::super::scale::label });
    let curve = |at: usize| Curve {
        label: SERIES[at],
        points: (1u32..6)
            .map(|step| {
                let value = 12.0 + 8.0 * at as f64 + f64::from(step);
                (f64::from(step) / 6.0, Estimate { value, interval: Some([value - 1.0, value + 1.0]) })
            })
            .collect(),
        colour: COLOURS[at],
    };
    assert!(draw_curves(&mut drawing, &axes, &[curve(0), curve(1)], |_, _| true).is_empty());
    drawing.end_at(bottom + 10.0);
    drawing
}

/// The kinds of faults after a change.
fn kinds(change: impl FnOnce(&mut Drawing)) -> Vec<FaultKind> {
    let mut drawing = good();
    change(&mut drawing);
    let mut kinds: Vec<FaultKind> = drawing.faults().into_iter().map(|fault| fault.kind).collect();
    kinds.dedup();
    kinds
}

/// Changes the first text of a role.
fn retext(drawing: &mut Drawing, role: &Role, change: impl FnOnce(&mut TextLine)) {
    let text = drawing.items.iter_mut().filter(|item| item.role == *role).find_map(|item| match &mut item.shape {
        Shape::Text(text) => Some(text),
        _ => None,
    });
    change(text.unwrap());
}

#[test]
fn a_good_plot_has_no_fault() {
    assert_eq!(good().faults(), []);
}

#[test]
fn texts_and_shapes_outside_are_found() {
    assert_eq!(kinds(|plot| plot.text(TextLine::new("beyond", [580.0, 100.0]))), [FaultKind::Outside]);
    assert_eq!(kinds(|plot| plot.text(TextLine::new("left", [10.0, 120.0]).side(Side::Right))), [FaultKind::Outside]);
    assert_eq!(kinds(|plot| plot.line([[10.0, 10.0], [10.0, -4.0]], Stroke::new(INK, 1.0))), [FaultKind::Outside]);
    assert_eq!(kinds(|plot| plot.disc([f64::NAN, 9.0], 2.0, Fill::solid(INK))), [FaultKind::Outside]);
    assert_eq!(kinds(|plot| plot.height -= 20), [FaultKind::Outside], "a plot that is cut off");
}

#[test]
fn an_ellipsis_is_found() {
    assert_eq!(kinds(|plot| retext(plot, &Role::Title, |text| text.text.push('…'))), [FaultKind::Truncated]);
}

#[test]
fn a_text_over_anything_is_found() {
    let over = |at: [f64; 2]| kinds(move |plot| plot.text(TextLine::new("over", at).small()));
    let place = |plot: &Drawing, wanted: fn(&Shape) -> Option<[f64; 2]>| {
        plot.items
            .iter()
            .filter(|item| matches!(item.role, Role::Data(_)))
            .find_map(|item| wanted(&item.shape))
            .unwrap()
    };
    let mark = place(&good(), |shape| if let Shape::Disc { centre, .. } = shape { Some(*centre) } else { None });
    assert_eq!(over([mark[0] - 3.0, mark[1]]), [FaultKind::Overprinted], "a mark");
    let line = place(&good(), |shape| match shape {
        Shape::Line { points, .. } => {
            Some([f64::midpoint(points[0][0], points[1][0]), f64::midpoint(points[0][1], points[1][1])])
        }
        _ => None,
    });
    assert_eq!(over([line[0] - 10.0, line[1]]), [FaultKind::Overprinted], "a curve");
    assert_eq!(over([MARGIN, 16.0]), [FaultKind::Overprinted], "the title");
    let bottom = good().items.iter().find_map(|item| match (&item.role, &item.shape) {
        (Role::Frame, Shape::Line { points, .. }) => Some(points[0][1]),
        _ => None,
    });
    assert_eq!(over([85.0, bottom.unwrap()]), [FaultKind::Overprinted], "the axis");
    assert_eq!(over([400.0, 30.0]), [], "next to everything");
    let bar = |role: Role| {
        kinds(move |plot| {
            plot.data(SERIES[0], |plot| plot.rectangle(Extent::new(420.0, 20.0, 500.0, 60.0), Fill::solid(COLOURS[0])));
            plot.with(role, |plot| plot.text(TextLine::new("12 ms", [430.0, 40.0]).small()));
        })
    };
    assert_eq!(bar(Role::Plain), [FaultKind::Overprinted], "a bar");
    assert_eq!(bar(Role::Inside), [], "a text that belongs into its bar");
}

#[test]
fn a_font_of_its_own_is_found() {
    assert_eq!(kinds(|plot| retext(plot, &Role::Axis(1), |text| text.size = 15.0)), [FaultKind::Font]);
}

#[test]
fn wrong_colours_are_found() {
    let recolour = |plot: &mut Drawing, name: &'static str, role: fn(&Role, &str) -> bool, colour| {
        for item in plot.items.iter_mut().filter(|item| role(&item.role, name)) {
            match &mut item.shape {
                Shape::Line { stroke, .. } => stroke.colour = colour,
                Shape::Disc { fill, .. } => fill.colour = colour,
                _ => {}
            }
        }
    };
    let recoloured =
        |name: &'static str, role: fn(&Role, &str) -> bool, colour| kinds(|plot| recolour(plot, name, role, colour));
    let data = |role: &Role, name: &str| matches!(role, Role::Data(series) if &**series == name);
    let key = |role: &Role, name: &str| matches!(role, Role::Key(series) if &**series == name);
    let all = |role: &Role, name: &str| matches!(role, Role::Data(series) | Role::Key(series) if &**series == name);
    assert_eq!(recoloured("two", all, COLOURS[0]), [FaultKind::Colour], "two series of one colour");
    assert_eq!(recoloured("two", key, COLOURS[4]), [FaultKind::Colour], "a legend of another colour");
    assert_eq!(recoloured("two", data, COLOURS[4]), [FaultKind::Colour], "a series of another colour");
    let mut alike = good();
    recolour(&mut alike, "two", all, plotters::style::RGBColor(0, 114, 186));
    let faults = alike.faults();
    assert!(faults.iter().any(|fault| fault.what.contains("“one” and “two” look alike")), "{faults:?}");
    let red = plotters::style::RGBColor(255, 0, 0);
    assert_eq!(recoloured("two", all, red), [FaultKind::Colour], "a colour outside the palette");
    assert_eq!(recoloured("two", all, COLOURS[4]), [], "any other colour");
}

#[test]
fn an_unexplained_line_is_found() {
    let line = |plot: &mut Drawing| {
        plot.data("frontier", |plot| plot.line([[420.0, 70.0], [560.0, 70.0]], Stroke::new(COLOURS[5], 2.0)));
    };
    assert_eq!(kinds(line), [FaultKind::Unexplained]);
    assert_eq!(
        kinds(|plot| plot.items.retain(|item| !matches!(&item.role, Role::Key(name) if &**name == "one"))),
        [FaultKind::Unexplained],
        "a legend without an entry"
    );
}

#[test]
fn ticks_that_do_not_agree_with_their_axis_are_found() {
    // The second axis is the horizontal one.
    let tick = |change: fn(&mut TextLine)| kinds(move |plot| retext(plot, &Role::Tick(2), change));
    assert_eq!(tick(|text| text.text.push_str(" ms")), [FaultKind::Axis], "a unit after the number");
    assert_eq!(tick(|text| text.text = "0.9".to_owned()), [FaultKind::Axis], "out of order");
    assert_eq!(tick(|text| text.text = "0.1".to_owned()), [FaultKind::Axis], "another value than its place");
    assert_eq!(tick(|text| text.at[0] += 9.0), [FaultKind::Axis], "another place than its value");
    assert_eq!(kinds(|plot| plot.items.retain(|item| item.role != Role::Axis(2))), [FaultKind::Axis], "no title");
    let with_ticks = |count: usize| {
        kinds(move |plot| {
            let mut left = count;
            plot.items.retain(|item| {
                let is_tick = item.role == Role::Tick(2);
                let stays = !is_tick || left > 0;
                left = left.saturating_sub(usize::from(is_tick));
                stays
            });
        })
    };
    assert_eq!([2, 1].map(with_ticks), [vec![], vec![FaultKind::Axis]], "a single tick");
}

/// Ends the line of the first series at its second point of five.
fn cut_line(plot: &mut Drawing) {
    let line = plot.items.iter_mut().find_map(|item| match (&item.role, &mut item.shape) {
        (Role::Data(name), Shape::Line { points, .. }) if &**name == "one" => Some(points),
        _ => None,
    });
    line.unwrap().truncate(2);
}

#[test]
fn intervals_without_points_are_found() {
    let mark_at = |plot: &Drawing, nth: usize| {
        let is_mark = |shape: &Shape| matches!(shape, Shape::Disc { .. });
        let is_of_one = |role: &Role| matches!(role, Role::Data(name) if &**name == "one");
        let marks = plot.items.iter().enumerate().filter(|(_, item)| is_of_one(&item.role) && is_mark(&item.shape));
        marks.map(|(at, _)| at).nth(nth).unwrap()
    };
    let without = |nth| {
        kinds(move |plot| {
            let at = mark_at(plot, nth);
            plot.items.remove(at);
        })
    };
    assert_eq!(without(2), [FaultKind::Band], "a band over a point that is not there");
    assert_eq!(without(4), [FaultKind::Band], "a band that ends without a point");
    let cut = |corner: usize| {
        kinds(move |plot| {
            let band = plot.items.iter_mut().find(|item| matches!(&item.role, Role::Band(name) if &**name == "one"));
            if let Shape::Area { corners, .. } = &mut band.unwrap().shape {
                let other = corners.len() - 1 - corner;
                corners.remove(other);
                corners.remove(corner);
            }
        })
    };
    assert_eq!(cut(2), [FaultKind::Band], "a band across a point without an interval");
    assert_eq!(cut(0), [], "a band that begins later");
    let gap = kinds(|plot| {
        let at = mark_at(plot, 2);
        plot.items.remove(at);
        let band = plot.items.iter_mut().find(|item| matches!(&item.role, Role::Band(name) if &**name == "one"));
        if let Shape::Area { corners, .. } = &mut band.unwrap().shape {
            corners.remove(7);
            corners.remove(2);
        }
        cut_line(plot);
    });
    assert_eq!(gap, [FaultKind::Band], "a band across a gap");
    assert_eq!(kinds(cut_line), [FaultKind::Band], "a band between points that no line joins");
}

#[test]
fn headings_without_protocol_or_count_are_found() {
    let subtitle =
        |text: &'static str| kinds(move |plot| retext(plot, &Role::Subtitle, |line| line.text = text.to_owned()));
    assert_eq!(subtitle("../shared/index.json"), [FaultKind::Heading], "a path");
    assert_eq!(subtitle("RealEstate10K, 2 views; means"), [FaultKind::Heading], "views are not scenes");
    assert_eq!(subtitle("8 scenes"), [FaultKind::Heading], "of what?");
    assert_eq!(subtitle("Simulated rooms; 24 simulated scenes"), []);
    assert_eq!(kinds(|plot| retext(plot, &Role::Title, |line| line.text.clear())), [FaultKind::Heading]);
}
