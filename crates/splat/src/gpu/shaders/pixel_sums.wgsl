// Backward pass of compositing: traverses each tile front to back again, starting from the final pixel values. Writes,
// for each (tile, Gaussian) pair, the sums over the tile's pixels in a fixed order: first the pixels of a thread.
@group(0) @binding(7) var<storage, read_write> pixels: array<vec4<f32>>;
// Twelve values per pair. With e, the gradient of the exponent, and the whitened distance (a, b): Σe, Σea, Σeb, Σeaa,
// Σeab, Σebb; then the gradients of red, green, blue, depth and scalar. With ABSOLUTE, in place of the last two, the sums
// of |e| times the whitened distance's absolute change with the centre, along columns and rows.
@group(0) @binding(8) var<storage, read_write> sums: array<f32>;

const SUMS: u32 = 11u;

// The state of a thread's pixels between Gaussians.
var<private> transmittance: array<vec4<f32>, ROWS>;
var<private> behind: array<vec4<f32>, ROWS>;
var<private> d_red: array<vec4<f32>, ROWS>;
var<private> d_green: array<vec4<f32>, ROWS>;
var<private> d_blue: array<vec4<f32>, ROWS>;
var<private> d_depth: array<vec4<f32>, ROWS>;
var<private> d_scalar: array<vec4<f32>, ROWS>;

// Threads without open pixels. Integer sums do not depend on the order.
var<workgroup> finished: atomic<u32>;
var<workgroup> all_finished: u32;

// Whether the rest of a tile's list keeps its initial zeros; after a barrier.
fn is_tile_finished(thread: u32) -> bool {
    if thread == 0u {
        all_finished = atomicLoad(&finished);
    }
    return workgroupUniformLoad(&all_finished) == THREADS;
}

// Reads the state, and returns whether any pixel is still open.
fn read_pixels(block: Block) -> bool {
    var is_open = false;
    for (var r = 0u; r < ROWS; r++) {
        transmittance[r] = vec4(-1.0);
        for (var n = 0u; n < 4u; n++) {
            if is_inside(block, r, n) {
                let pixel = 2u * pixel_of(block, r, n);
                let first = pixels[pixel];
                let second = pixels[pixel + 1u];
                transmittance[r][n] = second.z;
                d_red[r][n] = first.x;
                d_green[r][n] = first.y;
                d_blue[r][n] = first.z;
                d_depth[r][n] = first.w;
                d_scalar[r][n] = second.x;
                behind[r][n] = second.y;
                is_open = is_open || second.z > 0.0;
            }
        }
    }
    return is_open;
}

// Keeps the state for the next dispatch.
fn write_pixels(block: Block) {
    for (var r = 0u; r < ROWS; r++) {
        for (var n = 0u; n < 4u; n++) {
            if is_inside(block, r, n) {
                let pixel = 2u * pixel_of(block, r, n);
                pixels[pixel + 1u] = vec4(d_scalar[r][n], behind[r][n], transmittance[r][n], 0.0);
            }
        }
    }
}

// The sums of one Gaussian over a thread's pixels, and whether any of them is open behind it.
struct Sums {
    values: array<f32, SUMS>,
    is_open: bool,
}

// A Gaussian that is not needed changes nothing: threads of a subgroup go through this together.
fn sums_of(at: u32, block: Block, is_needed: bool) -> Sums {
    let gaussian = pairs[at].y;
    let shape = shapes[gaussian];
    let position = positions[gaussian];
    let splat_colour = splat_colours[gaussian];
    let z = bitcast<f32>(position.w);
    let clamp_stops = !has(CLAMP_PASSES);
    let scalar_passes = !has(SCALAR_STOPS);
    let one = vec4(1.0);
    var total: array<f32, SUMS>;
    var max_transmittance = vec4(-1.0);
    for (var r = 0u; r < ROWS; r++) {
        let falloff = falloff_at(shape, position, block, r);
        let full = select(vec4(0.0), shape.w * falloff.value, is_needed);
        let alpha = min(vec4(view.alphas.x), full);
        let before = transmittance[r];
        let layer = layer_of(alpha, before);
        let weight = layer.weight;
        var d_weight = d_red[r] * splat_colour.x + d_green[r] * splat_colour.y + d_blue[r] * splat_colour.z + d_depth[r] * z;
        if scalar_passes {
            d_weight += d_scalar[r] * splat_colour.w;
        }
        behind[r] -= weight * d_weight;
        let d_alpha = before * d_weight - behind[r] / max(one - alpha, vec4(1e-12));
        var is_clamped = !layer.hit;
        if clamp_stops {
            is_clamped = is_clamped | (full > vec4(view.alphas.x));
        }
        let e = select(-full * d_alpha, vec4(0.0), is_clamped);
        let ea = e * falloff.along;
        let sum = dot(e, one);
        let sum_along = dot(ea, one);
        total[0] += sum;
        total[1] += sum_along;
        total[2] += sum * falloff.across;
        total[3] += dot(ea, falloff.along);
        total[4] += sum_along * falloff.across;
        total[5] += sum * falloff.across * falloff.across;
        total[6] += dot(weight, d_red[r]);
        total[7] += dot(weight, d_green[r]);
        total[8] += dot(weight, d_blue[r]);
        if has(ABSOLUTE) {
            let down = falloff.along * shape.y + falloff.across * shape.z;
            total[9] += dot(abs(e), abs(falloff.along * shape.x));
            total[10] += dot(abs(e), abs(down));
        } else {
            total[9] += dot(weight, d_depth[r]);
            total[10] += dot(weight, d_scalar[r]);
        }
        transmittance[r] = layer.transmittance;
        max_transmittance = max(max_transmittance, transmittance[r]);
    }
    return Sums(total, any(max_transmittance > vec4(0.0)));
}
