// Sums over the threads of a tile as trees: within each subgroup by exchanging registers, then over subgroups by index.
// All threads of a subgroup take part in every Gaussian that one of them needs, and do not diverge before they exchange
// registers. The order is fixed, so that every run gives the same bits on one adapter.
const SUBGROUPS: u32 = THREADS / LEAST_SUBGROUP;
// As many as 12 KiB of shared memory hold.
const BATCH: u32 = min(64u, 256u / SUBGROUPS);

// By Gaussian of the batch, subgroup, value.
var<workgroup> partial: array<f32, BATCH * SUBGROUPS * 12u>;

// Sums of twelve values over a subgroup, by halves: each exchange sums half of the values that a thread still has. A
// thread ends with three sums, those from `3 * part_of(lane)` on.
fn sum_over_subgroup(values: array<f32, SUMS>, lane: u32, lanes: u32) -> vec3<f32> {
    let a = vec3(values[0], values[1], values[2]);
    let b = vec3(values[3], values[4], values[5]);
    let c = vec3(values[6], values[7], values[8]);
    let d = vec3(values[9], values[10], 0.0);
    let is_odd = (lane & 1u) != 0u;
    let first = select(a, c, is_odd) + subgroupShuffleXor(select(c, a, is_odd), 1u);
    let second = select(b, d, is_odd) + subgroupShuffleXor(select(d, b, is_odd), 1u);
    let is_upper = (lane & 2u) != 0u;
    var sum = select(first, second, is_upper) + subgroupShuffleXor(select(second, first, is_upper), 2u);
    for (var width = 4u; width < lanes; width *= 2u) {
        sum += subgroupShuffleXor(sum, width);
    }
    return sum;
}

fn part_of(lane: u32) -> u32 {
    return 2u * (lane & 1u) + ((lane >> 1u) & 1u);
}

// In one dimension, as naga requires where threads know their place in a subgroup.
@compute @workgroup_size(THREADS)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
    @builtin(subgroup_id) subgroup: u32,
    @builtin(subgroup_size) subgroup_size: u32,
    @builtin(subgroup_invocation_id) lane: u32,
) {
    let tile = group.y * groups.x + group.x;
    if tile >= all_tiles() {
        return;
    }
    let block = block_of(tile, vec3(thread % 4u, thread / 4u, 0u));
    let list = ranges[tile];
    if is_done(list) {
        return;
    }
    let range = current_entries(list);
    // A subgroup may be larger than the workgroup.
    let lanes = min(subgroup_size, THREADS);
    let subgroups = THREADS / lanes;
    if thread == 0u {
        atomicStore(&finished, 0u);
    }
    workgroupBarrier();

    var is_open = read_pixels(block);
    if !is_open {
        atomicAdd(&finished, 1u);
    }
    for (var batch = range.x; batch < range.y; batch += BATCH) {
        let end = min(batch + BATCH, range.y);
        for (var k = thread; k < BATCH * subgroups * 12u; k += THREADS) {
            partial[k] = 0.0;
        }
        workgroupBarrier();
        for (var at = batch; at < end; at++) {
            let is_needed = is_open && !misses(boxes[at], block);
            if !subgroupAny(is_needed) {
                continue;
            }
            let sums_of_thread = sums_of(at, block, is_needed);
            let sum = sum_over_subgroup(sums_of_thread.values, lane, lanes);
            if lane < 4u {
                let first = ((at - batch) * subgroups + subgroup) * 12u + 3u * part_of(lane);
                partial[first] = sum.x;
                partial[first + 1u] = sum.y;
                partial[first + 2u] = sum.z;
            }
            if is_open && !sums_of_thread.is_open {
                is_open = false;
                atomicAdd(&finished, 1u);
            }
        }
        workgroupBarrier();
        for (var k = thread; k < (end - batch) * SUMS; k += THREADS) {
            let first = k / SUMS * subgroups * 12u + k % SUMS;
            var sum = partial[first];
            for (var other = 1u; other < subgroups; other++) {
                sum += partial[first + 12u * other];
            }
            sums[PAIR_SUMS * pairs[batch + k / SUMS].x + k % SUMS] = sum;
        }
        if is_tile_finished(thread) {
            break;
        }
    }
    if continues(list) {
        write_pixels(block);
    }
}
