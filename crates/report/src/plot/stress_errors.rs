use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::native::{self, DrawResult, NativePlot};
use super::{FONT, GREY, PlotFormat, colour};
use crate::ReportError;

/// Errors of renderers on hard cases: a row per case, a dot per renderer path, its bound as a bar, failures crossed out.
#[derive(Debug)]
pub struct StressErrors<'a> {
    /// The errors, in the order of cases and paths.
    pub errors: &'a [StressError<'a>],
}

/// One error of a renderer path on a hard case.
#[derive(Clone, Copy, Debug)]
pub struct StressError<'a> {
    /// Name of the case.
    pub case: &'a str,
    /// Name of the renderer path.
    pub path: &'a str,
    /// `image`, `gradient` or `differences`; others are not shown.
    pub kind: &'a str,
    /// Relative error.
    pub relative: f64,
    /// The largest allowed error.
    pub bound: f64,
    /// Whether the error is within its bound.
    pub passes: bool,
}

const WIDTH: u32 = 1200;
const ROW: u32 = 17;
/// More rows would not be readable.
const MAX_ROWS: u32 = 10_000;
/// Height of title, legend and axis.
const AROUND: u32 = 150;
const NAMES: i32 = 210;
/// Range of powers of ten; smaller errors are drawn at the left edge, larger ones and NaN at the right edge.
const LOWEST: f64 = -9.0;
const HIGHEST: f64 = 0.0;
const PANELS: [(&str, &str); 3] = [
    ("image", "error of images"),
    ("gradient", "error of derivatives"),
    ("differences", "derivatives against differences"),
];

impl StressErrors<'_> {
    /// The bytes of the file; the same plot gives the same bytes.
    ///
    /// # Errors
    /// [`ReportError::Font`], [`ReportError::Plot`], [`ReportError::Picture`].
    pub fn encode(&self, format: PlotFormat) -> Result<Vec<u8>, ReportError> {
        native::encode(self, format)
    }
}

impl NativePlot for StressErrors<'_> {
    fn size(&self) -> (u32, u32) {
        let rows = u32::try_from(cases(self.errors).len()).unwrap_or(MAX_ROWS).min(MAX_ROWS);
        (WIDTH, AROUND + ROW * rows)
    }

    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>) -> DrawResult
    where
        B::ErrorType: 'static,
    {
        area.fill(&WHITE)?;
        let (cases, paths) = (cases(self.errors), paths(self.errors));
        let text = |size: i32| (FONT, size).into_text_style(area);
        area.draw(&Text::new("Hard cases: error by case", (16, 14), text(22)))?;
        let mut left = 16;
        for (at, path) in paths.iter().enumerate() {
            area.draw(&Circle::new((left + 6, 58), 5, colour(at).filled()))?;
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
            for error in self.errors.iter().filter(|error| error.kind == name) {
                let place = |all: &[&str], name: &str| all.iter().position(|own| *own == name);
                let (Some(case), Some(path)) = (place(&cases, error.case), place(&paths, error.path)) else { continue };
                let case = case as f64;
                let bound = power(error.bound);
                chart.draw_series([PathElement::new(
                    [(bound, case + 0.1), (bound, case + 0.9)],
                    GREY.stroke_width(3),
                )])?;
                let spread = (path as f64 + 0.5) / paths.len() as f64;
                let at = (power(error.relative), case + 0.15 + 0.7 * spread);
                draw_dot(&mut chart, at, colour(path), error.passes)?;
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
}

type Chart<'a, B> =
    ChartContext<'a, B, Cartesian2d<plotters::coord::types::RangedCoordf64, plotters::coord::types::RangedCoordf64>>;

/// A dot, crossed out if the error exceeds its bound.
fn draw_dot<B>(chart: &mut Chart<'_, B>, at: (f64, f64), colour: RGBColor, passes: bool) -> DrawResult
where
    B: DrawingBackend,
    B::ErrorType: 'static,
{
    chart.draw_series([Circle::new(at, 3, colour.filled())])?;
    if !passes {
        chart.draw_series([Cross::new(at, 7, RED.stroke_width(2))])?;
    }
    Ok(())
}

/// The power of ten, within the range of the plot.
fn power(value: f64) -> f64 {
    let power = value.log10();
    if power.is_nan() { HIGHEST } else { power.clamp(LOWEST, HIGHEST) }
}

fn cases<'a>(errors: &[StressError<'a>]) -> Vec<&'a str> {
    unique(errors.iter().map(|error| error.case))
}

fn paths<'a>(errors: &[StressError<'a>]) -> Vec<&'a str> {
    unique(errors.iter().map(|error| error.path))
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

    fn errors() -> Vec<StressError<'static>> {
        let rows = [("needles", "reference", 1e-8), ("needles", "cpu", 1e-6), ("dust", "reference", f64::NAN)];
        let error = |case, path, kind, relative| {
            let bound = 1e-4;
            StressError { case, path, kind, relative, bound, passes: relative <= bound }
        };
        let both = |(case, path, relative)| {
            [error(case, path, "image", relative), error(case, path, "gradient", 10.0 * relative)]
        };
        rows.into_iter().flat_map(both).collect()
    }

    #[test]
    fn shows_names_and_errors() {
        let bytes = StressErrors { errors: &errors() }.encode(PlotFormat::Svg).unwrap();
        let svg = String::from_utf8(bytes).unwrap();
        for name in ["needles", "dust", "reference", "cpu", "bound", "error of derivatives"] {
            assert!(svg.contains(name), "{name}");
        }
        let dots = svg.matches("<circle").count();
        assert_eq!(dots, 2 + 3 * 2, "a dot per path in the legend, one per error");
    }

    #[test]
    fn errors_stay_inside_the_plot() {
        for (value, expected) in [(0.0, LOWEST), (1e-30, LOWEST), (1e-4, -4.0), (7.0, HIGHEST), (f64::NAN, HIGHEST)] {
            atsplat_numeric::Tolerance::absolute(1e-12).assert([power(value)], [expected], "power");
        }
        let png = StressErrors { errors: &errors() }.encode(PlotFormat::Png).unwrap();
        let picture = atsplat_pixels::decode(&png, &atsplat_pixels::DecodeLimits::default()).unwrap();
        assert_eq!((picture.width(), picture.height()), (WIDTH, AROUND + 2 * ROW));
    }
}
