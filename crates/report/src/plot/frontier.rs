use super::axes::{Axes, AxisText};
use super::labels::Labels;
use super::scale::{Scale, count_label, seconds_label};
use super::series::{Estimate, Figure, Origin, origin_key, plain, whisker};
use super::shape::{Drawing, Extent, Fill, Stroke, TextLine};
use super::theme::{COLOURS, GREY, MUTED};

/// Quality against cost: every method as a point, the Pareto frontier as a step line.
#[derive(Clone, Debug)]
pub struct Frontier {
    /// Title.
    pub title: String,
    /// Protocol, scenes, machine.
    pub subtitle: String,
    /// The kind of cost.
    pub cost: CostAxis,
    /// The metric.
    pub quality: Figure,
    /// The methods; points without a positive cost are omitted.
    pub points: Vec<FrontierPoint>,
}

/// The kind of cost.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CostAxis {
    /// Seconds from context views to Gaussians.
    Seconds,
    /// Gaussians per scene.
    Gaussians,
}

/// A method.
#[derive(Clone, Debug)]
pub struct FrontierPoint {
    /// Its name.
    pub label: String,
    /// Seconds or Gaussians.
    pub cost: f64,
    /// Quartiles of the cost, if it was measured repeatedly.
    pub spread: Option<[f64; 2]>,
    /// The metric.
    pub quality: Estimate,
    /// Published points are hollow, because their times are from other machines.
    pub origin: Origin,
    /// Whether it is highlighted, such as the knee of a curve.
    pub highlighted: bool,
}

impl Frontier {
    /// Draws it, with separate frontiers of published and measured points, because times of different machines are not
    /// comparable.
    pub fn draw(&self) -> Drawing {
        let mut drawing = Drawing::new(860, 520);
        drawing.heading(&self.title, &self.subtitle);
        let shown: Vec<&FrontierPoint> =
            self.points.iter().filter(|p| p.cost > 0.0 && p.quality.value.is_finite()).collect();
        let axes = Axes {
            inside: Extent::new(64.0, 100.0, 836.0, 460.0),
            x: Scale::logarithmic(shown.iter().map(|point| point.cost), 0.12),
            y: Scale::around(shown.iter().flat_map(|point| point.quality.extent()), 0.12),
        };
        let label: &dyn Fn(f64, &[f64]) -> String = match self.cost {
            CostAxis::Seconds => &|secs, _| seconds_label(secs),
            CostAxis::Gaussians => &|count, _| count_label(count),
        };
        let title = match self.cost {
            CostAxis::Seconds => "time from context views to Gaussians, logarithmic",
            CostAxis::Gaussians => "Gaussians, logarithmic",
        };
        axes.draw_y(&mut drawing, &plain(&self.quality.title()));
        axes.draw_x(&mut drawing, &AxisText { title, label });
        if shown.iter().any(|point| point.origin == Origin::Published) {
            origin_key(&mut drawing);
        }

        let mut labels = Labels::new(Extent::new(axes.inside.left, 84.0, 856.0, axes.inside.bottom - 2.0));
        for (origin, colour) in [(Origin::Published, GREY), (Origin::Measured, COLOURS[0])] {
            let steps = self.steps(shown.iter().filter(|point| point.origin == origin).copied());
            let mut corners = Vec::new();
            for (at, point) in steps.iter().enumerate() {
                if let Some(before) = at.checked_sub(1).and_then(|before| steps.get(before)) {
                    corners.push(axes.place(point.cost, before.quality.value));
                }
                corners.push(axes.place(point.cost, point.quality.value));
            }
            if corners.len() > 1 {
                labels.avoid_line(&corners);
                drawing.line(corners, Stroke::new(colour, 2.0));
            }
        }
        for point in &shown {
            let at = axes.place(point.cost, point.quality.value);
            labels.avoid(at, 7.0);
            if let Some([low, high]) = point.quality.interval {
                let ends = [axes.y_of(low), axes.y_of(high)];
                whisker(&mut drawing, at[0], ends, Stroke::new(COLOURS[0], 1.5));
                labels.avoid_line(&[[at[0], ends[1]], [at[0], ends[0]]]);
            }
            if let Some([low, high]) = point.spread.filter(|ends| ends.iter().all(|end| *end > 0.0)) {
                let ends = [[axes.place(low, 0.0)[0], at[1]], [axes.place(high, 0.0)[0], at[1]]];
                drawing.line(ends, Stroke::new(COLOURS[0], 1.5));
            }
            match point.origin {
                Origin::Published => drawing.ring(at, 5.0, Stroke::new(GREY, 2.0)),
                Origin::Measured => drawing.disc(at, 6.0, Fill::solid(COLOURS[0])),
            }
            if point.highlighted {
                drawing.ring(at, 9.0, Stroke::new(COLOURS[1], 2.0));
                drawing.disc(at, 6.0, Fill::solid(COLOURS[0]));
            }
        }
        for point in &shown {
            let text = TextLine::new(point.label.as_str(), [0.0, 0.0]);
            let text = if point.highlighted { text.bold() } else { text };
            let text = if point.origin == Origin::Published { TextLine { colour: MUTED, ..text } } else { text };
            labels.place(&mut drawing, text, axes.place(point.cost, point.quality.value));
        }
        drawing
    }

    /// The points that no other point beats in both cost and quality, cheapest first.
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
            if steps.last().is_none_or(|best| self.quality.better(point.quality.value, best.quality.value)) {
                steps.push(point);
            }
        }
        steps
    }
}

#[cfg(test)]
mod tests {
    use atsplat_metrics::definition;

    use super::*;

    #[test]
    fn dominated_points_are_not_on_the_frontier() {
        let point = |label: &str, cost: f64, quality: f64| FrontierPoint {
            label: label.to_owned(),
            cost,
            spread: None,
            quality: Estimate::exact(quality),
            origin: Origin::Measured,
            highlighted: false,
        };
        let points = vec![
            point("dear", 3.0, 30.0),
            point("cheap", 1.0, 20.0),
            point("beaten", 2.0, 19.0),
            point("twin", 1.0, 18.0),
        ];
        let frontier = |id| Frontier {
            title: String::new(),
            subtitle: String::new(),
            cost: CostAxis::Gaussians,
            quality: Figure::from(definition(id).unwrap()),
            points: points.clone(),
        };
        let steps = |id| {
            let frontier = frontier(id);
            frontier.steps(points.iter()).iter().map(|point| point.label.as_str()).collect::<Vec<_>>()
        };
        assert_eq!(steps("psnr"), ["cheap", "dear"]);
        assert_eq!(steps("lpips"), ["twin"], "less is better");
    }
}
