use super::drawing::axes::Axes;
use super::drawing::labels::names_above;
use super::drawing::scale::Scale;
use super::drawing::series::{
    Curve, Estimate, QualityMetric, bars, beyond_note, draw_curves, height_of_names, note, number_axis, scale_of,
    sentences, without_interval,
};
use super::drawing::shape::{Drawing, Extent, Fill, MARGIN};
use super::drawing::theme::{GRID, colour};

/// Quality against the overlap of the context views.
#[derive(Clone, Debug)]
pub struct OverlapCurves {
    /// Title.
    pub title: String,
    /// Protocol, scenes.
    pub subtitle: String,
    /// The metric.
    pub quality: QualityMetric,
    /// The protocol's bins, shown behind the curves.
    pub bins: Vec<OverlapBin>,
    /// Edges between the steps of overlap, ascending; each belongs to the step below it. Points of neighbouring steps are joined.
    pub edges: Vec<f64>,
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
}

impl OverlapCurves {
    /// Draws it. Outliers do not stretch the scale: they are triangles at its edge, with their values below the plot.
    pub fn draw(&self) -> Drawing {
        let (mut drawing, head) = Drawing::titled(860, &self.title, &self.subtitle);
        let points = || self.series.iter().flat_map(|series| &series.points);
        let edges = self.bins.iter().flat_map(|bin| bin.edges);
        let top = head + 58.0;
        let names = height_of_names(self.series.iter().map(|series| series.label.as_str()));
        let height = names.clamp(340.0, f64::INFINITY);
        let axes = Axes {
            inside: Extent::new(64.0, top, 640.0, top + height),
            x: Scale::around(points().map(|(overlap, _)| *overlap).chain(edges), 0.0),
            y: scale_of(points().map(|(_, mean)| mean), 0.08),
        };
        let mut names = Vec::new();
        for (at, bin) in self.bins.iter().enumerate() {
            let part = bin.edges.map(|edge| axes.x_of(edge));
            if at % 2 == 0 {
                let tint = Extent { left: part[0], right: part[1], ..axes.inside };
                drawing.rectangle(tint, Fill::faint(GRID, 0.45));
            }
            names.push((format!("{} · {}", bin.name, bin.scenes), part));
        }
        names_above(&mut drawing, top - 12.0, &names, [MARGIN, 840.0]);
        axes.draw_y_below(&mut drawing, &number_axis(&self.quality.title()), 26.0);
        let bottom = axes
            .draw_x(&mut drawing, &number_axis("overlap of the context views; above the plot: bins and their scenes"));
        let curves = self.series.iter().enumerate().map(|(at, series)| Curve {
            label: &series.label,
            points: series.points.clone(),
            colour: colour(at),
        });
        let joined = |a: f64, b: f64| self.edges.iter().filter(|edge| (a..b).contains(*edge)).count() < 2;
        let beyond = draw_curves(&mut drawing, &axes, &curves.collect::<Vec<_>>(), joined);
        let intervals = bars("Bars and bands", points().map(|(_, mean)| mean), false);
        let few = without_interval(points().map(|(_, mean)| mean));
        let beyond = beyond_note(&beyond, self.quality);
        let bottom = note(&mut drawing, bottom, &sentences([&*intervals, &*few, &*beyond]));
        drawing.end_at(bottom + 14.0);
        drawing
    }
}

#[cfg(test)]
mod tests {
    use atsplat_metrics::definition;

    use super::super::drawing::check::FaultKind;
    use super::super::drawing::shape::{Role, Shape};
    use super::*;

    /// The step from 0.5 to 0.6 is empty: the points on either side of it, one of them on its edge, are closer than others that are joined.
    #[test]
    fn lines_and_bands_join_points_of_neighbouring_steps_alone() {
        let point = |overlap: f64| (overlap, Estimate { value: 20.0 + overlap, interval: Some([19.0, 22.0]) });
        let points = [0.21, 0.31, 0.32, 0.5, 0.61, 0.79].map(point).to_vec();
        let plot = OverlapCurves {
            title: "PSNR against overlap".to_owned(),
            subtitle: "RealEstate10K by overlap, 60 scenes".to_owned(),
            quality: definition("psnr").unwrap().into(),
            bins: vec![OverlapBin { name: "all".to_owned(), edges: [0.2, 0.8], scenes: 60 }],
            edges: vec![0.3, 0.315, 0.4, 0.5, 0.6, 0.7],
            series: vec![OverlapSeries { label: "a".to_owned(), points }],
        };
        let drawing = plot.draw();
        let corners = |is_of: fn(&Role) -> bool| -> Vec<usize> {
            let items = drawing.items.iter().filter(|item| is_of(&item.role));
            let counts = items.filter_map(|item| match &item.shape {
                Shape::Line { points, .. } => Some(points.len()),
                Shape::Area { corners, .. } => Some(corners.len()),
                _ => None,
            });
            counts.collect()
        };
        assert_eq!(corners(|role| matches!(role, Role::Data(_))), [4, 2]);
        assert_eq!(corners(|role| matches!(role, Role::Band(_))), [8, 4]);
        assert!(drawing.faults().iter().all(|fault| fault.kind != FaultKind::Band), "{:?}", drawing.faults());
    }
}
