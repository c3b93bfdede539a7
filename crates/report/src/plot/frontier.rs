use atsplat_results::tradeoff::{Axis, Standing};

use super::drawing::axes::{Axes, AxisText};
use super::drawing::labels::Labels;
use super::drawing::scale::{Scale, seconds_label, single_label, time_unit};
use super::drawing::series::{Estimate, Origin, QualityMetric, bars, mark, note, number_axis, sentences, whisker};
use super::drawing::shape::{Drawing, Extent, MARGIN, Stroke, TextLine};
use super::drawing::theme::{COLOURS, GREY, MUTED};
use crate::numbers::count_label;

/// Quality against one or several kinds of cost, side by side: every method as a point, the Pareto frontier as a step line.
#[derive(Clone, Debug)]
pub struct Frontiers {
    /// Title.
    pub title: String,
    /// Protocol, scenes, machine.
    pub subtitle: String,
    /// The metric.
    pub quality: QualityMetric,
    /// A panel per kind of cost; points without a positive cost are omitted.
    pub panels: Vec<(Axis, Vec<FrontierPoint>)>,
    /// Below the panels, after the meaning of the bars: which methods are on the frontiers, and which have no point.
    pub note: String,
}

/// A method.
#[derive(Clone, Debug)]
pub struct FrontierPoint {
    /// Its name.
    pub label: String,
    /// Seconds or Gaussians.
    pub cost: f64,
    /// Quartiles of the cost, if it is a time that was measured repeatedly.
    pub spread: Option<[f64; 2]>,
    /// The metric.
    pub quality: Estimate,
    /// Published points are hollow, because their times are from other machines.
    pub origin: Origin,
    /// Its relation to the frontier if that was tested; by its numbers alone if not.
    pub standing: Option<Standing>,
    /// Whether it may be on a frontier that was not tested; a method with random weights may not.
    pub ranked: bool,
    /// Whether it is highlighted, such as the knee of a curve.
    pub highlighted: bool,
}

impl FrontierPoint {
    /// Its label, with a mark if it is not distinguishable from the frontier.
    fn name(&self) -> String {
        let undecided = if self.standing == Some(Standing::NotDistinguishable) { " ?" } else { "" };
        format!("{}{undecided}", self.label)
    }

    /// The spread, if a logarithmic axis has a place for it.
    fn drawn_spread(&self) -> Option<[f64; 2]> {
        self.spread.filter(|ends| ends.iter().all(|end| *end > 0.0))
    }
}

impl Frontiers {
    /// Draws it, with separate frontiers of published and measured points, because times of different machines are not
    /// comparable.
    pub fn draw(&self) -> Drawing {
        const WIDTH: f64 = 500.0;
        let count = self.panels.len().clamp(1, 4);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most four panels")]
        let width = if count == 1 { 860 } else { (WIDTH * count as f64) as u32 + 40 };
        let (mut drawing, head) = Drawing::titled(width, &self.title, &self.subtitle);
        let panels: Vec<(Axis, Vec<&FrontierPoint>)> =
            self.panels.iter().map(|(cost, points)| (*cost, shown(points))).collect();
        let names = [Origin::Published, Origin::Measured].map(|origin| {
            let steps = panels.iter().map(|(_, points)| self.steps(of_origin(points, origin)).len()).max();
            let name = if origin == Origin::Published { "published" } else { "measured" };
            if steps > Some(1) { format!("{name}, and their frontier") } else { name.to_owned() }
        });
        let all = || panels.iter().flat_map(|(_, points)| points);
        let mut legend: Vec<(&str, Option<Origin>)> = Vec::new();
        for (origin, name) in [Origin::Published, Origin::Measured].into_iter().zip(&names) {
            legend.extend(all().any(|point| point.origin == origin).then_some((name.as_str(), Some(origin))));
        }
        legend.extend(all().any(|point| point.highlighted).then_some((KNEE, None)));
        let keys: Vec<&str> = legend.iter().map(|(name, _)| *name).collect();
        let bottom = drawing.legend(MARGIN, head + 12.0, &keys, |drawing, at, place| match legend.get(at) {
            Some((_, Some(origin))) => mark(drawing, place, *origin, colour_of(*origin)),
            _ => drawing.ring(place, 6.0, Stroke::new(COLOURS[1], 2.0)),
        });
        let top = bottom + 34.0;
        let y = Scale::around(all().flat_map(|point| point.quality.extent()), 0.12);
        let (mut below, mut crowded) = (top, Vec::new());
        for (at, (cost, points)) in panels.iter().enumerate() {
            let left = 64.0 + WIDTH * at as f64;
            let right = if count == 1 { 836.0 } else { left + WIDTH - 64.0 };
            let inside = Extent::new(left, top, right, top + 350.0);
            let names = [names[0].as_str(), names[1].as_str()];
            below = self.draw_panel(&mut drawing, (inside, y), (*cost, points), names, &mut crowded);
        }
        if !crowded.is_empty() {
            below = note(&mut drawing, below, &format!("No room for names at points: {}", crowded.join("; ")));
        }
        let has_times = all().any(|point| point.drawn_spread().is_some());
        let explained = bars("Bars", all().map(|point| &point.quality), has_times);
        let bottom = note(&mut drawing, below, &sentences([&*explained, &*self.note]));
        drawing.end_at(bottom + 14.0);
        drawing
    }

