// Depth of field in layers: each pixel gathers over the image of the aperture, the nearer surface and what lies behind
// it apart (src/effects/depth_of_field/layered.rs).
// @import shared/layer
// @import shared/lens

// The resolution that is drawn: 0 the layer's, 1 half of it and so on.
override level: i32 = 0;
// How many points of the aperture are looked through: 4, 12, 16, 32 or 64.
override taps: i32 = 4;

// Two points each, in radii.
struct Aperture {
    four: array<vec4<f32>, 2>,
    twelve: array<vec4<f32>, 6>,
    sixteen: array<vec4<f32>, 8>,
    thirty_two: array<vec4<f32>, 16>,
    sixty_four: array<vec4<f32>, 32>,
}

@group(0) @binding(0) var<uniform> lens: Lens;
@group(0) @binding(1) var<uniform> aperture: Aperture;
@group(0) @binding(2) var tiles: texture_2d<f32>;     // nearest and farthest circle, kind, levels
@group(0) @binding(3) var corners: texture_2d<f32>;   // of tiles: the circle of the surface around
@group(0) @binding(4) var color: texture_2d<f32>;
@group(0) @binding(5) var geometry: texture_2d<u32>;
@group(0) @binding(6) var colors: texture_2d<f32>;    // from half the resolution on
@group(0) @binding(7) var circles: texture_2d<f32>;   // nearest and farthest in each texel
// What was gathered at lower resolutions: the picture, and where two surfaces are, the nearer and the farther one.
@group(0) @binding(8) var blurred: texture_2d<f32>;
@group(0) @binding(9) var blurred_front: texture_2d<f32>;
@group(0) @binding(10) var blurred_back: texture_2d<f32>;
@group(0) @binding(11) var between: sampler;

fn texel_px() -> f32 { return exp2(f32(level)); }

struct Corner {
    @builtin(position) at: vec4<f32>,
    // Of the tile: nearest and farthest circle.
    @location(0) @interpolate(flat) range: vec2<f32>,
    // Of the surface around, for where there is none.
    @location(1) @interpolate(linear) around: f32,
}

// A corner of a tile's quad; all corners in one point where it is not drawn.
fn tile_corner(vertex: u32, instance: u32, first: f32, last: f32, by_level: bool) -> Corner {
    let columns = f32(lens.size.w);
    // Floats: whole numbers are divided one by one on software drivers.
    let row = floor((f32(instance) + 0.5) / columns);
    let tile = vec2<f32>(f32(instance) - row * columns, row);
    let what = textureLoad(tiles, vec2<i32>(tile), 0);
    let high = floor(what.w / 8.0);
    let low = what.w - 8.0 * high;
    let wanted = !by_level || (f32(level) >= low && f32(level) <= high);
    let corner = tile + vec2<f32>(f32(vertex & 1u), f32(vertex >> 1u));
    let at = corner * f32(lens.size.z) / texel_px();
    let size = ceil(vec2<f32>(lens.size.xy) / texel_px());
    let device = min(at, size) / size * vec2<f32>(2.0, -2.0) + vec2<f32>(-1.0, 1.0);
    var out: Corner;
    out.at = vec4<f32>(select(vec2<f32>(0.0), device, wanted && what.z >= first && what.z <= last), 0.0, 1.0);
    out.range = what.xy;
    out.around = textureLoad(corners, vec2<i32>(corner), 0).x;
    return out;
}

