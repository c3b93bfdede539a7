// The view, as every kernel sees it. Values that need more precision than f32 are sums of two f32, high and low.
struct View {
    // Rows of the rotation camera_from_world.
    rotation: array<vec4<f32>, 3>,
    rotation_low: array<vec4<f32>, 3>,
    // Camera centre in world coordinates.
    centre: vec4<f32>,
    centre_low: vec4<f32>,
    // x, y, then their low parts; in pixels.
    focal: vec4<f32>,
    principal: vec4<f32>,
    // Range to which slopes are clamped for the Jacobian: smallest x and y, largest x and y.
    slopes: vec4<f32>,
    // near, far (at most the largest depth that is composited), and their low parts.
    depths: vec4<f32>,
    // Blur, logarithm of min_alpha, min_alpha, min_compensation.
    rules: vec4<f32>,
    // max_alpha, min_alpha, min_transmittance.
    alphas: vec4<f32>,
    background: vec4<f32>,
    // Rows of the matrix, the offset last.
    exposure: array<vec4<f32>, 3>,
    lens: vec4<f32>,
    // p2, p1, and the largest radius (perspective) or angle (fisheye) that the lens maps.
    lens_more: vec4<f32>,
    // Width, height, flags, zero.
    image: vec4<u32>,
    // Gaussians of this part, index of its first, coefficients stored, degree evaluated. For tile lists: the first
    // entry of this pass, and the number of entries. For listing pairs: the most that longer lists could hold.
    part: vec4<u32>,
    // Tiles of the window: first column and row, columns and rows.
    tiles: vec4<u32>,
    // Pixels of the strip, pairs that the lists hold, first pixel row of the image buffers, total number of Gaussians.
    // Of more pairs none is listed: the host repeats the rendering with longer lists.
    window: vec4<u32>,
    // Of a batch: splats and tiles of an image, images, views of a scene. For a single image, the first two are larger than
    // any index.
    batch: vec4<u32>,
}

// Every model that bends rays. The host adds the constants of each flag, see `layout.rs`.
const LENS_ANY: u32 = LENS_OPENCV | LENS_FISHEYE;

fn has(flag: u32) -> bool {
    return (view.image.z & flag) != 0u;
}

// Compilers may assume that no value is NaN or infinite, so this tests the bits.
fn is_finite(value: f32) -> bool {
    return (bitcast<u32>(value) & 0x7f800000u) != 0x7f800000u;
}

fn are_finite(value: vec3<f32>) -> bool {
    return is_finite(value.x) && is_finite(value.y) && is_finite(value.z);
}

// The nearest finite number; NaN stays NaN. Tests the bits, as above.
fn saturated(value: f32) -> f32 {
    let bits = bitcast<u32>(value);
    if (bits & 0x7fffffffu) != 0x7f800000u {
        return value;
    }
    return bitcast<f32>(0x7f7fffffu | (bits & 0x80000000u));
}

fn saturated3(value: vec3<f32>) -> vec3<f32> {
    return vec3(saturated(value.x), saturated(value.y), saturated(value.z));
}

// Linear index of a thread; a dispatch may need more workgroups than one dimension allows.
fn linear_index(group: vec3<u32>, groups: vec3<u32>, size: u32, local: u32) -> u32 {
    return (group.y * groups.x + group.x) * size + local;
}
