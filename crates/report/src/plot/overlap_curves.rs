use super::axes::Axes;
use super::font::shortened;
use super::scale::Scale;
use super::series::{Curve, Estimate, Figure, Origin, draw_curves, plain, series_colour};
use super::shape::{Drawing, Extent, Fill, Side, TextLine};
use super::theme::GRID;

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
        let curves = self.series.iter().enumerate().map(|(at, series)| Curve {
            label: &series.label,
            points: series.points.clone(),
            colour: series_colour(at, series.origin),
        });
        draw_curves(&mut drawing, &axes, &curves.collect::<Vec<_>>());
        drawing
    }
}
