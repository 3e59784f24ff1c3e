// The camera's linear light at a pixel, and the remaining fraction of its noise σ, after effects
// acted on it.
@group(0) @binding(5) var real_light: texture_2d<f32>;

fn real_at(p: vec2<i32>, recorded: vec3<f32>) -> vec4<f32> {
    let acted_on = textureLoad(real_light, p + composite.in_layer, 0);
    // Untouched pixels stay the same to the last bit.
    return select(acted_on, vec4<f32>(recorded, 1.0), acted_on.a > 0.998);
}
