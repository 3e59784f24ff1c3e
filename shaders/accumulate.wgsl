// Adds one sample of a plan to the running sum in 32-bit floats; it starts from zeros.
// @import shared/layer
struct Step { size: vec2<u32>, stride: u32, unused: u32, weight: vec4<f32> }
@group(0) @binding(0) var<uniform> sample_step: Step;
@group(0) @binding(1) var color: texture_2d<f32>;
@group(0) @binding(2) var geometry: texture_2d<u32>;
@group(0) @binding(3) var<storage, read_write> sum: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> nearest: array<vec4<f32>>;

@compute @workgroup_size(8, 8)
fn add(@builtin(global_invocation_id) id: vec3<u32>) {
    if any(id.xy >= sample_step.size) {
        return;
    }
    let i = id.y * sample_step.stride + id.x;
    sum[i] += textureLoad(color, id.xy, 0) * sample_step.weight.x;
    let g = unpack_geometry(textureLoad(geometry, id.xy, 0));
    let before = nearest[i];
    if g.x > 0.0 && (before.x == 0.0 || depth_m(g) < depth_m(before)) {
        nearest[i] = g;
    }
}
