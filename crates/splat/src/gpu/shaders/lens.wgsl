// OpenCV's perspective and fisheye models, as in the camera crate: the displacement of a slope, its Jacobian
// (symmetric: xx, xy, yy) and the Jacobian's derivatives.

fn lens_sees(slope: vec2<f32>) -> bool {
    // Squares of larger slopes overflow f32.
    if !(max(abs(slope.x), abs(slope.y)) < 1e18) {
        return false;
    }
    let radius = root(dot(slope, slope));
    return select(radius < view.lens_more.z, arc_tangent(radius) < view.lens_more.z, has(LENS_FISHEYE));
}

// For r ≥ 0, to 2 units in the last place.
fn arc_tangent(r: f32) -> f32 {
    var base = 0.0;
    var x = r;
    if r > 2.4142135 {
        base = 1.5707964;
        x = -1.0 / r;
    } else if r > 0.41421357 {
        base = 0.7853982;
        x = (r - 1.0) / (r + 1.0);
    }
    let s = x * x;
    let odd = (((8.05374449538e-2 * s - 1.38776856032e-1) * s + 1.99777106478e-1) * s - 3.33329491539e-1) * s;
    return base + (odd * x + x);
}

struct Radial {
    // Distorted radius divided by the undistorted radius.
    ratio: f32,
    // (radial derivative − ratio) / r².
    bend: f32,
    // The derivative of `bend` with respect to r, divided by r.
    bend_slope: f32,
}

fn fisheye_radial(r: f32) -> Radial {
    let k = view.lens;
    if r < 0.1 {
        // Series of θ(1 + k₁θ² + …) with θ = atan r.
        let c3 = k.x - 1.0 / 3.0;
        let c5 = 0.2 - k.x + k.y;
        let c7 = -1.0 / 7.0 + 14.0 / 15.0 * k.x - 5.0 / 3.0 * k.y + k.z;
        let s = r * r;
        return Radial(1.0 + s * (c3 + s * (c5 + s * c7)), 2.0 * c3 + s * (4.0 * c5 + s * 6.0 * c7), 8.0 * c5 + s * 24.0 * c7);
    }
    let angle = arc_tangent(r);
    let a = angle * angle;
    let distorted = angle * (1.0 + a * (k.x + a * (k.y + a * (k.z + a * k.w))));
    let first = 1.0 + a * (3.0 * k.x + a * (5.0 * k.y + a * (7.0 * k.z + a * 9.0 * k.w)));
    let second = angle * (6.0 * k.x + a * (20.0 * k.y + a * (42.0 * k.z + a * 72.0 * k.w)));
    let angle_slope = 1.0 / (1.0 + r * r);
    let along = first * angle_slope;
    let across = distorted / r;
    let along_slope = (second * angle_slope - 2.0 * r * first * angle_slope) * angle_slope;
    let bend = (along - across) / (r * r);
    return Radial(across, bend, (along_slope - bend * r) / (r * r * r) - 2.0 * bend / (r * r));
}

// Displacement of a slope by the lens.
fn lens_bend(x: vec2<f32>) -> vec2<f32> {
    let s = dot(x, x);
    if has(LENS_FISHEYE) {
        return x * (fisheye_radial(root(s)).ratio - 1.0);
    }
    let p = view.lens_more.xy;
    return x * (s * (view.lens.x + s * (view.lens.y + s * view.lens.z)) + 2.0 * dot(p, x)) + p * s;
}

// Both models are `diagonal · I + bend · x xᵀ + 2(p xᵀ + x pᵀ)`.
fn lens_jacobian(x: vec2<f32>) -> vec3<f32> {
    let s = dot(x, x);
    if has(LENS_FISHEYE) {
        let radial = fisheye_radial(root(s));
        return vec3(radial.ratio + radial.bend * x.x * x.x, radial.bend * x.x * x.y, radial.ratio + radial.bend * x.y * x.y);
    }
    let p = view.lens_more.xy;
    let k = view.lens;
    let diagonal = 1.0 + s * (k.x + s * (k.y + s * k.z)) + 2.0 * dot(p, x);
    let bend = 2.0 * (k.x + s * (2.0 * k.y + s * 3.0 * k.z));
    return vec3(
        diagonal + bend * x.x * x.x + 4.0 * p.x * x.x,
        bend * x.x * x.y + 2.0 * (p.x * x.y + p.y * x.x),
        diagonal + bend * x.y * x.y + 4.0 * p.y * x.y,
    );
}

// Derivative of the Jacobian along one axis.
fn lens_jacobian_slope(x: vec2<f32>, axis: u32) -> vec3<f32> {
    let s = dot(x, x);
    let e = vec2(select(0.0, 1.0, axis == 0u), select(0.0, 1.0, axis == 1u));
    let along = x[axis];
    var diagonal: f32;
    var bend: f32;
    var bend_slope: f32;
    var p = vec2(0.0);
    if has(LENS_FISHEYE) {
        let radial = fisheye_radial(root(s));
        bend = radial.bend;
        diagonal = bend * along;
        bend_slope = radial.bend_slope * along;
    } else {
        let k = view.lens;
        p = view.lens_more.xy;
        bend = 2.0 * (k.x + s * (2.0 * k.y + s * 3.0 * k.z));
        diagonal = bend * along + 2.0 * p[axis];
        bend_slope = 4.0 * along * (2.0 * k.y + s * 6.0 * k.z);
    }
    return vec3(
        diagonal + bend_slope * x.x * x.x + 2.0 * bend * e.x * x.x + 4.0 * p.x * e.x,
        bend_slope * x.x * x.y + bend * (e.x * x.y + e.y * x.x) + 2.0 * (p.x * e.y + p.y * e.x),
        diagonal + bend_slope * x.y * x.y + 2.0 * bend * e.y * x.y + 4.0 * p.y * e.y,
    );
}
