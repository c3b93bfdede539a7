// Backward pass of projection, from a splat to its Gaussian and the camera: the reference's chain rule in whitened
// coordinates, in which nothing is huge or tiny. With the whitener L, the Jacobian's rows V in units of standard
// deviations and the second moments M, the gradient of V is −Lᵀ M L V.
@group(0) @binding(6) var<storage, read> firsts: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> seconds: array<vec4<f32>>;
// 24 values per splat: mean, quaternion, log-scales, logit, projected centre, conic, pose (rotation, then
// translation), two that `colour_backward.wgsl` wrote. On entry the first three hold the mean's gradient through the colour.
@group(0) @binding(8) var<storage, read_write> records: array<f32>;

fn store3(at: u32, value: vec3<f32>) {
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
    let at = linear_index(group, groups, 64u, local);
    if at >= splats() {
        return;
    }
    let gaussian = enter(at);
    let index = view.part.y + at;
    let record = RECORD * at;
    let mean = record + OF_MEAN;
    let d_mean = vec3(records[mean], records[mean + 1u], records[mean + 2u]);
    for (var k = 0u; k < OF_SCREEN; k++) {
        records[record + k] = 0.0;
    }
    let first = firsts[index];
    let second = seconds[index];
    let g = geometry_at(gaussian);
    if g.outcome != DRAWN {
        return;
    }

    // The whitener divided by 2^−exponent, in units of standard deviations.
    let across = root(g.yy);
    let root_determinant = root(g.determinant);
    let l11 = across / root_determinant;
    let l12 = -g.xy / (across * root_determinant);
    let l22 = 1.0 / across;
    let d_e = first.x;
    let m1 = first.yz / HALF_LOG2_E;
    let m = second.xyz / (HALF_LOG2_E * HALF_LOG2_E);

    // Opacity: e is minus the gradient of its logarithm.
    let one_minus_sigmoid = 1.0 / (1.0 + exp_within_range(logits[gaussian]));
    records[record + OF_LOGIT] = saturated(-d_e * one_minus_sigmoid);
    var d_logs = -d_e * (vec3(1.0) - g.unfiltered_share);

    // Centre and conic.
    let narrow = power_of_two(-g.exponent);
    let d_centre = -vec2(l11 * m1.x, l12 * m1.x + l22 * m1.y) * narrow;
    records[record + OF_CENTRE] = saturated(d_centre.x);
    records[record + OF_CENTRE + 1u] = saturated(d_centre.y);
    let widen = power_of_two(g.exponent);
    let k1 = root_determinant / across;
    let k2 = g.xy / across;
    let n = vec3(
        k1 * k1 * m.x + 2.0 * k1 * k2 * m.y + k2 * k2 * m.z,
        across * (k1 * m.y + k2 * m.z),
        across * across * m.z,
    );
    store3(record + OF_CONIC, ((n * vec3(0.5, 1.0, 0.5)) * widen) * widen);

    // Gradient of the rows V, divided by 2^−exponent.
    let u = g.rows[0];
    let v = g.rows[1];
    let p1 = l11 * u + l12 * v;
    let p2 = l22 * v;
    let q1 = m.x * p1 + m.y * p2;
    let q2 = m.y * p1 + m.z * p2;
    var d_u = -l11 * q1;
    var d_v = -l12 * q1 - l22 * q2;
    if has(ANTIALIASED) && g.compensation > view.rules.w {
        // The logarithm of the compensation contributes ½ (Σ⁻¹ − Σ'⁻¹): the second term as if M were reduced by the
        // identity, the first through the normal.
        let d_log = -d_e;
        d_u -= d_log * (l11 * p1);
        d_v -= d_log * (l12 * p1 + l22 * p2);
        let normal = cross(u, v);
        if g.inner_determinant > 1e-37 {
            d_u += d_log * cross(v, normal) / g.inner_determinant;
            d_v += d_log * cross(normal, u) / g.inner_determinant;
        }
    }
    let of_axes = d_u * u + d_v * v;
    d_logs += of_axes * g.unfiltered_share;
    store3(record + OF_LOG_SCALES, d_logs);

    // Rotation: gradient of a small rotation in the Gaussian's own frame.
    let scaled_u = d_u * g.scales;
    let scaled_v = d_v * g.scales;
    let shift = power_of_two(g.scale_exponent - exponent_of(g.z.x) - g.exponent);
    let d_turn = (cross(scaled_u, g.axis_rows[0]) + cross(scaled_v, g.axis_rows[1])) * shift;
    let w = g.unit.x;
    let xyz = g.unit.yzw;
    let d_unit = 2.0 * vec4(-dot(xyz, d_turn), w * d_turn + cross(xyz, d_turn)) / g.norm.mantissa;
    let back = power_of_two(-g.norm.exponent / 2);
    let rest_back = power_of_two(-g.norm.exponent - (-g.norm.exponent / 2));
    let d_quaternion = (d_unit * back) * rest_back;
    records[record + OF_QUATERNION] = saturated(d_quaternion.x);
    store3(record + OF_QUATERNION + 1u, d_quaternion.yzw);

    // Mean in camera coordinates, through the projected centre, the depth and the Jacobian.
    let z = g.z.x;
    var pixel_from_true_slope = g.pixel_from_slope;
    if has(LENS_ANY) {
        let j = lens_jacobian(g.true_slope);
        pixel_from_true_slope = mat2x2(view.focal.x * j.x, view.focal.y * j.y, view.focal.x * j.y, view.focal.y * j.z);
    }
    let d_true_slope = d_centre * pixel_from_true_slope;
    var d_camera = vec3(d_true_slope, -dot(d_true_slope, g.true_slope)) / z;
    d_camera.z += first.w - (of_axes.x + of_axes.y + of_axes.z) / z;
    let rotation = mat3x3(view.rotation[0].xyz, view.rotation[1].xyz, view.rotation[2].xyz);
    let to_camera = transpose(rotation) * g.rotation;
    // Gradient of the Jacobian's rows times the depth.
    let from_rows = shift / (z * power_of_two(-exponent_of(z)));
    let d_row1 = (to_camera * scaled_u) * from_rows;
    let d_row2 = (to_camera * scaled_v) * from_rows;
    var d_slope = -(vec2(d_row1.z, d_row2.z) * g.pixel_from_slope);
    if has(LENS_ANY) {
        let on1 = d_row1.xy - g.slope * d_row1.z;
        let on2 = d_row2.xy - g.slope * d_row2.z;
        for (var axis = 0u; axis < 2u; axis++) {
            let change = lens_jacobian_slope(g.slope, axis);
            d_slope[axis] += view.focal.x * dot(change.xy, on1) + view.focal.y * dot(change.yz, on2);
        }
    }
    for (var axis = 0u; axis < 2u; axis++) {
        if g.slope[axis] == g.true_slope[axis] {
            d_camera[axis] += d_slope[axis] / z;
            d_camera.z -= d_slope[axis] * g.true_slope[axis] / z;
        } else if has(CLAMP_PASSES) {
            d_camera.z -= d_slope[axis] * g.slope[axis] / z;
        }
    }
    store3(mean, d_mean + rotation * d_camera);
    let centre = vec3(g.x.x, g.y.x, g.z.x);
    let d_turn_jacobian = cross(d_row1, g.jacobian[0]) + cross(d_row2, g.jacobian[1]);
    store3(record + OF_ROTATION, cross(centre, d_camera) + d_turn_jacobian);
    store3(record + OF_TRANSLATION, d_camera + d_mean * rotation);
}
