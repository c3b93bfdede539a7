// Real spherical harmonics up to degree 4 in the basis of 3DGS and gsplat, as polynomials of a unit direction;
// coefficient l² + l + m.

fn sh_basis(degree: u32, d: vec3<f32>) -> array<f32, 25> {
    let x = d.x;
    let y = d.y;
    let z = d.z;
    let xx = x * x;
    let yy = y * y;
    let zz = z * z;
    let xy = x * y;
    let yz = y * z;
    let xz = x * z;
    var b: array<f32, 25>;
    b[0] = 0.28209479177387814;
    if degree >= 1u {
        b[1] = -0.48860251190292 * y;
        b[2] = 0.48860251190292 * z;
        b[3] = -0.48860251190292 * x;
    }
    if degree >= 2u {
        b[4] = 1.0925484305920792 * xy;
        b[5] = -1.0925484305920792 * yz;
        b[6] = 0.31539156525252005 * (2.0 * zz - xx - yy);
        b[7] = -1.0925484305920792 * xz;
        b[8] = 0.5462742152960396 * (xx - yy);
    }
    if degree >= 3u {
        b[9] = -0.5900435899266435 * y * (3.0 * xx - yy);
        b[10] = 2.890611442640554 * xy * z;
        b[11] = -0.4570457994644658 * y * (4.0 * zz - xx - yy);
        b[12] = 0.3731763325901154 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy);
        b[13] = -0.4570457994644658 * x * (4.0 * zz - xx - yy);
        b[14] = 1.445305721320277 * z * (xx - yy);
        b[15] = -0.5900435899266435 * x * (xx - 3.0 * yy);
    }
    if degree >= 4u {
        b[16] = 2.5033429417967046 * xy * (xx - yy);
        b[17] = -1.7701307697799307 * yz * (3.0 * xx - yy);
        b[18] = 0.9461746957575601 * xy * (7.0 * zz - 1.0);
        b[19] = -0.6690465435572892 * yz * (7.0 * zz - 3.0);
        b[20] = 0.1057855469152043 * (zz * (35.0 * zz - 30.0) + 3.0);
        b[21] = -0.6690465435572892 * xz * (7.0 * zz - 3.0);
        b[22] = 0.47308734787878004 * (xx - yy) * (7.0 * zz - 1.0);
        b[23] = -1.7701307697799307 * xz * (xx - 3.0 * yy);
        b[24] = 0.6258357354491761 * (xx * (xx - 3.0 * yy) - yy * (3.0 * xx - yy));
    }
    return b;
}

// Gradients of the basis with respect to x, y and z as independent variables.
fn sh_gradient(degree: u32, p: vec3<f32>) -> array<vec3<f32>, 25> {
    let x = p.x;
    let y = p.y;
    let z = p.z;
    let xx = x * x;
    let yy = y * y;
    let zz = z * z;
    let xy = x * y;
    let yz = y * z;
    let xz = x * z;
    var d: array<vec3<f32>, 25>;
    if degree >= 1u {
        d[1] = vec3(0.0, -0.48860251190292, 0.0);
        d[2] = vec3(0.0, 0.0, 0.48860251190292);
        d[3] = vec3(-0.48860251190292, 0.0, 0.0);
    }
    if degree >= 2u {
        d[4] = 1.0925484305920792 * vec3(y, x, 0.0);
        d[5] = -1.0925484305920792 * vec3(0.0, z, y);
        d[6] = 2.0 * 0.31539156525252005 * vec3(-x, -y, 2.0 * z);
        d[7] = -1.0925484305920792 * vec3(z, 0.0, x);
        d[8] = 2.0 * 0.5462742152960396 * vec3(x, -y, 0.0);
    }
    if degree >= 3u {
        let ring = 4.0 * zz - xx - yy;
        d[9] = 3.0 * -0.5900435899266435 * vec3(2.0 * xy, xx - yy, 0.0);
        d[10] = 2.890611442640554 * vec3(yz, xz, xy);
        d[11] = -0.4570457994644658 * vec3(-2.0 * xy, ring - 2.0 * yy, 8.0 * yz);
        d[12] = 3.0 * 0.3731763325901154 * vec3(-2.0 * xz, -2.0 * yz, 2.0 * zz - xx - yy);
        d[13] = -0.4570457994644658 * vec3(ring - 2.0 * xx, -2.0 * xy, 8.0 * xz);
        d[14] = 1.445305721320277 * vec3(2.0 * xz, -2.0 * yz, xx - yy);
        d[15] = 3.0 * -0.5900435899266435 * vec3(xx - yy, -2.0 * xy, 0.0);
    }
    if degree >= 4u {
        let seven1 = 7.0 * zz - 1.0;
        let seven3 = 7.0 * zz - 3.0;
        d[16] = 2.5033429417967046 * vec3(y * (3.0 * xx - yy), x * (xx - 3.0 * yy), 0.0);
        d[17] = -1.7701307697799307 * vec3(6.0 * xy * z, 3.0 * z * (xx - yy), y * (3.0 * xx - yy));
        d[18] = 0.9461746957575601 * vec3(y * seven1, x * seven1, 14.0 * xy * z);
        d[19] = -0.6690465435572892 * vec3(0.0, z * seven3, y * (21.0 * zz - 3.0));
        d[20] = 0.1057855469152043 * vec3(0.0, 0.0, z * (140.0 * zz - 60.0));
        d[21] = -0.6690465435572892 * vec3(z * seven3, 0.0, x * (21.0 * zz - 3.0));
        d[22] = 0.47308734787878004 * vec3(2.0 * x * seven1, -2.0 * y * seven1, 14.0 * z * (xx - yy));
        d[23] = -1.7701307697799307 * vec3(3.0 * z * (xx - yy), -6.0 * xy * z, x * (xx - 3.0 * yy));
        d[24] = 4.0 * 0.6258357354491761 * vec3(x * (xx - 3.0 * yy), y * (yy - 3.0 * xx), 0.0);
    }
    return d;
}

// Unit direction from the camera to a mean, in the axis order of the spherical harmonics, and the distance.
fn direction_to(mean: vec3<f32>) -> vec4<f32> {
    var offset: vec3<f32>;
    for (var axis = 0u; axis < 3u; axis++) {
        let difference = two_sum(mean[axis], -view.centre[axis]);
        offset[axis] = difference.x + (difference.y - view.centre_low[axis]);
    }
    let widest = max(max(abs(offset.x), abs(offset.y)), abs(offset.z));
    var unit = vec3(0.0, 0.0, 1.0);
    var distance = 0.0;
    if widest > 1e-30 {
        let scaled = offset / widest;
        let length = root(dot(scaled, scaled));
        unit = scaled / length;
        distance = widest * length;
    }
    return vec4(select(unit, unit.zxy, has(E3NN)), distance);
}
