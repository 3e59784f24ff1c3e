// Classifies tiles: the range of circles that may reach into each, and its kind; and the circle at
// each corner of tiles.
// @import shared/fullscreen
// @import shared/lens
@group(0) @binding(0) var<uniform> lens: Lens;
// Circles at a quarter of the resolution; later the output of the previous step.
@group(0) @binding(1) var before: texture_2d<f32>;
@group(0) @binding(2) var touched: texture_2d<f32>;

// The kinds, as drawn by shaders/depth_of_field.wgsl.
const SHARP: f32 = 1.0;
const FINE: f32 = 2.0;
const WIDER: f32 = 3.0;
const COARSE: f32 = 4.0;
const ANY: f32 = 5.0;
// Two surfaces, one behind the other.
const TWO_DEEP: f32 = 6.0;

fn side() -> i32 { return lens.side_px; }

// For each tile: nearest and farthest circle, their middle, and 1 (0 where the tile is empty).
@fragment
fn own(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let low = vec2<i32>(at.xy) * side() / 4;
    let high = min(low + side() / 4, (lens.size + 3) / 4);
    var near = NOTHING;
    var far = -NOTHING;
    for (var y = low.y; y < high.y; y++) {
        for (var x = low.x; x < high.x; x++) {
            let range = textureLoad(before, vec2<i32>(x, y), 0);
            near = min(near, range.x);
            far = max(far, range.y);
        }
    }
    let there = near <= far;
    return vec4<f32>(near, far, select(0.0, 0.5 * (near + far), there), select(0.0, 1.0, there));
}

fn last_tile() -> vec2<i32> {
    return (lens.size - 1) / side();
}

// Tiles to each side from which light can come.
fn reach_tiles() -> i32 { return i32(lens.reach_tiles); }

// The least distance between two tiles, px.
fn apart_px(tiles: vec2<i32>) -> f32 {
    return f32(side()) * length(max(abs(vec2<f32>(tiles)) - 1.0, vec2<f32>(0.0)));
}

// Distance to which a circle spreads (as reach_px of src/effects/depth_of_field/layered.rs), px.
fn spread_px(circle: f32) -> f32 {
    return 0.75 * abs(circle) + 3.0;
}

// For each tile: the widest spread of the circles that reach into it.
@fragment
fn touching(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let p = vec2<i32>(at.xy);
    let low = max(p - reach_tiles(), vec2<i32>(0));
    let high = min(p + reach_tiles(), last_tile());
    var spread = 0.0;
    for (var y = low.y; y <= high.y; y++) {
        for (var x = low.x; x <= high.x; x++) {
            let q = vec2<i32>(x, y);
            let range = textureLoad(before, q, 0);
            let own = spread_px(max(abs(range.x), abs(range.y)));
            spread = max(spread, select(0.0, own, range.w > 0.0 && own >= apart_px(q - p)));
        }
    }
    return vec4<f32>(spread, 0.0, 0.0, 0.0);
}

// For each tile and all surfaces visible through the circles that touch it: nearest and farthest
// circle, the kind, and the levels of resolution needed (first + 8 · last; 7 for none).
@fragment
fn around(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let p = vec2<i32>(at.xy);
    let spread = textureLoad(touched, p, 0).x;
    let low = max(p - reach_tiles(), vec2<i32>(0));
    let high = min(p + reach_tiles(), last_tile());
    var near = NOTHING;
    var far = -NOTHING;
    for (var y = low.y; y <= high.y; y++) {
        for (var x = low.x; x <= high.x; x++) {
            let q = vec2<i32>(x, y);
            let range = textureLoad(before, q, 0);
            let is_reached = spread >= apart_px(q - p);
            near = min(near, select(NOTHING, range.x, is_reached));
            far = max(far, select(-NOTHING, range.y, is_reached));
        }
    }
    let smallest = smallest_radius(near, far);
    let largest = 0.5 * max(abs(near), abs(far));
    let one = is_one_surface(near, far);
    let one_level = smallest >= HALF_PX && level_of(smallest) == level_of(largest);
    var kind = select(ANY, COARSE, one_level);
    kind = select(kind, WIDER, largest < HALF_PX);
    kind = select(kind, FINE, largest < FINE_CIRCLE_PX);
    kind = select(kind, SHARP, 2.0 * largest < SHARP_PX);
    kind = select(TWO_DEEP, kind, one);
    // With two surfaces of which one is sharp, only the other needs a lower resolution.
    let lowest = select(smallest, largest, !one && smallest < TWO_HALF_PX);
    let coarse = largest >= select(TWO_HALF_PX, HALF_PX, one);
    let first_level = select(level_of_two(lowest), max(level_of(lowest), 1.0), one);
    let last_level = select(level_of_two(largest), level_of(largest), one);
    let levels = select(7.0, first_level + 8.0 * last_level, coarse);
    return select(vec4<f32>(0.0, 0.0, 0.0, 7.0), vec4<f32>(near, far, kind, levels), near <= far);
}

// The same, including levels that the neighbouring tiles need: they are read across the borders.
@fragment
fn needed(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let p = vec2<i32>(at.xy);
    var first = 7.0;
    var last = 0.0;
    for (var y = max(p.y - 1, 0); y <= min(p.y + 1, last_tile().y); y++) {
        for (var x = max(p.x - 1, 0); x <= min(p.x + 1, last_tile().x); x++) {
            let levels = textureLoad(before, vec2<i32>(x, y), 0).w;
            last = max(last, floor(levels / 8.0));
            first = min(first, levels - 8.0 * floor(levels / 8.0));
        }
    }
    return vec4<f32>(textureLoad(before, p, 0).xyz, first + 8.0 * last);
}

// At a corner, the mean over the tiles that meet there: the middle of their own circles, or of
// those around (0 where there are none).
@fragment
fn corners(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let corner = vec2<i32>(at.xy);
    var sum = vec2<f32>(0.0);
    for (var i = 0; i < 4; i++) {
        let p = corner - vec2<i32>(i & 1, i >> 1);
        let own = textureLoad(before, p, 0);
        let circles = textureLoad(touched, p, 0);
        let there = all(p >= vec2<i32>(0)) && all(p <= last_tile()) && circles.z > 0.0;
        let middle = select(0.5 * (circles.x + circles.y), own.z, own.w > 0.0);
        sum += select(vec2<f32>(0.0), vec2<f32>(middle, 1.0), there);
    }
    return vec4<f32>(sum.x / max(sum.y, 1.0), 0.0, 0.0, 0.0);
}
