//! The learning curve: loss by term above, PSNR next to that of the nearest view below.

use atsplat_numeric::Extremes as _;
use atsplat_pixels::{ImageU8, encode_png};
use atsplat_report::plot::{COLOURS, FONT, GREY, register_fonts};
use atsplat_train::Terms;
use atsplat_train::journal::{EvaluationRecord, StepRecord};
use plotters::coord::Shift;
use plotters::coord::ranged1d::ValueFormatter;
use plotters::prelude::*;

const SIZE: (u32, u32) = (1000, 900);
/// Maximum number of points of a curve, each a mean over consecutive steps.
const POINTS: usize = 200;

/// Draws the curves of a run as PNG.
pub(super) fn draw(title: &str, steps: &[StepRecord], evaluations: &[EvaluationRecord]) -> anyhow::Result<Vec<u8>> {
    register_fonts()?;
    let (width, height) = SIZE;
    let mut samples = vec![0; width as usize * height as usize * 3];
    {
        let area = BitMapBackend::with_buffer(&mut samples, SIZE).into_drawing_area();
        area.fill(&WHITE)?;
        let (above, below) = area.split_vertically(480);
        losses(title, steps, &above)?;
        scores(evaluations, &below)?;
        area.present()?;
    }
    Ok(encode_png(&ImageU8::new(width, height, samples)?)?)
}

type Area<'a> = DrawingArea<BitMapBackend<'a>, Shift>;

fn losses(title: &str, steps: &[StepRecord], area: &Area<'_>) -> anyhow::Result<()> {
    let names = Terms::default().named().map(|(name, _)| name);
    let curves: Vec<Vec<(f64, f64)>> = (0..names.len()).map(|term| curve(steps, term)).collect();
    let values = || curves.iter().flatten().map(|(_, value)| *value).filter(|value| *value > 0.0);
    let (low, high) = range(values());
    let last = steps.last().map_or(1.0, |record| record.step as f64 + 1.0);
    let (low, high) = if low < high { (low * 0.9, high * 1.1) } else { (1e-4, 1.0) };
    let mut builder = builder(area);
    builder.caption(title, (FONT, 22)).x_label_area_size(32);
    let mut chart = builder.build_cartesian_2d(0.0..last, (low..high).log_scale())?;
    mesh(&mut chart, "", "loss, by term")?;
    for (position, (name, points)) in names.into_iter().zip(curves).enumerate() {
        let colour = COLOURS.get(position % COLOURS.len()).copied().unwrap_or(GREY);
        if points.is_empty() {
            continue;
        }
        let series = chart.draw_series(LineSeries::new(points, colour.stroke_width(2)))?;
        series.label(name).legend(move |(x, y)| PathElement::new([(x, y), (x + 16, y)], colour.stroke_width(2)));
    }
    legend(&mut chart)
}

fn scores(evaluations: &[EvaluationRecord], area: &Area<'_>) -> anyhow::Result<()> {
    let last = evaluations.last().map_or(1.0, |record| record.step as f64 + 1.0);
    let all = || evaluations.iter().flat_map(|record| [record.psnr, record.nearest_view_psnr]);
    let (low, high) = range(all());
    let (low, high) = if low <= high { (low - 1.0, high + 1.0) } else { (0.0, 1.0) };
    let mut chart = builder(area).x_label_area_size(44).build_cartesian_2d(0.0..last, low..high)?;
    mesh(&mut chart, "steps", "PSNR in dB, fixed samples")?;
    let renders: Vec<f64> = evaluations.iter().map(|record| record.psnr).collect();
    let copies: Vec<f64> = evaluations.iter().map(|record| record.nearest_view_psnr).collect();
    for (name, colour, values) in [("renders", COLOURS[0], renders), ("nearest context view", GREY, copies)] {
        let points = evaluations.iter().map(|record| record.step as f64).zip(values);
        let series = chart.draw_series(LineSeries::new(points, colour.stroke_width(2)))?;
        series.label(name).legend(move |(x, y)| PathElement::new([(x, y), (x + 16, y)], colour.stroke_width(2)));
    }
    legend(&mut chart)
}

/// Margins with room for labels; on the right for half of the last step's label.
fn builder<'a, 'b>(area: &'a Area<'b>) -> ChartBuilder<'a, 'b, BitMapBackend<'b>> {
    let mut builder = ChartBuilder::on(area);
    builder.margin(12).margin_right(32).y_label_area_size(72);
    builder
}

fn mesh<X, Y>(
    chart: &mut ChartContext<'_, BitMapBackend<'_>, Cartesian2d<X, Y>>,
    across: &str,
    upwards: &str,
) -> anyhow::Result<()>
where
    X: Ranged<ValueType = f64> + ValueFormatter<f64>,
    Y: Ranged<ValueType = f64> + ValueFormatter<f64>,
{
    let mut mesh = chart.configure_mesh();
    mesh.x_desc(across).y_desc(upwards).label_style((FONT, 15)).axis_desc_style((FONT, 16)).light_line_style(WHITE);
    mesh.x_label_formatter(&|step| format!("{step:.0}")).draw()?;
    Ok(())
}

fn legend<'a, X, Y>(chart: &mut ChartContext<'a, BitMapBackend<'a>, Cartesian2d<X, Y>>) -> anyhow::Result<()>
where
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

/// Means of a term over stretches of steps, at their middles, without skipped steps.
fn curve(steps: &[StepRecord], term: usize) -> Vec<(f64, f64)> {
    let stretch = steps.len().div_ceil(POINTS).max(1);
    let mean = |records: &[StepRecord]| {
        let values: Vec<f64> = records.iter().filter_map(|record| Some(record.terms?.named().get(term)?.1)).collect();
        let middle = records.get(records.len() / 2)?.step as f64;
        (!values.is_empty()).then(|| (middle, values.iter().sum::<f64>() / values.len() as f64))
    };
    steps.chunks(stretch).filter_map(mean).filter(|(_, value)| *value > 0.0).collect()
}
