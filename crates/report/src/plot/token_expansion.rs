use atsplat_pixels::ImageU8;

use super::scale::bounds;
use super::shape::{Drawing, Extent, Fill, Side, Stroke, TextLine};
use super::theme::{INK, SURFACE, colour};

/// Expanded tokens as seen by a camera: children around their parents.
#[derive(Clone, Debug)]
pub struct TokenExpansion {
    /// Title.
    pub title: String,
    /// Scene, frame, how a token's position is found.
    pub subtitle: String,
    /// The camera's picture, drawn below the tokens.
    pub picture: Option<ImageU8>,
    /// Width and height of the picture in pixels, in which positions are given.
    pub size: [f64; 2],
    /// Parents with their children.
    pub expansions: Vec<Expansion>,
}

/// A parent and its children, in pixels: +x right, +y down.
#[derive(Clone, Debug)]
pub struct Expansion {
    /// The decoder block that expanded it, counted from 1.
    pub block: usize,
    /// The mean centre of the parent's Gaussians.
    pub parent: [f64; 2],
    /// The mean centres of its children's Gaussians.
    pub children: Vec<[f64; 2]>,
}

impl TokenExpansion {
    /// Draws it; tokens outside the picture are omitted.
    pub fn draw(&self) -> Drawing {
        const LARGEST: f64 = 720.0;
        let [width, height] = self.size.map(|length| if length >= 1.0 { length } else { 1.0 });
        let longest = if width > height { width } else { height };
        let scale = LARGEST / longest;
        let inside = Extent::new(20.0, 96.0, 20.0 + width * scale, 96.0 + height * scale);
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "at most the largest side and its margin"
        )]
        let mut drawing = Drawing::new(inside.right.clamp(480.0, 2000.0) as u32 + 20, inside.bottom as u32 + 20);
        drawing.heading(&self.title, &self.subtitle);
        if let Some(picture) = &self.picture {
            drawing.picture(inside, picture.clone());
            drawing.rectangle(inside, Fill::faint(SURFACE, 0.45));
        }
        let place = |[x, y]: [f64; 2]| [inside.left + x * scale, inside.top + y * scale];
        let is_inside = |[x, y]: [f64; 2]| (0.0..=width).contains(&x) && (0.0..=height).contains(&y);
        let shown: Vec<&Expansion> = self.expansions.iter().filter(|expansion| is_inside(expansion.parent)).collect();
        for expansion in &shown {
            let own = colour(expansion.block.saturating_sub(1));
            for child in expansion.children.iter().filter(|child| is_inside(**child)) {
                drawing.line([place(expansion.parent), place(*child)], Stroke::new(own, 1.25));
                drawing.disc(place(*child), 2.5, Fill::solid(own));
            }
        }
        for expansion in &shown {
            let own = colour(expansion.block.saturating_sub(1));
            drawing.ring(place(expansion.parent), 3.5, Stroke::new(own, 1.5));
        }
        Self::key(&mut drawing, &shown);
        drawing
    }

    fn key(drawing: &mut Drawing, shown: &[&Expansion]) {
        let blocks = bounds(shown.iter().map(|expansion| expansion.block as f64));
        let mut x = 20.0;
        let mut entry = |drawing: &mut Drawing, text: String, mark: &dyn Fn(&mut Drawing, [f64; 2])| {
            let text = TextLine { colour: INK, ..TextLine::new(text, [x + 16.0, 76.0]).size(12.0).side(Side::Left) };
            mark(drawing, [x + 6.0, 76.0]);
            x = text.extent().right + 20.0;
            drawing.text(text);
        };
        entry(drawing, "parent".to_owned(), &|drawing, at| drawing.ring(at, 3.5, Stroke::new(INK, 1.5)));
        entry(drawing, "child".to_owned(), &|drawing, at| drawing.disc(at, 2.5, Fill::solid(INK)));
        for block in
            (0..64usize).filter(|block| blocks.is_some_and(|(low, high)| (low..=high).contains(&(*block as f64))))
        {
            let count = shown.iter().filter(|expansion| expansion.block == block).count();
            let own = colour(block.saturating_sub(1));
            let swatch = move |drawing: &mut Drawing, [x, y]: [f64; 2]| {
                drawing.rectangle(Extent::new(x - 6.0, y - 6.0, x + 6.0, y + 6.0), Fill::solid(own));
            };
            entry(drawing, format!("block {block}: {count}"), &swatch);
        }
    }
}
