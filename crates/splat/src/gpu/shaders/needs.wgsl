// What a window's lists need, for the host: if they hold it, the image is complete.
@group(0) @binding(1) var<storage, read> offsets: array<u32>;
@group(0) @binding(2) var<storage, read_write> ranges: array<vec2<u32>>;
// Five counts of Gaussians, whether lists were too short, most pairs of a window, most pairs of a tile.
@group(0) @binding(3) var<storage, read_write> status: array<atomic<u32>, 8>;

@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let tile = linear_index(group, groups, 64u, local);
    if tile >= view.tiles.z * view.tiles.w * view.batch.z {
        return;
    }
    let pairs = offsets[view.window.w];
    let were_listed = pairs <= view.window.y;
    let length = ranges[tile].y - ranges[tile].x;
    // Maxima do not depend on the order.
    if tile == 0u {
        atomicMax(&status[6], pairs);
    }
    atomicMax(&status[7], length);
    // `part.y` is the number of entries that all dispatches together composite.
    if !were_listed || length > view.part.y {
        atomicMax(&status[5], 1u);
    }
    if !were_listed {
        ranges[tile] = vec2(0u);
    }
}
