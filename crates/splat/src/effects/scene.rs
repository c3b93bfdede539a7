use std::borrow::Cow;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use atsplat_numeric::Tolerance;

use super::amplitude;
use crate::{Gaussians, PackedHarmonics};

/// Gaussians to be rendered to several views, and what is decided about them once for all views.
#[derive(Debug)]
pub struct Scene<'a> {
    gaussians: Cow<'a, Gaussians>,
    views: usize,
    packed: Mutex<Option<Packed>>,
    brightest: OnceLock<(u8, f64)>,
}

/// Harmonics packed up to a degree within a tolerance; `None` where packing does not pay.
#[derive(Debug)]
struct Packed {
    degree: u8,
    tolerance: f64,
    harmonics: Option<Arc<PackedHarmonics>>,
}

impl<'a> Scene<'a> {
    /// Fewest views for which packing harmonics pays: it takes about as long as one view, and saves up to a quarter of
    /// each.
    pub const MIN_VIEWS: usize = 16;

    /// Gaussians that will be rendered to about `views` views.
    pub const fn new(gaussians: &'a Gaussians, views: usize) -> Self {
        Self::of(Cow::Borrowed(gaussians), views)
    }

    /// As [`Scene::new`], and keeps the Gaussians.
    pub const fn owning(gaussians: Gaussians, views: usize) -> Self {
        Self::of(Cow::Owned(gaussians), views)
    }

    const fn of(gaussians: Cow<'a, Gaussians>, views: usize) -> Self {
        Self { gaussians, views, packed: Mutex::new(None), brightest: OnceLock::new() }
    }

    /// The Gaussians.
    pub fn gaussians(&self) -> &Gaussians {
        &self.gaussians
    }

    /// Number of views.
    pub const fn views(&self) -> usize {
        self.views
    }

    /// Harmonics up to `degree` that change no colour by more than `tolerance`, packed once; `None` if there are too few
    /// views, or too little would be saved.
    pub(super) fn harmonics(&self, degree: u8, tolerance: f64) -> Option<Arc<PackedHarmonics>> {
        // Of the bytes: with more, packed harmonics are hardly faster.
        const LARGEST_SHARE: f64 = 0.75;
        if self.views < Self::MIN_VIEWS {
            return None;
        }
        let mut packed = self.packed.lock().unwrap_or_else(PoisonError::into_inner);
        let is_known = |known: &&Packed| known.degree == degree && Tolerance::EXACT.accepts(known.tolerance, tolerance);
        if let Some(known) = packed.as_ref().filter(is_known) {
            return known.harmonics.clone();
        }
        let pays = PackedHarmonics::packed_share(&self.gaussians, degree, tolerance) <= LARGEST_SHARE;
        let harmonics = pays.then(|| PackedHarmonics::pack(&self.gaussians, degree, tolerance)).flatten().map(Arc::new);
        *packed = Some(Packed { degree, tolerance, harmonics: harmonics.clone() });
        harmonics
    }

    /// A bound on the colour of any Gaussian in any direction, of harmonics up to a degree that all have.
    pub(super) fn brightest(&self, degree: u8) -> f64 {
        let of_colour = || amplitude::of_colour(&self.gaussians, degree);
        let (known, brightest) = *self.brightest.get_or_init(|| (degree, of_colour()));
        if known == degree { brightest } else { of_colour() }
    }
}
