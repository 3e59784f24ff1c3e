// A Gaussian along one axis (src/effects/blur.rs), over premultiplied light and coverage.
// @import shared/fullscreen
// @import shared/half
// @import shared/layer

// Along columns; otherwise along rows.
override down: i32 = 0;

struct Blur { size: vec2<i32> }  // of the layer
@group(0) @binding(0) var<uniform> blur: Blur;
// The middle tap and those on one side of it.
@group(0) @binding(1) var<storage, read> taps: array<f32>;
@group(0) @binding(2) var layer: texture_2d<f32>;

fn light_at(p: vec2<i32>) -> vec4<f32> {
    return light_within(layer, p, blur.size);
}

@fragment
fn main(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let p = vec2<i32>(at.xy);
    let step = vec2<i32>(1 - down, down);
    var sum = taps[0] * textureLoad(layer, p, 0);
    for (var k = 1; k < i32(arrayLength(&taps)); k++) {
        sum += taps[k] * (light_at(p - k * step) + light_at(p + k * step));
    }
    return rounded_to_half(sum);
}

// Means of 2×2 pixels.
@fragment
fn halved(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let p = 2 * vec2<i32>(at.xy);
    let upper = light_at(p) + light_at(p + vec2<i32>(1, 0));
    let lower = light_at(p + vec2<i32>(0, 1)) + light_at(p + 1);
    return rounded_to_half(0.25 * (upper + lower));
}

// Linear interpolation between the centres of texels twice as wide; empty beyond them. `size` is in
// those texels.
@fragment
fn doubled(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let place = 0.5 * at.xy - 0.5;
    let corner = floor(place);
    let f = place - corner;
    let i = vec2<i32>(corner);
    let upper = mix(light_at(i), light_at(i + vec2<i32>(1, 0)), f.x);
    let lower = mix(light_at(i + vec2<i32>(0, 1)), light_at(i + 1), f.x);
    return rounded_to_half(mix(upper, lower, f.y));
}
