// Sums over the threads of a tile by index, through shared memory: on any adapter.
const BATCH: u32 = 4u * ROWS;
// One more than the number of threads, to avoid bank conflicts when each thread sums a row.
const STRIDE: u32 = THREADS + 1u;

var<workgroup> partial: array<f32, BATCH * SUMS * STRIDE>;

@compute @workgroup_size(4, THREADS / 4u)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_id) local: vec3<u32>,
    @builtin(local_invocation_index) thread: u32,
) {
    let tile = group.y * groups.x + group.x;
    if tile >= all_tiles() {
        return;
    }
    let block = block_of(tile, local);
    let list = ranges[tile];
    if is_done(list) {
        return;
    }
    let range = current_entries(list);
    if thread == 0u {
        atomicStore(&finished, 0u);
    }
    workgroupBarrier();

    var is_open = read_pixels(block);
    if !is_open {
        atomicAdd(&finished, 1u);
    }
    for (var batch = range.x; batch < range.y; batch += BATCH) {
        for (var k = 0u; k < BATCH * SUMS; k++) {
            partial[k * STRIDE + thread] = 0.0;
        }
        let end = select(batch, min(batch + BATCH, range.y), is_open);
        var at = batch;
        loop {
            while at < end && misses(boxes[at], block) {
                at += 1u;
            }
            if at >= end || !is_open {
                break;
            }
            let sums_of_thread = sums_of(at, block, true);
            for (var k = 0u; k < SUMS; k++) {
                partial[((at - batch) * SUMS + k) * STRIDE + thread] = sums_of_thread.values[k];
            }
            at += 1u;
            if !sums_of_thread.is_open {
                is_open = false;
                atomicAdd(&finished, 1u);
            }
        }
        workgroupBarrier();
        for (var k = thread; k < BATCH * SUMS; k += THREADS) {
            let pair = batch + k / SUMS;
            if pair < range.y {
                var sum = 0.0;
                for (var other = 0u; other < THREADS; other++) {
                    sum += partial[k * STRIDE + other];
                }
                sums[PAIR_SUMS * pairs[pair].x + k % SUMS] = sum;
            }
        }
        if is_tile_finished(thread) {
            break;
        }
    }
    if continues(list) {
        write_pixels(block);
    }
}
