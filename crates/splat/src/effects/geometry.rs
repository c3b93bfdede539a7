//! Whether Gaussians have the same shapes, places and opacities on the screen in two requests.
//!
//! The same to the bit, in f64: a difference however small takes an opacity across a cut-off somewhere, where a pixel
//! jumps by `min_alpha` times whatever colour that is, and a median depth from one Gaussian to another. No bound that
//! grows with the difference holds there.

use rayon::prelude::*;

use super::Request;
use crate::Gaussians;
use crate::reference::project::{Outcome, Splat, project};

/// Why pictures differ where Gaussians are projected as for `after` instead of `before`, in words; `None` where no
/// Gaussian does.
pub(super) fn objection(gaussians: &Gaussians, before: &Request, after: &Request) -> Option<String> {
    let optics = |request: &Request| request.view.optics(&request.options.constants);
    let (Ok(optics_before), Ok(optics_after)) = (optics(before), optics(after)) else {
        return Some("the view cannot be rendered, which rendering tells".to_owned());
    };
    let is_moved = |position: &usize| {
        let one =
            |request: &Request, optics| project(gaussians, *position, optics, request.view.size, &request.options);
        !is_same(&one(before, &optics_before), &one(after, &optics_after))
    };
    let moved = growing(gaussians.len()).find_map(|positions| positions.into_par_iter().find_first(is_moved))?;
    Some(format!("it changes where or how strongly Gaussian {moved} shows"))
}

/// All positions in ever larger steps: an objection is mostly found at once.
fn growing(count: usize) -> impl Iterator<Item = std::ops::Range<usize>> {
    const FIRST: usize = 256;
    let mut past = 0;
    std::iter::from_fn(move || {
        let from = past;
        past = (from + if from == 0 { FIRST } else { from }).min(count);
        (from < past).then_some(from..past)
    })
}

/// Whether a picture is composited of the same, or of neither for the same reason.
fn is_same(before: &Outcome, after: &Outcome) -> bool {
    match (before, after) {
        (Outcome::Drawn(a), Outcome::Drawn(b)) => a.reach == b.reach && bits(a) == bits(b),
        _ => std::mem::discriminant(before) == std::mem::discriminant(after),
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
    fn steps_cover_everything_once() {
        for count in [0, 1, 255, 256, 257, 5000] {
            let positions: Vec<usize> = growing(count).flatten().collect();
            assert_eq!(positions, (0..count).collect::<Vec<_>>());
        }
    }
}
