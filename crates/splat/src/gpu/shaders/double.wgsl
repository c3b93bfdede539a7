// Double-single arithmetic: unevaluated sums of two f32, high and low, with at least 45 bits. Compilers cannot see
// through `opaque`, which keeps them from reassociating operations whose rounding matters.
fn opaque(value: f32) -> f32 {
    return bitcast<f32>(bitcast<u32>(value) ^ view.image.w);
}

fn two_sum(a: f32, b: f32) -> vec2<f32> {
    let sum = opaque(a + b);
    let part = opaque(sum - a);
    return vec2(sum, opaque(a - opaque(sum - part)) + opaque(b - part));
}

// For |a| ≥ |b|.
fn quick_sum(a: f32, b: f32) -> vec2<f32> {
    let sum = opaque(a + b);
    return vec2(sum, b - opaque(sum - a));
}

fn upper_half(value: f32) -> f32 {
    return bitcast<f32>(bitcast<u32>(value) & 0xfffff000u);
}

fn two_product(a: f32, b: f32) -> vec2<f32> {
    let product = opaque(a * b);
    let a_high = upper_half(a);
    let b_high = upper_half(b);
    let a_low = opaque(a - a_high);
    let b_low = opaque(b - b_high);
    let rest = opaque(opaque(a_high * b_high) - product);
    return vec2(product, rest + a_high * b_low + a_low * b_high + a_low * b_low);
}

fn double_add(a: vec2<f32>, b: vec2<f32>) -> vec2<f32> {
    let sum = two_sum(a.x, b.x);
    return quick_sum(sum.x, sum.y + (a.y + b.y));
}

fn double_product(a: vec2<f32>, b: vec2<f32>) -> vec2<f32> {
    let product = two_product(a.x, b.x);
    return quick_sum(product.x, product.y + (a.x * b.y + a.y * b.x));
}

fn double_ratio(a: vec2<f32>, b: vec2<f32>) -> vec2<f32> {
    let first = opaque(a.x / b.x);
    let rest = double_add(a, -double_product(vec2(first, 0.0), b));
    return quick_sum(first, rest.x / b.x);
}

// Whether a ≤ b.
fn at_most(a: vec2<f32>, b: vec2<f32>) -> bool {
    return a.x < b.x || (a.x == b.x && a.y <= b.y);
}
