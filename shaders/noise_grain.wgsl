// @import shared/noise_overlay
// @import shared/noise_speed

// The pattern at a pixel of the picture, variance 1 everywhere.
fn pattern_at(pixel: vec2<i32>) -> vec3<f32> {
    // Patches larger than a pixel: the pattern is interpolated, and the variance lost by that is
    // restored: Σ wᵢ wⱼ ρᵢⱼ, which separates into the two axes.
    let x = (vec2<f32>(pixel) + 0.5) / noise.patch_px - noise.in_patch;
    let base = floor(x);
    let f = x - base;
    let i = vec2<i32>(base) - noise.origin;
    let top = mix(pattern_texel(i), pattern_texel(i + vec2<i32>(1, 0)), f.x);
    let bottom = mix(pattern_texel(i + vec2<i32>(0, 1)), pattern_texel(i + 1), f.x);
    let variance = f * f + (1.0 - f) * (1.0 - f) + 2.0 * f * (1.0 - f) * noise.neighbours;
    return mix(top, bottom, f.y) * inverseSqrt(variance.x * variance.y);
}
