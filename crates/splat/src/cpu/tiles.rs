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
}

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
        for splat in splats {
            for_tiles(splat, side, self.columns, |tile| {
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
            let Some(splat) = splats.get(at as usize) else { continue };
            for_tiles(splat, side, self.columns, |tile| {
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

    /// The splats of a tile.
    pub(super) fn list(&self, column: usize, row: usize) -> &[u32] {
        let tile = row * self.columns + column;
        match self.starts.get(tile..tile + 2) {
            Some(&[from, to]) => self.lists.get(from..to).unwrap_or_default(),
            _ => &[],
        }
    }
}

/// Calls `with` for each tile that the splat's rectangle touches.
fn for_tiles(splat: &Splat, side: u32, columns: usize, mut with: impl FnMut(usize)) {
    let [[left, right], [top, bottom]] =
        splat.reach.map(|[from, to]| [u32::from(from) / side, (u32::from(to) - 1) / side]);
    for row in top..=bottom {
        for column in left..=right {
            with(row as usize * columns + column as usize);
        }
    }
}
