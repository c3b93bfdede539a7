use std::fmt::Write as _;

use atsplat_pixels::encode_png;
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use plotters::style::RGBColor;

use super::font::{FAMILIES, register_fonts};
use super::shape::{Drawing, Item, Role, Shape, Side, TextLine};
use super::theme::SURFACE;
use crate::ReportError;

/// How far below its middle a text's baseline is, relative to its size.
pub(in crate::plot) const BASELINE: f64 = 0.27;

impl Drawing {
    /// The drawing as SVG. Each element's `data-role` says what it is, and `data-series` to which series it belongs.
    ///
    /// # Errors
    /// [`ReportError::Font`], [`ReportError::Image`].
    pub fn to_svg(&self) -> Result<String, ReportError> {
        register_fonts()?;
        let (width, height) = self.size();
        let mut svg = format!(
            "<svg width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\" xmlns=\"http://www.w3.org/2000/svg\" \
             font-family=\"{FAMILIES}\">\n<rect width=\"{width}\" height=\"{height}\" fill=\"{}\"/>\n",
            hex(SURFACE)
        );
        for Item { shape, role } in &self.items {
            let role = attributes(role);
            match shape {
                Shape::Text(text) => text.lines().iter().for_each(|line| svg.push_str(&printed(line, &role))),
                Shape::Image { at, image } => {
                    let data = STANDARD.encode(encode_png(image)?);
                    let [x, y, width, height] = [at.left, at.top, at.width(), at.height()].map(short);
                    svg.push_str(&format!(
                        "<image x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\" preserveAspectRatio=\"none\" \
                         style=\"image-rendering:pixelated\"{role} href=\"data:image/png;base64,{data}\"/>\n"
                    ));
                }
                other => svg.push_str(&drawn(other, &role)),
            }
        }
        svg.push_str("</svg>\n");
        Ok(svg)
    }
}

fn drawn(shape: &Shape, role: &str) -> String {
    match shape {
        Shape::Line { points, stroke } => format!(
            "<polyline points=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"{}\"{role}/>\n",
            path(points),
            hex(stroke.colour),
            short(stroke.width)
        ),
        Shape::Area { corners, fill } => format!(
            "<polygon points=\"{}\" fill=\"{}\"{}{role}/>\n",
            path(corners),
            hex(fill.colour),
            opacity(fill.opacity)
        ),
        Shape::Disc { centre: [x, y], radius, fill } => format!(
            "<circle cx=\"{}\" cy=\"{}\" r=\"{}\" fill=\"{}\"{}{role}/>\n",
            short(*x),
            short(*y),
            short(*radius),
            hex(fill.colour),
            opacity(fill.opacity)
        ),
        Shape::Ring { centre: [x, y], radius, stroke } => format!(
            "<circle cx=\"{}\" cy=\"{}\" r=\"{}\" fill=\"{}\" stroke=\"{}\" stroke-width=\"{}\"{role}/>\n",
            short(*x),
            short(*y),
            short(*radius),
            hex(SURFACE),
            hex(stroke.colour),
            short(stroke.width)
        ),
        Shape::Text(_) | Shape::Image { .. } => String::new(),
    }
}

fn printed(line: &TextLine, role: &str) -> String {
    let anchor = match line.side {
        Side::Left => "",
        Side::Middle => " text-anchor=\"middle\"",
        Side::Right => " text-anchor=\"end\"",
    };
    let [x, y] = line.at;
    format!(
        "<text x=\"{}\" y=\"{}\"{anchor} font-size=\"{}\"{} fill=\"{}\"{role}>{}</text>\n",
        short(x),
        short(y + line.size * BASELINE),
        short(line.size),
        if line.bold { " font-weight=\"bold\"" } else { "" },
        hex(line.colour),
        escaped(&line.text)
    )
}

fn attributes(role: &Role) -> String {
    let of_series = |kind: &str, name: &str| format!(" data-role=\"{kind}\" data-series=\"{}\"", escaped(name));
    match role {
        Role::Plain => String::new(),
        Role::Frame => " data-role=\"frame\"".to_owned(),
        Role::Data(name) => of_series("data", name),
        Role::Band(name) => of_series("band", name),
        Role::Key(name) => of_series("key", name),
        Role::Inside => " data-role=\"inside\"".to_owned(),
        Role::Title => " data-role=\"title\"".to_owned(),
        Role::Subtitle => " data-role=\"subtitle\"".to_owned(),
        Role::Tick(axis) => format!(" data-role=\"tick\" data-axis=\"{axis}\""),
        Role::Axis(axis) => format!(" data-role=\"axis\" data-axis=\"{axis}\""),
    }
}

fn path(points: &[[f64; 2]]) -> String {
    let mut text = String::new();
    for (at, [x, y]) in points.iter().enumerate() {
        let _ = write!(text, "{}{},{}", if at == 0 { "" } else { " " }, short(*x), short(*y));
    }
    text
}

/// A length with at most two decimals.
fn short(length: f64) -> String {
    let text = format!("{length:.2}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.to_owned() }
}

fn opacity(share: f64) -> String {
    if share < 1.0 { format!(" fill-opacity=\"{}\"", short(share)) } else { String::new() }
}

/// In upper case, as the page's dark theme expects it.
fn hex(RGBColor(r, g, b): RGBColor) -> String {
    format!("#{r:02X}{g:02X}{b:02X}")
}

fn escaped(text: &str) -> String {
    escaped_except(text, &[])
}

/// Text that is safe in elements and in attributes with double quotes; control characters, which XML does not allow, become
/// U+FFFD, except those in `kept`.
pub(crate) fn escaped_except(text: &str, kept: &[char]) -> String {
    let mut safe = String::with_capacity(text.len());
    for letter in text.chars() {
        match letter {
            '&' => safe.push_str("&amp;"),
            '<' => safe.push_str("&lt;"),
            '>' => safe.push_str("&gt;"),
            '"' => safe.push_str("&quot;"),
            letter if letter.is_control() && !kept.contains(&letter) => safe.push('\u{fffd}'),
            letter => safe.push(letter),
        }
    }
    safe
}
