// Motion blur by velocity: each pixel gathers, for each moment of the shutter, the surface that
// is there at that moment. Silhouettes dissolve because moments without a surface are empty.
// @import shared/layer
struct Blur {
    size: vec4<i32>,      // layer width, height, tile side, unused
    shutter: vec4<f32>,   // exposure time (s), shortest blur that is drawn (px)
}
@group(0) @binding(0) var<storage, read> blur: Blur;
@group(0) @binding(1) var color: texture_2d<f32>;
@group(0) @binding(2) var geometry: texture_2d<f32>;
@group(0) @binding(3) var fastest: texture_2d<f32>;
@group(0) @binding(4) var range: texture_2d<f32>;

struct Out { @location(0) color: vec4<f32>, @location(1) geometry: vec4<f32> }

fn inside(p: vec2<i32>) -> bool {
    return all(p >= vec2<i32>(0)) && all(p < blur.size.xy);
}

fn color_at(p: vec2<i32>) -> vec4<f32> {
    if !inside(p) {
        return vec4<f32>(0.0);
    }
    return textureLoad(color, p, 0);
}

fn geometry_at(p: vec2<i32>) -> vec4<f32> {
    if !inside(p) {
        return vec4<f32>(0.0);
    }
    return textureLoad(geometry, p, 0);
}

// Between the two pixels across the line's minor axis.
fn line_color(p: vec2<f32>, x_major: bool) -> vec4<f32> {
    if x_major {
        let y = floor(p.y);
        let q = vec2<i32>(i32(round(p.x)), i32(y));
        let f = p.y - y;
        if f < 0.01 { return color_at(q); }
        return mix(color_at(q), color_at(q + vec2<i32>(0, 1)), f);
    }
    let x = floor(p.x);
    let q = vec2<i32>(i32(x), i32(round(p.y)));
    let f = p.x - x;
    if f < 0.01 { return color_at(q); }
    return mix(color_at(q), color_at(q + vec2<i32>(1, 0)), f);
}

// A surface found by going back from x along a motion (px in the whole shutter) to the middle
// of the shutter; `hit` where it really comes from there.
struct Found { at: vec2<f32>, geometry: vec4<f32>, hit: bool }

fn go_back(x: vec2<f32>, motion: vec2<f32>, moment: f32) -> Found {
    let y = x - motion * moment;
    let g = geometry_at(vec2<i32>(round(y)));
    let error = (g.zw * blur.shutter.x - motion) * moment;
    return Found(y, g, g.x > 0.0 && dot(error, error) < 0.5625); // three quarters of a pixel
}

// The surface at x at one moment (-1/2..1/2 of the shutter), where motions differ: from the
// fastest motion, from x's own, and from whatever those met; the nearest that holds true.
fn surface_at(x: vec2<f32>, own: vec4<f32>, dominant: vec2<f32>, moment: f32, x_major: bool) -> vec4<f32> {
    let own_motion = own.zw * blur.shutter.x;
    var best = go_back(x, dominant, moment);
    let met = best.geometry;
    // Whether a surface is where what was met would come from by its own motion: it, or what hides it.
    var met_is_near = false;
    if own.x > 0.0 {
        let candidate = go_back(x, own_motion, moment);
        if candidate.hit && (!best.hit || depth_m(candidate.geometry) < depth_m(best.geometry)) {
            best = candidate;
        }
    }
    if met.x > 0.0 {
        let candidate = go_back(x, met.zw * blur.shutter.x, moment);
        met_is_near = candidate.geometry.x > 0.0;
        if candidate.hit && (!best.hit || depth_m(candidate.geometry) < depth_m(best.geometry)) {
            best = candidate;
        }
    }
    if best.hit {
        return line_color(best.at, x_major);
    }
    // Nothing holds true. Where the ways back meet nothing, nothing is there; where they meet
    // another surface, what was here is hidden behind it, and its neighbourhood stands for it.
    if met_is_near && (own.x == 0.0 || depth_m(met) > depth_m(own)) {
        return line_color(x - dominant * moment, x_major);
    }
    if own.x > 0.0 && geometry_at(vec2<i32>(round(x - own_motion * moment))).x > 0.0 {
        return color_at(vec2<i32>(x));
    }
    // Where the way back met something that has itself come from elsewhere, nothing is here.
    if !met_is_near {
        return vec4<f32>(0.0);
    }
    return color_at(vec2<i32>(round(x - dominant * moment)));
}

// What is to be done in a tile.
const NOTHING: u32 = 0u;
const ONE_MOTION: u32 = 1u;
const MANY_MOTIONS: u32 = 2u;

fn kind_of(tile: vec2<i32>) -> u32 {
    let near = textureLoad(fastest, tile, 0);
    if near.z == 0.0 {
        return NOTHING;
    }
    // Motions that end within a pixel of each other are one motion: at a pixel its own.
    let spread = textureLoad(range, tile, 0);
    let span = (spread.zw - spread.xy) * blur.shutter.x;
    return select(MANY_MOTIONS, ONE_MOTION, max(span.x, span.y) < 1.0);
}

