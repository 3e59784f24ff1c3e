// Red and blue enlarged against green around the principal point (src/effects/chromatic_aberration.rs).
// @import shared/fullscreen
// @import shared/half
// @import shared/layer
struct Chromatic {
    middle: vec4<f32>,  // principal point in the layer (px): x, y; 1 / half diagonal of the picture (1/px)
    parts: vec4<f32>,   // a and b of red: x, y; of blue: z, w
    size: vec4<i32>,    // of the layer: x, y
}
@group(0) @binding(0) var<uniform> chromatic: Chromatic;
@group(0) @binding(1) var layer: texture_2d<f32>;

// Of grey light (Rec. 709).
const LUMINANCE: vec3<f32> = vec3<f32>(0.2126, 0.7152, 0.0722);

// What a colour of these parts has brought to a place, px: r' = r (1 + a + b r²) solved for r.
fn source(at: vec2<f32>, parts: vec2<f32>) -> vec2<f32> {
    let d = at - chromatic.middle.xy;
    let r = dot(d, d) * chromatic.middle.z * chromatic.middle.z;
    var scale = 1.0 + parts.x + parts.y * r;
    for (var i = 0; i < 3; i++) {
        scale = 1.0 + parts.x + parts.y * r / (scale * scale);
    }
    return chromatic.middle.xy + d / scale;
}

fn light_at(p: vec2<i32>) -> vec4<f32> {
    return light_within(layer, p, chromatic.size.xy);
}

fn light_between(at: vec2<f32>) -> vec4<f32> {
    let corner = floor(at - 0.5);
    let f = at - 0.5 - corner;
    let p = vec2<i32>(corner);
    let upper = mix(light_at(p), light_at(p + vec2<i32>(1, 0)), f.x);
    let lower = mix(light_at(p + vec2<i32>(0, 1)), light_at(p + 1), f.x);
    return rounded_to_half(mix(upper, lower, f.y));
}

struct Out {
    @location(0) color: vec4<f32>,
    // How much of red, green and blue is covered.
    @location(1) coverage: vec4<f32>,
}

@fragment
fn main(@builtin(position) at: vec4<f32>) -> Out {
    let red = light_between(source(at.xy, chromatic.parts.xy));
    let green = textureLoad(layer, vec2<i32>(at.xy), 0);
    let blue = light_between(source(at.xy, chromatic.parts.zw));
    let coverage = vec3<f32>(red.a, green.a, blue.a);
    return Out(vec4<f32>(red.r, green.g, blue.b, dot(coverage, LUMINANCE)), vec4<f32>(coverage, 0.0));
}

@group(0) @binding(1) var geometry: texture_2d<u32>;

fn nearer(nearest: vec4<u32>, at: vec2<f32>) -> vec4<u32> {
    var found = nearest;
    let corner = vec2<i32>(floor(at - 0.5));
    for (var i = 0; i < 4; i++) {
        let p = corner + vec2<i32>(i & 1, i >> 1u);
        let met = textureLoad(geometry, p, 0);
        let depth = unpack_geometry(met).x;
        let best = unpack_geometry(found).x;
        if inside_layer(p, chromatic.size.xy) && depth > 0.0 && (best == 0.0 || depth < best) {
            found = met;
        }
    }
    return found;
}

// The geometry of what red or blue newly covers.
@fragment
fn passing(@builtin(position) at: vec4<f32>) -> @location(0) vec4<u32> {
    let own = textureLoad(geometry, vec2<i32>(at.xy), 0);
    let red = nearer(vec4<u32>(0u), source(at.xy, chromatic.parts.xy));
    let both = nearer(red, source(at.xy, chromatic.parts.zw));
    return select(both, own, unpack_geometry(own).x > 0.0);
}