    /// A panel's axes, frontiers, points and labels, and the labels without room; returns its lower edge.
    fn draw_panel(
        &self,
        drawing: &mut Drawing,
        (inside, y): (Extent, Scale),
        (cost, points): (Axis, &[&FrontierPoint]),
        names: [&str; 2],
        crowded: &mut Vec<String>,
    ) -> f64 {
        let (unit, length) = match cost {
            Axis::Seconds => time_unit(points.iter().map(|point| point.cost)),
            Axis::Gaussians => ("", 1.0),
        };
        let axes = Axes { inside, x: cost_scale(points, length), y };
        let title = match cost {
            Axis::Seconds => format!("time in {unit}, logarithmic"),
            Axis::Gaussians => "Gaussians per scene, logarithmic".to_owned(),
        };
        let label = |value, _: &[f64]| match cost {
            Axis::Seconds => single_label(value),
            Axis::Gaussians => count_label(value),
        };
        axes.draw_y(drawing, &number_axis(&self.quality.title()));
        let bottom = axes.draw_x(drawing, &AxisText { title: &title, label: &label });
        let x_of = |cost: f64| axes.x_of(cost / length).clamp(inside.left, inside.right);
        let place = |cost: f64, quality: f64| [x_of(cost), axes.y_of(quality)];
        let mut labels =
            Labels::new(Extent::new(inside.left, inside.top - 4.0, inside.right + 20.0, inside.bottom - 2.0));
        for (origin, name) in [Origin::Published, Origin::Measured].into_iter().zip(names) {
            let steps = self.steps(of_origin(points, origin));
            let mut corners = Vec::new();
            for (at, point) in steps.iter().enumerate() {
                if let Some(before) = at.checked_sub(1).and_then(|before| steps.get(before)) {
                    corners.push(place(point.cost, before.quality.value));
                }
                corners.push(place(point.cost, point.quality.value));
            }
            if corners.len() > 1 {
                labels.avoid_line(&corners);
                drawing.data(name, |drawing| drawing.line(corners, Stroke::new(colour_of(origin), 1.5)));
            }
            for point in of_origin(points, origin) {
                let at = place(point.cost, point.quality.value);
                labels.avoid(at, if point.highlighted { 11.0 } else { 7.0 });
                drawing.data(name, |drawing| {
                    let stroke = Stroke::new(colour_of(origin), 1.5);
                    if let Some([low, high]) = point.quality.interval {
                        let ends = [axes.y_of(low), axes.y_of(high)];
                        whisker(drawing, at[0], ends, stroke);
                        labels.avoid_line(&[[at[0], ends[1]], [at[0], ends[0]]]);
                    }
                    if let Some([low, high]) = point.drawn_spread() {
                        let ends = [[x_of(low), at[1]], [x_of(high), at[1]]];
                        drawing.line(ends, stroke);
                        labels.avoid_line(&ends);
                    }
                });
                if point.highlighted {
                    drawing.data(KNEE, |drawing| drawing.ring(at, 9.0, Stroke::new(COLOURS[1], 2.0)));
                }
                drawing.data(name, |drawing| mark(drawing, at, origin, colour_of(origin)));
            }
        }
        let mut without_room = Vec::new();
        for point in points {
            let text = TextLine::new(point.name(), [0.0, 0.0]).within(190.0);
            let bold = point.highlighted || point.standing == Some(Standing::Frontier);
            let text = if bold { text.bold() } else { text };
            let text = if point.origin == Origin::Published { TextLine { colour: MUTED, ..text } } else { text };
            if !labels.place_if_free(drawing, &text, place(point.cost, point.quality.value)) {
                without_room.push(*point);
            }
        }
        for point in without_room {
            let number = crowded.len() + 1;
            let text = TextLine::new(number.to_string(), [0.0, 0.0]).small();
            let has_number =
                labels.place_apart_if_free(drawing, &text, place(point.cost, point.quality.value), BETWEEN_NUMBERS);
            let words = self.in_words(point, cost);
            crowded.push(if has_number { format!("{number} {words}") } else { words });
        }
        bottom
    }

