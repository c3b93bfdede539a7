use atsplat_pixels::{ImageU8, encode_png};
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::font::{FONT, PIXELS_PER_CSS, register_fonts};
use super::shape::{Drawing, Extent, Fill, Shape, Side, Stroke, TextLine};
use super::theme::SURFACE;
use crate::ReportError;

/// A file format of plots.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlotFormat {
    /// Vector graphics, with text as text.
    Svg,
    /// Pixels, two per CSS pixel in each direction.
    Png,
}

impl PlotFormat {
    /// The file extension.
    pub const fn extension(self) -> &'static str {
        match self {
            Self::Svg => "svg",
            Self::Png => "png",
        }
    }
}

/// Pixels of a PNG per CSS pixel.
const SCALE: u32 = 2;
/// How far texts are moved down, as a fraction of their size: plotters centres a text vertically on its line, the SVGs
/// centre it on its lower-case letters.
const DROP: f64 = 0.17;

impl Drawing {
    /// The bytes of a file; equal drawings give equal bytes.
    ///
    /// # Errors
    /// [`ReportError::Font`], [`ReportError::Plot`] if plotters fails, [`ReportError::Image`].
    pub fn encode(&self, format: PlotFormat) -> Result<Vec<u8>, ReportError> {
        match format {
            PlotFormat::Svg => Ok(self.to_svg()?.into_bytes()),
            PlotFormat::Png => Ok(encode_png(&self.to_image()?)?),
        }
    }

    /// The drawing in pixels, two per CSS pixel.
    ///
    /// # Errors
    /// Those of [`encode`](Self::encode).
    pub fn to_image(&self) -> Result<ImageU8, ReportError> {
        register_fonts()?;
        let size = (self.width * SCALE, self.height * SCALE);
        let mut samples = vec![0; size.0 as usize * size.1 as usize * 3];
        {
            let area = BitMapBackend::with_buffer(&mut samples, size).into_drawing_area();
            let pen = Pen { area: &area, scale: f64::from(SCALE) };
            area.fill(&SURFACE).map_err(plot_error)?;
            self.items.iter().try_for_each(|item| pen.draw(&item.shape))?;
            area.present().map_err(plot_error)?;
        }
        Ok(ImageU8::new(size.0, size.1, samples)?)
    }
}

struct Pen<'a, B: DrawingBackend> {
    area: &'a DrawingArea<B, Shift>,
    scale: f64,
}

impl<B: DrawingBackend> Pen<'_, B>
where
    B::ErrorType: 'static,
{
    #[expect(clippy::cast_possible_truncation, reason = "floats saturate, and plots are thousands of pixels wide")]
    fn place(&self, [x, y]: [f64; 2]) -> (i32, i32) {
        ((x * self.scale).round() as i32, (y * self.scale).round() as i32)
    }

    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "lengths are small and not negative")]
    fn length(&self, length: f64) -> u32 {
        (length * self.scale).round() as u32
    }

    fn draw(&self, shape: &Shape) -> Result<(), ReportError> {
        let place = |points: &[[f64; 2]]| points.iter().map(|at| self.place(*at)).collect::<Vec<_>>();
        match shape {
            Shape::Line { points, stroke } => {
                self.area.draw(&PathElement::new(place(points), self.stroke(*stroke))).map_err(plot_error)
            }
            Shape::Area { corners, fill } => {
                self.area.draw(&Polygon::new(place(corners), filled(*fill))).map_err(plot_error)
            }
            Shape::Disc { centre, radius, fill } => self
                .area
                .draw(&Circle::new(self.place(*centre), self.length(*radius), filled(*fill)))
                .map_err(plot_error),
            // Two discs, because plotters' circle outlines have ragged insides.
            Shape::Ring { centre, radius, stroke } => {
                let disc = |radius, style| Circle::new(self.place(*centre), self.length(radius), style);
                self.area.draw(&disc(radius + stroke.width / 2.0, stroke.colour.filled())).map_err(plot_error)?;
                self.area.draw(&disc(radius - stroke.width / 2.0, SURFACE.filled())).map_err(plot_error)
            }
            Shape::Text(text) => text.lines().iter().try_for_each(|line| self.write(line)),
            Shape::Image { at, image } => self.blit(*at, image),
        }
    }

    fn write(&self, line: &TextLine) -> Result<(), ReportError> {
        let weight = if line.bold { FontStyle::Bold } else { FontStyle::Normal };
        let side = match line.side {
            Side::Left => HPos::Left,
            Side::Middle => HPos::Center,
            Side::Right => HPos::Right,
        };
        let font = (FONT, line.size * PIXELS_PER_CSS * self.scale, weight);
        let style = TextStyle::from(font).color(&line.colour).pos(Pos::new(side, VPos::Center));
        let [x, y] = line.at;
        self.area.draw(&Text::new(line.text.as_str(), self.place([x, y + line.size * DROP]), style)).map_err(plot_error)
    }

    /// Nearest-neighbour sampling, so that readers see the pixels that were scored.
    fn blit(&self, at: Extent, image: &ImageU8) -> Result<(), ReportError> {
        let (left, top) = self.place([at.left, at.top]);
        let (width, height) = (self.length(at.width()), self.length(at.height()));
        for row in 0..height {
            for column in 0..width {
                #[expect(clippy::cast_possible_truncation, reason = "less than the number of samples")]
                let source =
                    |at: u32, size: u32, samples: u32| (u64::from(at) * u64::from(samples) / u64::from(size)) as u32;
                #[expect(clippy::expect_used, reason = "both positions are less than the number of samples")]
                let [r, g, b] = image
                    .pixel(source(column, width, image.width()), source(row, height, image.height()))
                    .expect("a pixel of the image");
                let (x, y) = (left.saturating_add_unsigned(column), top.saturating_add_unsigned(row));
                self.area.draw_pixel((x, y), &RGBColor(r, g, b)).map_err(plot_error)?;
            }
        }
        Ok(())
    }

    fn stroke(&self, stroke: Stroke) -> ShapeStyle {
        ShapeStyle {
            color: stroke.colour.to_rgba(),
            filled: false,
            stroke_width: self.length(stroke.width).clamp(1, 1000),
        }
    }
}

fn filled(fill: Fill) -> ShapeStyle {
    fill.colour.mix(fill.opacity).filled()
}

#[expect(clippy::needless_pass_by_value, reason = "map_err passes errors by value")]
fn plot_error<E: std::error::Error + Send + Sync>(error: DrawingAreaErrorKind<E>) -> ReportError {
    ReportError::Plot(error.to_string())
}
