use atsplat_camera::ImageSize;

use super::forward::TILE;
use crate::View;

/// Tiles that are rendered together: half-open ranges of columns and rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Window {
    pub(super) columns: [u32; 2],
    pub(super) rows: [u32; 2],
    /// Index of the image strip that contains it, and the strip's first pixel row.
    pub(super) strip: usize,
    pub(super) first_row: u32,
    /// Images that have these tiles.
    pub(super) images: u32,
}

impl Window {
    pub(super) const fn tiles(&self) -> u64 {
        (self.columns[1] - self.columns[0]) as u64 * (self.rows[1] - self.rows[0]) as u64 * self.images as u64
    }

    /// Splits the window in two, the upper or left half first; `None` for a single tile.
    fn halves(self) -> Option<[Self; 2]> {
        let cut = |[from, past]: [u32; 2]| (past - from > 1).then(|| from + (past - from) / 2);
        if let Some(middle) = cut(self.rows) {
            let [from, past] = self.rows;
            return Some([Self { rows: [from, middle], ..self }, Self { rows: [middle, past], ..self }]);
        }
        let [from, past] = self.columns;
        let middle = cut(self.columns)?;
        Some([Self { columns: [from, middle], ..self }, Self { columns: [middle, past], ..self }])
    }

    /// Windows that cover this one in order, each of at most `most` tiles and halved `halvings` times more.
    fn split(self, most: u64, halvings: u32) -> Vec<Self> {
        let is_small = self.tiles() <= most;
        match self.halves() {
            Some(halves) if !is_small || halvings > 0 => {
                let left = if is_small { halvings - 1 } else { halvings };
                halves.into_iter().flat_map(|half| half.split(most, left)).collect()
            }
            _ => vec![self],
        }
    }
}

/// The windows of all strips, given by first row and number of rows, each of at most `most` tiles and halved `halvings`
/// times more.
pub(super) fn windows(strips: &[[u32; 2]], view: &View, most: u64, halvings: u32) -> Vec<Window> {
    let columns = [0, view.size.width.div_ceil(TILE)];
    let whole = |(strip, [first_row, rows]): (usize, &[u32; 2])| Window {
        columns,
        rows: [first_row / TILE, (first_row + rows).div_ceil(TILE)],
        strip,
        first_row: *first_row,
        images: 1,
    };
    strips.iter().enumerate().map(whole).flat_map(|window| window.split(most, halvings)).collect()
}

/// The window of a batch: all tiles of each image.
pub(super) const fn window_of_batch(view: &View, images: u32) -> Window {
    let ImageSize { width, height } = view.size;
    Window { columns: [0, width.div_ceil(TILE)], rows: [0, height.div_ceil(TILE)], strip: 0, first_row: 0, images }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_cover_every_tile_once_in_order() {
        let whole = Window { columns: [2, 5], rows: [1, 6], strip: 1, first_row: 16, images: 1 };
        assert_eq!(whole.split(u64::MAX, 0), [whole]);
        assert_eq!(
            whole.split(u64::MAX, 1).iter().map(|window| window.rows).collect::<Vec<_>>(),
            [[1, 3], [3, 6]],
            "rows first"
        );
        for (most, halvings) in [(15, 2), (7, 0), (1, 0), (2, 1), (u64::MAX, 9)] {
            let windows = whole.split(most, halvings);
            assert!(windows.iter().all(|window| window.tiles() <= most), "{most} {halvings}");
            // By row, then column: the order in which a Gaussian's pairs are summed.
            let tiles = windows.iter().flat_map(|window| {
                let [first, past] = window.columns;
                (window.rows[0]..window.rows[1]).flat_map(move |row| (first..past).map(move |column| [row, column]))
            });
            let expected = (1..6).flat_map(|row| (2..5).map(move |column| [row, column]));
            assert!(tiles.eq(expected), "{most} {halvings}");
        }
    }
}