    /// `ATSplat (22.30, 0.26 s, on the frontier)`.
    fn in_words(&self, point: &FrontierPoint, cost: Axis) -> String {
        let cost = match cost {
            Axis::Seconds => seconds_label(point.cost),
            Axis::Gaussians => count_label(point.cost),
        };
        let verdicts =
            [(point.standing == Some(Standing::Frontier), ", on the frontier"), (point.highlighted, ", at the knee")];
        let verdicts: String = verdicts.into_iter().filter_map(|(holds, text)| holds.then_some(text)).collect();
        format!("{} ({}, {cost}{verdicts})", point.name(), self.quality.print(point.quality.value))
    }

    /// The points of the frontier, cheapest first: those that were tested, or the ranked ones that no other ranked point
    /// beats in both cost and quality.
    fn steps<'a>(&self, points: impl Iterator<Item = &'a FrontierPoint>) -> Vec<&'a FrontierPoint> {
        let mut sorted: Vec<&FrontierPoint> = points.collect();
        sorted.sort_by(|a, b| {
            a.cost.total_cmp(&b.cost).then(if self.quality.better(a.quality.value, b.quality.value) {
                std::cmp::Ordering::Less
            } else {
                std::cmp::Ordering::Greater
            })
        });
        let mut steps: Vec<&FrontierPoint> = Vec::new();
        for point in sorted {
            let better =
                || steps.last().is_none_or(|best| self.quality.better(point.quality.value, best.quality.value));
            if point.standing.map_or_else(|| point.ranked && better(), |standing| standing == Standing::Frontier) {
                steps.push(point);
            }
        }
        steps
    }
}

/// Pixels beside the number of a point whose name has no room.
const BETWEEN_NUMBERS: f64 = 4.0;
const KNEE: &str = "knee: more cost buys less quality from here on";

fn shown(points: &[FrontierPoint]) -> Vec<&FrontierPoint> {
    points.iter().filter(|point| point.cost > 0.0 && point.quality.value.is_finite()).collect()
}

/// The axis of costs, in a unit of this length. Where a horizontal bar would leave it, it is extended to the bar's end.
fn cost_scale(points: &[&FrontierPoint], length: f64) -> Scale {
    let around = |ends: &[f64]| {
        let costs = points.iter().map(|point| point.cost).chain(ends.iter().copied());
        Scale::logarithmic(costs.map(|cost| cost / length), 0.12)
    };
    let of_points = around(&[]);
    let is_outside = |end: &f64| !(of_points.low()..=of_points.high()).contains(&(*end / length));
    let ends: Vec<f64> = points.iter().filter_map(|point| point.drawn_spread()).flatten().filter(is_outside).collect();
    around(&ends)
}

fn of_origin<'a>(points: &'a [&FrontierPoint], origin: Origin) -> impl Iterator<Item = &'a FrontierPoint> {
    points.iter().copied().filter(move |point| point.origin == origin)
}

const fn colour_of(origin: Origin) -> plotters::style::RGBColor {
    match origin {
        Origin::Published => GREY,
        Origin::Measured => COLOURS[0],
    }
}

#[cfg(test)]
mod tests {
    use atsplat_metrics::definition;
    use atsplat_numeric::Tolerance;

    use super::*;

    fn point(label: &str, cost: f64, quality: f64) -> FrontierPoint {
        FrontierPoint {
            label: label.to_owned(),
            cost,
            spread: None,
            quality: Estimate::exact(quality),
            origin: Origin::Measured,
            standing: None,
            ranked: true,
            highlighted: false,
        }
    }

