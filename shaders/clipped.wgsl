// The fraction of light that shadows remove from pixels at the camera's white
// (src/compositor/clipped.rs).
// @import shared/fullscreen
// @import shared/half

struct Clipped {
    part_px: vec2<f32>,      // size of the part that is shadowed
    in_light: vec2<i32>,     // where the part begins in the clipped light
    light_size: vec2<i32>,   // of the clipped light; its texture may be larger
}
@group(0) @binding(0) var<uniform> clipped: Clipped;
// The fraction of light that shadows remove, over the part.
@group(0) @binding(1) var shadow_mask: texture_2d<f32>;
// Ratio of the true radiance to the recorded light, 0 for channels that do not clip; and the degree
// to which all channels clip, 0 to 1.
@group(0) @binding(2) var excess: texture_2d<f32>;
// Rectangles of the part that contain shadows: x0, y0, x1, y1.
@group(0) @binding(3) var<storage, read> parts: array<vec4<i32>>;

@vertex
fn part(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> @builtin(position) vec4<f32> {
    return corner_of(parts[instance], vertex, clipped.part_px);
}

@fragment
fn main(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let p = vec2<i32>(at.xy);
    let removed = textureLoad(shadow_mask, p, 0);
    let q = p + clipped.in_light;
    if any(q < vec2<i32>(0)) || any(q >= clipped.light_size) {
        return removed;
    }
    let there = textureLoad(excess, q, 0);
    if all(there == vec4<f32>(0.0)) {
        return removed;
    }
    let ratio = 1.0 - removed.rgb;
    // Added light is not limited here; the composite clips it.
    let shown = select(min(there.rgb * ratio, vec3<f32>(1.0)), ratio, there.rgb == vec3<f32>(0.0) | (ratio >= vec3<f32>(1.0)));
    let level = min(max(shown.r, max(shown.g, shown.b)), 1.0);
    let neutral = mix(shown, vec3<f32>(level), there.a);
    return rounded_to_half(vec4<f32>(1.0 - neutral, removed.a));
}
