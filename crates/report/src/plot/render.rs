use atsplat_pixels::{ImageU8, encode_png};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::font::{FAMILIES, FONT, PIXELS_PER_CSS, SVG_PER_CSS, register_fonts};
use super::shape::{Drawing, Extent, Fill, Shape, Side, Stroke, Words};
use super::theme::SURFACE;
use crate::ReportError;

/// What plots are written as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlotFormat {
    /// Vectors, with text as text.
    Svg,
    /// Pixels, two to a CSS pixel in each direction.
    Png,
}

impl PlotFormat {
    /// The ending of a file's name.
    pub const fn extension(self) -> &'static str {
        match self {
            Self::Svg => "svg",
            Self::Png => "png",
        }
    }
}

/// plotters counts in whole pixels: a quarter of one is as fine as a reader sees.
const SVG_SCALE: u32 = 4;
const PNG_SCALE: u32 = 2;
/// A browser puts the middle of small letters at a text's place, plotters' pixels the middle of a line.
const RASTER_DROP: f64 = 0.17;

impl Drawing {
    /// The file's bytes; the same drawing gives the same bytes.
    ///
    /// # Errors
    /// [`ReportError::Font`], [`ReportError::Plot`] where plotters refuses, [`ReportError::Picture`].
    pub fn encode(&self, format: PlotFormat) -> Result<Vec<u8>, ReportError> {
        match format {
            PlotFormat::Svg => Ok(self.to_svg()?.into_bytes()),
            PlotFormat::Png => Ok(encode_png(&self.to_image()?)?),
        }
    }

    /// The drawing as SVG.
    ///
    /// # Errors
    /// As [`encode`](Self::encode).
    pub fn to_svg(&self) -> Result<String, ReportError> {
        let size = (self.width * SVG_SCALE, self.height * SVG_SCALE);
        let mut text = svg_of(size, |area| self.draw(area, SVG_SCALE))?;
        let sized = format!("width=\"{}\" height=\"{}\" viewBox", size.0, size.1);
        text = text.replacen(&sized, &format!("width=\"{}\" height=\"{}\" viewBox", self.width, self.height), 1);
        let mut pictures = String::new();
        for shape in &self.shapes {
            if let Shape::Picture { at, image } = shape {
                pictures.push_str(&svg_picture(*at, image)?);
            }
        }
        // Pictures lie below everything but the surface, which is the first thing drawn.
        if let Some(surface) = text.match_indices("/>\n").next().map(|(at, end)| at + end.len()) {
            text.insert_str(surface, &pictures);
        }
        Ok(text)
    }

    /// The drawing in pixels, two to a CSS pixel.
    ///
    /// # Errors
    /// As [`encode`](Self::encode).
    pub fn to_image(&self) -> Result<ImageU8, ReportError> {
        let size = (self.width * PNG_SCALE, self.height * PNG_SCALE);
        image_of(size, |area| self.draw(area, PNG_SCALE))
    }

    fn draw<B: DrawingBackend>(&self, area: &DrawingArea<B, Shift>, scale: u32) -> Result<(), ReportError>
    where
        B::ErrorType: 'static,
    {
        let raster = scale == PNG_SCALE;
        let (font, drop) = if raster { (PIXELS_PER_CSS, RASTER_DROP) } else { (SVG_PER_CSS, 0.0) };
        let pen = Pen { area, scale: f64::from(scale), font, drop };
        pen.area.fill(&SURFACE).map_err(refused)?;
        // What an SVG embeds is blitted here; SVG itself gets it from `to_svg`.
        if raster {
            for shape in &self.shapes {
                if let Shape::Picture { at, image } = shape {
                    pen.blit(*at, image)?;
                }
            }
        }
        self.shapes.iter().try_for_each(|shape| pen.draw(shape))?;
        pen.area.present().map_err(refused)
    }
}

