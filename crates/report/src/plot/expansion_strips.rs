use atsplat_pixels::ImageU8;

use super::Drawing;
use super::drawing::image_grid::{GridCell, GridRow, ImageGrid};

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
    pub images: Vec<StripImage>,
}

/// One image.
#[derive(Clone, Debug)]
pub struct StripImage {
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
            cells: strip.images.iter().map(|image| Some(GridCell::new(&image.image, image.caption.clone()))).collect(),
        });
        ImageGrid { title: &self.title, subtitle: &self.subtitle, columns: self.columns.clone(), rows: rows.collect() }
            .draw()
    }
}
