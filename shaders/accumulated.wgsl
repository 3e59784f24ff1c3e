// The finished sum of a plan, as a layer.
// @import shared/fullscreen
// @import shared/layer
struct Sum { stride: u32 }
@group(0) @binding(0) var<uniform> sum: Sum;
@group(0) @binding(1) var<storage, read> red_green: array<vec2<f32>>;
@group(0) @binding(2) var<storage, read> blue_alpha: array<vec2<f32>>;
@group(0) @binding(3) var<storage, read> nearest: array<vec2<u32>>;

struct Out { @location(0) color: vec4<f32>, @location(1) geometry: vec4<u32> }

@fragment
fn main(@builtin(position) at: vec4<f32>) -> Out {
    let i = u32(at.y) * sum.stride + u32(at.x);
    return Out(vec4<f32>(red_green[i], blue_alpha[i]), texel_of(nearest[i]));
}
