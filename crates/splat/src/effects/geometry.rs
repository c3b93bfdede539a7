//! Tests whether Gaussians project to the same shapes, positions and opacities in two requests.
//!
//! Bit for bit in f64: any difference, however small, may take an alpha across a threshold, where a pixel jumps by
//! `min_alpha` times the Gaussian's colour and a median depth jumps to another Gaussian. No bound proportional to the
//! difference holds there.

use rayon::prelude::*;

use super::{Assessment, Effect, Request};
use crate::Gaussians;
use crate::reference::project::{Splat, project};
use crate::rendering::Culled;

type Projected = Result<Box<Splat>, Culled>;

/// Removes an effect without which every Gaussian projects identically, and keeps any other.
pub(super) fn remove_if_unused(
    effect: &dyn Effect,
    gaussians: &Gaussians,
    request: &Request,
    reason: &str,
) -> Assessment {
    let mut reduced = request.clone();
    effect.remove_from(&mut reduced);
    match difference(gaussians, request, &reduced) {
        None => Assessment { reduced: Some(reduced), bound: Some(0.0), reason: reason.to_owned() },
        Some(difference) => Assessment::keep(difference),
    }
}

/// Explains why images differ if Gaussians are projected as for `after` instead of `before`; `None` if no Gaussian
/// changes.
fn difference(gaussians: &Gaussians, before: &Request, after: &Request) -> Option<String> {
    let optics = |request: &Request| request.view.optics(&request.options.constants);
    let (Ok(optics_before), Ok(optics_after)) = (optics(before), optics(after)) else {
        return Some("the view is invalid; rendering will report why".to_owned());
    };
    let is_moved = |position: &usize| {
        let one =
            |request: &Request, optics| project(gaussians, *position, optics, request.view.size, &request.options);
        !is_same(&one(before, &optics_before), &one(after, &optics_after))
    };
    let moved = growing_ranges(gaussians.len()).find_map(|positions| positions.into_par_iter().find_first(is_moved))?;
    Some(format!("it changes the position, shape or opacity of Gaussian {moved}"))
}

/// All indices in growing steps: a difference is mostly found early.
fn growing_ranges(count: usize) -> impl Iterator<Item = std::ops::Range<usize>> {
    const FIRST: usize = 256;
    let mut past = 0;
    std::iter::from_fn(move || {
        let from = past;
        past = (from + if from == 0 { FIRST } else { from }).min(count);
        (from < past).then_some(from..past)
    })
}

/// Whether both are drawn identically, or culled for the same reason.
fn is_same(before: &Projected, after: &Projected) -> bool {
    match (before, after) {
        (Ok(a), Ok(b)) => a.reach == b.reach && bits(a) == bits(b),
        (Err(a), Err(b)) => a == b,
        _ => false,
    }
}

fn bits(splat: &Splat) -> [u64; 11] {
    let ([x, y], [a, b, c], [red, green, blue]) =
        (splat.centre.to_array(), splat.conic.to_array(), splat.rgb.to_array());
    [x, y, a, b, c, red, green, blue, splat.depth, splat.opacity, splat.scalar].map(f64::to_bits)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn growing_steps_cover_every_index_once() {
        for count in [0, 1, 255, 256, 257, 5000] {
            let positions: Vec<usize> = growing_ranges(count).flatten().collect();
            assert_eq!(positions, (0..count).collect::<Vec<_>>());
        }
    }
}
