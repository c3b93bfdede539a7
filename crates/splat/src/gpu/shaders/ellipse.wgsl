// Which of a Gaussian's tiles its ellipse touches: a bit for each square of tiles, row by row. Conservative:
// a bit may be set in vain, but a tile with a pixel that the Gaussian colours has its bit. One kernel computes the mask and
// another reads it, because two kernels may round the same expression differently.

// The ellipse is widened by this many pixels, far above rounding errors, and by a share of its level.
const MARGIN: f32 = 0.5;
const SLACK: f32 = 1e-3;
// Share of the level by which rounding may let a steep slope's extreme exceed it, as in `cpu/bins.rs`.
const ROUNDING: f32 = 1e-5;

// The side of a square is 2^shift tiles, the smallest for which 32 bits suffice; 65 535 pixels are at most 2^12 tiles.
fn shift_of(tiles: vec4<u32>) -> u32 {
    var shift = 0u;
    while shift < 12u {
        let squares = squares_of(tiles, shift);
        if squares.x * squares.y <= 32u {
            break;
        }
        shift += 1u;
    }
    return shift;
}

// Columns and rows of squares.
fn squares_of(tiles: vec4<u32>, shift: u32) -> vec2<u32> {
    return (tiles.zw - tiles.xy + vec2((1u << shift) - 1u)) >> vec2(shift);
}

// Geometry as in `cpu/bins.rs`: with v the whitened distance down and u the one along, both seen from the centre, a pixel
// is within if u² + v² ≤ level; for a given v its columns are (±√(level − v²) − slope·v) / along.
fn mask_of(tiles: vec4<u32>, shift: u32, shape: vec4<f32>, position: vec4<u32>) -> u32 {
    let squares = squares_of(tiles, shift);
    // Narrow rectangles are as good.
    if squares.x < 2u || squares.y < 2u {
        return 0xffffffffu;
    }
    let along = shape.x;
    let down = shape.z;
    let offset = vec2(bitcast<f32>(position.x), bitcast<f32>(position.y));
    let base = vec2(f32(position.z & 0xffffu), f32(position.z >> 16u));
    let slope = shape.y / max(down, 1e-4);
    let is_tame = along > 1e-4 && along < 1e4 && down > 1e-4 && down < 1e4 && abs(slope) < 1e5 * along
        && max(abs(offset.x), abs(offset.y)) < 3e4;
    if !is_tame {
        return 0xffffffffu;
    }
    let level = max((log(shape.w) - view.rules.y) * 1.442695, 0.0) * (1.0 + SLACK) + SLACK;
    // Where the ellipse is farthest to the left; farthest to the right at the opposite.
    let extreme = slope * sqrt(level / (1.0 + slope * slope));
    let width = 16.0 * f32(1u << shift);
    var mask = 0u;
    for (var row = 0u; row < squares.y; row++) {
        let first = f32(16u * (tiles.y + (row << shift))) - base.y + offset.y;
        let top = down * (first - MARGIN);
        let bottom = down * (first + width - 1.0 + MARGIN);
        let v_right = clamp(-extreme, top, bottom);
        let v_left = clamp(extreme, top, bottom);
        if max(v_right * v_right, v_left * v_left) > level * (1.0 + ROUNDING) {
            continue;
        }
        let right = (sqrt(max(level - v_right * v_right, 0.0)) - slope * v_right) / along - offset.x + base.x + MARGIN;
        let left = (-sqrt(max(level - v_left * v_left, 0.0)) - slope * v_left) / along - offset.x + base.x - MARGIN;
        for (var column = 0u; column < squares.x; column++) {
            let start = f32(16u * (tiles.x + (column << shift)));
            if right >= start && left <= start + width - 1.0 {
                mask |= 1u << (row * squares.x + column);
            }
        }
    }
    return mask;
}
