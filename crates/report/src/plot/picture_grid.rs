use atsplat_pixels::ImageU8;

use super::font::shortened;
use super::shape::{Drawing, Extent, Side, TextLine};

/// Pictures in rows and columns, with a name above each column and a caption below each picture.
pub(super) struct PictureGrid<'a> {
    pub(super) title: &'a str,
    pub(super) subtitle: &'a str,
    pub(super) columns: Vec<String>,
    pub(super) rows: Vec<GridRow<'a>>,
}

pub(super) struct GridRow<'a> {
    pub(super) label: &'a str,
    /// One per column; `None` for an empty cell.
    pub(super) cells: Vec<Option<(&'a ImageU8, String)>>,
}

const WIDTH: f64 = 1000.0;
const GAP: f64 = 8.0;
const LEFT: f64 = 20.0;
const CAPTION: f64 = 26.0;

impl PictureGrid<'_> {
    pub(super) fn draw(&self) -> Drawing {
        let columns = self.columns.len().clamp(1, usize::MAX) as f64;
        let cell = ((WIDTH - 2.0 * LEFT - GAP * (columns - 1.0)) / columns).clamp(20.0, 320.0);
        let height_of = |row: &GridRow<'_>| {
            let shapes = row
                .cells
                .iter()
                .flatten()
                .map(|(image, _)| f64::from(image.height()) / f64::from(image.width().clamp(1, u32::MAX)));
            cell * shapes.fold(0.0, |tallest, shape| if shape > tallest { shape } else { tallest })
        };
        let top = if self.subtitle.is_empty() { 64.0 } else { 84.0 };
        let row_height = |row: &GridRow<'_>| height_of(row) + CAPTION + if row.label.is_empty() { 0.0 } else { 22.0 };
        let height = top + self.rows.iter().map(row_height).sum::<f64>() + 16.0;
        let width = 2.0 * LEFT + columns * cell + (columns - 1.0) * GAP;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "lengths of a page")]
        let mut drawing = Drawing::new((if width > 420.0 { width } else { 420.0 }) as u32, height as u32);
        drawing.heading(self.title, self.subtitle);
        let left_of = |column: usize| LEFT + column as f64 * (cell + GAP);
        for (column, name) in self.columns.iter().enumerate() {
            let middle = [left_of(column) + cell / 2.0, top - 12.0];
            drawing.text(TextLine::new(shortened(name, 12.5, true, cell), middle).size(12.5).bold().side(Side::Middle));
        }
        let mut y = top;
        for row in &self.rows {
            if !row.label.is_empty() {
                drawing.text(
                    TextLine::new(shortened(row.label, 12.5, false, width - 2.0 * LEFT), [LEFT, y + 11.0])
                        .size(12.5)
                        .muted(),
                );
                y += 22.0;
            }
            let height = height_of(row);
            for (column, picture) in row.cells.iter().enumerate() {
                let Some((image, caption)) = picture else { continue };
                let left = left_of(column);
                let own = cell * f64::from(image.height()) / f64::from(image.width().clamp(1, u32::MAX));
                drawing.picture(Extent::new(left, y, left + cell, y + own), (*image).clone());
                let middle = [left + cell / 2.0, y + height + 12.0];
                drawing
                    .text(TextLine::new(shortened(caption, 12.0, false, cell), middle).size(12.0).side(Side::Middle));
            }
            y += height + CAPTION;
        }
        drawing
    }
}
