//! `.torch` files from outside the project: a chunk in pixelSplat's layout, and checkpoints.

use atsplat_numeric::Tolerance;
use atsplat_scene::torch::{self, TorchChunks, Value};
use atsplat_scene::{FrameImage, SceneSource, Warnings};
use atsplat_tests::shared_data;

#[test]
fn the_real_chunk_has_the_scene_with_279_posed_jpegs() {
    let Some(data) = shared_data("the_real_chunk_has_the_scene_with_279_posed_jpegs") else { return };
    let mut warnings = Warnings::new();
    let source = TorchChunks::open(data.join("re10k/chunk"), &mut warnings).unwrap();
    assert_eq!(source.keys(), ["000c3ab189999a83"]);
    let scene = source.load("000c3ab189999a83", &mut warnings).unwrap();
    assert_eq!(scene.frames.len(), 279);
    assert!(scene.frames.is_sorted_by_key(|frame| frame.timestamp_micros), "a video's order");
    for (position, frame) in scene.frames.iter().enumerate() {
        let FrameImage::Encoded(bytes) = &frame.image else { panic!("frame {position}: {:?}", frame.image) };
        assert!(bytes.starts_with(b"\xff\xd8\xff") && bytes.ends_with(b"\xff\xd9"), "frame {position} is a whole JPEG");
        Tolerance::F32_ROUND_TRIP.assert([frame.camera.camera_from_world.determinant()], [1.0], "rotation");
        // The frames are square crops of 640×360, so the widened fx is close to fy.
        Tolerance::relative(1e-2).assert([frame.camera.intrinsics.fx], [frame.camera.intrinsics.fy], "square pixels");
    }
    assert_eq!(warnings.total(), 0);
}

/// Written by Python 2: `OrderedDict` called with a list of pairs, tensors tagged `cuda:0`.
#[test]
fn lpips_heads_in_the_old_format_are_read() {
    let Some(data) = shared_data("lpips_heads_in_the_old_format_are_read") else { return };
    for (network, widths) in [
        ("alex", &[64u64, 192, 384, 256, 256][..]),
        ("vgg", &[64, 128, 256, 512, 512]),
        ("squeeze", &[64, 128, 256, 384, 384, 512, 512]),
    ] {
        for version in ["v0.0", "v0.1"] {
            let value = torch::read(data.join(format!("lpips/linear_heads/{version}/{network}.pth"))).unwrap();
            let heads = value.as_dict().unwrap();
            assert_eq!(heads.len(), widths.len(), "{network}");
            for (layer, &width) in widths.iter().enumerate() {
                let name = format!("lin{layer}.model.1.weight");
                let tensor = heads.get(&name).and_then(Value::as_tensor).unwrap();
                assert_eq!(tensor.shape(), [1, width, 1, 1], "{network} {name}");
                let weights = tensor.to_f64().unwrap();
                assert!(weights.iter().all(|weight| *weight >= 0.0), "{network} {name}: trained to be non-negative");
            }
        }
    }
}

#[test]
fn a_whole_network_is_read() {
    let Some(data) = shared_data("a_whole_network_is_read") else { return };
    let value = torch::read(data.join("lpips/st_lpips/alex_shift_tolerant.pth")).unwrap();
    let tensor = |name| value.as_dict().and_then(|state| state.get(name)).and_then(Value::as_tensor).unwrap();
    assert_eq!(tensor("net.slice1.0.weight").shape(), [64, 3, 11, 11]);
    // float32 of the published constants, as PyTorch prints them.
    Tolerance::F32_ROUND_TRIP.assert(
        tensor("scaling_layer.shift").to_f64().unwrap(),
        [-0.030, -0.088, -0.188],
        "shift",
    );
    Tolerance::F32_ROUND_TRIP.assert(tensor("scaling_layer.scale").to_f64().unwrap(), [0.458, 0.448, 0.450], "scale");
}
