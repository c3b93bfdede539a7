// The derivative of compositing: each tile once more from front to back, knowing what its pixels ended as. For each
// pair of tile and Gaussian it leaves the sums over the tile's pixels, always in the same order: four pixels of a
// thread, then threads by number.
@group(0) @binding(1) var<storage, read> shapes: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> places: array<vec4<u32>>;
@group(0) @binding(3) var<storage, read> paints: array<vec4<f32>>;
// Number of the pair, Gaussian.
@group(0) @binding(4) var<storage, read> pairs: array<vec2<u32>>;
@group(0) @binding(5) var<storage, read> ranges: array<vec2<u32>>;
@group(0) @binding(6) var<storage, read> pixels: array<vec4<f32>>;
// Twelve numbers a pair. With e, the derivative by the exponent, and the whitened distance (a, b): Σe, Σea, Σeb,
// Σeaa, Σeab, Σebb; then by red, green, blue, depth, scalar.
@group(0) @binding(7) var<storage, read_write> sums: array<f32>;

const AT_ONCE: u32 = 4u;
const SUMS: u32 = 11u;
// One more than there are threads, so that threads that each sum a row do not wait for one bank.
const STRIDE: u32 = 65u;

var<workgroup> partial: array<f32, 2860>;
var<workgroup> finished: atomic<u32>;
var<workgroup> all_finished: u32;

@compute @workgroup_size(4, 16)
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
    let column = (view.tiles.x + tile % view.tiles.z) * 16u + local.x * 4u;
    let row = (view.tiles.y + tile / view.tiles.z) * 16u + local.y;
    let range = ranges[tile];

    var transmittance = vec4(-1.0);
    var by_red = vec4(0.0);
    var by_green = vec4(0.0);
    var by_blue = vec4(0.0);
    var by_depth = vec4(0.0);
    var by_scalar = vec4(0.0);
    var behind = vec4(0.0);
    for (var n = 0u; n < 4u; n++) {
        if row < view.picture.y && column + n < view.picture.x {
            let pixel = 2u * ((row - view.window.z) * view.picture.x + column + n);
            let first = pixels[pixel];
            let second = pixels[pixel + 1u];
            transmittance[n] = 1.0;
            by_red[n] = first.x;
            by_green[n] = first.y;
            by_blue[n] = first.z;
            by_depth[n] = first.w;
            by_scalar[n] = second.x;
            behind[n] = second.y;
        }
    }
    var is_open = any(transmittance > vec4(0.0));
    if !is_open {
        atomicAdd(&finished, 1u);
    }
    let clamp_stops = !has(CLAMP_PASSES);
    let scalar_passes = !has(SCALAR_STOPS);
    let one = vec4(1.0);

    for (var at = range.x; at < range.y; at += AT_ONCE) {
        for (var n = 0u; n < AT_ONCE; n++) {
            var total: array<f32, 11>;
            if is_open && at + n < range.y {
                let gaussian = pairs[at + n].y;
                let shape = shapes[gaussian];
                let place = places[gaussian];
                let falloff = falloff_at(shape, place, column, row);
                let full = shape.w * falloff.value;
                let alpha = min(vec4(view.alphas.x), full);
                let seen = alpha >= vec4(view.alphas.y);
                if any(seen) {
                    let paint = paints[gaussian];
                    let z = bitcast<f32>(place.w);
                    let product = alpha * transmittance;
                    let after = transmittance - product;
                    let open = after > vec4(view.alphas.z);
                    let hit = seen & open;
                    let weight = select(vec4(0.0), product, hit);
                    var shown = by_red * paint.x + by_green * paint.y + by_blue * paint.z + by_depth * z;
                    if scalar_passes {
                        shown += by_scalar * paint.w;
                    }
                    behind -= weight * shown;
                    let left = max(one - alpha, vec4(1e-12));
                    let by_alpha = transmittance * shown - behind / left;
                    var stops = !hit;
                    if clamp_stops {
                        stops = stops | (full > vec4(view.alphas.x));
                    }
                    let e = select(-full * by_alpha, vec4(0.0), stops);
                    let ea = e * falloff.along;
                    total[0] = dot(e, one);
                    total[1] = dot(ea, one);
                    total[2] = total[0] * falloff.across;
                    total[3] = dot(ea, falloff.along);
                    total[4] = total[1] * falloff.across;
                    total[5] = total[2] * falloff.across;
                    total[6] = dot(weight, by_red);
                    total[7] = dot(weight, by_green);
                    total[8] = dot(weight, by_blue);
                    total[9] = dot(weight, by_depth);
                    total[10] = dot(weight, by_scalar);
                    transmittance = select(transmittance, select(-abs(transmittance), after, open), seen);
                    if all(transmittance <= vec4(0.0)) {
                        is_open = false;
                        // An integer count comes out the same in any order.
                        atomicAdd(&finished, 1u);
                    }
                }
            }
            for (var k = 0u; k < SUMS; k++) {
                partial[(n * SUMS + k) * STRIDE + thread] = total[k];
            }
        }
        workgroupBarrier();
        if thread < AT_ONCE * SUMS {
            let n = thread / SUMS;
            if at + n < range.y {
                var sum = 0.0;
                for (var other = 0u; other < 64u; other++) {
                    sum += partial[thread * STRIDE + other];
                }
                sums[12u * pairs[at + n].x + thread % SUMS] = sum;
            }
        }
        if thread == 0u {
            all_finished = atomicLoad(&finished);
        }
        // The rest of the list keeps the zeros that were there.
        if workgroupUniformLoad(&all_finished) == 64u {
            break;
        }
    }
}
