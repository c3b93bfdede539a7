use atsplat_eval::expansion::ProjectedToken;
use atsplat_numeric::Extremes as _;
use atsplat_pixels::ImageU8;

use super::drawing::shape::{Drawing, Extent, Fill, MARGIN, Stroke};
use super::drawing::theme::{INK, SURFACE, colour};

/// Expanded tokens as seen by a camera: children around their parents.
#[derive(Clone, Debug)]
pub struct TokenExpansion {
    /// Title.
    pub title: String,
    /// Scene, frame, how a token's position is found.
    pub subtitle: String,
    /// The camera's image, drawn below the tokens.
    pub image: Option<ImageU8>,
    /// Width and height of the image in pixels, in which positions are given.
    pub size: [f64; 2],
    /// Parents with their children.
    pub expansions: Vec<ProjectedToken>,
}

impl TokenExpansion {
    /// Draws it; tokens outside the image are omitted.
    pub fn draw(&self) -> Drawing {
        const LARGEST: f64 = 720.0;
        let [width, height] = self.size.map(|length| if length >= 1.0 { length } else { 1.0 });
        let scale = LARGEST / width.maximum_of(height);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "at most the largest side")]
        let page_width = (width * scale + 2.0 * MARGIN).clamp(480.0, 2000.0) as u32;
        let (mut drawing, head) = Drawing::titled(page_width, &self.title, &self.subtitle);
        let is_inside = |[x, y]: [f64; 2]| (0.0..=width).contains(&x) && (0.0..=height).contains(&y);
        let shown: Vec<&ProjectedToken> =
            self.expansions.iter().filter(|expansion| is_inside(expansion.parent)).collect();
        let top = Self::key(&mut drawing, head + 12.0, &shown) + 14.0;
        let inside = Extent::new(MARGIN, top, MARGIN + width * scale, top + height * scale);
        if let Some(image) = &self.image {
            drawing.image(inside, image.clone());
            drawing.rectangle(inside, Fill::faint(SURFACE, 0.45));
        }
        let place = |[x, y]: [f64; 2]| [inside.left + x * scale, inside.top + y * scale];
        for expansion in &shown {
            let block_colour = colour(expansion.block.saturating_sub(1));
            drawing.data(&name(expansion.block, &shown), |drawing| {
                for child in expansion.children.iter().filter(|child| is_inside(**child)) {
                    drawing.line([place(expansion.parent), place(*child)], Stroke::new(block_colour, 1.25));
                    drawing.disc(place(*child), 2.5, Fill::solid(block_colour));
                }
            });
        }
        for expansion in &shown {
            let stroke = Stroke::new(colour(expansion.block.saturating_sub(1)), 1.5);
            let at = place(expansion.parent);
            drawing.data(&name(expansion.block, &shown), |drawing| drawing.ring(at, 3.5, stroke));
        }
        drawing.end_at(inside.bottom + 20.0);
        drawing
    }

    /// The legend; returns its lower edge.
    fn key(drawing: &mut Drawing, top: f64, shown: &[&ProjectedToken]) -> f64 {
        let mut blocks: Vec<usize> = shown.iter().map(|expansion| expansion.block).collect();
        blocks.sort_unstable();
        blocks.dedup();
        let names: Vec<String> = blocks.iter().map(|block| name(*block, shown)).collect();
        let all: Vec<&str> = ["parent", "child"].into_iter().chain(names.iter().map(String::as_str)).collect();
        drawing.legend(MARGIN, top, &all, |drawing, at, [x, y]| match at {
            0 => drawing.ring([x, y], 3.5, Stroke::new(INK, 1.5)),
            1 => drawing.disc([x, y], 2.5, Fill::solid(INK)),
            _ => {
                let block_colour = blocks.get(at - 2).map_or(INK, |block| colour(block.saturating_sub(1)));
                drawing.rectangle(Extent::new(x - 6.0, y - 6.0, x + 6.0, y + 6.0), Fill::solid(block_colour));
            }
        })
    }
}

fn name(block: usize, shown: &[&ProjectedToken]) -> String {
    let count = shown.iter().filter(|expansion| expansion.block == block).count();
    format!("block {block}: {count}")
}
