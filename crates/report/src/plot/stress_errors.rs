use atsplat_numeric::{Extremes as _, distinct};

use super::drawing::axes::{Axes, AxisText};
use super::drawing::scale::Scale;
use super::drawing::shape::{Drawing, Extent, Fill, MARGIN, Role, Side, Stroke, TextLine};
use super::drawing::theme::{GRID, INK, colour};
use crate::numbers::{fixed, with_minus_sign};

/// Errors of renderers on hard cases: a row per case, a dot per renderer next to its bound, failures crossed out, and a ring for an
/// error that has no bound.
#[derive(Debug)]
pub struct StressErrors<'a> {
    /// The errors, in the order of cases and renderers.
    pub errors: &'a [StressError<'a>],
}

/// One error of a renderer on a hard case.
#[derive(Clone, Copy, Debug)]
pub struct StressError<'a> {
    /// Name of the case.
    pub case: &'a str,
    /// Name of the renderer.
    pub renderer: &'a str,
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
const ROW: f64 = 19.0;
const NAMES: f64 = 210.0;
/// Range of powers of ten; smaller errors are drawn at the left edge, larger ones and NaN at the right edge.
const LOWEST: f64 = -9.0;
const HIGHEST: f64 = 0.0;
const PANELS: [(&str, &str); 3] = [
    ("image", "error of images, power of ten"),
    ("gradient", "error of derivatives, power of ten"),
    ("differences", "derivatives against differences, power of ten"),
];

impl StressErrors<'_> {
    /// Draws it.
    pub fn draw(&self) -> Drawing {
        let cases = distinct(self.errors.iter().map(|error| error.case));
        let renderers = distinct(self.errors.iter().map(|error| error.renderer));
        let failed = self.errors.iter().filter(|error| !error.passes).count();
        let is_shown = |error: &&StressError<'_>| PANELS.iter().any(|(kind, _)| *kind == error.kind);
        let unbounded = self.errors.iter().filter(is_shown).filter(|error| !error.bound.is_finite()).count();
        let unbounded = if unbounded > 0 { format!(", {unbounded} without a bound") } else { String::new() };
        let subtitle = format!(
            "{} hard cases on {} renderers; relative errors, {failed} beyond their bounds{unbounded}",
            cases.len(),
            renderers.len()
        );
        let (mut drawing, head) = Drawing::titled(WIDTH, "Hard cases: error by case", &subtitle);
        let mut keys = renderers.clone();
        keys.extend(["the renderer's bound, in its colour", "beyond the bound"]);
        keys.extend((!unbounded.is_empty()).then_some("without a bound"));
        let bottom =
            drawing.legend(MARGIN, head + 12.0, &keys, |drawing, at, [x, y]| match at.checked_sub(renderers.len()) {
                None => drawing.disc([x, y], 4.0, Fill::solid(colour(at))),
                Some(0) => drawing.line([[x, y - 6.0], [x, y + 6.0]], Stroke::new(INK, 2.0)),
                Some(1) => cross(drawing, [x, y]),
                Some(_) => drawing.ring([x, y], 3.5, Stroke::new(INK, 1.5)),
            });
        let top = bottom + 14.0;
        let height = ROW * cases.len() as f64;
        for (at, case) in cases.iter().enumerate() {
            let y = top + ROW * at as f64;
            if at % 2 == 1 {
                let band = Extent::new(NAMES, y, f64::from(WIDTH) - MARGIN, y + ROW);
                drawing.rectangle(band, Fill::faint(GRID, 0.5));
            }
            drawing.text(TextLine::new(*case, [NAMES - 10.0, y + ROW / 2.0]).small().side(Side::Right));
        }
        let pitch = (f64::from(WIDTH) - NAMES - MARGIN) / PANELS.len() as f64;
        let mut below = top + height;
        for (at, (kind, title)) in PANELS.into_iter().enumerate() {
            let left = NAMES + pitch * at as f64 + 12.0;
            let inside = Extent::new(left, top, left + pitch - 24.0, top + height);
            let axes = Axes { inside, x: Scale::linear(LOWEST, HIGHEST), y: Scale::linear(0.0, 1.0) };
            let powers: Vec<f64> = (-9..=0).map(f64::from).collect();
            axes.draw_x_grid(&mut drawing, &powers);
            let label = |power: f64, _: &[f64]| with_minus_sign(&fixed(power, 0));
            let edge = axes.draw_x_at(&mut drawing, &AxisText { title, label: &label }, &powers);
            below = below.maximum_of(edge);
            for error in self.errors.iter().filter(|error| error.kind == kind) {
                let place = |all: &[&str], name: &str| all.iter().position(|known| *known == name);
                let (Some(case), Some(renderer)) = (place(&cases, error.case), place(&renderers, error.renderer))
                else {
                    continue;
                };
                let part = (ROW - 3.0) / renderers.len() as f64;
                let upper = top + ROW * case as f64 + 1.5 + part * renderer as f64;
                let (bound, at) =
                    (axes.x_of(power(error.bound)), [axes.x_of(power(error.relative)), upper + part / 2.0]);
                drawing.data(error.renderer, |drawing| {
                    // Without a bound, an error must only be finite.
                    if error.bound.is_finite() {
                        drawing.line([[bound, upper], [bound, upper + part]], Stroke::new(colour(renderer), 2.5));
                        drawing.disc(at, 2.5, Fill::solid(colour(renderer)));
                    } else {
                        drawing.ring(at, 2.5, Stroke::new(colour(renderer), 1.5));
                    }
                });
                if !error.passes {
                    cross(&mut drawing, at);
                }
            }
        }
        drawing.end_at(below + 14.0);
        drawing
    }
}

