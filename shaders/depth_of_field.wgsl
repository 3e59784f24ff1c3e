// Depth of field in layers: each pixel gathers over the image of the aperture, the nearer surface and what lies behind
// it apart (src/effects/depth_of_field/layered.rs).
// @import shared/layer
// @import shared/lens

// The resolution that is drawn: 0 the layer's, 1 half of it and so on.
override level: i32 = 0;
// How many points of the aperture are looked through; even.
override taps: i32 = 32;

const FINE_TAPS: i32 = 12;

struct Aperture {
    fine: array<vec4<f32>, 6>,   // two points each, in radii
    few: array<vec4<f32>, 16>,
    many: array<vec4<f32>, 32>,
}

@group(0) @binding(0) var<uniform> lens: Lens;
@group(0) @binding(1) var<uniform> aperture: Aperture;
@group(0) @binding(2) var tiles: texture_2d<f32>;     // nearest and farthest circle, kind, levels
@group(0) @binding(3) var middles: texture_2d<f32>;   // z: middle of a tile's circles, w: 1, or both 0
@group(0) @binding(4) var color: texture_2d<f32>;
@group(0) @binding(5) var geometry: texture_2d<u32>;
@group(0) @binding(6) var colors: texture_2d<f32>;    // from half the resolution on
@group(0) @binding(7) var circles: texture_2d<f32>;   // nearest and farthest in each texel
@group(0) @binding(8) var blurred: texture_2d<f32>;   // what was gathered at lower resolutions
@group(0) @binding(9) var between: sampler;

fn texel_px() -> f32 { return exp2(f32(level)); }

// A corner of a tile's quad; all corners in one point where it is not drawn.
fn tile_corner(vertex: u32, instance: u32, first: f32, last: f32, by_level: bool) -> vec4<f32> {
    let columns = f32(lens.size.w);
    // Floats: whole numbers are divided one by one on software drivers.
    let row = floor((f32(instance) + 0.5) / columns);
    let tile = vec2<f32>(f32(instance) - row * columns, row);
    let what = textureLoad(tiles, vec2<i32>(tile), 0);
    let high = floor(what.w / 8.0);
    let low = what.w - 8.0 * high;
    let wanted = !by_level || (f32(level) >= low && f32(level) <= high);
    let at = (tile + vec2<f32>(f32(vertex & 1u), f32(vertex >> 1u))) * f32(lens.size.z) / texel_px();
    let size = ceil(vec2<f32>(lens.size.xy) / texel_px());
    let device = min(at, size) / size * vec2<f32>(2.0, -2.0) + vec2<f32>(-1.0, 1.0);
    return vec4<f32>(select(vec2<f32>(0.0), device, wanted && what.z >= first && what.z <= last), 0.0, 1.0);
}

@vertex
fn sharp_tiles(@builtin(vertex_index) v: u32, @builtin(instance_index) i: u32) -> @builtin(position) vec4<f32> {
    return tile_corner(v, i, 1.0, 1.0, false);
}
@vertex
fn fine_tiles(@builtin(vertex_index) v: u32, @builtin(instance_index) i: u32) -> @builtin(position) vec4<f32> {
    return tile_corner(v, i, 2.0, 2.0, false);
}
@vertex
fn coarse_tiles(@builtin(vertex_index) v: u32, @builtin(instance_index) i: u32) -> @builtin(position) vec4<f32> {
    return tile_corner(v, i, 3.0, 3.0, false);
}
@vertex
fn both_tiles(@builtin(vertex_index) v: u32, @builtin(instance_index) i: u32) -> @builtin(position) vec4<f32> {
    return tile_corner(v, i, 4.0, 4.0, false);
}
@vertex
fn two_deep_tiles(@builtin(vertex_index) v: u32, @builtin(instance_index) i: u32) -> @builtin(position) vec4<f32> {
    return tile_corner(v, i, 5.0, 5.0, false);
}
@vertex
fn two_deep_coarse_tiles(@builtin(vertex_index) v: u32, @builtin(instance_index) i: u32) -> @builtin(position) vec4<f32> {
    return tile_corner(v, i, 6.0, 6.0, false);
}
@vertex
fn level_one_deep_tiles(@builtin(vertex_index) v: u32, @builtin(instance_index) i: u32) -> @builtin(position) vec4<f32> {
    return tile_corner(v, i, 1.0, 4.0, true);
}
@vertex
fn level_two_deep_tiles(@builtin(vertex_index) v: u32, @builtin(instance_index) i: u32) -> @builtin(position) vec4<f32> {
    return tile_corner(v, i, 5.0, 6.0, true);
}
@vertex
fn all_tiles(@builtin(vertex_index) v: u32, @builtin(instance_index) i: u32) -> @builtin(position) vec4<f32> {
    return tile_corner(v, i, 1.0, 6.0, false);
}

fn tile_of(at_px: vec2<f32>) -> vec4<f32> {
    return textureLoad(tiles, vec2<i32>(at_px / f32(lens.size.z)), 0);
}

