use super::axes::Axes;
use super::font::shortened;
use super::labels::spread;
use super::scale::Scale;
use super::series::{Estimate, Figure, Origin, plain};
use super::shape::{Drawing, Extent, Fill, Side, Stroke, TextLine};
use super::theme::{GREY, GRID, colour};

/// Quality against the overlap of the context views.
#[derive(Clone, Debug)]
pub struct OverlapCurves {
    /// Title.
    pub title: String,
    /// Protocol, scenes.
    pub subtitle: String,
    /// The metric.
    pub quality: Figure,
    /// The protocol's bins, shown behind the curves.
    pub bins: Vec<OverlapBin>,
    /// A curve per method.
    pub series: Vec<OverlapSeries>,
}

/// An overlap bin.
#[derive(Clone, Debug)]
pub struct OverlapBin {
    /// Its name.
    pub name: String,
    /// Lower and upper edge, in [0, 1].
    pub edges: [f64; 2],
    /// Number of scenes in it.
    pub scenes: u64,
}

/// One method.
#[derive(Clone, Debug)]
pub struct OverlapSeries {
    /// Its name.
    pub label: String,
    /// Overlap in [0, 1] and the mean of the scenes around it, ascending.
    pub points: Vec<(f64, Estimate)>,
    /// Published series are grey.
    pub origin: Origin,
}

impl OverlapCurves {
    /// Draws it.
    pub fn draw(&self) -> Drawing {
        let mut drawing = Drawing::new(860, 520);
        drawing.heading(&self.title, &self.subtitle);
        let overlaps = self.series.iter().flat_map(|series| series.points.iter().map(|(overlap, _)| *overlap));
        let edges = self.bins.iter().flat_map(|bin| bin.edges);
        let values =
            self.series.iter().flat_map(|series| series.points.iter().flat_map(|(_, estimate)| estimate.extent()));
        let axes = Axes {
            inside: Extent::new(64.0, 120.0, 640.0, 460.0),
            x: Scale::around(overlaps.chain(edges), 0.0),
            y: Scale::around(values, 0.08),
        };
        for (at, bin) in self.bins.iter().enumerate() {
            let [from, to] = bin.edges.map(|edge| axes.x_of(edge));
            if at % 2 == 0 {
                drawing.rectangle(Extent::new(from, axes.inside.top, to, axes.inside.bottom), Fill::faint(GRID, 0.45));
            }
            let name = shortened(&format!("{} · {}", bin.name, bin.scenes), 12.0, false, to - from - 6.0);
            drawing.text(
                TextLine::new(name, [f64::midpoint(from, to), axes.inside.top + 12.0])
                    .size(12.0)
                    .muted()
                    .side(Side::Middle),
            );
        }
        axes.draw_y(&mut drawing, &plain(&self.quality.title()));
        axes.draw_x(&mut drawing, &plain("overlap of the context views"));
        let ends: Vec<f64> = self
            .series
            .iter()
            .map(|series| series.points.last().map_or(0.0, |(_, end)| axes.y_of(end.value)))
            .collect();
        let heights = spread(&ends, 18.0, axes.inside.top + 8.0, axes.inside.bottom - 8.0);
        for (at, series) in self.series.iter().enumerate() {
            let colour = if series.origin == Origin::Published { GREY } else { colour(at) };
            let band: Vec<(f64, [f64; 2])> =
                series.points.iter().filter_map(|(x, e)| e.interval.map(|i| (*x, i))).collect();
            if band.len() > 1 {
                let low = band.iter().map(|(x, [low, _])| axes.place(*x, *low));
                let high = band.iter().rev().map(|(x, [_, high])| axes.place(*x, *high));
                drawing.area(low.chain(high).collect::<Vec<_>>(), Fill::faint(colour, 0.16));
            }
            let points: Vec<[f64; 2]> =
                series.points.iter().map(|(x, estimate)| axes.place(*x, estimate.value)).collect();
            drawing.line(points.clone(), Stroke::new(colour, 2.0));
            for point in &points {
                drawing.disc(*point, 3.0, Fill::solid(colour));
            }
            if let (Some(end), Some(height)) = (points.last(), heights.get(at)) {
                drawing.line([*end, [axes.inside.right + 12.0, *height]], Stroke::new(colour, 1.0));
                let room = f64::from(drawing.size().0) - axes.inside.right - 24.0;
                let name = shortened(&series.label, 13.0, false, room);
                drawing.text(TextLine::new(name, [axes.inside.right + 16.0, *height]));
            }
        }
        drawing
    }
}
