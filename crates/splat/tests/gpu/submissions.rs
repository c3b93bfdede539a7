//! What passes between the host and the device: submissions, waits and bytes, and renderings repeated with longer lists.

use atsplat_numeric::Tolerance;
use atsplat_splat::gpu::{GpuCounts, GpuOverrides, GpuRenderer, ImageFormat, ImageNumbers};
use atsplat_splat::{Gaussians, RenderOptions, Renderer};

use crate::scenes::{
    as_gradients, assert_identical, beside, cloud, everything, gpu, image_gradients, narrow, open, overriding, view,
};

/// What `work` added to the counts.
fn counted<T>(gpu: &mut GpuRenderer, work: impl FnOnce(&mut GpuRenderer) -> T) -> (T, GpuCounts) {
    let before = gpu.counts();
    let made = work(gpu);
    (made, gpu.counts() - before)
}

fn requests(counts: GpuCounts) -> [u64; 3] {
    [counts.submissions, counts.waits, counts.repeats]
}

#[test]
fn a_resident_image_is_one_submission_and_reading_it_one_wait() {
    let Some(mut gpu) = gpu() else { return };
    let (gaussians, view) = (cloud(3000, 1, 7), view(97, 71));
    let resident = gpu.upload(&gaussians).unwrap();
    let expected = gpu.render(&gaussians, &view, &everything()).unwrap();

    let (image, counts) = counted(&mut gpu, |gpu| gpu.render_resident(&resident, &view, &everything()).unwrap());
    assert_eq!(requests(counts), [1, 0, 0], "{counts:?}");
    assert!(counts.dispatches > 10 && counts.bytes_down == 0, "{counts:?}");
    assert!(counts.bytes_up < 64 << 10, "only uniform blocks: {counts:?}");
    let (read, counts) = counted(&mut gpu, |gpu| gpu.read(&image).unwrap());
    assert_eq!((requests(counts), counts.dispatches), ([1, 1, 0], 0), "{counts:?}");
    assert!(read == expected);
    let (of_gaussians, counts) = counted(&mut gpu, |gpu| gpu.settle(&image).unwrap().counts);
    assert_eq!((requests(counts), of_gaussians), ([0, 0, 0], expected.counts), "known from reading");

    let images = as_gradients(&image.unsettled().strips);
    let backward = |gpu: &mut GpuRenderer| gpu.backward_resident(&resident, &view, &everything(), &images).unwrap();
    let first = backward(&mut gpu);
    gpu.settle(&first).unwrap();
    let (gradients, counts) = counted(&mut gpu, backward);
    assert_eq!((requests(counts), counts.bytes_down), ([1, 0, 0], 0), "{counts:?}");
    let (_, counts) = counted(&mut gpu, |gpu| gpu.read_gradients(&gradients, &gaussians).unwrap());
    assert_eq!(requests(counts), [1, 1, 0], "{counts:?}");
}

#[test]
fn an_image_for_the_host_is_one_submission_and_one_wait() {
    let Some(mut gpu) = gpu() else { return };
    let (gaussians, view) = (cloud(3000, 1, 7), view(97, 71));
    let images = narrow(&image_gradients(&view));
    let mut both = || {
        let (_, image) = counted(&mut gpu, |gpu| gpu.render(&gaussians, &view, &everything()).unwrap());
        let (_, gradients) = counted(&mut gpu, |gpu| gpu.backward(&gaussians, &view, &everything(), &images).unwrap());
        [image, gradients]
    };
    both();
    let [image, gradients] = both();
    assert_eq!([requests(image), requests(gradients)], [[1, 1, 0]; 2], "{image:?} {gradients:?}");
    // Means, quaternions, scales, opacities, four coefficients, scalars; and uniform blocks.
    let uploaded = 4 * 3000 * (3 + 4 + 3 + 1 + 12 + 1);
    assert!((uploaded..uploaded + (64 << 10)).contains(&image.bytes_up), "{image:?}");
    assert!(image.bytes_down >= 32 * 97 * 71, "two images of four f32: {image:?}");
}