// vSLRcam (8) in pixels: fx · D · (1/d_s − 1/d_o).
fn circle_of(depth: f32) -> f32 {
    return clamp(lens.circle.x * (lens.circle.y - 1.0 / max(depth, 1e-6)), -lens.circle.w, lens.circle.w);
}

// Nearest and farthest circle in a pixel of the layer.
fn circles_in_layer(p: vec2<i32>) -> vec2<f32> {
    let depth = unpack_geometry(textureLoad(geometry, p, 0)).x;
    let circle = circle_of(depth);
    return select(vec2<f32>(NOTHING, -NOTHING), vec2<f32>(circle), depth > 0.0 && all(p >= vec2<i32>(0)) && all(p < lens.size.xy));
}

fn circles_at(p: vec2<i32>) -> vec2<f32> {
    if level == 0 {
        return circles_in_layer(p);
    }
    return textureLoad(circles, p, level - 1).xy;
}

// The circle at a place with one surface: its own; beside it, what the tiles around have in the middle.
fn circle_of_one(p: vec2<i32>, at_px: vec2<f32>) -> f32 {
    let own = circles_at(p);
    let around = textureSampleLevel(middles, between, at_px * lens.texture.zw, 0.0).zw;
    return select(around.x / max(around.y, 1e-6), 0.5 * (own.x + own.y), own.x <= own.y);
}

// Which of the smaller pictures points that far apart are looked up in: their texels are as wide as the points' spacing.
fn level_of_taps(radius: f32, count: i32) -> f32 {
    // Each point stands for an area of π r²/count.
    let spacing = radius * sqrt(3.14159 / f32(count));
    return clamp(floor(log2(max(spacing, 1e-3)) + 0.5), f32(max(level, 1)), 4.0);
}

// The points' radius for which all that blurs — the points, the texels that they look up (square, with straight lines
// between them), and the straight lines between the pixels that are drawn here — has the variance of the aperture.
fn narrowed(radius: f32, of_taps: f32) -> f32 {
    let texel = exp2(2.0 * of_taps);
    let drawn = select(0.0, texel_px() * texel_px(), level > 0);
    let added = (texel - 1.0) / 12.0 + texel / 6.0 + drawn / 6.0;
    return sqrt(max(radius * radius - added / lens.circle.z, 0.0));
}

fn two_taps(i: i32) -> vec4<f32> {
    if taps > 32 {
        return aperture.many[i];
    }
    return aperture.few[i];
}

// One surface, at a lower resolution.
fn gather(at_px: vec2<f32>, circle: f32) -> vec4<f32> {
    let radius = max(0.5 * abs(circle), HALF_PX);
    let m = level_of_taps(radius, taps);
    // Of a point before the focus plane the image of the opening is upside down.
    let r = sign(circle) * narrowed(radius, m);
    var sum = vec4<f32>(0.0);
    for (var i = 0; i < taps / 2; i++) {
        let t = r * two_taps(i);
        sum += textureSampleLevel(colors, between, (at_px - t.xy) * lens.texture.xy, m - 1.0);
        sum += textureSampleLevel(colors, between, (at_px - t.zw) * lens.texture.xy, m - 1.0);
    }
    return sum / f32(taps);
}

// One surface with small circles, at the layer's resolution.
fn gather_fine(at_px: vec2<f32>, circle: f32) -> vec4<f32> {
    let radius = 0.5 * abs(circle);
    // Straight lines between pixels add 1/6 to the variance as a rule. Within a pixel, a point at x blurs by |x| in
    // all, of which the mean over a disc is 0.849 of the standard deviation.
    let within = radius * radius * sqrt(lens.circle.z) / 0.849;
    let r = sign(circle) * select(sqrt(max(radius * radius - 1.0 / (6.0 * lens.circle.z), 0.0)), within, radius < 1.25);
    var sum = vec4<f32>(0.0);
    for (var i = 0; i < FINE_TAPS / 2; i++) {
        let t = r * aperture.fine[i];
        sum += textureSampleLevel(color, between, (at_px - t.xy) * lens.texture.xy, 0.0);
        sum += textureSampleLevel(color, between, (at_px - t.zw) * lens.texture.xy, 0.0);
    }
    return sum / f32(FINE_TAPS);
}

// Share of a pixel that a circle around another one, of an opening of this variance, covers.
fn covers(radius: f32, distance: f32) -> f32 {
    let same_variance = 2.0 * sqrt(lens.circle.z) * radius;
    return clamp(same_variance + 0.5 - distance, 0.0, 1.0);
}