@vertex
fn sharp_tiles(@builtin(vertex_index) v: u32, @builtin(instance_index) i: u32) -> Corner {
    return tile_corner(v, i, 1.0, 1.0, false);
}
@vertex
fn fine_tiles(@builtin(vertex_index) v: u32, @builtin(instance_index) i: u32) -> Corner {
    return tile_corner(v, i, 2.0, 2.0, false);
}
@vertex
fn wider_tiles(@builtin(vertex_index) v: u32, @builtin(instance_index) i: u32) -> Corner {
    return tile_corner(v, i, 3.0, 3.0, false);
}
@vertex
fn coarse_tiles(@builtin(vertex_index) v: u32, @builtin(instance_index) i: u32) -> Corner {
    return tile_corner(v, i, 4.0, 4.0, false);
}
@vertex
fn any_tiles(@builtin(vertex_index) v: u32, @builtin(instance_index) i: u32) -> Corner {
    return tile_corner(v, i, 5.0, 5.0, false);
}
@vertex
fn two_deep_tiles(@builtin(vertex_index) v: u32, @builtin(instance_index) i: u32) -> Corner {
    return tile_corner(v, i, 6.0, 8.0, false);
}
@vertex
fn level_one_deep_tiles(@builtin(vertex_index) v: u32, @builtin(instance_index) i: u32) -> Corner {
    return tile_corner(v, i, 1.0, 5.0, true);
}
@vertex
fn level_two_deep_16_tiles(@builtin(vertex_index) v: u32, @builtin(instance_index) i: u32) -> Corner {
    return tile_corner(v, i, 6.0, 6.0, true);
}
@vertex
fn level_two_deep_32_tiles(@builtin(vertex_index) v: u32, @builtin(instance_index) i: u32) -> Corner {
    return tile_corner(v, i, 7.0, 7.0, true);
}
@vertex
fn level_two_deep_64_tiles(@builtin(vertex_index) v: u32, @builtin(instance_index) i: u32) -> Corner {
    return tile_corner(v, i, 8.0, 8.0, true);
}
@vertex
fn all_tiles(@builtin(vertex_index) v: u32, @builtin(instance_index) i: u32) -> Corner {
    return tile_corner(v, i, 1.0, 8.0, false);
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

// The circle at a place with one surface: its own; beside it, that of the surface around.
fn circle_of_one(p: vec2<i32>, around: f32) -> f32 {
    let own = circles_at(p);
    return select(around, 0.5 * (own.x + own.y), own.x <= own.y);
}

// Which of the smaller pictures points that far apart are looked up in: their texels are as wide as the points' spacing.
fn level_of_taps(radius: f32, count: i32) -> f32 {
    // Each point stands for an area of π r²/count.
    let spacing = radius * sqrt(3.14159 / f32(count));
    return clamp(floor(log2(max(spacing, 1e-3)) + 0.5), f32(max(level, 1)), 4.0);
}

// The points' radius for which edges are as wide as the aperture makes them: less than the aperture's by what blurs
// besides: the texels that the points look up (squares; between them straight lines, 1/6, or the nearest, 1/12), and the
// straight lines between the pixels that are drawn here. An edge through a disc is wider from 10 to 90 % (2.75 σ) than one through what
// is rounder (2.56 σ): not all of their variance counts. The share is found by measuring (tests/depth_of_field.rs).
fn narrowed(radius: f32, of_taps: f32, between_texels: f32) -> f32 {
    let texel = exp2(2.0 * of_taps);
    let drawn = select(0.0, texel_px() * texel_px(), level > 0);
    let added = (texel - 1.0) / 12.0 + texel * between_texels + drawn / 6.0;
    return sqrt(max(radius * radius - 0.85 * added / lens.circle.z, 0.0));
}

// Of a point before the focus plane the image of the opening is upside down.
fn side_of(circle: f32) -> f32 {
    return select(1.0, -1.0, circle < 0.0);
}

fn two_taps(i: i32) -> vec4<f32> {
    if taps > 32 { return aperture.sixty_four[i]; }
    if taps > 16 { return aperture.thirty_two[i]; }
    if taps > 12 { return aperture.sixteen[i]; }
    if taps > 4 { return aperture.twelve[i]; }
    return aperture.four[i];
}

// One surface, at a lower resolution.
fn gather(at_px: vec2<f32>, circle: f32) -> vec4<f32> {
    let radius = max(0.5 * abs(circle), HALF_PX);
    let m = level_of_taps(radius, taps);
    let r = side_of(circle) * narrowed(radius, m, 1.0 / 6.0);
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
    // As in `narrowed`; straight lines between pixels add 1/6 to the variance, of which four points want less taken off.
    let added = select(1.2, 0.35, taps == 4) / 6.0;
    let r = side_of(circle) * sqrt(max(radius * radius - added / lens.circle.z, 0.0));
    var sum = vec4<f32>(0.0);
    for (var i = 0; i < taps / 2; i++) {
        let t = r * two_taps(i);
        sum += textureSampleLevel(color, between, (at_px - t.xy) * lens.texture.xy, 0.0);
        sum += textureSampleLevel(color, between, (at_px - t.zw) * lens.texture.xy, 0.0);
    }
    return sum / f32(taps);
}

// Share of a pixel that a circle around another one, of an opening of this variance, covers.
fn covers(radius: f32, distance: f32) -> f32 {
    let same_variance = 2.0 * sqrt(lens.circle.z) * radius;
    return clamp(same_variance + 0.5 - distance, 0.0, 1.0);
}

// Two surfaces, one behind the other, parted in the middle of the circles: their signed circles at a place, and the
// radii over which they are gathered.
struct Two { split: f32, front: f32, back: f32, front_px: f32, back_px: f32, one_is_sharp: bool }

fn two_at(p: vec2<i32>, range: vec2<f32>) -> Two {
    let split = 0.5 * (range.x + range.y);
    let own = circles_at(p);
    let in_front = own.x < split;
    let seen_behind = !in_front && own.x <= own.y;
    let front = select(range.x, own.x, in_front);
    let back = select(range.y, own.y, seen_behind);
    let front_px = 0.5 * abs(front);
    // What the nearer one hides is made up of what is seen around it, as far as its blur uncovers it.
    let smallest = select(0.0, 0.5 * min(abs(range.x), abs(range.y)), range.x * range.y > 0.0);
    let back_px = max(0.5 * abs(back), select(0.0, front_px, in_front));
    return Two(split, front, back, front_px, back_px, smallest < TWO_HALF_PX);
}

struct Layers { front: vec4<f32>, back: vec4<f32> }

// Of sums and of the weights that went into them. What shows through the nearer one is known to be empty. Where nothing
// is known of the farther one, the nearer one is whole.
fn layers(near: vec4<f32>, near_weight: f32, far: vec4<f32>, far_weight: f32) -> Layers {
    let front = near / max(near_weight, 1e-6);
    let back = select(front / max(front.a, 1e-6), far / max(far_weight, 1e-6), far_weight > 0.0);
    return Layers(front, back);
}

fn over(l: Layers) -> vec4<f32> {
    return l.front + (1.0 - l.front.a) * l.back;
}

// At a lower resolution, by points that look up whole texels, each of them the nearer surface's or the farther one's.
fn gather_two(p: vec2<i32>, at_px: vec2<f32>, around: vec2<f32>) -> Layers {
    let two = two_at(p, around);
    let front_px = max(two.front_px, TWO_HALF_PX);
    let back_px = max(two.back_px, TWO_HALF_PX);
    let m = vec2<f32>(level_of_taps(front_px, taps), level_of_taps(back_px, taps));
    let front_r = side_of(two.front) * narrowed(front_px, m.x, 1.0 / 12.0);
    let back_r = side_of(two.back) * narrowed(back_px, m.y, 1.0 / 12.0);
    let texel = exp2(m);
    let mip = vec2<i32>(m) - 1;
    var near = vec4<f32>(0.0);
    var far = vec4<f32>(0.0);
    var far_weight = 0.0;
    for (var i = 0; i < taps; i++) {
        let pair = two_taps(i / 2);
        let t = select(pair.xy, pair.zw, (i & 1) == 1);
        let q = vec2<i32>(floor((at_px - front_r * t) / texel.x));
        let range = textureLoad(circles, q, mip.x);
        // A texel with both is half of each.
        near += select(select(1.0, 0.5, range.y >= two.split), 0.0, range.x >= two.split) * textureLoad(colors, q, mip.x);
        let r = vec2<i32>(floor((at_px - back_r * t) / texel.y));
        let seen = select(0.0, 1.0, textureLoad(circles, r, mip.y).x >= two.split);
        let light = textureLoad(colors, r, mip.y);
        far += seen * light;
        far_weight += max(seen, 1.0 - light.a);
    }
    return layers(near, f32(taps), far, far_weight);
}

// At the layer's resolution: what has small circles here, the rest from lower resolutions.
fn gather_two_fine(p: vec2<i32>, at_px: vec2<f32>, around: vec2<f32>) -> Layers {
    let two = two_at(p, around);
    let front_is_fine = two.front_px < TWO_HALF_PX;
    let back_is_fine = two.back_px < TWO_HALF_PX;
    var near = vec4<f32>(0.0);
    var near_weight = 0.0;
    var far = vec4<f32>(0.0);
    var far_weight = 0.0;
    // Without a turn where there is nothing to do: software drivers work through both sides of a branch.
    let reach = i32(ceil(max(select(-1.0, two.front_px, front_is_fine), select(-1.0, two.back_px, back_is_fine))));
    for (var y = -reach; y <= reach; y++) {
        for (var x = -reach; x <= reach; x++) {
            let q = p + vec2<i32>(x, y);
            let away = length(vec2<f32>(f32(x), f32(y)));
            let is_near = circles_in_layer(q).x < two.split;
            let c = textureLoad(color, q, 0);
            let w = covers(two.front_px, away);
            near += select(0.0, w, is_near) * c;
            near_weight += w;
            let v = covers(two.back_px, away);
            far += select(v, 0.0, is_near) * c;
            far_weight += select(v, v * (1.0 - c.a), is_near);
        }
    }
    let fine = layers(near, near_weight, far, far_weight);
    let uv = at_px * lens.texture.xy;
    // Where one of the two is sharp, only the level of the other was drawn.
    let lowest = select(1.0, level_of_two(0.5 * max(abs(around.x), abs(around.y))), two.one_is_sharp);
    let front_coarse = textureSampleLevel(blurred_front, between, uv, max(level_of_two(two.front_px), lowest) - 1.0);
    let back_coarse = textureSampleLevel(blurred_back, between, uv, max(level_of_two(two.back_px), lowest) - 1.0);
    return Layers(select(front_coarse, fine.front, front_is_fine), select(back_coarse, fine.back, back_is_fine));
}

struct Blurred { @location(0) all: vec4<f32>, @location(1) front: vec4<f32>, @location(2) back: vec4<f32> }

@fragment
fn level_one_deep(in: Corner) -> Blurred {
    let one = gather(in.at.xy * texel_px(), circle_of_one(vec2<i32>(in.at.xy), in.around));
    return Blurred(one, vec4<f32>(0.0), one);
}

@fragment
fn level_two_deep(in: Corner) -> Blurred {
    let two = gather_two(vec2<i32>(in.at.xy), in.at.xy * texel_px(), in.range);
    return Blurred(over(two), two.front, two.back);
}

@fragment
fn sharp(in: Corner) -> @location(0) vec4<f32> {
    return textureLoad(color, vec2<i32>(in.at.xy), 0);
}

@fragment
fn fine(in: Corner) -> @location(0) vec4<f32> {
    return gather_fine(in.at.xy, circle_of_one(vec2<i32>(in.at.xy), in.around));
}

fn from_level(at_px: vec2<f32>, radius: f32) -> vec4<f32> {
    return textureSampleLevel(blurred, between, at_px * lens.texture.xy, max(level_of(radius), 1.0) - 1.0);
}

@fragment
fn coarse(in: Corner) -> @location(0) vec4<f32> {
    return from_level(in.at.xy, 0.5 * abs(in.range.x));
}

@fragment
fn any_circles(in: Corner) -> @location(0) vec4<f32> {
    let circle = circle_of_one(vec2<i32>(in.at.xy), in.around);
    let radius = 0.5 * abs(circle);
    return select(from_level(in.at.xy, radius), gather_fine(in.at.xy, circle), radius < HALF_PX);
}

@fragment
fn two_deep(in: Corner) -> @location(0) vec4<f32> {
    return over(gather_two_fine(vec2<i32>(in.at.xy), in.at.xy, in.range));
}

// The geometry of what is newly covered: of the nearest surface around.
@fragment
fn passing(in: Corner) -> @location(0) vec4<u32> {
    let own = textureLoad(geometry, vec2<i32>(in.at.xy), 0);
    let around = lens.circle.y - in.range.x / lens.circle.x;
    return select(pack_geometry(1.0 / max(around, 1e-6), vec2<f32>(0.0)), own, unpack_geometry(own).x > 0.0);
}
