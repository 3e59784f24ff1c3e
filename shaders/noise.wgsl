// @import shared/noise

// The pattern at a pixel of the picture, variance 1 everywhere.
fn pattern_at(pixel: vec2<i32>) -> vec3<f32> {
    return pattern_texel(pixel - noise.origin.xy);
}
