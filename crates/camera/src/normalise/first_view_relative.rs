use super::Step;
use crate::{Similarity, WorldFromCamera};

/// The first context view becomes the identity. The 3×3 part is inverted as the matrix it is, not
/// transposed, as `torch.inverse` does: the first view's own rounding cancels.
pub(super) fn step(first: &WorldFromCamera) -> Step {
    let rotation = first.rotation().inverse();
    Step { new_from_old: Similarity { rotation, origin: first.centre(), scale: 1.0 }, ..Step::UNCHANGED }
}