// A corner of a tile's quad; all corners in one point where the tile is of another kind.
// A branch in the fragment shader would do the same, but software drivers work through both
// sides of a branch, and the one for many motions costs several times the other.
fn tile_corner(vertex: u32, instance: u32, kind: u32) -> vec4<f32> {
    let columns = u32((blur.size.x + blur.size.z - 1) / blur.size.z);
    let tile = vec2<i32>(vec2<u32>(instance % columns, instance / columns));
    if kind_of(tile) != kind {
        return vec4<f32>(0.0, 0.0, 0.0, 1.0);
    }
    // Corners 0 1 2 and 2 1 3 of a Z.
    var corners = array<u32, 6>(0u, 1u, 2u, 2u, 1u, 3u);
    let z = corners[vertex];
    let at = (tile + vec2<i32>(i32(z & 1u), i32(z >> 1u))) * blur.size.z;
    let fraction = vec2<f32>(min(at, blur.size.xy)) / vec2<f32>(blur.size.xy);
    return vec4<f32>(fraction * vec2<f32>(2.0, -2.0) + vec2<f32>(-1.0, 1.0), 0.0, 1.0);
}

@vertex
fn one_motion_tiles(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> @builtin(position) vec4<f32> {
    return tile_corner(vertex, instance, ONE_MOTION);
}

@vertex
fn many_motions_tiles(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> @builtin(position) vec4<f32> {
    return tile_corner(vertex, instance, MANY_MOTIONS);
}

// The box of the shutter along a motion: one tap for each pixel of the major axis, the two at
// the ends by the part of them that the box covers.
struct Line { step: vec2<f32>, half: f32, taps: i32, x_major: bool }

fn line_along(motion: vec2<f32>) -> Line {
    let major = max(max(abs(motion.x), abs(motion.y)), 1e-6);
    let half = 0.5 * major;
    return Line(motion / major, half, i32(ceil(half - 0.5)), abs(motion.x) >= abs(motion.y));
}

fn tap_weight(line: Line, k: i32) -> f32 {
    return clamp(line.half - abs(f32(k)) + 0.5, 0.0, 1.0);
}

fn is_still(motion: vec2<f32>, dominant: vec2<f32>) -> bool {
    return length(dominant) <= blur.shutter.y || max(abs(motion.x), abs(motion.y)) < 0.25;
}

// The geometry of a newly covered pixel: of the nearest surface that passes.
fn passing(x: vec2<f32>, line: Line) -> vec4<f32> {
    var nearest = vec4<f32>(0.0);
    for (var k = -line.taps; k <= line.taps; k++) {
        let q = x - f32(k) * line.step;
        let low = geometry_at(vec2<i32>(floor(q)));
        if low.x > 0.0 && (nearest.x == 0.0 || depth_m(low) < depth_m(nearest)) { nearest = low; }
        let high = geometry_at(vec2<i32>(ceil(q)));
        if high.x > 0.0 && (nearest.x == 0.0 || depth_m(high) < depth_m(nearest)) { nearest = high; }
    }
    return nearest;
}

fn finish(p: vec2<i32>, out: vec4<f32>, own: vec4<f32>, line: Line) -> Out {
    if out.a == 0.0 {
        return Out(vec4<f32>(0.0), vec4<f32>(0.0));
    }
    if own.x > 0.0 {
        return Out(out, own);
    }
    return Out(out, passing(vec2<f32>(p), line));
}

@fragment
fn one_motion(@builtin(position) at: vec4<f32>) -> Out {
    let p = vec2<i32>(at.xy);
    let own = textureLoad(geometry, p, 0);
    let dominant = textureLoad(fastest, p / blur.size.z, 0).xy * blur.shutter.x;
    let motion = select(dominant, own.zw * blur.shutter.x, own.x > 0.0);
    if is_still(motion, dominant) {
        return Out(textureLoad(color, p, 0), own);
    }
    let line = line_along(motion);
    var sum = vec4<f32>(0.0);
    var weight = 0.0;
    for (var k = -line.taps; k <= line.taps; k++) {
        let w = tap_weight(line, k);
        weight += w;
        sum += w * line_color(vec2<f32>(p) - f32(k) * line.step, line.x_major);
    }
    return finish(p, sum / weight, own, line);
}

@fragment
fn many_motions(@builtin(position) at: vec4<f32>) -> Out {
    let p = vec2<i32>(at.xy);
    let own = textureLoad(geometry, p, 0);
    let dominant = textureLoad(fastest, p / blur.size.z, 0).xy * blur.shutter.x;
    if is_still(dominant, dominant) {
        return Out(textureLoad(color, p, 0), own);
    }
    let line = line_along(dominant);
    var sum = vec4<f32>(0.0);
    var weight = 0.0;
    for (var k = -line.taps; k <= line.taps; k++) {
        let w = tap_weight(line, k);
        weight += w;
        sum += w * surface_at(vec2<f32>(p), own, dominant, f32(k) / (2.0 * line.half), line.x_major);
    }
    return finish(p, sum / weight, own, line);
}
