// Projection of one Gaussian, as in the reference. Quantities that may be huge or tiny keep their power of two
// separately, because a Gaussian of width 1e30 is valid too.
const DRAWN: u32 = 0u;
const INVALID: u32 = 1u;
const OUTSIDE_DEPTH: u32 = 2u;
const FAINT: u32 = 3u;
const OUTSIDE_IMAGE: u32 = 4u;

const LOG_SCALE_LIMIT: f32 = 43.5;

struct Geometry {
    outcome: u32,
    // Mean in camera coordinates.
    x: vec2<f32>,
    y: vec2<f32>,
    z: vec2<f32>,
    // Projected centre in pixels.
    centre_x: vec2<f32>,
    centre_y: vec2<f32>,
    true_slope: vec2<f32>,
    // Clamped slope for the Jacobian.
    slope: vec2<f32>,
    // Rotation world_from_gaussian: columns are the Gaussian's axes.
    rotation: mat3x3<f32>,
    unit: vec4<f32>,
    norm: Scaled,
    // Standard deviations over 2^scale_exponent.
    scales: vec3<f32>,
    scale_exponent: i32,
    unfiltered_share: vec3<f32>,
    // Rows of ∂pixel/∂slope: focal lengths times the lens's Jacobian.
    pixel_from_slope: mat2x2<f32>,
    // Rows of ∂pixel/∂(x, y, z) in camera coordinates, times the depth.
    jacobian: array<vec3<f32>, 2>,
    // Rows of the Jacobian in the Gaussian's axes, times the power of two of the depth.
    axis_rows: array<vec3<f32>, 2>,
    // Rows of the Jacobian in units of standard deviations, divided by 2^exponent.
    rows: array<vec3<f32>, 2>,
    exponent: i32,
    // 2D covariance and determinants, divided by powers of 2^exponent; all but `inner_determinant` include the blur.
    xx: f32,
    xy: f32,
    yy: f32,
    inner_determinant: f32,
    determinant: f32,
    compensation: f32,
    opacity: f32,
}

fn row_of_rotation(row: u32, x: vec2<f32>, y: vec2<f32>, z: vec2<f32>) -> vec2<f32> {
    let high = view.rotation[row];
    let low = view.rotation_low[row];
    let sum = double_add(double_product(x, vec2(high.x, low.x)), double_product(y, vec2(high.y, low.y)));
    return double_add(sum, double_product(z, vec2(high.z, low.z)));
}

fn from_centre(mean: vec3<f32>, axis: u32) -> vec2<f32> {
    let difference = two_sum(mean[axis], -view.centre[axis]);
    return quick_sum(difference.x, difference.y - view.centre_low[axis]);
}

fn depth_is_kept(z: vec2<f32>) -> bool {
    let near = view.depths.xz;
    let far = view.depths.yw;
    let beyond = select(at_most(near, z), !at_most(z, near), has(NEAR_IS_CULLED));
    return beyond && at_most(z, far);
}

fn rotation_of(q: vec4<f32>) -> mat3x3<f32> {
    let w = q.x;
    let x = q.y;
    let y = q.z;
    let z = q.w;
    return mat3x3(
        1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y),
        2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x),
        2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y),
    );
}

// Largest distance in pixels from the image corner to a drawn centre: `FARTHEST` of reach.rs.
const FARTHEST_CENTRE: f32 = 1e10;

fn is_near_image(centre: vec2<f32>) -> bool {
    let most = vec2(FARTHEST_CENTRE, 0.0);
    return at_most(centre, most) && at_most(-centre, most);
}

// Distance from the camera beyond which f32 arithmetic would overflow: 2^60.
const FARTHEST: f32 = 1.152921504606847e18;

// A quaternion divided by a power of two, after which its largest part is a normal number.
struct Lifted {
    parts: vec4<f32>,
    largest: f32,
    exponent: i32,
}

// `magnitudes` are the bits of the parts without their signs, `largest` is the largest of them.
fn lifted_quaternion(quaternion: vec4<f32>, magnitudes: vec4<u32>, largest: u32) -> Lifted {
    if largest >= 0x00800000u {
        return Lifted(quaternion, bitcast<f32>(largest), 0);
    }
    // Bits of denormals are multiples of 2^-149.
    let signs = bitcast<vec4<u32>>(quaternion) & vec4(0x80000000u);
    let parts = bitcast<vec4<f32>>(bitcast<vec4<u32>>(vec4<f32>(magnitudes)) | signs);
    return Lifted(parts, f32(largest), -149);
}

