//! How long lists have to be. The device counts what they need while it fills them, so that the host waits for nothing;
//! lists that prove too short are lengthened, and the work is repeated.

use std::collections::BTreeMap;

use atsplat_camera::ImageSize;

use super::GpuError;
use super::context::Context;
use super::job::Job;
use super::sort::word;
use super::status::Status;
use super::windows::{Window, window_of_batch, windows};

/// Pairs that any first rendering has room for.
const MIN_PAIRS: u64 = 1 << 14;
/// Pairs per Gaussian that it has room for.
const PAIRS_PER_GAUSSIAN: u64 = 2;
/// Length of a tile's list that it composites.
const FIRST_ENTRIES: u64 = 4096;
/// Sizes of scenes and images that are stored; if there are more, all are dropped.
const MAX_KEYS: usize = 256;

/// What bounds are learnt for: the numbers of Gaussians and pixels, and whether there is a backward pass.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Key {
    gaussians: u64,
    size: [u32; 2],
    backward: bool,
}

impl Key {
    pub(super) fn new(job: Job<'_>, backward: bool) -> Self {
        let ImageSize { width, height } = job.size();
        Self { gaussians: job.splats(), size: [width, height], backward }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Bound {
    /// Pairs of a window.
    pairs: u64,
    /// Entries of a tile's list.
    entries: u64,
    /// How often windows are halved.
    halvings: u32,
}

/// How one rendering is carried out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Plan {
    key: Key,
    /// Pairs of a window that the lists hold, and the most that they could hold.
    pub(super) capacity: u64,
    pub(super) most: u64,
    /// Dispatches over the tile lists.
    pub(super) passes: u32,
    halvings: u32,
    /// Whether windows are single tiles.
    is_finest: bool,
    /// Windows of a batch cannot be halved.
    is_batch: bool,
}

/// What the renderings of a device have needed so far.
#[derive(Debug, Default)]
pub(super) struct Bounds(BTreeMap<Key, Bound>);

impl Bounds {
    /// Plans a rendering with lists of at most `most` pairs.
    pub(super) fn plan(
        &self,
        context: &Context,
        key: Key,
        (strips, job): (&[[u32; 2]], Job<'_>),
        most: u64,
    ) -> (Plan, Vec<Window>) {
        let known = self.0.get(&key).or_else(|| self.0.get(&Key { backward: false, ..key }));
        let halvings = known.map_or(0, |known| known.halvings);
        let (view, images) = (job.view(), job.images());
        let windows = match images {
            1 => windows(strips, view, context.tiles_per_window, halvings),
            _ => vec![window_of_batch(view, images)],
        };
        let tiles = windows.iter().map(Window::tiles).max().unwrap_or(0);
        let possible = key.gaussians.saturating_mul(tiles);
        let guess = key.gaussians.saturating_mul(PAIRS_PER_GAUSSIAN).max(MIN_PAIRS).min(context.first_pairs);
        let capacity = known.map_or(guess, |known| known.pairs).min(most).min(possible);
        let each = u64::from(context.entries_per_dispatch);
        let entries = known.map_or(FIRST_ENTRIES, |known| known.entries);
        let passes = entries.min(key.gaussians).min(capacity).div_ceil(each).max(1);
        let passes = word(passes);
        let plan = Plan { key, capacity, most, passes, halvings, is_finest: tiles <= 1, is_batch: images > 1 };
        (plan, windows)
    }

    /// Whether a rendering has to be repeated, with longer lists from now on.
    ///
    /// # Errors
    /// [`GpuError::TooLarge`] if lists cannot be long enough.
    pub(super) fn learn(&mut self, context: &Context, plan: &Plan, status: &Status) -> Result<bool, GpuError> {
        if !status.is_incomplete {
            return Ok(false);
        }
        let mut needed = Bound {
            pairs: plan.capacity,
            entries: (u64::from(plan.passes) * u64::from(context.entries_per_dispatch)).max(with_slack(status.longest)),
            halvings: plan.halvings,
        };
        if status.pairs > plan.most {
            if plan.is_finest || plan.is_batch {
                return Err(GpuError::TooLarge {
                    adapter: context.name.clone(),
                    what: if plan.is_batch { "Gaussians of a batch" } else { "Gaussians of one tile" },
                    unit: "list entries",
                    needed: status.pairs,
                    limit: plan.most,
                });
            }
            // Enough if pairs are spread evenly; otherwise windows are halved again.
            let parts = status.pairs.div_ceil(plan.most.max(1)).next_power_of_two();
            (needed.pairs, needed.halvings) = (plan.most, plan.halvings + parts.ilog2().clamp(1, 32));
        } else if status.pairs > plan.capacity {
            needed.pairs = with_slack(status.pairs).min(plan.most);
        }
        if self.0.len() >= MAX_KEYS && !self.0.contains_key(&plan.key) {
            self.0.clear();
        }
        // Other renderings of these sizes may have needed more.
        let known = self.0.entry(plan.key).or_insert(needed);
        known.pairs = known.pairs.max(needed.pairs);
        known.entries = known.entries.max(needed.entries);
        known.halvings = known.halvings.max(needed.halvings);
        tracing::debug!(pairs = status.pairs, longest = status.longest, "lists were too short: rendering again");
        context.counters.repeats.add(1);
        Ok(true)
    }
}

/// A quarter more, for the next views.
const fn with_slack(needed: u64) -> u64 {
    needed + needed / 4
}
