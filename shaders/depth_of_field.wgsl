// Depth of field in layers: each pixel gathers over the image of the aperture, with separate layers
// for the nearer surface and the surface behind it (src/effects/depth_of_field/layered.rs).
// @import shared/layer
// @import shared/lens
// @import shared/highlights

// The resolution drawn: 0 is the layer's, 1 half of it, and so on.
override level: i32 = 0;
// Number of points of the aperture at the layer's resolution: 4 or 12.
override taps: i32 = 4;

// Written by src/effects/depth_of_field/image.rs.
struct Aperture {
    // Two points per vector, in radii.
    four: array<vec4<f32>, 2>,
    twelve: array<vec4<f32>, 6>,
    // For each radius of the aperture's image (in quarters of a texel), and for the next one: the
    // rim, and the distance of the outermost texels from the middle.
    rims: array<vec4<f32>, RIM_COUNT>,
    // Row by row around the image's middle: the rim on which a texel lies, in the image of a point
    // behind the focus plane and of one in front of it; then the same with the middle between four
    // texels.
    places: array<vec4<f32>, PLACES>,
    // Angle between the middles of two sides (0 for a circle) and the angle of one of them, rad;
    // the apothem, in radii; the area, in squares of the apothem.
    shape: vec4<f32>,
}
const RIM_COUNT: u32 = 64u;
const REACH: i32 = 13;
const COLUMNS: i32 = 27;
const PLACES: u32 = 729u;

@group(0) @binding(0) var<uniform> lens: Lens;
@group(0) @binding(1) var<uniform> aperture: Aperture;
@group(0) @binding(2) var tiles: texture_2d<f32>;     // nearest and farthest circle, kind, levels
@group(0) @binding(3) var corners: texture_2d<f32>;   // at the tiles' corners: the circle of the surface around
@group(0) @binding(4) var color: texture_2d<f32>;
@group(0) @binding(5) var geometry: texture_2d<u32>;
@group(0) @binding(6) var colors: texture_2d<f32>;    // at half the resolution and below
@group(0) @binding(7) var circles: texture_2d<f32>;   // nearest and farthest in each texel
// The results of lower resolutions: the picture, and where there are two surfaces, the nearer and
// the farther.
@group(0) @binding(8) var blurred: texture_2d<f32>;
@group(0) @binding(9) var blurred_front: texture_2d<f32>;
@group(0) @binding(10) var blurred_back: texture_2d<f32>;
@group(0) @binding(11) var between: sampler;
@group(0) @binding(12) var<storage, read> highlights: Highlights;

fn texel_px() -> f32 { return exp2(f32(level)); }

struct Corner {
    @builtin(position) at: vec4<f32>,
    // The tile's nearest and farthest circle.
    @location(0) @interpolate(flat) range: vec2<f32>,
    // The circle of the surface around, for pixels without a surface.
    @location(1) @interpolate(linear) around: f32,
}

// A corner of a tile's quad. All corners coincide if the tile is not drawn.
fn tile_corner(vertex: u32, instance: u32, first: f32, last: f32, by_level: bool) -> Corner {
    let columns = f32(lens.columns);
    // In floats: software drivers divide integers one by one.
    let row = floor((f32(instance) + 0.5) / columns);
    let tile = vec2<f32>(f32(instance) - row * columns, row);
    let what = textureLoad(tiles, vec2<i32>(tile), 0);
    let high = floor(what.w / 8.0);
    let low = what.w - 8.0 * high;
    let wanted = !by_level || (f32(level) >= low && f32(level) <= high);
    let corner = tile + vec2<f32>(f32(vertex & 1u), f32(vertex >> 1u));
    let at = corner * f32(lens.side_px) / texel_px();
    let size = ceil(vec2<f32>(lens.size) / texel_px());
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
    return tile_corner(v, i, 6.0, 6.0, false);
}
@vertex
fn level_one_deep_tiles(@builtin(vertex_index) v: u32, @builtin(instance_index) i: u32) -> Corner {
    return tile_corner(v, i, 1.0, 5.0, true);
}
@vertex
fn level_two_deep_tiles(@builtin(vertex_index) v: u32, @builtin(instance_index) i: u32) -> Corner {
    return tile_corner(v, i, 6.0, 6.0, true);
}
@vertex
fn all_tiles(@builtin(vertex_index) v: u32, @builtin(instance_index) i: u32) -> Corner {
    return tile_corner(v, i, 1.0, 6.0, false);
}