    /// In milliseconds: a single method, whose quartiles are farther apart than the axis of its median would be wide.
    #[test]
    fn the_axis_has_the_ends_of_horizontal_bars() {
        let ends = |spread: Option<[f64; 2]>| {
            let point = FrontierPoint { spread, ..point("warp", 0.010, 20.0) };
            let scale = cost_scale(&[&point], 1e-3);
            [scale.low(), scale.high()]
        };
        let [low, high] = ends(None);
        assert!(low > 8.0 && high < 12.0, "{low} to {high}");
        Tolerance::F64.assert(ends(Some([0.0098, 0.0105])), [low, high], "quartiles inside change nothing");
        let [low, high] = ends(Some([0.0099, 0.015]));
        assert!(low > 8.0 && high > 15.0, "{low} to {high}");
        let [low, high] = ends(Some([0.004, 0.015]));
        assert!(low < 4.0 && high > 15.0, "{low} to {high}");
    }

    /// Twenty settings with long names, of which some have no room.
    #[test]
    fn points_without_room_for_their_names_have_numbers() {
        let name =
            |at: u32| format!("setting {at} with a name that is much too long for the middle of a crowd of points");
        let points =
            (0..20).map(|at| point(&name(at), 1000.0 + 10.0 * f64::from(at), 20.0 + 0.01 * f64::from(at))).collect();
        let drawing = Frontiers {
            title: String::new(),
            subtitle: String::new(),
            quality: QualityMetric::from(definition("psnr").unwrap()),
            panels: vec![(Axis::Gaussians, points), (Axis::Gaussians, vec![point("alone", 1000.0, 20.0)])],
            note: String::new(),
        }
        .draw();
        let texts: Vec<&str> = drawing.texts().collect();
        let key = texts.iter().find_map(|text| text.strip_prefix("No room for names at points: ")).unwrap();
        let numbered: Vec<&str> = key.split("; ").collect();
        assert!(numbered[0].starts_with("1 setting ") && texts.contains(&"1"), "{key}");
    }

    #[test]
    fn a_point_without_room_for_its_name_keeps_its_verdict() {
        let frontier = Frontiers {
            title: String::new(),
            subtitle: String::new(),
            quality: QualityMetric::from(definition("psnr").unwrap()),
            panels: Vec::new(),
            note: String::new(),
        };
        let said = |standing, highlighted| {
            let point = FrontierPoint { standing, highlighted, ..point("warp", 0.26, 22.3) };
            frontier.in_words(&point, Axis::Seconds)
        };
        assert_eq!(said(None, false), "warp (22.30, 260 ms)");
        assert_eq!(said(Some(Standing::Frontier), true), "warp (22.30, 260 ms, on the frontier, at the knee)");
        assert_eq!(said(Some(Standing::NotDistinguishable), false), "warp ? (22.30, 260 ms)");
    }

    #[test]
    fn dominated_points_are_not_on_the_frontier() {
        let points = vec![
            point("dear", 3.0, 30.0),
            point("cheap", 1.0, 20.0),
            point("beaten", 2.0, 19.0),
            point("twin", 1.0, 18.0),
        ];
        let frontier = |id| Frontiers {
            title: String::new(),
            subtitle: String::new(),
            quality: QualityMetric::from(definition(id).unwrap()),
            panels: Vec::new(),
            note: String::new(),
        };
        let steps = |id| {
            let frontier = frontier(id);
            frontier.steps(points.iter()).iter().map(|point| point.label.as_str()).collect::<Vec<_>>()
        };
        assert_eq!(steps("psnr"), ["cheap", "dear"]);
        assert_eq!(steps("lpips"), ["twin"], "less is better");
        let mut unranked = points.clone();
        unranked[1].ranked = false;
        let without: Vec<_> = frontier("psnr").steps(unranked.iter()).iter().map(|point| point.label.clone()).collect();
        assert_eq!(without, ["twin", "beaten", "dear"], "as if it were not there");
        let mut tested = points.clone();
        for point in &mut tested {
            point.standing = Some(Standing::NotDistinguishable);
        }
        tested[0].standing = Some(Standing::Frontier);
        let on_frontier: Vec<_> =
            frontier("psnr").steps(tested.iter()).iter().map(|point| point.label.clone()).collect();
        assert_eq!(on_frontier, ["dear"], "what was tested counts, not the numbers");
    }
}
