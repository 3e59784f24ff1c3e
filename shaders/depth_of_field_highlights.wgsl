// Finds lights that stand out in a picture that is out of focus, and takes them out of its pyramid
// (src/effects/depth_of_field/highlights.rs).
// @import shared/lens
// @import shared/highlights
@group(0) @binding(0) var<uniform> lens: Lens;
// The pyramid: its first level is the half.
@group(0) @binding(1) var colors: texture_2d<f32>;
@group(0) @binding(2) var circles: texture_2d<f32>;
// What is left of each block's light, cell by cell, where the cell has any that stands out; how many those are in each cell.
@group(0) @binding(3) var<storage, read_write> left: array<f32>;
@group(0) @binding(4) var<storage, read_write> numbers: array<u32>;
@group(0) @binding(5) var<storage, read_write> found: Highlights;
// The same, for drawing.
@group(0) @binding(1) var<storage, read> drawn: Highlights;

// The level that is drawn into: its texels are parts of blocks, or whole ones.
override texels_to_block: f32 = 1.0;

// How much brighter than all around (it or one beside it) and than white a block's mean is that stands out.
const TIMES_AROUND: f32 = 8.0;
const BRIGHT: f32 = 2.0;
// From this radius on gathering shows its texels (px).
const LEAST_RADIUS_PX: f32 = 4.0;
// No more are drawn, and of no more pixels than so many times the layer's.
const MOST: u32 = 8192u;
const MOST_AREA: f32 = 4.0;

// Blocks to a side of a cell: the fourth level of the pyramid.
const CELL: i32 = 4;
const BLOCKS: u32 = 16u;

fn cells() -> vec2<u32> {
    let side = BLOCK_PX * CELL;
    return vec2<u32>((lens.size.xy + side - 1) / side);
}

fn block(cell: vec2<u32>, i: u32) -> vec2<i32> {
    return CELL * vec2<i32>(cell) + vec2<i32>(i32(i) % CELL, i32(i) / CELL);
}

fn circle_of_block(b: vec2<i32>) -> f32 {
    return textureLoad(circles, b, 1).x;
}

fn is_blurred(circle: f32) -> bool {
    return 0.5 * abs(circle) >= LEAST_RADIUS_PX && circle < NOTHING;
}

@compute @workgroup_size(8, 8)
fn find(@builtin(global_invocation_id) id: vec3<u32>) {
    let size = cells();
    if any(id.xy >= size) {
        return;
    }
    let cell = id.y * size.x + id.x;
    var most = 0.0;
    for (var i = 0u; i < BLOCKS; i++) {
        most = max(most, brightest(textureLoad(colors, block(id.xy, i), 1)));
    }
    numbers[cell] = 0u;
    if most <= BRIGHT {
        return;
    }
    var sum = 0.0;
    var least = most;
    for (var i = 0; i < 9; i++) {
        let around = brightest(textureLoad(colors, vec2<i32>(id.xy) + vec2<i32>(i % 3, i / 3) - 1, 3));
        sum += around;
        least = min(least, around);
    }
    var number = 0u;
    for (var i = 0u; i < BLOCKS; i++) {
        let b = block(id.xy, i);
        let light = brightest(textureLoad(colors, b, 1));
        // Of a light on two blocks the fainter part goes with the brighter one.
        var beside = light;
        for (var k = 0; k < 9; k++) {
            beside = max(beside, brightest(textureLoad(colors, b + vec2<i32>(k % 3, k / 3) - 1, 1)));
        }
        let stands_out = light > BRIGHT && beside > TIMES_AROUND * sum / 9.0 && is_blurred(circle_of_block(b));
        left[cell * BLOCKS + i] = select(1.0, min(least / light, 1.0), stands_out);
        number += select(0u, 1u, stands_out);
    }
    numbers[cell] = number;
}

const THREADS: u32 = 256u;
var<workgroup> areas: array<f32, THREADS>;
var<workgroup> counts: array<u32, THREADS>;

fn area_of(circle: f32) -> f32 {
    let side = abs(circle) + f32(BLOCK_PX);
    return side * side;
}

// Cell by cell in rows, so that it is the same list each time.
@compute @workgroup_size(THREADS)
fn list(@builtin(local_invocation_index) thread: u32) {
    let size = cells();
    let all = size.x * size.y;
    let first = thread * all / THREADS;
    let end = (thread + 1u) * all / THREADS;
    var area = 0.0;
    var count = 0u;
    for (var cell = first; cell < end; cell++) {
        if numbers[cell] > 0u {
            for (var i = 0u; i < BLOCKS; i++) {
                let b = block(vec2<u32>(cell % size.x, cell / size.x), i);
                area += select(0.0, area_of(circle_of_block(b)), left[cell * BLOCKS + i] < 1.0);
            }
            count += numbers[cell];
        }
    }
    areas[thread] = area;
    counts[thread] = count;
    workgroupBarrier();
    area = 0.0;
    count = 0u;
    for (var before = 0u; before < thread; before++) {
        area += areas[before];
        count += counts[before];
    }
    workgroupBarrier();
    let budget = MOST_AREA * f32(lens.size.x * lens.size.y);
    var listed = 0u;
    for (var cell = first; cell < end; cell++) {
        if numbers[cell] > 0u {
            for (var i = 0u; i < BLOCKS; i++) {
                let b = block(vec2<u32>(cell % size.x, cell / size.x), i);
                let keep = left[cell * BLOCKS + i];
                let circle = circle_of_block(b);
                area += select(0.0, area_of(circle), keep < 1.0);
                if keep < 1.0 && area <= budget && count < MOST {
                    let taken = f32(BLOCK_PX * BLOCK_PX) * (1.0 - keep) * textureLoad(colors, b, 1);
                    found.all[count] = Highlight(vec4<f32>(vec2<f32>(b), keep, circle), vec4<f32>(taken.rgb, 0.0));
                    count += 1u;
                    listed = count;
                }
            }
        }
    }
    // Those that the budget leaves out are the last.
    counts[thread] = listed;
    workgroupBarrier();
    if thread == 0u {
        var most = 0u;
        for (var i = 0u; i < THREADS; i++) {
            most = max(most, counts[i]);
        }
        found.draw = vec4<u32>(4u, most, 0u, 0u);
    }
}

struct Corner { @builtin(position) at: vec4<f32>, @location(0) @interpolate(flat) keep: f32 }

// A block in a level of the pyramid.
@vertex
fn block_corner(@builtin(vertex_index) v: u32, @builtin(instance_index) i: u32) -> Corner {
    let place = drawn.all[i].place;
    let corner = texels_to_block * (place.xy + vec2<f32>(f32(v & 1u), f32(v >> 1u)));
    let size = ceil(vec2<f32>(lens.size.xy) * texels_to_block / f32(BLOCK_PX));
    var out: Corner;
    out.at = vec4<f32>(corner / size * vec2<f32>(2.0, -2.0) + vec2<f32>(-1.0, 1.0), 0.0, 1.0);
    out.keep = place.z;
    return out;
}

// Times what is there.
@fragment
fn dim(in: Corner) -> @location(0) vec4<f32> {
    return vec4<f32>(vec3<f32>(in.keep), 1.0);
}
