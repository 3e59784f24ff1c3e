// Draws a part of a window: a picture, enlarged, or the plain ground around it.
// @import shared/fullscreen

struct Canvas {
    // Of the picture on the target, px.
    origin: vec2<f32>,
    extent: vec2<f32>,
    ground: vec4<f32>,
}
@group(0) @binding(0) var<uniform> canvas: Canvas;
@group(0) @binding(1) var texels: sampler;
@group(0) @binding(2) var picture: texture_2d<f32>;

@fragment
fn main(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let place = (at.xy - canvas.origin) / canvas.extent;
    return vec4<f32>(textureSampleLevel(picture, texels, place, 0.0).rgb, 1.0);
}

@fragment
fn ground(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    return canvas.ground;
}
