// Draws a part of a window: a picture, enlarged, on a plain ground; at the left of a line another one.
// @import shared/fullscreen

struct Canvas {
    // Of the pictures on the target, px.
    origin: vec2<f32>,
    extent: vec2<f32>,
    ground: vec4<f32>,
    // Target px.
    line_x: f32,
}
@group(0) @binding(0) var<uniform> canvas: Canvas;
@group(0) @binding(1) var texels: sampler;
@group(0) @binding(2) var left_of_line: texture_2d<f32>;
@group(0) @binding(3) var right_of_line: texture_2d<f32>;

@fragment
fn main(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let place = (at.xy - canvas.origin) / canvas.extent;
    let left = textureSampleLevel(left_of_line, texels, place, 0.0);
    let right = textureSampleLevel(right_of_line, texels, place, 0.0);
    let picture = select(right, left, at.x < canvas.line_x);
    let is_inside = all(place >= vec2<f32>(0.0)) && all(place < vec2<f32>(1.0));
    return select(canvas.ground, vec4<f32>(picture.rgb, 1.0), is_inside);
}