// Nearest and farthest circle in a pixel of the layer.
fn circles_in_layer(p: vec2<i32>) -> vec2<f32> {
    let depth = unpack_geometry(textureLoad(geometry, p, 0)).x;
    let circle = circle_of(depth);
    return select(vec2<f32>(NOTHING, -NOTHING), vec2<f32>(circle), depth > 0.0 && all(p >= vec2<i32>(0)) && all(p < lens.size));
}

fn circles_at(p: vec2<i32>) -> vec2<f32> {
    if level == 0 {
        return circles_in_layer(p);
    }
    return textureLoad(circles, p, level - 1).xy;
}

// The circle at a pixel with one surface: its own; next to the surface, that of the surface around.
fn circle_of_one(p: vec2<i32>, around: f32) -> f32 {
    let own = circles_at(p);
    return select(around, 0.5 * (own.x + own.y), own.x <= own.y);
}

// The image of the aperture is upside down for a point in front of the focus plane.
fn side_of(circle: f32) -> f32 {
    return select(1.0, -1.0, circle < 0.0);
}

fn two_taps(i: i32) -> vec4<f32> {
    if taps > 4 { return aperture.twelve[i]; }
    return aperture.four[i];
}

// Sampling of the aperture's image.
struct Image {
    // The resolution, and the texel whose centre (or upper left corner) is the image's middle.
    level: i32,
    middle: vec2<i32>,
    // Distance of the outermost texels from the middle, and rows to each side.
    far: f32,
    reach: i32,
    // Whether the middle lies between texels.
    between: bool,
    // Texels per px, and the variance that other blurs add, to be subtracted from a squared radius
    // (texels²).
    scale: f32,
    off: f32,
}

// For circles of up to this radius (px). Smaller ones drawn at a quarter are looked up at a half.
fn image_at(p: vec2<i32>, radius: f32) -> Image {
    var image: Image;
    image.between = level == 2 && radius < FINER_PX;
    image.level = select(level, 1, image.between);
    image.middle = select(p, 2 * p + 1, image.between);
    image.scale = exp2(-f32(image.level));
    // Texels are squares, and the result is interpolated linearly. An edge through a disc
    // is wider from 10 to 90 % (2.75 σ) than one through something rounder (2.56 σ), so not all of
    // their variance counts. The share was found by measuring (tests/composite/depth_of_field.rs).
    let drawn = texel_px() * image.scale;
    image.off = 0.85 * ((1.0 - image.scale * image.scale) / 12.0 + drawn * drawn / 6.0) / lens.variance;
    image.far = rim_of(image, radius).y;
    image.reach = min(i32(image.far + select(0.0, 0.5, image.between)), REACH);
    return image;
}

// The rim whose edges are as wide as those of the circle, and the extent of the image.
fn rim_of(image: Image, radius_px: f32) -> vec2<f32> {
    // Larger ones are not sampled here.
    let radius = min(radius_px, max_radius_of_level(level)) * image.scale;
    return rim_at(4.0 * sqrt(max(radius * radius - image.off, 0.0)));
}

// The rim for a radius in quarters of a texel.
fn rim_at(quarters: f32) -> vec2<f32> {
    let i = min(u32(quarters), RIM_COUNT - 1u);
    let rims = aperture.rims[i];
    return mix(rims.xy, rims.zw, quarters - f32(i));
}

// Columns to each side in a row.
fn columns_of(image: Image, y: i32) -> i32 {
    let beside = select(0.0, 0.5, image.between);
    let away = f32(y) + beside;
    return min(i32(sqrt(max(image.far * image.far - away * away, 0.0)) + beside), REACH);
}

// The component of a place that applies.
fn part_of(between: bool, circle: f32) -> vec4<f32> {
    let side = select(vec2<f32>(1.0, 0.0), vec2<f32>(0.0, 1.0), circle < 0.0);
    return select(vec4<f32>(side, 0.0, 0.0), vec4<f32>(0.0, 0.0, side), between);
}

// The share of a texel that lies in an image of the aperture.
fn share_of(place: vec4<f32>, part: vec4<f32>, rim: f32) -> f32 {
    return clamp(rim - dot(place, part), 0.0, 1.0);
}