fn geometry(mean: vec3<f32>, quaternion: vec4<f32>, log_scales: vec3<f32>, logit: f32, filter_3d: f32) -> Geometry {
    var g: Geometry;
    g.outcome = INVALID;
    if !are_finite(mean) {
        return g;
    }
    let dx = from_centre(mean, 0u);
    let dy = from_centre(mean, 1u);
    let dz = from_centre(mean, 2u);
    if !(max(max(abs(dx.x), abs(dy.x)), abs(dz.x)) < FARTHEST) {
        // Too far to project; only its side of the near and far planes is determined.
        let row = view.rotation[2].xyz;
        let depth = dot(row, vec3(dx.x, dy.x, dz.x) * 5.421011e-20) * 1.8446744e19;
        g.outcome = select(INVALID, OUTSIDE_DEPTH, !depth_is_kept(vec2(depth, 0.0)));
        return g;
    }
    g.x = row_of_rotation(0u, dx, dy, dz);
    g.y = row_of_rotation(1u, dx, dy, dz);
    g.z = row_of_rotation(2u, dx, dy, dz);
    if !depth_is_kept(g.z) {
        g.outcome = OUTSIDE_DEPTH;
        return g;
    }
    if !(abs(g.z.x) > 1e-30) {
        return g;
    }

    if (bitcast<u32>(logit) & 0x7fffffffu) > 0x7f800000u {
        return g;
    }
    let sigmoid = 1.0 / (1.0 + exp_within_range(-logit));
    if sigmoid < view.rules.z {
        g.outcome = FAINT;
        return g;
    }

    // Compared as bits, because arithmetic may take denormals for zero.
    let magnitudes = bitcast<vec4<u32>>(quaternion) & vec4(0x7fffffffu);
    let largest = max(max(magnitudes.x, magnitudes.y), max(magnitudes.z, magnitudes.w));
    let all_finite = largest < 0x7f800000u;
    // -inf is a standard deviation of 0.
    let scales_valid = is_valid_log_scale(log_scales.x) && is_valid_log_scale(log_scales.y) && is_valid_log_scale(log_scales.z);
    if !all_finite || largest == 0u || !scales_valid || !is_finite(filter_3d) {
        return g;
    }
    let lifted = lifted_quaternion(quaternion, magnitudes, largest);
    let size = exponent_of(lifted.largest);
    let half = power_of_two(-size / 2);
    let near_unit = lifted.parts * half * power_of_two(-size - (-size / 2));
    let length = root(dot(near_unit, near_unit));
    g.norm = Scaled(length, size + lifted.exponent);
    g.unit = near_unit / length;
    g.rotation = rotation_of(g.unit);

    let sx = scaled_exp(log_scales.x);
    let sy = scaled_exp(log_scales.y);
    let sz = scaled_exp(log_scales.z);
    g.scale_exponent = max(max(sx.exponent, sy.exponent), sz.exponent);
    let filtered = has(HAS_FILTER) && filter_3d != 0.0;
    if filtered {
        g.scale_exponent = max(g.scale_exponent, exponent_of(filter_3d));
    }
    g.scales = vec3(
        sx.mantissa * power_of_two(sx.exponent - g.scale_exponent),
        sy.mantissa * power_of_two(sy.exponent - g.scale_exponent),
        sz.mantissa * power_of_two(sz.exponent - g.scale_exponent),
    );
    g.unfiltered_share = vec3(1.0);
    var filtering = 1.0;
    if filtered {
        let size_of_filter = exponent_of(filter_3d);
        let mantissa = bitcast<f32>((bitcast<u32>(filter_3d) & 0x007fffffu) | 0x3f800000u);
        let width = select(mantissa * power_of_two(size_of_filter - g.scale_exponent), 0.0, size_of_filter < -126);
        let own = g.scales * g.scales;
        let total = own + vec3(width * width);
        g.unfiltered_share = select(own / total, vec3(1.0), total <= vec3(0.0));
        g.scales = vec3(root(total.x), root(total.y), root(total.z));
        filtering = root(g.unfiltered_share.x) * root(g.unfiltered_share.y) * root(g.unfiltered_share.z);
    }

    // Centre and Jacobian.
    let slope_x = double_ratio(g.x, g.z);
    let slope_y = double_ratio(g.y, g.z);
    g.true_slope = vec2(slope_x.x, slope_y.x);
    g.slope = clamp(g.true_slope, view.slopes.xy, view.slopes.zw);
    var distorted_x = slope_x;
    var distorted_y = slope_y;
    g.pixel_from_slope = mat2x2(view.focal.x, 0.0, 0.0, view.focal.y);
    if has(LENS_ANY) {
        if !lens_sees(g.true_slope) || !lens_sees(g.slope) {
            g.outcome = OUTSIDE_IMAGE;
            return g;
        }
        let bend = lens_bend(g.true_slope);
        distorted_x = double_add(slope_x, vec2(bend.x, 0.0));
        distorted_y = double_add(slope_y, vec2(bend.y, 0.0));
        let jacobian = lens_jacobian(g.slope);
        g.pixel_from_slope = mat2x2(
            view.focal.x * jacobian.x, view.focal.y * jacobian.y,
            view.focal.x * jacobian.y, view.focal.y * jacobian.z,
        );
    }
    g.centre_x = double_add(double_product(distorted_x, view.focal.xz), view.principal.xz);
    g.centre_y = double_add(double_product(distorted_y, view.focal.yw), view.principal.yw);
    if !is_finite(g.centre_x.x) || !is_finite(g.centre_y.x) || !is_finite(g.centre_x.y) || !is_finite(g.centre_y.y) {
        return g;
    }
    let depth_exponent = exponent_of(g.z.x);
    let depth_mantissa = g.z.x * power_of_two(-depth_exponent);
    let to_camera = transpose(mat3x3(view.rotation[0].xyz, view.rotation[1].xyz, view.rotation[2].xyz)) * g.rotation;
    for (var row = 0u; row < 2u; row++) {
        let along = vec2(g.pixel_from_slope[0][row], g.pixel_from_slope[1][row]);
        g.jacobian[row] = vec3(along, -dot(along, g.slope));
        g.axis_rows[row] = (g.jacobian[row] / depth_mantissa) * to_camera;
    }

    // Covariance.
    let u = g.axis_rows[0] * g.scales;
    let v = g.axis_rows[1] * g.scales;
    let widest = max(max(max(abs(u.x), abs(u.y)), abs(u.z)), max(max(abs(v.x), abs(v.y)), abs(v.z)));
    if !is_finite(widest) {
        return g;
    }
    let blur = view.rules.x;
    let shift = g.scale_exponent - depth_exponent;
    g.exponent = max(exponent_of(widest) + shift, select(exponent_of(blur) / 2, -10000, !(blur > 0.0)));
    let rescale = power_of_two(shift - g.exponent);
    g.rows[0] = u * rescale;
    g.rows[1] = v * rescale;
    let normal = cross(g.rows[0], g.rows[1]);
    g.inner_determinant = dot(normal, normal);
    let blurring = (blur * power_of_two(-g.exponent)) * power_of_two(-g.exponent);
    let uu = dot(g.rows[0], g.rows[0]);
    let vv = dot(g.rows[1], g.rows[1]);
    g.xx = uu + blurring;
    g.yy = vv + blurring;
    g.xy = dot(g.rows[0], g.rows[1]);
    g.determinant = g.inner_determinant + blurring * (uu + vv) + blurring * blurring;
    if !(min(g.determinant, g.yy) > 1e-37) || !is_finite(g.determinant) {
        return g;
    }
    g.compensation = 1.0;
    if has(ANTIALIASED) {
        g.compensation = max(root(g.inner_determinant / g.determinant), view.rules.w);
    }
    g.opacity = sigmoid * filtering * g.compensation;
    if !(g.opacity >= view.rules.z) {
        g.outcome = FAINT;
        return g;
    }
    g.outcome = select(OUTSIDE_IMAGE, DRAWN, is_near_image(g.centre_x) && is_near_image(g.centre_y));
    return g;
}

fn is_valid_log_scale(log_scale: f32) -> bool {
    let bits = bitcast<u32>(log_scale);
    let is_number = (bits & 0x7fffffffu) <= 0x7f800000u;
    return is_number && bits != 0x7f800000u && log_scale <= LOG_SCALE_LIMIT;
}
