use atsplat_pixels::ImageU8;

use super::Drawing;
use super::picture_grid::{GridCell, GridRow, PictureGrid};

/// Views rendered with expansion enabled in more and more of the decoder's blocks, followed by the truth.
#[derive(Clone, Debug)]
pub struct ExpansionStrips {
    /// Title.
    pub title: String,
    /// Method, protocol.
    pub subtitle: String,
    /// Names of the columns: `no expansion`, `block 1`, …, `truth`.
    pub columns: Vec<String>,
    /// One per view.
    pub strips: Vec<ExpansionStrip>,
}

/// One view.
#[derive(Clone, Debug)]
pub struct ExpansionStrip {
    /// Scene and frame.
    pub label: String,
    /// One per column.
    pub pictures: Vec<StripPicture>,
}

/// One picture.
#[derive(Clone, Debug)]
pub struct StripPicture {
    /// The render.
    pub image: ImageU8,
    /// Score and number of Gaussians.
    pub caption: String,
}

impl ExpansionStrips {
    /// Draws it.
    pub fn draw(&self) -> Drawing {
        let rows = self.strips.iter().map(|strip| GridRow {
            label: &strip.label,
            cells: strip
                .pictures
                .iter()
                .map(|picture| Some(GridCell::new(&picture.image, picture.caption.clone())))
                .collect(),
        });
        PictureGrid {
            title: &self.title,
            subtitle: &self.subtitle,
            columns: self.columns.clone(),
            rows: rows.collect(),
        }
        .draw()
    }
}
