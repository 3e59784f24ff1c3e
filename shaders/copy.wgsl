// A full-screen copy: the yardstick of every benchmark.
// @import shared/fullscreen
@group(0) @binding(0) var source: texture_2d<f32>;

@fragment
fn main(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    return textureLoad(source, vec2<i32>(at.xy), 0);
}
