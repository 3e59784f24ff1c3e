// Adds one sample of a plan to the running sum in 32-bit floats, which starts at zero.
// @import shared/layer
struct Step { size: vec2<u32>, stride: u32, first: u32, weight: f32 }
@group(0) @binding(0) var<uniform> sample_step: Step;
@group(0) @binding(1) var color: texture_2d<f32>;
@group(0) @binding(2) var geometry: texture_2d<u32>;
// Eight bytes per pixel in each: adapters limit the size of a buffer binding.
@group(0) @binding(3) var<storage, read_write> red_green: array<vec2<f32>>;
@group(0) @binding(4) var<storage, read_write> blue_alpha: array<vec2<f32>>;
// Geometry of the nearest surface, in words.
@group(0) @binding(5) var<storage, read_write> nearest: array<vec2<u32>>;

@compute @workgroup_size(8, 8)
fn add(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= sample_step.size) {
        return;
    }
    let i = sample_step.first + id.y * sample_step.stride + id.x;
    let light = textureLoad(color, id.xy, 0) * sample_step.weight;
    red_green[i] += light.xy;
    blue_alpha[i] += light.zw;
    let g = words_of(textureLoad(geometry, id.xy, 0));
    let depth = bitcast<f32>(g.x);
    let before = bitcast<f32>(nearest[i].x);
    if depth > 0.0 && (before == 0.0 || depth < before) {
        nearest[i] = g;
    }
}