/// Lets `draw` fill an SVG of this size with plotters' own elements.
///
/// # Errors
/// [`ReportError::Font`], and what `draw` says.
pub fn svg_of<E: From<ReportError>>(
    size: (u32, u32),
    draw: impl FnOnce(&DrawingArea<SVGBackend<'_>, Shift>) -> Result<(), E>,
) -> Result<String, E> {
    register_fonts()?;
    let mut text = String::new();
    {
        let area = SVGBackend::with_string(&mut text, size).into_drawing_area();
        draw(&area)?;
    }
    Ok(text.replace(&format!("font-family=\"{FONT}\""), &format!("font-family=\"{FAMILIES}\"")))
}

/// Lets `draw` fill pixels with plotters' own elements.
///
/// # Errors
/// [`ReportError::Font`], and what `draw` says.
pub fn image_of<E: From<ReportError>>(
    size: (u32, u32),
    draw: impl FnOnce(&DrawingArea<BitMapBackend<'_>, Shift>) -> Result<(), E>,
) -> Result<ImageU8, E> {
    register_fonts()?;
    let mut samples = vec![0; size.0 as usize * size.1 as usize * 3];
    {
        let area = BitMapBackend::with_buffer(&mut samples, size).into_drawing_area();
        draw(&area)?;
    }
    ImageU8::new(size.0, size.1, samples).map_err(|error| ReportError::from(error).into())
}

struct Pen<'a, B: DrawingBackend> {
    area: &'a DrawingArea<B, Shift>,
    scale: f64,
    /// What plotters calls a font of one CSS pixel.
    font: f64,
    /// How far a text is moved down, in parts of its size.
    drop: f64,
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
                self.area.draw(&PathElement::new(place(points), self.stroke(*stroke))).map_err(refused)
            }
            Shape::Area { corners, fill } => {
                self.area.draw(&Polygon::new(place(corners), filled(*fill))).map_err(refused)
            }
            Shape::Disc { centre, radius, fill } => {
                self.area.draw(&Circle::new(self.place(*centre), self.length(*radius), filled(*fill))).map_err(refused)
            }
            // Two discs: plotters' outlines of circles have ragged insides.
            Shape::Ring { centre, radius, stroke } => {
                let disc = |radius, style| Circle::new(self.place(*centre), self.length(radius), style);
                self.area.draw(&disc(radius + stroke.width / 2.0, stroke.colour.filled())).map_err(refused)?;
                self.area.draw(&disc(radius - stroke.width / 2.0, SURFACE.filled())).map_err(refused)
            }
            Shape::Words(words) => self.write(words),
            Shape::Picture { .. } => Ok(()),
        }
    }

    fn write(&self, words: &Words) -> Result<(), ReportError> {
        let style = if words.bold { FontStyle::Bold } else { FontStyle::Normal };
        let side = match words.side {
            Side::Left => HPos::Left,
            Side::Middle => HPos::Center,
            Side::Right => HPos::Right,
        };
        let font = (FONT, words.size * self.font * self.scale, style);
        let text = TextStyle::from(font).color(&words.colour).pos(Pos::new(side, VPos::Center));
        let [x, y] = words.at;
        self.area
            .draw(&Text::new(words.text.as_str(), self.place([x, y + words.size * self.drop]), text))
            .map_err(refused)
    }

    /// Nearest samples, so that a reader sees the pixels that were scored.
    fn blit(&self, at: Extent, image: &ImageU8) -> Result<(), ReportError> {
        let (left, top) = self.place([at.left, at.top]);
        let (width, height) = (self.length(at.width()), self.length(at.height()));
        for row in 0..height {
            for column in 0..width {
                let from = |at: u32, size: u32, samples: u32| {
                    u64::from(at) * u64::from(samples) / u64::from(size.clamp(1, u32::MAX))
                };
                let source = (from(column, width, image.width()), from(row, height, image.height()));
                let pixel = u32::try_from(source.0).ok().zip(u32::try_from(source.1).ok());
                let Some([r, g, b]) = pixel.and_then(|(x, y)| image.pixel(x, y)) else { continue };
                let (x, y) = (left.saturating_add_unsigned(column), top.saturating_add_unsigned(row));
                self.area.draw_pixel((x, y), &RGBColor(r, g, b)).map_err(refused)?;
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

#[expect(clippy::needless_pass_by_value, reason = "map_err hands errors over")]
fn refused<E: std::error::Error + Send + Sync>(error: DrawingAreaErrorKind<E>) -> ReportError {
    ReportError::Plot(error.to_string())
}

fn svg_picture(at: Extent, image: &ImageU8) -> Result<String, ReportError> {
    let scale = f64::from(SVG_SCALE);
    let data = STANDARD.encode(encode_png(image)?);
    Ok(format!(
        "<image x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" preserveAspectRatio=\"none\" href=\"data:image/png;base64,{data}\"/>\n",
        at.left * scale,
        at.top * scale,
        at.width() * scale,
        at.height() * scale,
    ))
}
