// A splat's derivatives to its Gaussian and the camera: the reference's chain, in whitened coordinates, in which
// nothing is huge or tiny. With L the whitener, V the rows of pixels by standard deviations and M the second moments,
// the derivative by V is −Lᵀ M L V.
@group(0) @binding(1) var<storage, read> means: array<f32>;
@group(0) @binding(2) var<storage, read> quaternions: array<f32>;
@group(0) @binding(3) var<storage, read> log_scales: array<f32>;
@group(0) @binding(4) var<storage, read> logits: array<f32>;
@group(0) @binding(5) var<storage, read> filters: array<f32>;
@group(0) @binding(6) var<storage, read> firsts: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> seconds: array<vec4<f32>>;
// 24 numbers a Gaussian: mean, quaternion, log scales, logit, centre on the screen, conic, pose (rotation, then
// translation), two spare. On entry, what the colour gives to the mean.
@group(0) @binding(8) var<storage, read_write> records: array<f32>;

// √(½ log₂e)
const HALF_LOG2_E: f32 = 0.8493218;

fn put3(at: u32, value: vec3<f32>) {
    records[at] = saturated(value.x);
    records[at + 1u] = saturated(value.y);
    records[at + 2u] = saturated(value.z);
}

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let at = linear(group, groups, 64u, local);
    if at >= view.part.x {
        return;
    }
    let place = view.part.y + at;
    let record = 24u * at;
    let by_mean = vec3(records[record], records[record + 1u], records[record + 2u]);
    for (var k = 0u; k < 24u; k++) {
        records[record + k] = 0.0;
    }
    let first = firsts[place];
    let second = seconds[place];
    let mean = vec3(means[3u * at], means[3u * at + 1u], means[3u * at + 2u]);
    let quaternion =
        vec4(quaternions[4u * at], quaternions[4u * at + 1u], quaternions[4u * at + 2u], quaternions[4u * at + 3u]);
    let logs = vec3(log_scales[3u * at], log_scales[3u * at + 1u], log_scales[3u * at + 2u]);
    var filter_3d = 0.0;
    if has(HAS_FILTER) {
        filter_3d = filters[at];
    }
    let g = geometry(mean, quaternion, logs, logits[at], filter_3d);
    if g.outcome != DRAWN {
        return;
    }

    // The whitener over 2^−exponent, in units of standard deviations.
    let across = root(g.yy);
    let spread = root(g.determinant);
    let l11 = across / spread;
    let l12 = -g.xy / (across * spread);
    let l22 = 1.0 / across;
    let by_e = first.x;
    let m1 = first.yz / HALF_LOG2_E;
    let m = second.xyz / (HALF_LOG2_E * HALF_LOG2_E);

    // Opacity: e is the derivative by minus its logarithm.
    let rest = 1.0 / (1.0 + exp_within_range(logits[at]));
    records[record + 10u] = saturated(-by_e * rest);
    var by_logs = -by_e * (vec3(1.0) - g.own_share);

    // Centre and conic.
    let narrow = power_of_two(-g.exponent);
    let by_centre = -vec2(l11 * m1.x, l12 * m1.x + l22 * m1.y) * narrow;
    records[record + 11u] = saturated(by_centre.x);
    records[record + 12u] = saturated(by_centre.y);
    let widen = power_of_two(g.exponent);
    let k1 = spread / across;
    let k2 = g.xy / across;
    let n = vec3(
        k1 * k1 * m.x + 2.0 * k1 * k2 * m.y + k2 * k2 * m.z,
        across * (k1 * m.y + k2 * m.z),
        across * across * m.z,
    );
    put3(record + 13u, ((n * vec3(0.5, 1.0, 0.5)) * widen) * widen);

    // By the rows V, over 2^−exponent.
    let u = g.rows[0];
    let v = g.rows[1];
    let p1 = l11 * u + l12 * v;
    let p2 = l22 * v;
    let q1 = m.x * p1 + m.y * p2;
    let q2 = m.y * p1 + m.z * p2;
    var by_u = -l11 * q1;
    var by_v = -l12 * q1 - l22 * q2;
    if has(ANTIALIASED) && g.compensation > view.rules.w {
        // ½ (Σ⁻¹ − Σ'⁻¹) of the logarithm: the second as if M were less by the identity, the first by the normal.
        let by_log = -by_e;
        by_u -= by_log * (l11 * p1);
        by_v -= by_log * (l12 * p1 + l22 * p2);
        let normal = cross(u, v);
        if g.sharp > 1e-37 {
            by_u += by_log * cross(v, normal) / g.sharp;
            by_v += by_log * cross(normal, u) / g.sharp;
        }
    }
    let of_axes = by_u * u + by_v * v;
    by_logs += of_axes * g.own_share;
    put3(record + 7u, by_logs);

    // Rotation: by a small turn within the Gaussian's own frame.
    let scaled_u = by_u * g.scales;
    let scaled_v = by_v * g.scales;
    let shift = power_of_two(g.scale_exponent - exponent_of(g.z.x) - g.exponent);
    let turn = (cross(scaled_u, g.by_axis[0]) + cross(scaled_v, g.by_axis[1])) * shift;
    let w = g.unit.x;
    let xyz = g.unit.yzw;
    let by_unit = 2.0 * vec4(-dot(xyz, turn), w * turn + cross(xyz, turn)) / g.norm.mantissa;
    let back = power_of_two(-g.norm.exponent / 2);
    let rest_back = power_of_two(-g.norm.exponent - (-g.norm.exponent / 2));
    let by_quaternion = (by_unit * back) * rest_back;
    records[record + 3u] = saturated(by_quaternion.x);
    put3(record + 4u, by_quaternion.yzw);

    // Centre in the camera's frame, through the centre on the screen, the depth and the Jacobian.
    let z = g.z.x;
    var there = g.pixel_from_slope;
    if has(LENS_OPENCV | LENS_FISHEYE) {
        let j = lens_jacobian(g.true_slope);
        there = mat2x2(view.focal.x * j.x, view.focal.y * j.y, view.focal.x * j.y, view.focal.y * j.z);
    }
    let by_true_slope = by_centre * there;
    var in_camera = vec3(by_true_slope, -dot(by_true_slope, g.true_slope)) / z;
    in_camera.z += first.w - (of_axes.x + of_axes.y + of_axes.z) / z;
    let rotation = mat3x3(view.rotation[0].xyz, view.rotation[1].xyz, view.rotation[2].xyz);
    let to_camera = transpose(rotation) * g.rotation;
    // By the Jacobian's rows times the depth.
    let from_rows = shift / (z * power_of_two(-exponent_of(z)));
    let by_row1 = (to_camera * scaled_u) * from_rows;
    let by_row2 = (to_camera * scaled_v) * from_rows;
    var by_slope = -(vec2(by_row1.z, by_row2.z) * g.pixel_from_slope);
    if has(LENS_OPENCV | LENS_FISHEYE) {
        let on1 = by_row1.xy - g.slope * by_row1.z;
        let on2 = by_row2.xy - g.slope * by_row2.z;
        for (var axis = 0u; axis < 2u; axis++) {
            let change = lens_jacobian_slope(g.slope, axis);
            by_slope[axis] += view.focal.x * dot(change.xy, on1) + view.focal.y * dot(change.yz, on2);
        }
    }
    for (var axis = 0u; axis < 2u; axis++) {
        if g.slope[axis] == g.true_slope[axis] {
            in_camera[axis] += by_slope[axis] / z;
            in_camera.z -= by_slope[axis] * g.true_slope[axis] / z;
        } else if has(CLAMP_PASSES) {
            in_camera.z -= by_slope[axis] * g.slope[axis] / z;
        }
    }
    put3(record, by_mean + rotation * in_camera);
    let centre = vec3(g.x.x, g.y.x, g.z.x);
    let turned = cross(by_row1, g.jacobian[0]) + cross(by_row2, g.jacobian[1]);
    put3(record + 16u, cross(centre, in_camera) + turned);
    put3(record + 19u, in_camera + by_mean * rotation);
}