// Two surfaces, one behind the other, parted in the middle of the circles. What the nearer one hides is made up of what
// is seen of the farther one around it.
fn gather_two(p: vec2<i32>, at_px: vec2<f32>) -> vec4<f32> {
    let tile = tile_of(at_px);
    let split = 0.5 * (tile.x + tile.y);
    let own = circles_at(p);
    let in_front = own.x < split;
    let seen_behind = !in_front && own.x <= own.y;
    let front = select(tile.x, own.x, in_front);
    let back = select(tile.y, own.y, seen_behind);
    let smallest = select(0.0, HALF_PX, level > 0);
    let front_px = max(0.5 * abs(front), smallest);
    // As far as the blur of the nearer one uncovers what it hides.
    let back_px = max(max(0.5 * abs(back), smallest), select(0.0, front_px, in_front));

    var near = vec4<f32>(0.0);
    var near_weight = 0.0;
    var far = vec4<f32>(0.0);
    var far_weight = 0.0;

    // Loops without a turn stand for branches, both sides of which software drivers work through.
    let front_is_fine = front_px < HALF_PX;
    let back_is_fine = back_px < HALF_PX;
    let reach = i32(ceil(max(select(-1.0, front_px, front_is_fine), select(-1.0, back_px, back_is_fine))));
    for (var y = -reach; y <= reach; y++) {
        for (var x = -reach; x <= reach; x++) {
            let q = p + vec2<i32>(x, y);
            let away = length(vec2<f32>(f32(x), f32(y)));
            let is_near = circles_in_layer(q).x < split;
            let c = textureLoad(color, q, 0);
            let w = select(0.0, covers(front_px, away), front_is_fine);
            near += select(0.0, w, is_near) * c;
            near_weight += w;
            let v = select(0.0, covers(back_px, away), back_is_fine && !is_near);
            far += v * c;
            far_weight += v;
        }
    }
    let front_taps = select(taps / 2, 0, front_is_fine);
    let front_level = level_of_taps(front_px, taps);
    let front_r = sign(front) * narrowed(front_px, front_level) / exp2(front_level);
    let front_at = at_px / exp2(front_level);
    for (var i = 0; i < front_taps; i++) {
        let two = front_r * two_taps(i);
        for (var k = 0; k < 2; k++) {
            let q = vec2<i32>(floor(front_at - select(two.xy, two.zw, k == 1)));
            let range = textureLoad(circles, q, i32(front_level) - 1);
            // A texel with both is half of each.
            let share = select(select(1.0, 0.5, range.y >= split), 0.0, range.x >= split);
            near += share * textureLoad(colors, q, i32(front_level) - 1);
            near_weight += 1.0;
        }
    }
    let back_taps = select(taps / 2, 0, back_is_fine);
    let back_level = level_of_taps(back_px, taps);
    let back_r = sign(back) * narrowed(back_px, back_level) / exp2(back_level);
    let back_at = at_px / exp2(back_level);
    for (var i = 0; i < back_taps; i++) {
        let two = back_r * two_taps(i);
        for (var k = 0; k < 2; k++) {
            let q = vec2<i32>(floor(back_at - select(two.xy, two.zw, k == 1)));
            let seen = select(0.0, 1.0, textureLoad(circles, q, i32(back_level) - 1).x >= split);
            far += seen * textureLoad(colors, q, i32(back_level) - 1);
            far_weight += seen;
        }
    }
    let over = near / max(near_weight, 1e-6);
    let under = far / max(far_weight, 1e-6);
    return over + (1.0 - over.a) * under;
}

// Less than a 16-bit float's step at 1 is what rounding brings from next door.
fn rounded(c: vec4<f32>) -> vec4<f32> {
    return select(c, vec4<f32>(0.0), c.a < 1.0 / 2048.0);
}

@fragment
fn level_one_deep(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let at_px = at.xy * texel_px();
    return gather(at_px, circle_of_one(vec2<i32>(at.xy), at_px));
}

@fragment
fn level_two_deep(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    return gather_two(vec2<i32>(at.xy), at.xy * texel_px());
}

@fragment
fn sharp(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    return textureLoad(color, vec2<i32>(at.xy), 0);
}

@fragment
fn fine(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    return rounded(gather_fine(at.xy, circle_of_one(vec2<i32>(at.xy), at.xy)));
}

fn from_level(at_px: vec2<f32>, radius: f32) -> vec4<f32> {
    return textureSampleLevel(blurred, between, at_px * lens.texture.xy, max(level_of(radius), 1.0) - 1.0);
}

@fragment
fn coarse(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    return rounded(from_level(at.xy, 0.5 * abs(circle_of_one(vec2<i32>(at.xy), at.xy))));
}

@fragment
fn both(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let circle = circle_of_one(vec2<i32>(at.xy), at.xy);
    let radius = 0.5 * abs(circle);
    return rounded(select(from_level(at.xy, radius), gather_fine(at.xy, circle), radius < HALF_PX));
}

@fragment
fn two_deep(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    return rounded(gather_two(vec2<i32>(at.xy), at.xy));
}

@fragment
fn two_deep_coarse(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let tile = tile_of(at.xy);
    return rounded(from_level(at.xy, 0.5 * min(abs(tile.x), abs(tile.y))));
}

// The geometry of what is newly covered: of the nearest surface around.
@fragment
fn passing(@builtin(position) at: vec4<f32>) -> @location(0) vec4<u32> {
    let own = textureLoad(geometry, vec2<i32>(at.xy), 0);
    let around = lens.circle.y - tile_of(at.xy).x / lens.circle.x;
    return select(pack_geometry(1.0 / max(around, 1e-6), vec2<f32>(0.0)), own, unpack_geometry(own).x > 0.0);
}
