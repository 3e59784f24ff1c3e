// Finds highlights in a picture out of focus, and removes them from its pyramid
// (src/effects/depth_of_field/highlights.rs).
// @import shared/layer
// @import shared/lens
// @import shared/highlights
@group(0) @binding(0) var<uniform> lens: Lens;
// The pyramid: its first level is half the resolution.
@group(0) @binding(1) var colors: texture_2d<f32>;
@group(0) @binding(2) var circles: texture_2d<f32>;
// The share left of each block's light, cell by cell, in cells where any stands out; and how many
// do in each cell.
@group(0) @binding(3) var<storage, read_write> left: array<f32>;
@group(0) @binding(4) var<storage, read_write> numbers: array<u32>;
@group(0) @binding(5) var<storage, read_write> highlights: Highlights;
// The layer itself.
@group(0) @binding(6) var color: texture_2d<f32>;
@group(0) @binding(7) var geometry: texture_2d<u32>;
// The same list, for drawing.
@group(0) @binding(1) var<storage, read> drawn: Highlights;

// For the level that is drawn into: its texels are parts of blocks, or whole ones.
override texels_to_block: f32 = 1.0;

// A block is a highlight if its mean, or that of a neighbouring block, exceeds these multiples of
// its surroundings and of white.
const HIGHLIGHT_TO_SURROUNDINGS: f32 = 8.0;
const HIGHLIGHT_TO_WHITE: f32 = 2.0;
// A block belongs to a brighter neighbour if it exceeds this multiple of the darkest block around.
const NEIGHBOUR_TO_DARKEST: f32 = 2.0;
// Radius from which on gathering makes its texels visible (px).
const MIN_RADIUS_PX: f32 = 2.9;
// Marks a block of two surfaces in which the farther one's light is the highlight. The pyramid has
// only the nearer one's light there, which stays.
const FARTHER: f32 = 2.0;
// Largest number of highlights that are drawn, and largest area of their sprites as a multiple of
// the layer's.
const MAX_HIGHLIGHTS: u32 = 8192u;
const MAX_AREA: f32 = 4.0;

// Blocks per side of a cell: the fourth level of the pyramid.
const CELL: i32 = 4;
const BLOCKS: u32 = 16u;

fn cells() -> vec2<u32> {
    let side = BLOCK_PX * CELL;
    return vec2<u32>((lens.size + side - 1) / side);
}

fn block(cell: vec2<u32>, i: u32) -> vec2<i32> {
    return CELL * vec2<i32>(cell) + vec2<i32>(i32(i) % CELL, i32(i) / CELL);
}

fn is_blurred(circle: f32) -> bool {
    return 0.5 * abs(circle) >= MIN_RADIUS_PX && abs(circle) < NOTHING;
}

// Whether a block's range of circles spans two surfaces. The pyramid then has only the nearer one's
// light.
fn hides_one(range: vec2<f32>) -> bool {
    return range.x < range.y && !is_one_surface(range.x, range.y) && is_blurred(range.y);
}

// In a block of two surfaces: the farther one's light, averaged over the block, and the circle of
// its bright part.
fn farther_light(b: vec2<i32>, range: vec2<f32>) -> vec4<f32> {
    let split = 0.5 * (range.x + range.y);
    var sum = vec3<f32>(0.0);
    var circle = 0.0;
    var weight = 1e-6;
    for (var k = 0; k < BLOCK_PX * BLOCK_PX; k++) {
        let q = BLOCK_PX * b + vec2<i32>(k % BLOCK_PX, k / BLOCK_PX);
        let light = light_within(color, q, lens.size);
        let own = circle_of(unpack_geometry(textureLoad(geometry, q, 0)).x);
        let taken = select(0.0, 1.0, light.a > 0.0 && own >= split);
        sum += taken * light.rgb;
        circle += taken * brightest(light) * own;
        weight += taken * brightest(light);
    }
    return vec4<f32>(sum / f32(BLOCK_PX * BLOCK_PX), circle / weight);
}

// The light taken from a block, averaged over it, and its circle.
fn taken_of(b: vec2<i32>, left: f32) -> vec4<f32> {
    let range = textureLoad(circles, b, 1).xy;
    if left == FARTHER {
        return farther_light(b, range);
    }
    return vec4<f32>((1.0 - left) * textureLoad(colors, b, 1).rgb, range.x);
}

