// Shared by projection and its backward pass: the Gaussians, and where one appears.
@group(0) @binding(1) var<storage, read> means: array<f32>;
@group(0) @binding(2) var<storage, read> quaternions: array<f32>;
@group(0) @binding(3) var<storage, read> log_scales: array<f32>;
@group(0) @binding(4) var<storage, read> logits: array<f32>;
@group(0) @binding(5) var<storage, read> filters: array<f32>;

// √(½ log₂e)
const HALF_LOG2_E: f32 = 0.8493218;

fn geometry_at(at: u32) -> Geometry {
    let mean = vec3(means[3u * at], means[3u * at + 1u], means[3u * at + 2u]);
    let quaternion =
        vec4(quaternions[4u * at], quaternions[4u * at + 1u], quaternions[4u * at + 2u], quaternions[4u * at + 3u]);
    let logs = vec3(log_scales[3u * at], log_scales[3u * at + 1u], log_scales[3u * at + 2u]);
    var filter_3d = 0.0;
    if has(HAS_FILTER) {
        filter_3d = filters[at];
    }
    return geometry(mean, quaternion, logs, logits[at], filter_3d);
}
