// Motion blur by velocity: for each time of the shutter, each pixel gathers the surface that is
// there at that time. Silhouettes dissolve because times without a surface are empty.
// @import shared/fullscreen
// @import shared/layer
struct Blur {
    size: vec2<i32>,      // of the layer
    texel: vec2<f32>,     // 1 / size of the colour texture, 1/px
    side_px: i32,         // of a tile
    exposure_s: f32,
    threshold_px: f32,    // shortest blur
    longest_px: f32,      // the layer's margin is half of this
}
@group(0) @binding(0) var<uniform> blur: Blur;
@group(0) @binding(1) var fastest: texture_2d<f32>;
@group(0) @binding(2) var geometry: texture_2d<u32>;
@group(0) @binding(3) var color: texture_2d<f32>;
@group(0) @binding(4) var between: sampler;

// Beyond the layer's border its edge texels repeat: they are empty, or too far from the picture to
// be seen.
fn geometry_at(p: vec2<i32>) -> vec4<f32> {
    return unpack_geometry(textureLoad(geometry, clamp(p, vec2<i32>(0), blur.size - 1), 0));
}

// Interpolated between the four pixels around a point; whole numbers are pixels.
fn color_between(p: vec2<f32>) -> vec4<f32> {
    return textureSampleLevel(color, between, (p + 0.5) * blur.texel, 0.0);
}

// The fastest motion in the pixel's tile and its neighbours (px over the whole shutter), and the
// tile's kind: 0 no motion, 1 one motion, 2 many (shaders/motion_blur_tiles.wgsl).
struct Tile { motion: vec2<f32>, kind: f32 }

fn tile_at(p: vec2<i32>) -> Tile {
    // In floats: software drivers divide integers one by one.
    let tile = textureLoad(fastest, vec2<i32>((vec2<f32>(p) + 0.5) / f32(blur.side_px)), 0);
    return Tile(tile.xy * blur.exposure_s, tile.w);
}

// A motion too short to be drawn counts as none.
fn drawn_motion(motion: vec2<f32>, dominant: vec2<f32>) -> vec2<f32> {
    let still = length(dominant) <= blur.threshold_px || max(abs(motion.x), abs(motion.y)) < 0.25;
    return select(motion, vec2<f32>(0.0), still);
}

// The share of a motion that lies within the layer's margin. Beyond it nothing is drawn, so that a
// surface larger than the margin becomes translucent.
fn share_within(motion: vec2<f32>) -> f32 {
    return min(1.0, blur.longest_px / max(length(motion), 1e-6));
}

// Largest number of taps. Motions of more pixels occur where the camera passes close to a surface.
// They are sampled every few pixels: a step of at most 1/128 of the light's range. Small bright
// objects become dots.
const MAX_TAPS: f32 = 256.0;

// The shutter's box along a motion: a tap for each pixel of the major axis, at most MAX_TAPS, the
// end taps weighted by how much of them the box covers. `half` is half the number of taps.
struct Line { step: vec2<f32>, half: f32, taps: i32 }

fn line_along(motion: vec2<f32>) -> Line {
    let major = max(max(abs(motion.x), abs(motion.y)), 1e-6);
    let length = min(major, MAX_TAPS);
    let half = 0.5 * length;
    return Line(motion / length, half, i32(ceil(half - 0.5)));
}

fn tap_weight(line: Line, k: f32) -> f32 {
    return clamp(line.half - k + 0.5, 0.0, 1.0);
}

struct Sum { color: vec4<f32>, weight: f32 }

// Less than a 16-bit float's step at 1 comes from a neighbour, by the sampler's rounding.
fn mean_of(sum: vec4<f32>, weight: f32) -> vec4<f32> {
    return select(sum / weight, vec4<f32>(0.0), sum.a < weight / 2048.0);
}

// The sum over the shutter, and its weight, where everything that passes has one motion: the
// pixel's own.
fn one_motion(p: vec2<i32>, own: vec4<f32>, dominant: vec2<f32>, wanted: bool) -> Sum {
    let x = vec2<f32>(p);
    let motion = drawn_motion(select(dominant, own.zw * blur.exposure_s, own.x > 0.0), dominant);
    let within = share_within(motion);
    let line = line_along(within * motion);
    let center = tap_weight(line, 0.0);
    var sum = center * color_between(x);
    var weight = center;
    // Two neighbouring taps are one sample between them, nearer to the heavier one.
    let taps = select(0, line.taps, wanted);
    for (var k = 1; k <= taps; k += 2) {
        let near = tap_weight(line, f32(k));
        let far = tap_weight(line, f32(k + 1));
        let both = near + far;
        let away = (f32(k) + far / both) * line.step;
        sum += both * (color_between(x + away) + color_between(x - away));
        weight += 2.0 * both;
    }
    return Sum(sum, weight / within);
}

// Whether a surface that was found by backtracking along `motion` (px over the whole shutter) has
// that motion: within three quarters of a pixel.
fn is_consistent(surface: vec4<f32>, motion: vec2<f32>, time: f32) -> bool {
    let error = (surface.zw * blur.exposure_s - motion) * time;
    return surface.x > 0.0 && dot(error, error) < 0.5625;
}

