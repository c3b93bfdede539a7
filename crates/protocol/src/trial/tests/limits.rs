//! Sizes that headers state, and the limits of decoding.

use super::*;

/// A header of the frames' shape that was damaged: a method that renders at the size of a target would need 32 GB for its image.
#[test]
fn images_beyond_the_limits_of_decoding_give_no_trial() {
    let outcome = |at: usize, [width, height]: [u32; 2], decode_limits: DecodeLimits| {
        let mut changed = scene("s", 9, 5);
        let mut damaged = png([1, 2, 3]);
        damaged[16..24].copy_from_slice(&[width.to_be_bytes(), height.to_be_bytes()].concat());
        changed.frames[at].image = FrameImage::Encoded(SharedBytes::new(damaged));
        let recipe = TrialRecipe { preprocessing: Preprocessing::default(), decode_limits, ..recipe() };
        only_trial(changed, entry(&[2, 6], &[4]), recipe).map(drop)
    };
    for at in [4, 6] {
        let skipped = outcome(at, [60_000, 45_000], DecodeLimits::default()).unwrap_err();
        assert_eq!(skipped.reason, SkipReason::ImageUnreadable);
        let expected =
            format!("frame {at} of scene \"s\": PNG of 60000×45000: width of at most 16384 allowed, found 60000");
        assert!(skipped.detail.contains(&expected), "{}", skipped.detail);
    }
    let [fitting, narrow] = [64, 63].map(|max_width| DecodeLimits { max_width, ..DecodeLimits::default() });
    assert_eq!(outcome(4, [64, 48], fitting), Ok(()));
    assert!(outcome(4, [64, 48], narrow).is_err());
}
