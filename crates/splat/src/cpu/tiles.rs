use atsplat_camera::ImageSize;

use super::project::Splat;
use crate::SplatError;

/// For each tile of a picture the splats that may reach it, in the order they are composited.
#[derive(Debug, Default)]
pub(super) struct Tiles {
    columns: usize,
    /// Where each tile's list begins, and the end of the last.
    starts: Vec<usize>,
    lists: Vec<u32>,
    /// Of each splat, apart from the rest of it: the second pass reads them in no order.
    reaches: Vec<Reach>,
}

/// First and one past the last tile column, then row.
type Reach = [[u16; 2]; 2];

impl Tiles {
    /// Fills the lists, by counting first: one function tells the tiles of a splat for both passes.
    ///
    /// # Errors
    /// [`SplatError::Memory`] where the lists would hold more entries than a machine can address.
    pub(super) fn fill(
        &mut self,
        splats: &[Splat],
        order: &[u32],
        size: ImageSize,
        side: u32,
    ) -> Result<(), SplatError> {
        self.columns = size.width.div_ceil(side) as usize;
        let rows = size.height.div_ceil(side) as usize;
        self.starts.clear();
        self.starts.resize(self.columns * rows + 1, 0);
        self.reaches.clear();
        self.reaches.extend(splats.iter().map(|splat| tiles_of(splat, side)));
        for reach in &self.reaches {
            for_tiles(*reach, self.columns, |tile| {
                if let Some(count) = self.starts.get_mut(tile + 1) {
                    *count += 1;
                }
            });
        }
        let mut total = 0usize;
        for start in &mut self.starts {
            total += *start;
            *start = total;
        }
        self.lists.clear();
        let failed = |_| SplatError::Memory { needed: 4 * total as u64, limit: 0 };
        self.lists.try_reserve_exact(total).map_err(failed)?;
        self.lists.resize(total, 0);
        let mut next = self.starts.clone();
        for &at in order {
            let Some(reach) = self.reaches.get(at as usize) else { continue };
            for_tiles(*reach, self.columns, |tile| {
                if let Some(place) = next.get_mut(tile) {
                    if let Some(slot) = self.lists.get_mut(*place) {
                        *slot = at;
                    }
                    *place += 1;
                }
            });
        }
        Ok(())
    }

    pub(super) const fn columns(&self) -> usize {
        self.columns
    }

    /// Every tile with its list, row by row.
    pub(super) fn all(&self) -> impl Iterator<Item = ((usize, usize), &[u32])> {
        self.starts.windows(2).enumerate().map(|(tile, ends)| {
            let list = self.lists.get(ends.first().copied().unwrap_or(0)..ends.last().copied().unwrap_or(0));
            ((tile % self.columns, tile / self.columns), list.unwrap_or_default())
        })
    }

    /// Entries of all lists together.
    pub(super) const fn entries(&self) -> usize {
        self.lists.len()
    }

    /// The splats of a tile.
    pub(super) fn list(&self, column: usize, row: usize) -> &[u32] {
        let tile = row * self.columns + column;
        match self.starts.get(tile..tile + 2) {
            Some(&[from, to]) => self.lists.get(from..to).unwrap_or_default(),
            _ => &[],
        }
    }
}

fn tiles_of(splat: &Splat, side: u32) -> Reach {
    let side = u16::try_from(side).unwrap_or(u16::MAX);
    splat.reach.map(|[from, past]| [from / side, past.div_ceil(side)])
}

/// Calls `with` for each tile of a rectangle.
#[inline]
fn for_tiles([[left, right], [top, bottom]]: Reach, columns: usize, mut with: impl FnMut(usize)) {
    for row in usize::from(top)..usize::from(bottom) {
        for column in usize::from(left)..usize::from(right) {
            with(row * columns + column);
        }
    }
}
