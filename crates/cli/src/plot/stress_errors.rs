use atsplat_pixels::encode_png;
use atsplat_report::plot::{COLOURS, FONT, GREY, PlotFormat, image_of, svg_of};
use atsplat_splat::stress::{MeasuredError, StressRow};
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

/// What [`draw_stress_errors`] shows.
#[derive(Debug)]
pub(crate) struct StressErrors<'a> {
    /// A row per case and path.
    pub(crate) rows: &'a [StressRow],
}

const WIDTH: u32 = 1200;
const ROW: u32 = 17;
/// Title, legend and axis.
const AROUND: u32 = 150;
const NAMES: i32 = 210;
/// Powers of ten: what is smaller stands at the left edge, what is larger or no number at the right.
const LOWEST: f64 = -9.0;
const HIGHEST: f64 = 0.0;
const PANELS: [(&str, &str); 3] = [
    ("image", "error of images"),
    ("gradient", "error of derivatives"),
    ("differences", "derivatives against differences"),
];

/// Draws a row per case: an error per path as a dot, its bound as a bar; returns the file's bytes.
pub(crate) fn draw_stress_errors(errors: &StressErrors<'_>, format: PlotFormat) -> anyhow::Result<Vec<u8>> {
    let size = (WIDTH, AROUND + ROW * u32::try_from(cases(errors.rows).len())?);
    match format {
        PlotFormat::Svg => Ok(svg_of(size, |area| draw(errors, area))?.into_bytes()),
        PlotFormat::Png => Ok(encode_png(&image_of(size, |area| draw(errors, area))?)?),
    }
}

