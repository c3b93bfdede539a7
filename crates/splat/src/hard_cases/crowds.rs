use atsplat_camera::ImageSize;

use super::HardCase;
use super::scene::{BACKDROP, SAMPLE, Sample, case, gaussians, view_of_size};

/// Gaussians at one position, each with its own colour.
fn coincident(count: usize, logit: f32) -> impl Iterator<Item = Sample> {
    (0..count).map(move |n| {
        let shade = (n % 97) as f32 / 97.0;
        Sample { logit, colour: [shade, 1.0 - shade, 0.5 - shade], ..SAMPLE }
    })
}

pub(super) fn cases() -> Vec<HardCase> {
    let batch = |name, count| {
        let description = "counts around the capacity of a batch or a byte";
        let case = case(name, description, gaussians(coincident(count, -3.5))).with_counts([count as u64, 0, 0, 0, 0]);
        case.with_image_bound(5e-6).with_gradient_bound(1e-3)
    };
    let ties = (0..300).map(|n| {
        let turn = n as f32;
        let mean = [0.4 * (0.7 * turn).sin(), 0.3 * (1.1 * turn).cos(), 2.0];
        Sample { mean, logit: -1.0, colour: [turn.sin(), turn.cos(), 0.2], ..SAMPLE }
    });
    let mut depth = 2.0f32;
    let adjacent = std::iter::repeat_with(|| {
        depth = depth.next_down();
        Sample { mean: [0.0, 0.0, depth], logit: 0.0, colour: [depth.fract(), (2.0 - depth) * 4e5, 0.1], ..SAMPLE }
    });
    let adjacent: Vec<Sample> = adjacent.take(12).collect();
    let crowd = case("ten-thousand", "ten thousand Gaussians at one position", gaussians(coincident(10_000, -4.0)))
        .with_counts([10_000, 0, 0, 0, 0])
        .with_image_bound(1e-5)
        .with_gradient_bound(1e-3);
    let small = ImageSize { width: 5, height: 4 };
    vec![
        case("nothing", "no Gaussians at all", gaussians([])).with_counts([0; 5]),
        crowd.with_view(view_of_size(small.width, small.height)),
        batch("255-in-one-place", 255),
        batch("256-in-one-place", 256),
        batch("257-in-one-place", 257),
        case("equal-depths", "three hundred at one depth, composited in list order", gaussians(ties))
            .with_image_bound(5e-6),
        case("adjacent-depths", "depths one unit in the last place apart, listed from the farthest", {
            gaussians(adjacent.into_iter().chain([BACKDROP]))
        }),
    ]
}
