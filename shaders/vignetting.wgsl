// Multiplies the layer's light by a gain at the corners of a grid over the picture; coverage stays.
// Outside the image circle, whose edge is one pixel wide, the layer is empty.
// @import shared/fullscreen
struct Vignetting {
    cell_share: vec2<f32>,   // per pixel
    cells: vec2<f32>,        // across and down
    in_picture: vec2<i32>,   // where the layer begins
    circle_at: vec2<f32>,    // the image circle's middle in the picture
    circle_radius: f32,
}
@group(0) @binding(0) var<uniform> vignetting: Vignetting;
@group(0) @binding(1) var layer: texture_2d<f32>;
@group(0) @binding(2) var gains: texture_2d<f32>;

fn gain_at(corner: vec2<i32>) -> f32 {
    return textureLoad(gains, corner, 0).x;
}

@fragment
fn main(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let p = vec2<i32>(at.xy);
    let place = (vec2<f32>(p + vignetting.in_picture) + 0.5) * vignetting.cell_share;
    let inside = clamp(place, vec2<f32>(0.0), vignetting.cells);
    let corner = min(floor(inside), vignetting.cells - 1.0);
    let f = inside - corner;
    let i = vec2<i32>(corner);
    let upper = mix(gain_at(i), gain_at(i + vec2<i32>(1, 0)), f.x);
    let lower = mix(gain_at(i + vec2<i32>(0, 1)), gain_at(i + 1), f.x);
    let from_middle = vec2<f32>(p + vignetting.in_picture) + 0.5 - vignetting.circle_at;
    let exposed = clamp(vignetting.circle_radius - length(from_middle) + 0.5, 0.0, 1.0);
    return exposed * textureLoad(layer, p, 0) * vec4<f32>(vec3<f32>(mix(upper, lower, f.y)), 1.0);
}