/// Of many pairs, of lists longer than a loop allows, and of both; a single wait for several results.
#[test]
fn lists_that_are_too_short_cost_one_repeat_and_no_pixel() {
    let Some(mut gpu) = gpu() else { return };
    let (gaussians, view) = (cloud(3000, 1, 7), view(97, 71));
    let images = narrow(&image_gradients(&view));
    let expected = gpu.render(&gaussians, &view, &everything()).unwrap();
    let gradients = gpu.backward(&gaussians, &view, &everything(), &images).unwrap();
    let short = GpuOverrides { first_pairs: 100, ..GpuOverrides::default() };
    // 4096 entries are composited at first: fewer than a list has if one dispatch takes a single entry of it.
    for overrides in [short, GpuOverrides { first_pairs: 0, entries_limit: 37, ..short }] {
        let mut short = beside(&gpu, overriding(overrides));
        let (read, counts) = counted(&mut short, |gpu| gpu.render(&gaussians, &view, &everything()).unwrap());
        assert_eq!(requests(counts), [2, 2, 1], "{counts:?}");
        assert!(read == expected);
        let (read, counts) = counted(&mut short, |gpu| gpu.render(&gaussians, &view, &everything()).unwrap());
        assert_eq!((requests(counts), read == expected), ([1, 1, 0], true), "learnt: {counts:?}");
        assert!(short.backward(&gaussians, &view, &everything(), &images).unwrap() == gradients);
    }

    let mut short = beside(&gpu, overriding(short));
    let resident = short.upload(&gaussians).unwrap();
    let (images, counts) =
        counted(&mut short, |gpu| [(); 2].map(|()| gpu.render_resident(&resident, &view, &everything()).unwrap()));
    assert_eq!(requests(counts), [2, 0, 0], "{counts:?}");
    let (settled, counts) = counted(&mut short, |gpu| {
        let settled = gpu.settle_all(&[&images[0], &images[1]]).unwrap();
        settled.iter().map(|settled| (settled.was_repeated, settled.counts)).collect::<Vec<_>>()
    });
    assert_eq!(settled, [(true, expected.counts); 2]);
    assert_eq!((counts.waits, counts.repeats), (2, 2), "one wait for both, and one for both repeated: {counts:?}");
    for image in &images {
        assert!(short.read(image).unwrap() == expected);
    }
    let (next, counts) = counted(&mut short, |gpu| {
        let next = gpu.render_resident(&resident, &view, &everything()).unwrap();
        gpu.read(&next).unwrap()
    });
    assert_eq!((requests(counts), next == expected), ([2, 1, 0], true), "{counts:?}");
}

/// A reader of an image need not know of a repeat; a user of its buffers checks for one later.
#[test]
fn an_image_that_was_repeated_when_it_was_read_says_so() {
    let short = GpuOverrides { first_pairs: 100, ..GpuOverrides::default() };
    let Some(mut gpu) = open(overriding(short)) else { return };
    let (gaussians, view) = (cloud(2000, 0, 7), view(97, 71));
    let resident = gpu.upload(&gaussians).unwrap();
    let repeats = [(); 2].map(|()| {
        let image = gpu.render_resident(&resident, &view, &RenderOptions::default()).unwrap();
        gpu.read(&image).unwrap();
        gpu.settle(&image).unwrap().was_repeated
    });
    assert_eq!(repeats, [true, false], "the second has learnt how long its lists are");
}