fn draw<B>(errors: &StressErrors<'_>, area: &DrawingArea<B, Shift>) -> anyhow::Result<()>
where
    B: DrawingBackend,
    B::ErrorType: 'static,
{
    area.fill(&WHITE)?;
    let (cases, paths) = (cases(errors.rows), paths(errors.rows));
    let text = |size: i32| (FONT, size).into_text_style(area);
    area.draw(&Text::new("Hard cases: error by case", (16, 14), text(22)))?;
    let mut left = 16;
    for (path, colour) in paths.iter().zip(COLOURS.iter().cycle()) {
        area.draw(&Circle::new((left + 6, 58), 5, colour.filled()))?;
        area.draw(&Text::new(*path, (left + 17, 50), text(15)))?;
        left += 40 + i32::try_from(area.estimate_text_size(path, &text(15))?.0)?;
    }
    area.draw(&PathElement::new([(left + 6, 51), (left + 6, 65)], GREY.stroke_width(3)))?;
    area.draw(&Text::new("bound", (left + 17, 50), text(15)))?;

    let (_, below) = area.split_vertically(76);
    let (names, charts) = below.split_horizontally(NAMES);
    let panels = charts.split_evenly((1, PANELS.len()));
    for (panel, (name, title)) in panels.iter().zip(PANELS) {
        let mut chart = ChartBuilder::on(panel)
            .margin_left(18)
            .margin_right(18)
            .x_label_area_size(56)
            .build_cartesian_2d(LOWEST..HIGHEST, cases.len() as f64..0.0)?;
        chart
            .configure_mesh()
            .x_desc(title)
            .x_labels(10)
            .x_label_formatter(&|power| format!("1e{power:.0}"))
            .disable_y_axis()
            .disable_y_mesh()
            .label_style((FONT, 13))
            .axis_desc_style((FONT, 15))
            .light_line_style(WHITE)
            .draw()?;
        for case in 0..cases.len() {
            let top = case as f64;
            if case % 2 == 1 {
                let band = [(LOWEST, top), (HIGHEST, top + 1.0)];
                chart.draw_series([Rectangle::new(band, BLACK.mix(0.04).filled())])?;
            }
        }
        for row in errors.rows {
            let place = |all: &[&str], name: &str| all.iter().position(|own| *own == name).unwrap_or_default();
            let (case, path) = (place(&cases, &row.case) as f64, place(&paths, &row.path));
            let Some(error) = row.error(name).filter(|error| error.compared > 0) else { continue };
            let bound = power(error.bound);
            chart.draw_series([PathElement::new([(bound, case + 0.1), (bound, case + 0.9)], GREY.stroke_width(3))])?;
            let spread = (path as f64 + 0.5) / paths.len() as f64;
            let at = (power(error.relative), case + 0.15 + 0.7 * spread);
            let colour = COLOURS.iter().cycle().nth(path).copied().unwrap_or(GREY);
            draw_dot(&mut chart, at, colour, error)?;
        }
        if name == PANELS[0].0 {
            let style = text(13).pos(Pos::new(HPos::Right, VPos::Center));
            for (case, name) in cases.iter().enumerate() {
                let (_, row) = chart.backend_coord(&(LOWEST, case as f64 + 0.5));
                let (_, top) = names.get_base_pixel();
                names.draw(&Text::new(*name, (NAMES - 10, row - top), style.clone()))?;
            }
        }
    }
    area.present()?;
    Ok(())
}

type Chart<'a, B> =
    ChartContext<'a, B, Cartesian2d<plotters::coord::types::RangedCoordf64, plotters::coord::types::RangedCoordf64>>;

/// What fails is crossed out.
fn draw_dot<B>(chart: &mut Chart<'_, B>, at: (f64, f64), colour: RGBColor, error: &MeasuredError) -> anyhow::Result<()>
where
    B: DrawingBackend,
    B::ErrorType: 'static,
{
    chart.draw_series([Circle::new(at, 3, colour.filled())])?;
    if !error.passes() {
        chart.draw_series([Cross::new(at, 7, RED.stroke_width(2))])?;
    }
    Ok(())
}

/// Of ten, within the plot.
fn power(value: f64) -> f64 {
    let power = value.log10();
    if power.is_nan() { HIGHEST } else { power.clamp(LOWEST, HIGHEST) }
}

fn cases(rows: &[StressRow]) -> Vec<&str> {
    unique(rows.iter().map(|row| row.case.as_str()))
}

fn paths(rows: &[StressRow]) -> Vec<&str> {
    unique(rows.iter().map(|row| row.path.as_str()))
}

fn unique<'a>(names: impl Iterator<Item = &'a str>) -> Vec<&'a str> {
    let mut list = Vec::new();
    for name in names {
        if !list.contains(&name) {
            list.push(name);
        }
    }
    list
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows() -> Vec<StressRow> {
        let error = |name, relative| MeasuredError { name, absolute: relative, relative, bound: 1e-4, compared: 5 };
        let row = |case: &str, path: &str, relative| StressRow {
            case: case.to_owned(),
            path: path.to_owned(),
            errors: vec![error("image", relative), error("gradient", 10.0 * relative)],
            non_finite: 0,
            findings: Vec::new(),
        };
        vec![row("needles", "reference", 1e-8), row("needles", "cpu", 1e-6), row("dust", "reference", f64::NAN)]
    }

    #[test]
    fn names_and_errors_are_there() {
        let rows = rows();
        let bytes = draw_stress_errors(&StressErrors { rows: &rows }, PlotFormat::Svg).unwrap();
        let svg = String::from_utf8(bytes).unwrap();
        for word in ["needles", "dust", "reference", "cpu", "bound", "error of derivatives"] {
            assert!(svg.contains(word), "{word}");
        }
        let dots = svg.matches("<circle").count();
        assert_eq!(dots, 2 + 3 * 2, "a dot per path in the legend, one per error");
    }

    #[test]
    fn errors_stay_in_the_picture() {
        for (value, expected) in [(0.0, LOWEST), (1e-30, LOWEST), (1e-4, -4.0), (7.0, HIGHEST), (f64::NAN, HIGHEST)] {
            atsplat_numeric::Tolerance::absolute(1e-12).assert([power(value)], [expected], "power");
        }
        let png = draw_stress_errors(&StressErrors { rows: &rows() }, PlotFormat::Png).unwrap();
        let picture = atsplat_pixels::decode(&png, &atsplat_pixels::DecodeLimits::default()).unwrap();
        assert_eq!((picture.width(), picture.height()), (WIDTH, AROUND + 2 * ROW));
    }
}
