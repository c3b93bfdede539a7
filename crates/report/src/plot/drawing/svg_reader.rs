use std::collections::BTreeMap;

use plotters::style::RGBColor;

use super::shape::{Drawing, Extent, Fill, Role, Shape, Side, Stroke, TextLine};
use super::svg::BASELINE;
use super::theme::SURFACE;

impl Drawing {
    /// Reads what [`to_svg`](Self::to_svg) wrote, so that tests can check the plots of a written report. Images become
    /// empty boxes of their size, and a text of several lines becomes several texts. Anything else is an error, with its
    /// line.
    pub(crate) fn of_svg(svg: &str) -> Result<Self, String> {
        let mut drawing = None;
        for (at, line) in svg.lines().enumerate() {
            let wrong = |expected: &str| format!("SVG, line {}: expected {expected}, found {line:?}", at + 1);
            let element = Element::of(line).ok_or_else(|| wrong("one element a line"))?;
            let known = match (&mut drawing, element.name) {
                (None, "svg") => {
                    drawing = element.size().map(|[width, height]| {
                        let mut drawing = Self::new(0, 0);
                        (drawing.width, drawing.height) = (width, height);
                        drawing
                    });
                    drawing.is_some()
                }
                (Some(_), "rect" | "/svg") => true,
                (Some(drawing), _) => element.add_to(drawing).is_some(),
                (None, _) => false,
            };
            if !known {
                return Err(wrong("an element as plots write it"));
            }
        }
        drawing.ok_or_else(|| "SVG: expected an svg element, found nothing".to_owned())
    }
}

/// An element with its attributes and its text.
struct Element<'a> {
    name: &'a str,
    attributes: BTreeMap<&'a str, &'a str>,
    text: &'a str,
}

impl<'a> Element<'a> {
    fn of(line: &'a str) -> Option<Self> {
        let line = line.strip_prefix('<')?;
        let end = line.find([' ', '>'])?;
        let (name, mut rest) = line.split_at(end);
        let mut attributes = BTreeMap::new();
        while let Some(attribute) = rest.strip_prefix(' ') {
            let (key, after) = attribute.split_once("=\"")?;
            let (value, after) = after.split_once('"')?;
            attributes.insert(key, value);
            rest = after;
        }
        let text = match rest.strip_prefix('>') {
            Some(text) => text.strip_suffix("</text>").unwrap_or(text),
            None => rest.strip_prefix("/>")?,
        };
        Some(Self { name, attributes, text })
    }

    fn number(&self, key: &str) -> Option<f64> {
        self.attributes.get(key)?.parse().ok()
    }

    fn size(&self) -> Option<[u32; 2]> {
        Some([self.attributes.get("width")?.parse().ok()?, self.attributes.get("height")?.parse().ok()?])
    }

    fn colour(&self, key: &str) -> Option<RGBColor> {
        let digits = self.attributes.get(key)?.strip_prefix('#').filter(|digits| digits.len() == 6)?;
        let part = |at: usize| u8::from_str_radix(digits.get(at..at + 2)?, 16).ok();
        Some(RGBColor(part(0)?, part(2)?, part(4)?))
    }

    fn points(&self) -> Option<Vec<[f64; 2]>> {
        let pair = |text: &str| {
            let (x, y) = text.split_once(',')?;
            Some([x.parse().ok()?, y.parse().ok()?])
        };
        self.attributes.get("points")?.split_whitespace().map(pair).collect()
    }

    fn role(&self) -> Option<Role> {
        let series = || Some(unescaped(self.attributes.get("data-series")?).into());
        let axis = || self.attributes.get("data-axis")?.parse().ok();
        Some(match self.attributes.get("data-role").copied() {
            None => Role::Plain,
            Some("frame") => Role::Frame,
            Some("data") => Role::Data(series()?),
            Some("band") => Role::Band(series()?),
            Some("key") => Role::Key(series()?),
            Some("inside") => Role::Inside,
            Some("title") => Role::Title,
            Some("subtitle") => Role::Subtitle,
            Some("tick") => Role::Tick(axis()?),
            Some("axis") => Role::Axis(axis()?),
            Some(_) => return None,
        })
    }

    fn shape(&self) -> Option<Shape> {
        let stroke = || Some(Stroke::new(self.colour("stroke")?, self.number("stroke-width")?));
        let fill = || Some(Fill::faint(self.colour("fill")?, self.number("fill-opacity").unwrap_or(1.0)));
        let centre = || Some([self.number("cx")?, self.number("cy")?]);
        Some(match self.name {
            "polyline" => Shape::Line { points: self.points()?, stroke: stroke()? },
            "polygon" => Shape::Area { corners: self.points()?, fill: fill()? },
            "circle" if self.attributes.contains_key("stroke") => {
                Shape::Ring { centre: centre()?, radius: self.number("r")?, stroke: stroke()? }
            }
            "circle" => Shape::Disc { centre: centre()?, radius: self.number("r")?, fill: fill()? },
            "image" => {
                let (left, top) = (self.number("x")?, self.number("y")?);
                let at = Extent::new(left, top, left + self.number("width")?, top + self.number("height")?);
                let RGBColor(r, g, b) = SURFACE;
                Shape::Image { at, image: atsplat_pixels::ImageU8::new(1, 1, vec![r, g, b]).ok()? }
            }
            "text" => {
                let size = self.number("font-size")?;
                let at = [self.number("x")?, self.number("y")? - size * BASELINE];
                let side = match self.attributes.get("text-anchor").copied() {
                    None => Side::Left,
                    Some("middle") => Side::Middle,
                    Some("end") => Side::Right,
                    Some(_) => return None,
                };
                let bold = self.attributes.contains_key("font-weight");
                let text = TextLine::new(unescaped(self.text), at).side(side);
                Shape::Text(TextLine { size, bold, colour: self.colour("fill")?, ..text })
            }
            _ => return None,
        })
    }

    fn add_to(&self, drawing: &mut Drawing) -> Option<()> {
        let (shape, role) = (self.shape()?, self.role()?);
        drawing.with(role, |drawing| drawing.push(shape));
        Some(())
    }
}

fn unescaped(text: &str) -> String {
    text.replace("&lt;", "<").replace("&gt;", ">").replace("&quot;", "\"").replace("&amp;", "&")
}