/// Converted on the device; of several strips, whose lengths are not whole words; after a repeat, too.
#[test]
fn images_are_read_in_the_requested_format() {
    let short = GpuOverrides { binding_limit: 64 << 10, first_pairs: 100, ..GpuOverrides::default() };
    let Some(mut gpu) = gpu() else { return };
    let mut limited = beside(&gpu, overriding(short));
    let mut parts = cloud(2000, 0, 7).into_parts();
    parts.sh.iter_mut().for_each(|rgb| *rgb = rgb.map(|value| 6.0 * value));
    let (gaussians, view) = (Gaussians::new(parts).unwrap(), view(97, 71));
    let expected = gpu.render(&gaussians, &view, &RenderOptions::default()).unwrap();
    assert!(expected.rgb.as_flattened().iter().any(|value| *value > 1.0), "colours beyond white");
    // With the bytes of a staging buffer: one wait each time it is filled.
    for (gpu, staging) in [(&mut *gpu, 64 << 20), (&mut limited, 64 << 10)] {
        let resident = gpu.upload(&gaussians).unwrap();
        for (numbers, alpha) in
            [ImageNumbers::U8, ImageNumbers::F16, ImageNumbers::F32].into_iter().flat_map(|n| [(n, false), (n, true)])
        {
            let rendering = gpu.render_resident(&resident, &view, &RenderOptions::default()).unwrap();
            let format = ImageFormat { numbers, alpha };
            let (image, counts) = counted(gpu, |gpu| gpu.read_image(&rendering, format).unwrap());
            let colours = expected.rgb.iter().zip(&expected.alpha);
            let values: Vec<f32> =
                colours.flat_map(|(rgb, opacity)| rgb.iter().copied().chain(alpha.then_some(*opacity))).collect();
            let bytes = image.bytes.as_slice();
            match numbers {
                ImageNumbers::U8 => {
                    // The nearest level, or either of two between which a value is.
                    let levels = values.iter().map(|value| 255.0 * f64::from(value.clamp(0.0, 1.0)));
                    Tolerance::absolute(0.5 + 1e-4).assert(bytes.iter().map(|byte| f64::from(*byte)), levels, "levels");
                }
                ImageNumbers::F16 => {
                    let halves: Vec<f64> =
                        bytes.as_chunks().0.iter().map(|two| half(u16::from_le_bytes(*two))).collect();
                    let near = Tolerance { absolute: 1e-7, relative: 1.0 / 1024.0 };
                    near.assert(halves, values.iter().map(|value| f64::from(*value)), "halves");
                }
                ImageNumbers::F32 => {
                    let words = bytes.as_chunks().0.iter().map(|word| f32::from_le_bytes(*word).to_bits());
                    assert!(words.eq(values.iter().map(|value| value.to_bits())), "alpha {alpha}");
                }
            }
            assert_eq!(image.counts, expected.counts);
            if counts.repeats == 0 {
                let loads = counts.bytes_down.div_ceil(staging);
                assert_eq!(requests(counts), [loads, loads, 0], "{counts:?}");
                let length = bytes.len() as u64;
                assert!((length..length + 64).contains(&counts.bytes_down), "{counts:?}, {length} bytes");
            }
        }
    }
}

/// The value of a finite f16.
fn half(bits: u16) -> f64 {
    let (sign, exponent, fraction) = (bits >> 15, i32::from(bits >> 10 & 31), f64::from(bits & 1023));
    let size = if exponent == 0 { fraction * 2f64.powi(-24) } else { (1024.0 + fraction) * 2f64.powi(exponent - 25) };
    if sign == 1 { -size } else { size }
}

/// Where memory holds fewer pairs than an image has, it is rendered in windows; their number is learnt, too.
#[test]
fn windows_are_learnt() {
    let small = GpuOverrides { binding_limit: 64 << 10, ..GpuOverrides::default() };
    let Some(mut gpu) = gpu() else { return };
    let mut limited = beside(&gpu, overriding(small));
    let (gaussians, view) = (cloud(3000, 0, 7), view(97, 71));
    assert_identical(&mut limited, &mut gpu, &gaussians, &view, &everything());
    let images = narrow(&image_gradients(&view));
    let (_, counts) = counted(&mut limited, |gpu| {
        gpu.render(&gaussians, &view, &RenderOptions::default()).unwrap();
        gpu.backward(&gaussians, &view, &everything(), &images).unwrap()
    });
    assert_eq!(counts.repeats, 0, "{counts:?}");
}