// One surface, at a lower resolution.
fn gather(p: vec2<i32>, circle: f32) -> vec4<f32> {
    let radius = max(0.5 * abs(circle), HALF_PX);
    let image = image_at(p, radius);
    let rim = rim_of(image, radius).x;
    let part = part_of(image.between, circle);
    var sum = vec4<f32>(0.0);
    var weight = 0.0;
    for (var y = -image.reach; y <= image.reach; y++) {
        let columns = columns_of(image, y);
        for (var x = -columns; x <= columns; x++) {
            let w = share_of(aperture.places[(y + REACH) * COLUMNS + x + REACH], part, rim);
            // Outside the layer there is no light.
            sum += w * textureLoad(colors, image.middle + vec2<i32>(x, y), image.level - 1);
            weight += w;
        }
    }
    return sum / weight;
}

// One surface with small circles, at the layer's resolution.
fn gather_fine(at_px: vec2<f32>, circle: f32) -> vec4<f32> {
    let radius = 0.5 * abs(circle);
    // As in `image_at`. Linear interpolation adds 1/6 px² to the variance; with four points less
    // must be subtracted.
    let added = select(1.2, 0.35, taps == 4) / 6.0;
    let r = side_of(circle) * sqrt(max(radius * radius - added / lens.variance, 0.0));
    var sum = vec4<f32>(0.0);
    for (var i = 0; i < taps / 2; i++) {
        let t = r * two_taps(i);
        sum += textureSampleLevel(color, between, (at_px - t.xy) * lens.texel, 0.0);
        sum += textureSampleLevel(color, between, (at_px - t.zw) * lens.texel, 0.0);
    }
    return sum / f32(taps);
}

// Two surfaces, one behind the other, split at the middle of the range of circles: their signed
// circles at a place, and the radii over which they are gathered.
struct Two { split: f32, front: f32, back: f32, front_px: f32, back_px: f32, hidden: bool, one_is_sharp: bool }

fn two_at(p: vec2<i32>, range: vec2<f32>) -> Two {
    let split = 0.5 * (range.x + range.y);
    let own = circles_at(p);
    let in_front = own.x < split;
    let seen_behind = !in_front && own.x <= own.y;
    let front = select(range.x, own.x, in_front);
    let back = select(range.y, own.y, seen_behind);
    let front_px = 0.5 * abs(front);
    // The hidden part of the farther one is filled from its visible surroundings, as far as the
    // nearer one's blur uncovers it.
    let smallest = smallest_radius(range.x, range.y);
    let back_px = max(0.5 * abs(back), select(0.0, front_px, in_front));
    return Two(split, front, back, front_px, back_px, in_front, smallest < TWO_HALF_PX);
}

struct Layers { front: vec4<f32>, back: vec4<f32> }

// From weighted sums and their weights. The gaps of the nearer surface are known to be empty.
// Without samples of the farther one, the nearer one is opaque.
fn layers(near: vec4<f32>, near_weight: f32, far: vec4<f32>, far_weight: f32) -> Layers {
    let front = near / max(near_weight, 1e-6);
    let back = select(front / max(front.a, 1e-6), far / max(far_weight, 1e-6), far_weight > 0.0);
    return Layers(front, back);
}

fn over(l: Layers) -> vec4<f32> {
    return l.front + (1.0 - l.front.a) * l.back;
}

// At a lower resolution, where each texel belongs to the nearer surface or to the farther one.
fn gather_two(p: vec2<i32>, around: vec2<f32>) -> Layers {
    let two = two_at(p, around);
    let front_px = max(two.front_px, TWO_HALF_PX);
    // Texels next to the nearer surface contain both: the search for the hidden surface begins
    // beyond them.
    let beyond = select(1.5, 2.0, level == 1) * texel_px();
    let back_px = max(two.back_px + select(0.0, beyond, two.hidden), TWO_HALF_PX);
    let image = image_at(p, min(max(front_px, back_px), max_radius_of_level(level)));
    let front = rim_of(image, front_px).x;
    let back = rim_of(image, back_px).x;
    let front_part = part_of(image.between, two.front);
    let back_part = part_of(image.between, two.back);
    var near = vec4<f32>(0.0);
    var near_weight = 0.0;
    var far = vec4<f32>(0.0);
    var far_weight = 0.0;
    for (var y = -image.reach; y <= image.reach; y++) {
        let columns = columns_of(image, y);
        for (var x = -columns; x <= columns; x++) {
            let q = image.middle + vec2<i32>(x, y);
            let place = aperture.places[(y + REACH) * COLUMNS + x + REACH];
            let light = textureLoad(colors, q, image.level - 1);
            let range = textureLoad(circles, q, image.level - 1);
            // A texel with both has the nearer one's light; the farther one is unknown there.
            let w = share_of(place, front_part, front);
            near += select(w, 0.0, range.x >= two.split) * light;
            near_weight += w;
            let v = share_of(place, back_part, back);
            let visible = select(0.0, v, range.x >= two.split);
            far += visible * light;
            far_weight += select(max(visible, v * (1.0 - light.a)), visible, range.y >= two.split);
        }
    }
    return layers(near, near_weight, far, far_weight);
}

