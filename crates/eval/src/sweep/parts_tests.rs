//! Which Gaussians of trained weights are left at a smaller K.

use atsplat_camera::{Camera, CameraFromWorld, NormalizedIntrinsics};
use atsplat_model::config::{AnchorContext, AnchorDesign, HeadFrame};
use atsplat_model::network::{Device, Network, Views};
use atsplat_model::parameters::parameters;
use atsplat_model::weights::generated;
use atsplat_model::{ImageSize, ModelConfig};
use atsplat_numeric::{SplitMix64, Tolerance};
use atsplat_splat::{GaussianParts, Gaussians};
use glam::{DMat3, DVec3};

use super::Overrides;
use super::parts::adapted;
use crate::method::WeightsSource;

/// A matrix product with fewer columns may round differently.
const ROUNDING: Tolerance = Tolerance { absolute: 1e-5, relative: 1e-4 };

/// Two views side by side, of two rows of three patches.
fn views() -> Views {
    let camera = |x: f64| {
        let pose = CameraFromWorld::new(DMat3::IDENTITY, DVec3::new(-x, 0.0, 0.0)).unwrap();
        Camera::pinhole(pose, NormalizedIntrinsics::new(1.0, 1.5, 0.5, 0.5).unwrap())
    };
    let (size, mut random) = (ImageSize::new(32, 48), SplitMix64::new(7));
    let samples = (0..2 * 32 * 48 * 3).map(|_| (random.next_u64() % 256) as f32 / 255.0).collect();
    Views::new(size, samples, vec![camera(0.0), camera(0.5)]).unwrap()
}

/// The numbers of the first `kept` of each token's Gaussians, by field.
fn first(gaussians: &Gaussians, kept: usize, per_token: usize) -> [(&'static str, Vec<f64>); 5] {
    let GaussianParts { means, quaternions, log_scales, opacity_logits, sh, .. } = gaussians.parts();
    let of = |values: &[f32], width: usize| -> Vec<f64> {
        let tokens = values.chunks_exact(per_token * width);
        tokens.flat_map(|token| &token[..kept * width]).copied().map(f64::from).collect()
    };
    [
        ("means", of(means.as_flattened(), 3)),
        ("quaternions", of(quaternions.as_flattened(), 4)),
        ("log scales", of(log_scales.as_flattened(), 3)),
        ("opacities", of(opacity_logits, 1)),
        ("colours", of(sh.as_flattened(), 3)),
    ]
}

/// In the patch's frame and on rays, the place of a Gaussian depends on how many there are.
#[test]
fn fewer_gaussians_per_token_are_the_first_of_the_whole_network() {
    let world = ModelConfig::named("nano").unwrap();
    let (mut patch, mut rays) = (world.clone(), world.clone());
    patch.head.frame = HeadFrame::Patch;
    (rays.anchors.design, rays.anchors.context) = (AnchorDesign::RayDepth {}, AnchorContext::None {});
    let weights = WeightsSource::File { sha256: "00".to_owned() };
    for (stored, what) in [(world, "world"), (patch, "patch"), (rays, "rays")] {
        let tensors = generated(&parameters(&stored), 1);
        let of = |count: Option<usize>| {
            let config = Overrides { gaussians_per_token: count, ..Overrides::default() }.model(&stored).unwrap();
            let tensors = adapted(&config, tensors.clone(), &weights).unwrap();
            let network = Network::new(&config, &Device::flex()).unwrap().with_weights(&tensors).unwrap();
            network.reconstruct(&views(), 0).unwrap().gaussians
        };
        let whole = of(None);
        for count in [12, 8, 2] {
            let few = of(Some(count));
            assert_eq!(few.len() * 16, whole.len() * count, "{what}");
            for ((field, found), (_, expected)) in first(&few, count, count).into_iter().zip(first(&whole, count, 16)) {
                ROUNDING.assert(found, expected, &format!("{what}, K {count}, {field}"));
            }
        }
    }
}
