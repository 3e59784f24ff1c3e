// Halation (src/effects/halation.rs): a share of the light is reflected by the film's base and
// spread around its origin.
// @import shared/fullscreen
// @import shared/half
struct Halation { share: f32 }
@group(0) @binding(0) var<uniform> halation: Halation;
@group(0) @binding(1) var layer: texture_2d<f32>;
@group(0) @binding(2) var around: texture_2d<f32>;

@fragment
fn main(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let p = vec2<i32>(at.xy);
    let own = textureLoad(layer, p, 0);
    let light = mix(own.rgb, textureLoad(around, p, 0).rgb, halation.share);
    return vec4<f32>(rounded_to_half(vec4<f32>(light, 0.0)).rgb, own.a);
}
