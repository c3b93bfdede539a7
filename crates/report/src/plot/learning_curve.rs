use atsplat_numeric::Extremes as _;
use plotters::coord::Shift;
use plotters::coord::ranged1d::ValueFormatter;
use plotters::prelude::*;

use super::native::{self, DrawResult, NativePlot};
use super::{FONT, GREY, PlotFormat, colour};
use crate::ReportError;

const SIZE: (u32, u32) = (1000, 900);
/// Maximum number of points of a curve, each a mean over consecutive steps.
const POINTS: usize = 200;

/// The learning curve of a training run: loss by term above, PSNR next to that of the nearest context view below.
#[derive(Debug)]
pub struct LearningCurve<'a> {
    /// Title above the plot.
    pub title: &'a str,
    /// Number of each step.
    pub steps: &'a [u64],
    /// Name of each loss term, and its value at each step; `None` for skipped steps.
    pub losses: &'a [(&'static str, Vec<Option<f64>>)],
    /// Step, PSNR of the renders and PSNR of the nearest context view in dB, of each evaluation.
    pub evaluations: &'a [(u64, f64, f64)],
}

impl LearningCurve<'_> {
    /// The bytes of the file; the same plot gives the same bytes.
    ///
    /// # Errors
    /// [`ReportError::Font`], [`ReportError::Plot`], [`ReportError::Picture`].
    pub fn encode(&self, format: PlotFormat) -> Result<Vec<u8>, ReportError> {
        native::encode(self, format)
    }

    fn draw_losses<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> DrawResult
    where
        B::ErrorType: 'static,
    {
        let curves: Vec<Vec<(f64, f64)>> = self.losses.iter().map(|(_, values)| curve(self.steps, values)).collect();
        let values = || curves.iter().flatten().map(|(_, value)| *value).filter(|value| *value > 0.0);
        let (low, high) = range(values());
        let last = self.steps.last().map_or(1.0, |step| *step as f64 + 1.0);
        let (low, high) = if low < high { (low * 0.9, high * 1.1) } else { (1e-4, 1.0) };
        let mut builder = builder(area);
        builder.caption(self.title, (FONT, 22)).x_label_area_size(32);
        let mut chart = builder.build_cartesian_2d(0.0..last, (low..high).log_scale())?;
        mesh(&mut chart, "", "loss, by term")?;
        for (position, ((name, _), points)) in self.losses.iter().zip(curves).enumerate() {
            let colour = colour(position);
            if points.is_empty() {
                continue;
            }
            let series = chart.draw_series(LineSeries::new(points, colour.stroke_width(2)))?;
            series.label(*name).legend(move |(x, y)| PathElement::new([(x, y), (x + 16, y)], colour.stroke_width(2)));
        }
        legend(&mut chart)
    }

    fn draw_scores<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> DrawResult
    where
        B::ErrorType: 'static,
    {
        let last = self.evaluations.last().map_or(1.0, |(step, ..)| *step as f64 + 1.0);
        let all = || self.evaluations.iter().flat_map(|(_, renders, nearest)| [*renders, *nearest]);
        let (low, high) = range(all());
        let (low, high) = if low <= high { (low - 1.0, high + 1.0) } else { (0.0, 1.0) };
        let mut chart = builder(area).x_label_area_size(44).build_cartesian_2d(0.0..last, low..high)?;
        mesh(&mut chart, "steps", "PSNR in dB, fixed samples")?;
        let renders: Vec<f64> = self.evaluations.iter().map(|(_, renders, _)| *renders).collect();
        let copies: Vec<f64> = self.evaluations.iter().map(|(.., nearest)| *nearest).collect();
        for (name, colour, values) in [("renders", colour(0), renders), ("nearest context view", GREY, copies)] {
            let points = self.evaluations.iter().map(|(step, ..)| *step as f64).zip(values);
            let series = chart.draw_series(LineSeries::new(points, colour.stroke_width(2)))?;
            series.label(name).legend(move |(x, y)| PathElement::new([(x, y), (x + 16, y)], colour.stroke_width(2)));
        }
        legend(&mut chart)
    }
}

impl NativePlot for LearningCurve<'_> {
    fn size(&self) -> (u32, u32) {
        SIZE
    }

    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> DrawResult
    where
        B::ErrorType: 'static,
    {
        area.fill(&WHITE)?;
        let (above, below) = area.split_vertically(480);
        self.draw_losses(&above)?;
        self.draw_scores(&below)?;
        area.present()?;
        Ok(())
    }
}

/// Margins with room for labels; on the right for half of the last step's label.
fn builder<'b, B: DrawingBackend>(area: &DrawingArea<B, Shift>) -> ChartBuilder<'_, 'b, B> {
    let mut builder = ChartBuilder::on(area);
    builder.margin(12).margin_right(32).y_label_area_size(72);
    builder
}

fn mesh<B, X, Y>(chart: &mut ChartContext<'_, B, Cartesian2d<X, Y>>, x: &str, y: &str) -> DrawResult
where
    B: DrawingBackend,
    B::ErrorType: 'static,
    X: Ranged<ValueType = f64> + ValueFormatter<f64>,
    Y: Ranged<ValueType = f64> + ValueFormatter<f64>,
{
    let mut mesh = chart.configure_mesh();
    mesh.x_desc(x).y_desc(y).label_style((FONT, 15)).axis_desc_style((FONT, 16)).light_line_style(WHITE);
    mesh.x_label_formatter(&|step| format!("{step:.0}")).draw()?;
    Ok(())
}

fn legend<'a, B, X, Y>(chart: &mut ChartContext<'a, B, Cartesian2d<X, Y>>) -> DrawResult
where
    B: DrawingBackend + 'a,
    B::ErrorType: 'static,
    X: Ranged<ValueType = f64>,
    Y: Ranged<ValueType = f64>,
{
    chart
        .configure_series_labels()
        .label_font((FONT, 15))
        .background_style(WHITE.mix(0.85))
        .border_style(BLACK.mix(0.3))
        .draw()?;
    Ok(())
}

/// Minimum and maximum; minimum > maximum if there are no values.
fn range(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.minimum_of(value), high.maximum_of(value)))
}

/// Means over stretches of steps, at their middles, without skipped steps.
fn curve(steps: &[u64], values: &[Option<f64>]) -> Vec<(f64, f64)> {
    let stretch = steps.len().div_ceil(POINTS).max(1);
    let mean = |(steps, values): (&[u64], &[Option<f64>])| {
        let values: Vec<f64> = values.iter().copied().flatten().collect();
        let middle = *steps.get(steps.len() / 2)? as f64;
        (!values.is_empty()).then(|| (middle, values.iter().sum::<f64>() / values.len() as f64))
    };
    steps.chunks(stretch).zip(values.chunks(stretch)).filter_map(mean).filter(|(_, value)| *value > 0.0).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_are_means_without_skipped_steps() {
        let steps: Vec<u64> = (0..400).collect();
        let values: Vec<Option<f64>> = (0u32..400).map(|at| (at % 4 != 1).then_some(f64::from(at % 2 + 1))).collect();
        let points = curve(&steps, &values);
        assert_eq!((points.len(), points[0], points[1]), (200, (1.0, 1.0), (3.0, 1.5)));
    }
}
