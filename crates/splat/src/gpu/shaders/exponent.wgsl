// Powers of two, exponentials and square roots, accurate to f32's last bits regardless of the driver's own.

// 2^n; 0 below the smallest normal number, and at most 2^127.
fn power_of_two(n: i32) -> f32 {
    return select(bitcast<f32>(u32(clamp(n, -126, 127) + 127) << 23u), 0.0, n < -126);
}

// Exponent of the largest power of two not above a magnitude; -10000 for zero.
fn exponent_of(value: f32) -> i32 {
    let bits = bitcast<u32>(value) & 0x7fffffffu;
    return select(i32(bits >> 23u) - 127, -10000, bits < 0x00800000u);
}

struct Scaled {
    // In [0.7, 1.5), or 0.
    mantissa: f32,
    exponent: i32,
}

// e^x as a mantissa and a power of two, for any x up to several thousand; 0 far below.
fn scaled_exp(x: f32) -> Scaled {
    if x < -20000.0 {
        return Scaled(0.0, -10000);
    }
    let n = round(x * 1.442695);
    // ln 2 in two parts; the products with the first are exact.
    let r = opaque(x - n * 0.693359375) + n * 2.12194440e-4;
    var e = 1.0 / 720.0;
    e = e * r + 1.0 / 120.0;
    e = e * r + 1.0 / 24.0;
    e = e * r + 1.0 / 6.0;
    e = e * r + 0.5;
    return Scaled((e * r) * r + r + 1.0, i32(n));
}

fn exp_within_range(x: f32) -> f32 {
    let e = scaled_exp(clamp(x, -87.0, 88.0));
    return e.mantissa * power_of_two(e.exponent);
}

// Square root: one Newton step from the driver's result. For infinity it is finite: 1.7e19.
fn root(x: f32) -> f32 {
    let finite = min(x, 3e38);
    let guess = sqrt(finite);
    return select(0.5 * (guess + finite / guess), 0.0, !(x > 1e-37));
}
