// Projection: one Gaussian per thread.
// Whitener (three values) and opacity.
@group(0) @binding(6) var<storage, read_write> shapes: array<vec4<f32>>;
// Centre of the pixel `base` minus the projected centre (x, y), `base` as two 16-bit halves, depth.
@group(0) @binding(7) var<storage, read_write> positions: array<vec4<u32>>;
// Half-open range of columns, then rows; for a culled Gaussian the reason and no rows.
@group(0) @binding(8) var<storage, read_write> reaches: array<vec2<u32>>;

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
    let g = geometry_at(gaussian);
    let index = view.part.y + at;
    if g.outcome != DRAWN {
        reaches[index] = vec2(g.outcome, 0u);
        return;
    }
    let reach = reach_of(g);
    if (reach.x >> 16u) <= (reach.x & 0xffffu) || (reach.y >> 16u) <= (reach.y & 0xffffu) {
        reaches[index] = vec2(OUTSIDE_IMAGE, 0u);
        return;
    }
    reaches[index] = reach;
    let scale = HALF_LOG2_E * power_of_two(-g.exponent);
    let across = root(g.yy);
    let leg = scale / (across * root(g.determinant));
    // Without blur a Gaussian may be too narrow to whiten in f32; the clamped one is practically a point.
    let whitener = clamp(vec3(g.yy * leg, -g.xy * leg, scale / across), vec3(-1e30), vec3(1e30));
    shapes[index] = vec4(whitener, g.opacity);
    let base = vec2(clamp(floor(g.centre_x.x), 0.0, 65535.0), clamp(floor(g.centre_y.x), 0.0, 65535.0));
    let offset = vec2(((base.x + 0.5) - g.centre_x.x) - g.centre_x.y, ((base.y + 0.5) - g.centre_y.x) - g.centre_y.y);
    positions[index] = vec4(
        bitcast<u32>(offset.x), bitcast<u32>(offset.y), u32(base.x) | (u32(base.y) << 16u), bitcast<u32>(g.z.x),
    );
}

fn reach_of(g: Geometry) -> vec2<u32> {
    let size = vec2(f32(view.image.x), f32(view.image.y));
    // Clamped far outside the image, so that nothing below overflows.
    let centre = clamp(vec2(g.centre_x.x, g.centre_y.x), vec2(-1e30), vec2(1e30));
    // Applied in two steps, because its square may overflow f32.
    let widen = min(power_of_two(g.exponent), 1e18);
    var first: vec2<f32>;
    var end: vec2<f32>;
    if has(THREE_SIGMA) {
        let middle = 0.5 * (g.xx + g.yy);
        let gap = middle * middle - g.determinant;
        // 0.1 square pixels, in the covariance's units.
        let least = 0.1 * power_of_two(-2 * g.exponent) * power_of_two(-2 * g.exponent);
        let longest = middle + root(max(gap, least));
        // For so narrow a Gaussian, possible only without blur, `least` overflows f32, and the radius follows from it
        // alone.
        let radius = select(ceil(3.0 * root(longest) * widen), 2.0, g.exponent < -24);
        first = trunc((centre - 0.5 - radius) / 16.0) * 16.0;
        end = trunc((centre - 0.5 + radius + 15.0) / 16.0) * 16.0;
    } else {
        let cut = root(max(2.0 * (log(g.opacity) - view.rules.y), 0.0));
        let half = vec2(root(g.xx), root(g.yy)) * (cut * 1.01 * widen) + 0.01;
        first = ceil(centre - half - 0.5);
        end = floor(centre + half - 0.5) + 1.0;
    }
    let low = vec2<u32>(clamp(first, vec2(0.0), size));
    let high = vec2<u32>(clamp(end, vec2(0.0), size));
    return vec2(low.x | (high.x << 16u), low.y | (high.y << 16u));
}
