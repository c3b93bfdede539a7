//! Requests that are rejected because they are too large or invalid, and the memory that counts towards the limit.

use super::*;

/// Larger than memory, and larger than 16-bit coordinates.
#[test]
fn rejects_images_that_do_not_fit() {
    let gaussians = cloud(3, 0, 1);
    let images = ImageGradients { rgb: vec![[1.0f32; 3]; 4], alpha: None, depth: None, scalar: None };
    for side in [u32::MAX, 100_000] {
        let view = view(side, side);
        let options = everything();
        let mut renderer = CpuRenderer::default();
        assert!(matches!(renderer.render(&gaussians, &view, &options), Err(SplatError::View { .. })));
        assert!(matches!(renderer.render_many(&gaussians, &[view; 2], &options), Err(SplatError::View { .. })));
        assert!(matches!(renderer.record(&gaussians, &view, &options), Err(SplatError::View { .. })));
        assert!(matches!(renderer.backward(&gaussians, &view, &options, &images), Err(SplatError::View { .. })));
        assert!(matches!(reference::render(&gaussians, &view, &options), Err(SplatError::View { .. })));
    }
    let view = view(65_535, 65_535);
    let options = everything();
    assert!(matches!(CpuRenderer::default().render(&gaussians, &view, &options), Err(SplatError::Memory { .. })));
    assert!(matches!(CpuRenderer::default().record(&gaussians, &view, &options), Err(SplatError::Memory { .. })));
    assert!(matches!(reference::render(&gaussians, &view, &options), Err(SplatError::Memory { .. })));
}

#[test]
fn constants_are_checked_by_every_backend() {
    let (gaussians, view) = (cloud(3, 0, 1), view(20, 10));
    let constants = RendererConstants { min_alpha: 0.0, ..RendererConstants::default() };
    let options = RenderOptions { constants, ..everything() };
    let images = narrow(&image_gradients(&view));
    let rejected = |outcome: Result<(), SplatError>| {
        assert!(matches!(outcome, Err(SplatError::Constants { field: "min-alpha", .. })), "{outcome:?}");
    };
    let mut renderer = CpuRenderer::default();
    rejected(renderer.render(&gaussians, &view, &options).map(drop));
    rejected(renderer.render_many(&gaussians, &[view], &options).map(drop));
    rejected(renderer.record(&gaussians, &view, &options).map(drop));
    rejected(renderer.backward(&gaussians, &view, &options, &images).map(drop));
    rejected(reference::render(&gaussians, &view, &options).map(drop));
    rejected(reference::project(&gaussians, &view, &options).map(drop));
    rejected(reference::backward(&gaussians, &view, &options, &image_gradients(&view)).map(drop));
    rejected(reference::jumps(&gaussians, &view, &options, 0.0).map(drop));
}

#[test]
fn rejects_counts_beyond_32_bits() {
    assert!(frame::check_count("Gaussians", u64::from(u32::MAX)).is_ok());
    let outcome = frame::check_count("Gaussians", 1 << 32);
    assert!(matches!(outcome, Err(SplatError::Count { what: "Gaussians", found: 0x1_0000_0000, .. })));
}

/// Gaussians that each cover the whole image.
fn sheets(count: usize) -> Gaussians {
    let mut parts = cloud(count, 0, 54).into_parts();
    parts.log_scales.fill([5.0; 3]);
    parts.opacity_logits.fill(4.0);
    Gaussians::new(parts).unwrap()
}

fn limited(memory_limit: u64) -> CpuRenderer {
    CpuRenderer::new(CpuOptions { memory_limit, ..CpuOptions::default() })
}

/// The smallest limit under which an operation succeeds, to a precision of 1/64.
fn least_limit(succeeds: impl Fn(u64) -> bool) -> u64 {
    let (mut fails, mut fits) = (0u64, 1 << 30);
    assert!(succeeds(fits));
    while fits - fails > fits / 64 {
        let middle = fails.midpoint(fits);
        *(if succeeds(middle) { &mut fits } else { &mut fails }) = middle;
    }
    fits
}

