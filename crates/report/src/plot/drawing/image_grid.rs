use atsplat_metrics::ColourMap;
use atsplat_numeric::Extremes as _;
use atsplat_pixels::ImageU8;

use super::scale::single_label;
use super::shape::{Drawing, Extent, MARGIN, Side, TextLine};

/// Images in rows and columns, with a name above each column and a caption below each image.
pub(in crate::plot) struct ImageGrid<'a> {
    pub(in crate::plot) title: &'a str,
    pub(in crate::plot) subtitle: &'a str,
    pub(in crate::plot) columns: Vec<String>,
    pub(in crate::plot) rows: Vec<GridRow<'a>>,
}

pub(in crate::plot) struct GridRow<'a> {
    pub(in crate::plot) label: &'a str,
    /// One per column; `None` for an empty cell.
    pub(in crate::plot) cells: Vec<Option<GridCell<'a>>>,
}

pub(in crate::plot) struct GridCell<'a> {
    pub(in crate::plot) image: &'a ImageU8,
    pub(in crate::plot) caption: String,
    /// The colours of a map, and the value of the last one; the first is zero.
    pub(in crate::plot) colours: Option<(ColourMap, f64)>,
}

impl<'a> GridCell<'a> {
    pub(in crate::plot) const fn new(image: &'a ImageU8, caption: String) -> Self {
        Self { image, caption, colours: None }
    }
}

const WIDTH: f64 = 1000.0;
const GAP: f64 = 8.0;
/// The height of a colour bar.
const BAR: f64 = 8.0;

impl ImageGrid<'_> {
    pub(in crate::plot) fn draw(&self) -> Drawing {
        let columns = self.columns.len().clamp(1, usize::MAX) as f64;
        let cell = ((WIDTH - 2.0 * MARGIN - GAP * (columns - 1.0)) / columns).clamp(20.0, 320.0);
        let width = (2.0 * MARGIN + columns * cell + (columns - 1.0) * GAP).maximum_of(480.0);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "lengths of a page")]
        let (mut drawing, head) = Drawing::titled(width as u32, self.title, self.subtitle);
        let left_of = |column: usize| MARGIN + column as f64 * (cell + GAP);
        let mut y = head;
        for (column, name) in self.columns.iter().enumerate() {
            let middle = [left_of(column) + cell / 2.0, 0.0];
            let name = TextLine::new(name, middle).small().bold().side(Side::Middle).within(cell).below(head + 14.0);
            y = y.maximum_of(name.extent().bottom);
            drawing.text(name);
        }
        for row in &self.rows {
            y += 10.0;
            if !row.label.is_empty() {
                let label = TextLine::new(row.label, [MARGIN, 0.0]).small().muted();
                let label = label.within(width - 2.0 * MARGIN).below(y);
                y = label.extent().bottom + 6.0;
                drawing.text(label);
            }
            let height = |cell: &GridCell<'_>| f64::from(cell.image.height()) / f64::from(cell.image.width().max(1));
            let under = y + cell * row.cells.iter().flatten().map(height).fold(0.0, f64::maximum_of);
            let mut below = under;
            for (column, content) in row.cells.iter().enumerate() {
                let Some(content) = content else { continue };
                let left = left_of(column);
                drawing.image(Extent::new(left, y, left + cell, y + cell * height(content)), content.image.clone());
                below = below.maximum_of(draw_below(&mut drawing, content, [left, left + cell], under));
            }
            y = below;
        }
        drawing.end_at(y + 16.0);
        drawing
    }
}

/// The colour bar and the caption of an image; returns their lower edge.
fn draw_below(drawing: &mut Drawing, cell: &GridCell<'_>, [left, right]: [f64; 2], top: f64) -> f64 {
    let mut y = top + 6.0;
    if let Some((map, most)) = cell.colours {
        let zero = TextLine::new("0", [left, y + BAR / 2.0]).small().muted();
        let most = TextLine::new(single_label((most * 100.0).round() / 100.0), [right, y + BAR / 2.0]).small().muted();
        let most = most.side(Side::Right);
        let bar = Extent::new(zero.extent().right + 5.0, y, most.extent().left - 5.0, y + BAR);
        if let Some(colours) = colours(map) {
            drawing.image(bar, colours);
        }
        drawing.text(zero);
        drawing.text(most);
        y += BAR + 6.0;
    }
    if cell.caption.is_empty() {
        return y;
    }
    let caption = TextLine::new(&*cell.caption, [f64::midpoint(left, right), 0.0]).small().side(Side::Middle);
    let caption = caption.within(right - left).below(y);
    let bottom = caption.extent().bottom;
    drawing.text(caption);
    bottom
}

/// A row of a map's colours.
fn colours(map: ColourMap) -> Option<ImageU8> {
    const STEPS: u8 = 128;
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "colours are in [0, 1]")]
    let samples = (0..STEPS).flat_map(|at| {
        let share = f64::from(at) / f64::from(STEPS - 1);
        map.colour(share).map(|value| (value * 255.0).round() as u8)
    });
    ImageU8::new(u32::from(STEPS), 1, samples.collect()).ok()
}
