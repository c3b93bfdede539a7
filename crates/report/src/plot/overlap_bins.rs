use atsplat_numeric::Extremes as _;
use plotters::style::RGBColor;

use super::drawing::axes::Axes;
use super::drawing::scale::Scale;
use super::drawing::series::{
    Estimate, Origin, QualityMetric, bars, mark, note, number_axis, sentences, whisker, without_interval,
};
use super::drawing::shape::{Drawing, Extent, Fill, MARGIN, Role, Side, Stroke, TextLine};
use super::drawing::theme::{GRID, MUTED, colour};

/// Quality in each overlap bin, and the average over all scenes.
#[derive(Clone, Debug)]
pub struct OverlapBinMeans {
    /// Title.
    pub title: String,
    /// Protocol, scenes.
    pub subtitle: String,
    /// The metric.
    pub quality: QualityMetric,
    /// Names of the bins, the average last.
    pub bins: Vec<String>,
    /// A mark per bin and method.
    pub series: Vec<OverlapBinSeries>,
}

/// One method.
#[derive(Clone, Debug)]
pub struct OverlapBinSeries {
    /// Its name.
    pub label: String,
    /// Means in the order of the bins; `None` for bins without scenes.
    pub means: Vec<Option<Estimate>>,
    /// Published marks are hollow.
    pub origin: Origin,
}

impl OverlapBinMeans {
    /// Draws it: a column per bin, with a mark per method in the order of the legend.
    pub fn draw(&self) -> Drawing {
        let (mut drawing, head) = Drawing::titled(860, &self.title, &self.subtitle);
        let names: Vec<&str> = self.series.iter().map(|series| series.label.as_str()).collect();
        let bottom = drawing.legend(MARGIN, head + 12.0, &names, |drawing, at, place| {
            if let Some(series) = self.series.get(at) {
                mark(drawing, place, series.origin, self.colour_of(at));
            }
        });
        let top = bottom + 34.0;
        let means = || self.series.iter().flat_map(|series| series.means.iter().flatten());
        let axes = Axes {
            inside: Extent::new(64.0, top, 836.0, top + 320.0),
            x: Scale::linear(0.0, self.bins.len() as f64),
            y: Scale::around(means().flat_map(|mean| mean.extent()), 0.08),
        };
        let bottom = axes.inside.bottom;
        let mut below = bottom;
        for (bin, name) in self.bins.iter().enumerate() {
            let (left, right) = (axes.x_of(bin as f64), axes.x_of(bin as f64 + 1.0));
            if bin % 2 == 1 {
                drawing.rectangle(Extent::new(left, top, right, bottom), Fill::faint(GRID, 0.4));
            }
            let name = TextLine::new(name, [f64::midpoint(left, right), 0.0]).side(Side::Middle);
            let name = name.within(right - left - 8.0).below(bottom + 12.0);
            below = below.maximum_of(name.extent().bottom);
            drawing.text(name);
        }
        axes.draw_y(&mut drawing, &number_axis(&self.quality.title()));
        let line = [[axes.inside.left, bottom], [axes.inside.right, bottom]];
        drawing.with(Role::Frame, |drawing| drawing.line(line, Stroke::new(MUTED, 1.0)));
        for (at, series) in self.series.iter().enumerate() {
            let colour = self.colour_of(at);
            for (bin, mean) in series.means.iter().enumerate() {
                let Some(mean) = mean else { continue };
                let place = axes.place(bin as f64 + (at as f64 + 1.0) / (self.series.len() as f64 + 1.0), mean.value);
                drawing.data(&series.label, |drawing| {
                    if let Some(interval) = mean.interval {
                        let ends = interval.map(|value| axes.y_of(value));
                        whisker(drawing, place[0], ends, Stroke::new(colour, 1.5));
                    }
                    mark(drawing, place, series.origin, colour);
                });
            }
        }
        let hollow = self.series.iter().any(|series| series.origin == Origin::Published);
        let hollow = if hollow { "Hollow: published; filled: measured." } else { "" };
        let measured = self.series.iter().filter(|series| series.origin == Origin::Measured);
        let few = without_interval(measured.flat_map(|series| series.means.iter().flatten()));
        let bottom = note(&mut drawing, below, &sentences([hollow, &*bars("Bars", means(), false), &*few]));
        drawing.end_at(bottom + 14.0);
        drawing
    }

    /// Measured methods have the first colours, as in the curves over overlap, which have no published ones.
    fn colour_of(&self, at: usize) -> RGBColor {
        let is_measured = |series: &&OverlapBinSeries| series.origin == Origin::Measured;
        let (before, from) = self.series.split_at(at.min(self.series.len()));
        let measured_before = before.iter().filter(is_measured).count();
        let measured_after = from.iter().filter(is_measured).count();
        let is_published = from.first().is_some_and(|series| series.origin == Origin::Published);
        colour(if is_published { before.len() + measured_after } else { measured_before })
    }
}

#[cfg(test)]
mod tests {
    use atsplat_metrics::definition;

    use super::*;

    #[test]
    fn measured_methods_have_the_first_colours() {
        let series = |label: &str, origin| OverlapBinSeries {
            label: label.to_owned(),
            means: vec![Some(Estimate::exact(20.0))],
            origin,
        };
        let plot = OverlapBinMeans {
            title: "PSNR by overlap".to_owned(),
            subtitle: "RealEstate10K by overlap, 60 scenes".to_owned(),
            quality: definition("psnr").unwrap().into(),
            bins: vec!["average".to_owned()],
            series: vec![
                series("a (paper)", Origin::Published),
                series("b", Origin::Measured),
                series("c (paper)", Origin::Published),
                series("d", Origin::Measured),
            ],
        };
        assert_eq!([0, 1, 2, 3].map(|at| plot.colour_of(at)), [2, 0, 3, 1].map(colour));
    }
}
