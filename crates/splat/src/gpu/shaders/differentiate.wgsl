// The derivative of compositing: each tile once more from front to back, knowing what its pixels ended as. For each
// pair of tile and Gaussian it leaves the sums over the tile's pixels, always in the same order: pixels of a thread,
// then threads by number.
@group(0) @binding(7) var<storage, read_write> pixels: array<vec4<f32>>;
// Twelve numbers a pair. With e, the derivative by the exponent, and the whitened distance (a, b): Σe, Σea, Σeb,
// Σeaa, Σeab, Σebb; then by red, green, blue, depth, scalar.
@group(0) @binding(8) var<storage, read_write> sums: array<f32>;

const AT_ONCE: u32 = 4u * ROWS;
const SUMS: u32 = 11u;
// One more than there are threads, so that threads that each sum a row do not wait for one bank.
const STRIDE: u32 = THREADS + 1u;

var<workgroup> partial: array<f32, AT_ONCE * SUMS * STRIDE>;
var<workgroup> finished: atomic<u32>;
var<workgroup> all_finished: u32;

@compute @workgroup_size(4, THREADS / 4u)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_id) local: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let tile = group.y * groups.x + group.x;
    if tile >= view.tiles.z * view.tiles.w {
        return;
    }
    let corner = vec2(local.x * 4u, local.y * ROWS);
    let column = (view.tiles.x + tile % view.tiles.z) * 16u + corner.x;
    let row = (view.tiles.y + tile / view.tiles.z) * 16u + corner.y;
    let range = entries_now(ranges[tile]);

    var transmittance: array<vec4<f32>, ROWS>;
    var by_red: array<vec4<f32>, ROWS>;
    var by_green: array<vec4<f32>, ROWS>;
    var by_blue: array<vec4<f32>, ROWS>;
    var by_depth: array<vec4<f32>, ROWS>;
    var by_scalar: array<vec4<f32>, ROWS>;
    var behind: array<vec4<f32>, ROWS>;
    var is_open = false;
    for (var r = 0u; r < ROWS; r++) {
        transmittance[r] = vec4(-1.0);
        for (var n = 0u; n < 4u; n++) {
            if row + r < view.picture.y && column + n < view.picture.x {
                let pixel = 2u * ((row + r - view.window.z) * view.picture.x + column + n);
                let first = pixels[pixel];
                let second = pixels[pixel + 1u];
                transmittance[r][n] = second.z;
                by_red[r][n] = first.x;
                by_green[r][n] = first.y;
                by_blue[r][n] = first.z;
                by_depth[r][n] = first.w;
                by_scalar[r][n] = second.x;
                behind[r][n] = second.y;
                is_open = is_open || second.z > 0.0;
            }
        }
    }
    if !is_open {
        atomicAdd(&finished, 1u);
    }
    let clamp_stops = !has(CLAMP_PASSES);
    let scalar_passes = !has(SCALAR_STOPS);
    let one = vec4(1.0);

    for (var batch = range.x; batch < range.y; batch += AT_ONCE) {
        for (var k = 0u; k < AT_ONCE * SUMS; k++) {
            partial[k * STRIDE + thread] = 0.0;
        }
        let past = select(batch, min(batch + AT_ONCE, range.y), is_open);
        var at = batch;
        loop {
            while at < past && misses(boxes[at], corner) {
                at += 1u;
            }
            if at >= past || !is_open {
                break;
            }
            let gaussian = pairs[at].y;
            let shape = shapes[gaussian];
            let place = places[gaussian];
            let paint = paints[gaussian];
            let z = bitcast<f32>(place.w);
            var total: array<f32, SUMS>;
            var most = vec4(-1.0);
            for (var r = 0u; r < ROWS; r++) {
                let falloff = falloff_at(shape, place, column, row + r);
                let full = shape.w * falloff.value;
                let alpha = min(vec4(view.alphas.x), full);
                let seen = alpha >= vec4(view.alphas.y);
                let before = transmittance[r];
                let product = alpha * before;
                let after = before - product;
                let open = after > vec4(view.alphas.z);
                let hit = seen & open;
                let weight = select(vec4(0.0), product, hit);
                var shown = by_red[r] * paint.x + by_green[r] * paint.y + by_blue[r] * paint.z + by_depth[r] * z;
                if scalar_passes {
                    shown += by_scalar[r] * paint.w;
                }
                behind[r] -= weight * shown;
                let by_alpha = before * shown - behind[r] / max(one - alpha, vec4(1e-12));
                var stops = !hit;
                if clamp_stops {
                    stops = stops | (full > vec4(view.alphas.x));
                }
                let e = select(-full * by_alpha, vec4(0.0), stops);
                let ea = e * falloff.along;
                let sum = dot(e, one);
                let sum_along = dot(ea, one);
                total[0] += sum;
                total[1] += sum_along;
                total[2] += sum * falloff.across;
                total[3] += dot(ea, falloff.along);
                total[4] += sum_along * falloff.across;
                total[5] += sum * falloff.across * falloff.across;
                total[6] += dot(weight, by_red[r]);
                total[7] += dot(weight, by_green[r]);
                total[8] += dot(weight, by_blue[r]);
                total[9] += dot(weight, by_depth[r]);
                total[10] += dot(weight, by_scalar[r]);
                transmittance[r] = select(before, select(-abs(before), after, open), seen);
                most = max(most, transmittance[r]);
            }
            for (var k = 0u; k < SUMS; k++) {
                partial[((at - batch) * SUMS + k) * STRIDE + thread] = total[k];
            }
            at += 1u;
            if all(most <= vec4(0.0)) {
                is_open = false;
                // An integer count comes out the same in any order.
                atomicAdd(&finished, 1u);
            }
        }
        workgroupBarrier();
        for (var k = thread; k < AT_ONCE * SUMS; k += THREADS) {
            let pair = batch + k / SUMS;
            if pair < range.y {
                var sum = 0.0;
                for (var other = 0u; other < THREADS; other++) {
                    sum += partial[k * STRIDE + other];
                }
                sums[12u * pairs[pair].x + k % SUMS] = sum;
            }
        }
        if thread == 0u {
            all_finished = atomicLoad(&finished);
        }
        // The rest of the list keeps the zeros that were there.
        if workgroupUniformLoad(&all_finished) == THREADS {
            break;
        }
    }
    if has(STOPS_HERE) {
        for (var r = 0u; r < ROWS; r++) {
            for (var n = 0u; n < 4u; n++) {
                if row + r < view.picture.y && column + n < view.picture.x {
                    let pixel = 2u * ((row + r - view.window.z) * view.picture.x + column + n);
                    pixels[pixel + 1u] = vec4(by_scalar[r][n], behind[r][n], transmittance[r][n], 0.0);
                }
            }
        }
    }
}
