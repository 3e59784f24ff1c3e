// The camera's linear light at a pixel, and the remaining fraction of its noise σ, as recorded.
fn real_at(p: vec2<i32>, recorded: vec3<f32>) -> vec4<f32> {
    return vec4<f32>(recorded, 1.0);
}