@compute @workgroup_size(8, 8)
fn find(@builtin(global_invocation_id) id: vec3<u32>) {
    let size = cells();
    if any(id.xy >= size) {
        return;
    }
    let cell = id.y * size.x + id.x;
    var brightest_around = 0.0;
    for (var i = 0u; i < BLOCKS; i++) {
        let b = block(id.xy, i);
        brightest_around = max(brightest_around, brightest(textureLoad(colors, b, 1)));
        let range = textureLoad(circles, b, 1).xy;
        if hides_one(range) {
            brightest_around = max(brightest_around, brightest(farther_light(b, range)));
        }
    }
    numbers[cell] = 0u;
    if brightest_around <= HIGHLIGHT_TO_WHITE {
        return;
    }
    var sum = 0.0;
    var darkest_around = brightest_around;
    for (var i = 0; i < 9; i++) {
        let around = brightest(textureLoad(colors, vec2<i32>(id.xy) + vec2<i32>(i % 3, i / 3) - 1, 3));
        sum += around;
        darkest_around = min(darkest_around, around);
    }
    var number = 0u;
    for (var i = 0u; i < BLOCKS; i++) {
        let b = block(id.xy, i);
        let light = brightest(textureLoad(colors, b, 1));
        let range = textureLoad(circles, b, 1).xy;
        var farther = 0.0;
        if hides_one(range) {
            farther = brightest(farther_light(b, range));
        }
        // If a highlight spans two blocks, the fainter part belongs to the brighter, unless it is
        // as dark as the surroundings.
        var beside = max(light, farther);
        for (var k = 0; k < 9; k++) {
            beside = max(beside, brightest(textureLoad(colors, b + vec2<i32>(k % 3, k / 3) - 1, 1)));
        }
        let is_seen = beside > max(HIGHLIGHT_TO_WHITE, HIGHLIGHT_TO_SURROUNDINGS * sum / 9.0);
        let near_stands_out = is_seen && light > NEIGHBOUR_TO_DARKEST * darkest_around && is_blurred(range.x);
        let far_stands_out = is_seen && farther > NEIGHBOUR_TO_DARKEST * darkest_around;
        let rest = select(1.0, min(darkest_around / light, 1.0), near_stands_out);
        left[cell * BLOCKS + i] = select(rest, FARTHER, far_stands_out);
        number += select(0u, 1u, near_stands_out || far_stands_out);
    }
    numbers[cell] = number;
}

const THREADS: u32 = 256u;
var<workgroup> areas: array<f32, THREADS>;
var<workgroup> counts: array<u32, THREADS>;

fn area_of(b: vec2<i32>, left: f32) -> f32 {
    let range = textureLoad(circles, b, 1).xy;
    let side = abs(select(range.x, range.y, left == FARTHER)) + f32(BLOCK_PX);
    return select(side * side, 0.0, left == 1.0);
}

// Cell by cell in rows, so that the list is the same each time.
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
                area += area_of(b, left[cell * BLOCKS + i]);
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
    let budget = MAX_AREA * f32(lens.size.x * lens.size.y);
    var listed = 0u;
    for (var cell = first; cell < end; cell++) {
        if numbers[cell] > 0u {
            for (var i = 0u; i < BLOCKS; i++) {
                let b = block(vec2<u32>(cell % size.x, cell / size.x), i);
                let keep = left[cell * BLOCKS + i];
                area += area_of(b, keep);
                if keep != 1.0 && area <= budget && count < MAX_HIGHLIGHTS {
                    let taken = taken_of(b, keep);
                    let is_farther = select(0.0, 1.0, keep == FARTHER);
                    highlights.all[count] = Highlight(
                        vec4<f32>(vec2<f32>(b), min(keep, 1.0), taken.w),
                        vec4<f32>(f32(BLOCK_PX * BLOCK_PX) * taken.rgb, is_farther),
                    );
                    count += 1u;
                    listed = count;
                }
            }
        }
    }
    // The ones that the budget leaves out come last.
    counts[thread] = listed;
    workgroupBarrier();
    if thread == 0u {
        var max_count = 0u;
        for (var i = 0u; i < THREADS; i++) {
            max_count = max(max_count, counts[i]);
        }
        highlights.draw = vec4<u32>(4u, max_count, 0u, 0u);
    }
}

struct Corner { @builtin(position) at: vec4<f32>, @location(0) @interpolate(flat) keep: f32 }

// A block in a level of the pyramid.
@vertex
fn block_corner(@builtin(vertex_index) v: u32, @builtin(instance_index) i: u32) -> Corner {
    let place = drawn.all[i].place;
    let corner = texels_to_block * (place.xy + vec2<f32>(f32(v & 1u), f32(v >> 1u)));
    let size = ceil(vec2<f32>(lens.size) * texels_to_block / f32(BLOCK_PX));
    var out: Corner;
    out.at = vec4<f32>(corner / size * vec2<f32>(2.0, -2.0) + vec2<f32>(-1.0, 1.0), 0.0, 1.0);
    out.keep = place.z;
    return out;
}

// The blend state multiplies by this.
@fragment
fn dim(in: Corner) -> @location(0) vec4<f32> {
    return vec4<f32>(vec3<f32>(in.keep), 1.0);
}