// At the layer's resolution: surfaces with small circles are gathered here, the rest comes from
// lower resolutions.
fn gather_two_fine(p: vec2<i32>, at_px: vec2<f32>, around: vec2<f32>) -> Layers {
    let two = two_at(p, around);
    let front_is_fine = two.front_px < TWO_HALF_PX;
    let back_is_fine = two.back_px < TWO_HALF_PX;
    var near = vec4<f32>(0.0);
    var near_weight = 0.0;
    var far = vec4<f32>(0.0);
    var far_weight = 0.0;
    // No iterations if there is no work: software drivers execute both sides of a branch.
    let reach = i32(ceil(max(select(-1.0, two.front_px, front_is_fine), select(-1.0, two.back_px, back_is_fine))));
    let front_rim = rim_at(4.0 * two.front_px).x;
    let back_rim = rim_at(4.0 * two.back_px).x;
    let front_part = part_of(false, two.front);
    let back_part = part_of(false, two.back);
    for (var y = -reach; y <= reach; y++) {
        for (var x = -reach; x <= reach; x++) {
            let q = p + vec2<i32>(x, y);
            let place = aperture.places[(y + REACH) * COLUMNS + x + REACH];
            let is_near = circles_in_layer(q).x < two.split;
            let c = textureLoad(color, q, 0);
            let w = share_of(place, front_part, front_rim);
            near += select(0.0, w, is_near) * c;
            near_weight += w;
            let v = share_of(place, back_part, back_rim);
            far += select(v, 0.0, is_near) * c;
            far_weight += select(v, v * (1.0 - c.a), is_near);
        }
    }
    let fine = layers(near, near_weight, far, far_weight);
    let uv = at_px * lens.texel;
    // Where one of the two is sharp, only the other's level was drawn.
    let lowest = select(1.0, level_of_two(0.5 * max(abs(around.x), abs(around.y))), two.one_is_sharp);
    let front_coarse = textureSampleLevel(blurred_front, between, uv, max(level_of_two(two.front_px), lowest) - 1.0);
    let back_coarse = textureSampleLevel(blurred_back, between, uv, max(level_of_two(two.back_px), lowest) - 1.0);
    return Layers(select(front_coarse, fine.front, front_is_fine), select(back_coarse, fine.back, back_is_fine));
}

struct Blurred { @location(0) all: vec4<f32>, @location(1) front: vec4<f32>, @location(2) back: vec4<f32> }

@fragment
fn level_one_deep(in: Corner) -> Blurred {
    let p = vec2<i32>(in.at.xy);
    let one = gather(p, circle_of_one(p, in.around));
    return Blurred(one, vec4<f32>(0.0), one);
}

