use super::{NoEntry, SceneViews, entry};
use crate::{EvaluationIndex, IndexEntry};

/// Every frame is both context and target (pixelSplat `src/dataset/view_sampler/view_sampler_all.py`): to look at a
/// scene, not to score a method.
///
/// # Errors
/// [`NoEntry::TooFewFrames`] for an empty scene.
pub fn all_frames(scene: &SceneViews<'_>) -> Result<Vec<IndexEntry>, NoEntry> {
    let frames: Vec<usize> = (0..scene.cameras.len()).collect();
    if frames.is_empty() {
        return Err(NoEntry::TooFewFrames { needed: 1, found: 0 });
    }
    Ok(vec![entry(frames.clone(), frames)])
}

/// The index with every frame from the first to the last context frame as targets, as pixelSplat's
/// `assets/evaluation_index_re10k_video.json` relates to `evaluation_index_re10k.json`, and as in DepthSplat's
/// `…_12v_video.json`. Scenes without entries and overlaps are kept as they are.
#[must_use]
pub fn video_index(index: &EvaluationIndex) -> EvaluationIndex {
    let mut video = index.clone();
    for entry in video.scenes.values_mut().flatten() {
        if let Some((first, last)) = entry.window() {
            entry.target = (first..=last).collect();
        }
    }
    video
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_video_fills_the_window_for_any_order_of_context() {
        let mut index = EvaluationIndex::default();
        index.scenes.insert("dropped".to_owned(), Vec::new());
        index.scenes.insert("kept".to_owned(), vec![entry(vec![9, 5, 7], vec![20])]);
        let video = video_index(&index);
        assert!(video.scenes["dropped"].is_empty());
        assert_eq!(video.scenes["kept"][0].target, [5, 6, 7, 8, 9]);
        assert_eq!(video.scenes["kept"][0].context, [9, 5, 7]);
    }
}
