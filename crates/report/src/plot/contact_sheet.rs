use atsplat_pixels::ImageU8;

use super::Drawing;
use super::drawing::image_grid::{GridCell, GridRow, ImageGrid};

/// What a network renders for some samples: a row each with the context views, then each render next to its ground truth.
#[derive(Clone, Debug)]
pub struct ContactSheet {
    /// Title.
    pub title: String,
    /// Run, data, number of samples.
    pub subtitle: String,
    /// One per sample.
    pub rows: Vec<ContactRow>,
}

/// One sample.
#[derive(Clone, Debug)]
pub struct ContactRow {
    /// Its name and score.
    pub label: String,
    /// The context views.
    pub context: Vec<ImageU8>,
    /// Each target's render and ground truth.
    pub targets: Vec<[ImageU8; 2]>,
}

impl ContactSheet {
    /// Draws it; rows of fewer views leave cells empty.
    pub fn draw(&self) -> Drawing {
        let most = |count: fn(&ContactRow) -> usize| self.rows.iter().map(count).max().unwrap_or(0);
        let (views, targets) = (most(|row| row.context.len()), most(|row| row.targets.len()));
        let context = (1..=views).map(|view| format!("context {view}"));
        let pairs = (1..=targets).flat_map(|target| [format!("render {target}"), format!("truth {target}")]);
        let rows = self.rows.iter().map(|row| GridRow {
            label: &row.label,
            cells: (0..views)
                .map(|view| row.context.get(view).map(plain))
                .chain(
                    (0..targets).flat_map(|at| [0, 1].map(|side| row.targets.get(at).map(|pair| plain(&pair[side])))),
                )
                .collect(),
        });
        let columns = context.chain(pairs).collect();
        ImageGrid { title: &self.title, subtitle: &self.subtitle, columns, rows: rows.collect() }.draw()
    }
}

const fn plain(image: &ImageU8) -> GridCell<'_> {
    GridCell::new(image, String::new())
}
