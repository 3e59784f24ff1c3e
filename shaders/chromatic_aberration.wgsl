// Red and blue enlarged relative to green around the principal point
// (src/effects/chromatic_aberration.rs).
// @import shared/fullscreen
// @import shared/half
// @import shared/layer
struct Chromatic {
    middle: vec2<f32>,      // principal point in the layer, px
    red: vec2<f32>,         // a and b
    blue: vec2<f32>,
    size: vec2<i32>,        // of the layer
    per_diagonal: f32,      // 1 / half diagonal of the picture, 1/px
}
@group(0) @binding(0) var<uniform> chromatic: Chromatic;
@group(0) @binding(1) var layer: texture_2d<f32>;

// Luminance weights (Rec. 709).
const LUMINANCE: vec3<f32> = vec3<f32>(0.2126, 0.7152, 0.0722);

// Where the light at a place comes from, px, for a colour with these a and b: r' = r (1 + a + b r²)
// solved for r.
fn source(at: vec2<f32>, parts: vec2<f32>) -> vec2<f32> {
    let d = at - chromatic.middle;
    let r = dot(d, d) * chromatic.per_diagonal * chromatic.per_diagonal;
    var scale = 1.0 + parts.x + parts.y * r;
    for (var i = 0; i < 3; i++) {
        scale = 1.0 + parts.x + parts.y * r / (scale * scale);
    }
    return chromatic.middle + d / scale;
}

fn light_at(p: vec2<i32>) -> vec4<f32> {
    return light_within(layer, p, chromatic.size);
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
    let red = light_between(source(at.xy, chromatic.red));
    let green = textureLoad(layer, vec2<i32>(at.xy), 0);
    let blue = light_between(source(at.xy, chromatic.blue));
    let coverage = vec3<f32>(red.a, green.a, blue.a);
    return Out(vec4<f32>(red.r, green.g, blue.b, dot(coverage, LUMINANCE)), vec4<f32>(coverage, 0.0));
}