// The surface at x at one time (-1/2..1/2 of the shutter), in tiles with different motions. There
// are three candidates: backtracked by the fastest motion, by x's own, and by that of the first
// candidate. The nearest consistent one is used.
fn surface_at(x: vec2<f32>, own: vec4<f32>, dominant: vec2<f32>, time: f32, x_major: bool) -> vec4<f32> {
    let by_dominant = x - dominant * time;
    let met = geometry_at(vec2<i32>(round(by_dominant)));
    let by_own = x - own.zw * blur.exposure_s * time;
    let own_met = geometry_at(vec2<i32>(round(by_own)));
    let met_motion = met.zw * blur.exposure_s;
    let by_met = x - met_motion * time;
    let met_met = geometry_at(vec2<i32>(round(by_met)));

    // If none is consistent: without a surface at the backtracked positions, x is empty. With
    // another surface there, the surface at x is hidden behind it and its neighbourhood is used
    // instead, unless that other surface itself has come from elsewhere.
    let met_is_near = met.x > 0.0 && met_met.x > 0.0;
    let uncovers = met_is_near && (own.x == 0.0 || depth_m(met) > depth_m(own));
    let stays = own.x > 0.0 && own_met.x > 0.0;
    var source = select(select(round(by_dominant), x, stays), by_dominant, uncovers);
    var there = met_is_near || stays;

    var nearest = 1e30;
    if is_consistent(met, dominant, time) {
        source = by_dominant;
        nearest = depth_m(met);
        there = true;
    }
    if own.x > 0.0 && is_consistent(own_met, own.zw * blur.exposure_s, time) && depth_m(own_met) < nearest {
        source = by_own;
        nearest = depth_m(own_met);
        there = true;
    }
    if met.x > 0.0 && is_consistent(met_met, met_motion, time) && depth_m(met_met) < nearest {
        source = by_met;
        there = true;
    }
    // Whole pixels of the major axis: positions between them belong to another tap.
    let color = color_between(select(vec2<f32>(source.x, round(source.y)), vec2<f32>(round(source.x), source.y), x_major));
    let is_drawn = all(source > vec2<f32>(-1.0)) && all(source < vec2<f32>(blur.size));
    return select(vec4<f32>(0.0), color, there && is_drawn);
}

fn many_motions(p: vec2<i32>, own: vec4<f32>, dominant: vec2<f32>, enabled: bool) -> Sum {
    let motion = drawn_motion(dominant, dominant);
    let line = line_along(motion);
    let x_major = abs(motion.x) >= abs(motion.y);
    var sum = vec4<f32>(0.0);
    var weight = 0.0;
    let taps = select(-1, line.taps, enabled);
    for (var k = -taps; k <= taps; k++) {
        let time = f32(k) / (2.0 * line.half);
        let w = tap_weight(line, abs(f32(k)));
        weight += w;
        sum += w * surface_at(vec2<f32>(p), own, motion, time, x_major);
    }
    return Sum(sum, weight);
}

// Software drivers execute both sides of a branch, and many motions cost several times as much as
// one. A loop that no pixel of a group enters costs nothing.
@fragment
fn blurred(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let p = vec2<i32>(at.xy);
    let own = unpack_geometry(textureLoad(geometry, p, 0));
    let tile = tile_at(p);
    let is_many = tile.kind > 1.5;
    let one = one_motion(p, own, tile.motion, !is_many);
    let many = many_motions(p, own, tile.motion, is_many);
    return mean_of(select(one.color, many.color, is_many), select(one.weight, many.weight, is_many));
}

// The geometry of newly covered pixels: that of the nearest surface on their path.
@fragment
fn passing(@builtin(position) at: vec4<f32>) -> @location(0) vec4<u32> {
    let p = vec2<i32>(at.xy);
    let own = textureLoad(geometry, p, 0);
    if unpack_geometry(own).x > 0.0 {
        return own;
    }
    var nearest = vec4<f32>(0.0);
    let tile = tile_at(p);
    let motion = drawn_motion(tile.motion, tile.motion);
    let line = line_along(share_within(motion) * motion);
    let taps = select(-1, line.taps, tile.kind > 0.5);
    // Everything that a sample between pixels can touch: four pixels across for each column (row)
    // of the major axis.
    let across = select(vec2<i32>(1, 0), vec2<i32>(0, 1), abs(tile.motion.x) >= abs(tile.motion.y));
    for (var k = -taps; k <= taps; k++) {
        let q = vec2<i32>(floor(vec2<f32>(p) - f32(k) * line.step));
        for (var m = -1; m <= 2; m++) {
            let g = geometry_at(q + m * across);
            if g.x > 0.0 && (nearest.x == 0.0 || depth_m(g) < depth_m(nearest)) { nearest = g; }
        }
    }
    return pack_geometry(nearest.x, nearest.zw);
}
