// Second kernel of a pass: sorts each block of 2048 keys by the digit in shared memory, 4 bits at a time, then moves its keys to
// where the prefix sums of the table say, neighbours to neighbouring places. Stable for equal digits.
@group(0) @binding(2) var<storage, read> keys: array<u32>;
@group(0) @binding(3) var<storage, read> values: array<u32>;
@group(0) @binding(4) var<storage, read> table: array<u32>;
@group(0) @binding(5) var<storage, read_write> keys_out: array<u32>;
@group(0) @binding(6) var<storage, read_write> values_out: array<u32>;

// Digit and place in the block of each key, the digit above the lowest 11 bits.
var<workgroup> order: array<u32, 2176>;
// How many keys each thread has of 16 digits: a row for two digits, of 16 bits each, and a column for a thread. Then how many keys with
// the same digit are before its own.
var<workgroup> counts: array<u32, 1024>;
// While a block is sorted: sums of eight columns of a row, sums of rows, and the first place of each of 16 digits. Then the first place
// of each digit.
var<workgroup> places: array<u32, 256>;

const SUMS_OF_ROWS: u32 = 128u;
const FIRST_PLACES: u32 = 136u;

// Threads that read 16 neighbours each would all hit the same banks of shared memory.
fn padded(place: u32) -> u32 {
    return place + (place >> 4u);
}

fn row_of(digit: u32) -> u32 {
    return 2u * (digit >> 2u) + (digit & 1u);
}

fn half_of(word: u32, digit: u32) -> u32 {
    return (word >> (8u * (digit & 2u))) & 0xffffu;
}

@compute @workgroup_size(128)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let block = group.y * groups.x + group.x;
    let blocks = sort_blocks();
    let count = select(0u, items(), block < blocks);
    for (var n = 0u; n < 16u; n++) {
        let place = n * 128u + local;
        let at = block * 2048u + place;
        // What is behind the last key stays there.
        var digit = work.mask;
        if at < count {
            digit = (keys[at] >> work.shift) & work.mask;
        }
        order[padded(place)] = (digit << 11u) | place;
    }
    workgroupBarrier();

    for (var low = 11u; ((work.mask << 11u) >> low) != 0u; low += 4u) {
        var own: array<u32, 16>;
        // Sixteen counts of 8 bits.
        var before = vec4(0u);
        for (var n = 0u; n < 16u; n++) {
            own[n] = order[padded(16u * local + n)];
            before += one_more((own[n] >> low) & 15u);
        }
        for (var n = 0u; n < 4u; n++) {
            counts[2u * n * 128u + local] = before[n] & 0x00ff00ffu;
            counts[(2u * n + 1u) * 128u + local] = (before[n] >> 8u) & 0x00ff00ffu;
        }
        workgroupBarrier();
        var sum = 0u;
        for (var n = 0u; n < 8u; n++) {
            sum += counts[8u * local + n];
        }
        places[local] = sum;
        workgroupBarrier();
        if local < 8u {
            var total = 0u;
            for (var n = 0u; n < 16u; n++) {
                let next = places[16u * local + n];
                places[16u * local + n] = total;
                total += next;
            }
            places[SUMS_OF_ROWS + local] = total;
        }
        workgroupBarrier();
        if local == 0u {
            var first = 0u;
            for (var digit = 0u; digit < 16u; digit++) {
                places[FIRST_PLACES + digit] = first;
                first += half_of(places[SUMS_OF_ROWS + row_of(digit)], digit);
            }
        }
        var total = places[local];
        for (var n = 0u; n < 8u; n++) {
            let next = counts[8u * local + n];
            counts[8u * local + n] = total;
            total += next;
        }
        workgroupBarrier();
        before = vec4(0u);
        for (var n = 0u; n < 16u; n++) {
            let digit = (own[n] >> low) & 15u;
            let in_thread = (before[digit >> 2u] >> (8u * (digit & 3u))) & 255u;
            let in_earlier_threads = half_of(counts[row_of(digit) * 128u + local], digit);
            order[padded(places[FIRST_PLACES + digit] + in_earlier_threads + in_thread)] = own[n];
            before += one_more(digit);
        }
        workgroupBarrier();
    }

    for (var n = 0u; n < 16u; n++) {
        let place = n * 128u + local;
        let digit = order[padded(place)] >> 11u;
        if place == 0u || order[padded(max(place, 1u) - 1u)] >> 11u != digit {
            places[digit] = place;
        }
    }
    workgroupBarrier();
    for (var n = 0u; n < 16u; n++) {
        let place = n * 128u + local;
        let digit = order[padded(place)] >> 11u;
        let at = block * 2048u + (order[padded(place)] & 2047u);
        if at < count {
            let destination = table[digit * blocks + block] + place - places[digit];
            keys_out[destination] = keys[at];
            values_out[destination] = values[at];
        }
    }
}

// A count of one for a digit, in the byte of that digit.
fn one_more(digit: u32) -> vec4<u32> {
    return select(vec4(0u), vec4(1u << (8u * (digit & 3u))), vec4(digit >> 2u) == vec4(0u, 1u, 2u, 3u));
}
