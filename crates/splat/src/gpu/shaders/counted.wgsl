// Shared by sorting and prefix sums: how many items there are, known to the host or counted by an earlier kernel.
struct Work {
    // The number of items, or the most that buffers hold.
    bound: u32,
    // Where `totals` has the number; KNOWN if it is the bound.
    at: u32,
    // Of the sort's digit, and which bits it has after the shift.
    shift: u32,
    mask: u32,
    // Of the prefix sum: 0 for the numbers themselves, 1 for the sums of their blocks, and so on.
    level: u32,
    // Whether this level is a single block, and whether the numbers are the digits of a sort.
    is_last: u32,
    is_table: u32,
    spare: u32,
}

@group(0) @binding(0) var<uniform> work: Work;
@group(0) @binding(1) var<storage, read> totals: array<u32>;

const KNOWN: u32 = 0xffffffffu;

// None if there are too many: the host repeats the work with longer lists.
fn items() -> u32 {
    if work.at == KNOWN {
        return work.bound;
    }
    let total = totals[work.at];
    return select(total, 0u, total > work.bound);
}

// Blocks of 2048 keys, which a workgroup sorts.
fn sort_blocks() -> u32 {
    let count = items();
    return count / 2048u + select(0u, 1u, (count & 2047u) != 0u);
}
