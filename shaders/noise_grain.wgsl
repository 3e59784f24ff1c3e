// @import shared/noise_overlay

// At another film speed (src/camera/grain.rs): shot noise grows with the speed's ratio k, read
// noise with k². At k = 1 it is the calibrated variance, bit for bit.
fn calibrated_variance(code: vec3<f32>) -> vec3<f32> {
    return variance_at(code, noise.speed);
}

fn variance_at(code: vec3<f32>, k: f32) -> vec3<f32> {
    let s = sigma_at(code);
    let shown = clamp(code, vec3<f32>(0.0), vec3<f32>(1.0));
    let read = noise.read.rgb * slope_at(shown, decode(shown, curve, composite.gamma), curve, composite.gamma);
    return k * s * s + (k * k - k) * min(read * read, s * s);
}

// Variance of the camera's pixels relative to the calibrated one, if they were taken at another
// speed.
fn camera_factor(code: vec3<f32>) -> vec3<f32> {
    let s = max(sigma_at(code), vec3<f32>(1e-6));
    return mix(vec3<f32>(1.0), variance_at(code, noise.recorded_speed) / (s * s), noise.recorded);
}

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