/// Long tile lists, and the sums over them, count towards the limit.
#[test]
fn rejects_tile_lists_beyond_the_memory_limit() {
    let (gaussians, view) = (sheets(4000), view(512, 512));
    let options = RenderOptions::default();
    let lists = 3000 * 256 * 8;
    let outcome = limited(lists).render(&gaussians, &view, &options);
    assert!(matches!(outcome, Err(SplatError::Memory { needed, .. }) if needed > lists), "{outcome:?}");
    assert!(limited(6 * lists).render(&gaussians, &view, &options).is_ok());
    let images = ImageGradients { rgb: vec![[1.0; 3]; view.pixels()], alpha: None, depth: None, scalar: None };
    let outcome = limited(4 * lists).backward(&gaussians, &view, &options, &images);
    assert!(matches!(outcome, Err(SplatError::Memory { .. })), "{outcome:?}");
}

/// Views that fit only one at a time are rendered one at a time.
#[test]
fn many_views_fit_if_their_images_and_one_frame_do() {
    let (gaussians, view) = (sheets(3000), view(256, 256));
    let options = RenderOptions::default();
    let one = least_limit(|limit| limited(limit).render(&gaussians, &view, &options).is_ok());
    let views = [view; 4];
    let images = 4 * Rendering::<f32>::bytes(&view, &options);
    let together = limited(one + images).render_many(&gaussians, &views, &options).unwrap();
    let alone = limited(one).render(&gaussians, &view, &options).unwrap();
    assert!(together.iter().all(|rendering| *rendering == alone));
}

/// The backward pass counts the recording's memory, and buffers of earlier jobs are freed or counted.
#[test]
fn all_allocated_buffers_count() {
    let (gaussians, view) = (sheets(2000), view(256, 256));
    let options = RenderOptions::default();
    let images = ImageGradients { rgb: vec![[1.0; 3]; view.pixels()], alpha: None, depth: None, scalar: None };
    let limit = least_limit(|limit| limited(limit).backward(&gaussians, &view, &options, &images).is_ok());
    let mut renderer = CpuRenderer::default();
    let mut recording = renderer.record(&gaussians, &view, &options).unwrap();
    recording.backward(&images).unwrap();
    renderer.reuse(recording);
    let frames: u64 = renderer.spare.iter().map(Frame::allocated_bytes).sum();
    let allocated_bytes = frames + Rendering::<f32>::bytes(&view, &options) + gaussians.size_in_bytes();
    assert!(limit >= allocated_bytes, "{limit} bytes allowed, {allocated_bytes} in use");

    // Buffers of a large job must be freed under a limit that only the small job fits.
    let small = least_limit(|limit| limited(limit).render(&cloud(10, 0, 1), &view, &options).is_ok());
    assert!(frames > small);
    renderer.options.memory_limit = small;
    renderer.render(&cloud(10, 0, 1), &view, &options).unwrap();
    let allocated_bytes: u64 = renderer.spare.iter().map(Frame::allocated_bytes).sum();
    assert!(allocated_bytes <= small, "{allocated_bytes} bytes allocated, {small} allowed");
}

#[test]
fn keeps_at_most_one_batch_of_frames() {
    let (gaussians, view) = (cloud(10, 0, 1), view(16, 16));
    let mut renderer = CpuRenderer::default();
    let recordings: Vec<_> =
        (0..9).map(|_| renderer.record(&gaussians, &view, &RenderOptions::default()).unwrap()).collect();
    for recording in recordings {
        renderer.reuse(recording);
    }
    assert_eq!(renderer.spare.len(), VIEW_BATCH);
}

/// The requested level, or the fallback.
#[test]
fn reports_the_instruction_set_in_use() {
    let levels = SimdLevel::available();
    #[cfg(target_arch = "x86_64")]
    for simd in [SimdLevel::Avx2, SimdLevel::Avx512] {
        let used = CpuRenderer::new(CpuOptions { simd, ..CpuOptions::default() }).simd();
        assert_eq!(used, if levels.contains(&simd) { simd } else { SimdLevel::Portable });
    }
    assert_eq!(CpuRenderer::default().simd(), *levels.last().unwrap());
}
