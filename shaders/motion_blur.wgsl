// Motion blur by velocity: each pixel gathers, for each moment of the shutter, the surface that
// is there at that moment. Silhouettes dissolve because moments without a surface are empty.
// @import shared/fullscreen
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
    if own.x > 0.0 {
        let candidate = go_back(x, own_motion, moment);
        if candidate.hit && (!best.hit || depth_m(candidate.geometry) < depth_m(best.geometry)) {
            best = candidate;
        }
    }
    if met.x > 0.0 {
        let candidate = go_back(x, met.zw * blur.shutter.x, moment);
        if candidate.hit && (!best.hit || depth_m(candidate.geometry) < depth_m(best.geometry)) {
            best = candidate;
        }
    }
    if best.hit {
        return line_color(best.at, x_major);
    }
    // Nothing holds true. Where the ways back meet nothing, nothing is there; where they meet
    // another surface, what was here is hidden behind it, and its neighbourhood stands for it.
    if met.x > 0.0 && (own.x == 0.0 || depth_m(met) > depth_m(own)) {
        return line_color(x - dominant * moment, x_major);
    }
    if own.x > 0.0 && geometry_at(vec2<i32>(round(x - own_motion * moment))).x > 0.0 {
        return color_at(vec2<i32>(x));
    }
    // An edge pixel whose surface has left: only its share of coverage is known.
    return color_at(vec2<i32>(round(x - dominant * moment)));
}

@fragment
fn main(@builtin(position) at: vec4<f32>) -> Out {
    let p = vec2<i32>(at.xy);
    let tile = p / blur.size.z;
    let near = textureLoad(fastest, tile, 0);
    if near.z == 0.0 {
        return Out(vec4<f32>(0.0), vec4<f32>(0.0));
    }
    let spread = textureLoad(range, tile, 0);
    let own = textureLoad(geometry, p, 0);
    let dominant = near.xy * blur.shutter.x;
    // Motions that end within a pixel of each other are one motion: at a pixel its own.
    let span = (spread.zw - spread.xy) * blur.shutter.x;
    let uniform_motion = max(span.x, span.y) < 1.0;
    var motion = dominant;
    if uniform_motion && own.x > 0.0 {
        motion = own.zw * blur.shutter.x;
    }
    let major = max(abs(motion.x), abs(motion.y));
    if length(dominant) <= blur.shutter.y || major < 0.25 {
        return Out(textureLoad(color, p, 0), own);
    }
    // The box of the shutter along the motion, one tap for each pixel of the major axis, the
    // two at the ends by the part of them that the box covers.
    let x_major = abs(motion.x) >= abs(motion.y);
    let step = motion / major;
    let half = 0.5 * major;
    let taps = i32(ceil(half - 0.5));
    let x = vec2<f32>(p);
    var sum = vec4<f32>(0.0);
    var weight = 0.0;
    for (var k = -taps; k <= taps; k++) {
        let w = clamp(half - abs(f32(k)) + 0.5, 0.0, 1.0);
        weight += w;
        if uniform_motion {
            sum += w * line_color(x - f32(k) * step, x_major);
        } else {
            sum += w * surface_at(x, own, motion, f32(k) / major, x_major);
        }
    }
    let out = sum / weight;
    if out.a == 0.0 {
        return Out(vec4<f32>(0.0), vec4<f32>(0.0));
    }
    if own.x > 0.0 {
        return Out(out, own);
    }
    // Newly covered: the geometry of the nearest surface that passes.
    var nearest = vec4<f32>(0.0);
    for (var k = -taps; k <= taps; k++) {
        let q = x - f32(k) * step;
        let low = geometry_at(vec2<i32>(floor(q)));
        if low.x > 0.0 && (nearest.x == 0.0 || depth_m(low) < depth_m(nearest)) { nearest = low; }
        let high = geometry_at(vec2<i32>(ceil(q)));
        if high.x > 0.0 && (nearest.x == 0.0 || depth_m(high) < depth_m(nearest)) { nearest = high; }
    }
    return Out(out, nearest);
}