fn cross(drawing: &mut Drawing, [x, y]: [f64; 2]) {
    drawing.with(Role::Frame, |drawing| {
        for slope in [-5.0, 5.0] {
            drawing.line([[x - 5.0, y - slope], [x + 5.0, y + slope]], Stroke::new(INK, 2.0));
        }
    });
}

/// The power of ten, within the range of the plot.
fn power(value: f64) -> f64 {
    let power = value.log10();
    if power.is_nan() { HIGHEST } else { power.clamp(LOWEST, HIGHEST) }
}

#[cfg(test)]
mod tests {
    use super::super::drawing::shape::{Item, Shape};
    use super::*;

    fn errors() -> Vec<StressError<'static>> {
        let rows = [("needles", "reference", 1e-8), ("needles", "cpu", 1e-6), ("dust", "reference", f64::NAN)];
        let error = |case, renderer, kind, relative| {
            let bound = 1e-4;
            StressError { case, renderer, kind, relative, bound, passes: relative <= bound }
        };
        let both = |(case, renderer, relative)| {
            [error(case, renderer, "image", relative), error(case, renderer, "gradient", 10.0 * relative)]
        };
        rows.into_iter().flat_map(both).collect()
    }

    #[test]
    fn shows_names_and_errors_and_each_renderers_bound() {
        let errors = errors();
        let drawing = StressErrors { errors: &errors }.draw();
        let texts: Vec<&str> = drawing.texts().collect();
        for name in ["needles", "dust", "reference", "cpu", "error of derivatives, power of ten"] {
            assert!(texts.contains(&name), "{name}");
        }
        let of_renderer = |renderer: &str| {
            let items =
                drawing.items.iter().filter(move |item| matches!(&item.role, Role::Data(name) if &**name == renderer));
            let is_dot = |item: &&Item| matches!(item.shape, Shape::Disc { .. });
            (items.clone().filter(is_dot).count(), items.filter(|item| !is_dot(item)).count())
        };
        assert_eq!((of_renderer("reference"), of_renderer("cpu")), ((4, 4), (2, 2)), "dots and bounds");
        assert_eq!(drawing.faults(), []);
    }

    /// Large errors without a bound are not failures, which only the count and the rings explain.
    #[test]
    fn errors_without_a_bound_are_counted_and_drawn_as_rings() {
        let mut errors = errors();
        let subtitle = |errors: &[StressError<'_>]| {
            let drawing = StressErrors { errors }.draw();
            let mut found = drawing.texts().filter(|text| text.contains("beyond their bounds"));
            found.next().map(str::to_owned)
        };
        let before = "2 hard cases on 2 renderers; relative errors, 2 beyond their bounds";
        assert_eq!(subtitle(&errors).as_deref(), Some(before));
        for error in errors.iter_mut().filter(|error| error.kind == "gradient" && error.passes) {
            (error.relative, error.bound) = (7.0, f64::INFINITY);
        }
        let unseen = StressError { kind: "another", bound: f64::INFINITY, ..errors[0] };
        errors.push(unseen);
        assert_eq!(subtitle(&errors), Some(format!("{before}, 2 without a bound")));
        let drawing = StressErrors { errors: &errors }.draw();
        let rings = drawing.items.iter().filter(|item| matches!(item.shape, Shape::Ring { .. }));
        assert_eq!(rings.count(), 3, "of both errors, and of the legend");
    }

    #[test]
    fn errors_stay_inside_the_plot() {
        for (value, expected) in [(0.0, LOWEST), (1e-30, LOWEST), (1e-4, -4.0), (7.0, HIGHEST), (f64::NAN, HIGHEST)] {
            atsplat_numeric::Tolerance::absolute(1e-12).assert([power(value)], [expected], "power");
        }
    }
}