@fragment
fn level_two_deep(in: Corner) -> Blurred {
    let two = gather_two(vec2<i32>(in.at.xy), in.range);
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
    return textureSampleLevel(blurred, between, at_px * lens.texel, max(level_of(radius), 1.0) - 1.0);
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

// The geometry of newly covered pixels: that of the nearest surface around.
@fragment
fn passing(in: Corner) -> @location(0) vec4<u32> {
    let own = textureLoad(geometry, vec2<i32>(in.at.xy), 0);
    let around = lens.per_focus - in.range.x / lens.fx_diameter;
    return select(pack_geometry(1.0 / max(around, 1e-6), vec2<f32>(0.0)), own, unpack_geometry(own).x > 0.0);
}

struct Spot {
    @builtin(position) at: vec4<f32>,
    @location(0) @interpolate(flat) middle: vec2<f32>,
    // Apothem of its image and circle (px).
    @location(1) @interpolate(flat) size: vec2<f32>,
    // In a pixel that lies fully inside.
    @location(2) @interpolate(flat) light: vec3<f32>,
    // How the light spreads over its block, px²: variance along x, along y, covariance.
    @location(3) @interpolate(flat) spread: vec3<f32>,
}

// Sprite of a highlight: centred on the light of its block, with a rim as wide as that light.
@vertex
fn spot_corner(@builtin(vertex_index) v: u32, @builtin(instance_index) i: u32) -> Spot {
    let highlight = highlights.all[i];
    let block = vec2<i32>(highlight.place.xy);
    let first = BLOCK_PX * block;
    let range = textureLoad(circles, block, 1).xy;
    let split = select(-NOTHING, 0.5 * (range.x + range.y), highlight.light.w > 0.0);
    var sum = 0.0;
    var middle = vec2<f32>(0.0);
    var second = vec3<f32>(0.0);
    for (var k = 0; k < BLOCK_PX * BLOCK_PX; k++) {
        let step = vec2<i32>(k % BLOCK_PX, k / BLOCK_PX);
        let is_of_it = circles_in_layer(first + step).x >= split;
        let light = select(0.0, brightest(textureLoad(color, first + step, 0)), is_of_it);
        let place = vec2<f32>(step);
        sum += light;
        middle += light * place;
        second += light * vec3<f32>(place * place, place.x * place.y);
    }
    middle /= max(sum, 1e-6);
    let spread = second / max(sum, 1e-6) - vec3<f32>(middle * middle, middle.x * middle.y);
    // Averaged over all sides.
    let rim = sqrt(max(6.0 * (spread.x + spread.y), 1.0));
    let circle = highlight.place.w;
    let apothem = 0.5 * abs(circle) * aperture.shape.z;
    // A rim that spreads evenly to both sides adds to the area.
    let area = aperture.shape.w * (apothem * apothem + rim * rim / 12.0);
    let reach = (apothem + f32(BLOCK_PX)) / aperture.shape.z;
    var out: Spot;
    out.middle = vec2<f32>(first) + middle + 0.5;
    let corner = out.middle + reach * (2.0 * vec2<f32>(f32(v & 1u), f32(v >> 1u)) - 1.0);
    let device = corner / vec2<f32>(lens.size) * vec2<f32>(2.0, -2.0) + vec2<f32>(-1.0, 1.0);
    out.at = vec4<f32>(device, 0.0, 1.0);
    out.size = vec2<f32>(apothem, circle);
    out.spread = spread;
    out.light = highlight.light.rgb / area;
    return out;
}

// The outward normal of the aperture's side in the direction of a point.
fn side_towards(place: vec2<f32>) -> vec2<f32> {
    let side = aperture.shape.x;
    let angle = atan2(place.y, place.x);
    let of_side = aperture.shape.y + side * round((angle - aperture.shape.y) / max(side, 1e-6));
    let towards = select(angle, of_side, side > 0.0);
    return vec2<f32>(cos(towards), sin(towards));
}

// Small enough to occlude nothing, but large enough that the pixel does not count as the camera's.
const MIN_ALPHA: f32 = 0.0009765625;

@fragment
fn spot(in: Spot) -> @location(0) vec4<f32> {
    let circle = in.size.y;
    let place = side_of(circle) * (in.at.xy - in.middle);
    let n = side_towards(place);
    // Along the normal the light is as wide as a square of the same variance; at least a pixel.
    let across = in.spread.x * n.x * n.x + in.spread.y * n.y * n.y + 2.0 * in.spread.z * n.x * n.y;
    let share = clamp((in.size.x - dot(place, n)) / sqrt(max(12.0 * across, 1.0)) + 0.5, 0.0, 1.0);
    if share == 0.0 {
        discard;
    }
    // With two surfaces, the nearer one occludes the farther one's highlights.
    let tile = textureLoad(tiles, vec2<i32>(in.at.xy / f32(lens.side_px)), 0);
    let p = vec2<i32>(in.at.xy);
    var visible_share = 1.0;
    if tile.z == 6.0 && circle >= 0.5 * (tile.x + tile.y) {
        visible_share = 1.0 - gather_two_fine(p, in.at.xy, tile.xy).front.a;
    }
    // So does a nearer surface in focus, whichever of the two it belongs to.
    let own = circles_in_layer(p).x;
    if own < circle && !is_one_surface(own, circle) && 0.5 * abs(own) < TWO_HALF_PX {
        visible_share = min(visible_share, 1.0 - textureLoad(color, p, 0).a);
    }
    return vec4<f32>(share * visible_share * in.light, select(0.0, MIN_ALPHA, visible_share > 0.0));
}
