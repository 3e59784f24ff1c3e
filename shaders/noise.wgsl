// Calibrated noise over virtual pixels (Fischer 2006, noise overlay): the pattern, scaled to
// the variance that the pixel lacks.
struct Noise {
    shape: vec4<f32>,   // magnification (px), scale, correlation of lattice neighbours right and below
    origin: vec4<i32>,  // xy: the lattice point of the pattern's first texel
}
@group(0) @binding(4) var<uniform> noise: Noise;
@group(0) @binding(5) var noise_pattern: texture_2d<i32>;

fn pattern_texel(p: vec2<i32>) -> vec3<f32> {
    return vec3<f32>(textureLoad(noise_pattern, p, 0).xyz) / 4096.0;
}

// The pattern at a pixel of the picture, variance 1 everywhere.
fn pattern_at(pixel: vec2<i32>) -> vec3<f32> {
    if noise.shape.x <= 1.0 {
        return pattern_texel(pixel - noise.origin.xy);
    }
    // Patches larger than a pixel: interpolated, and the variance that interpolation takes
    // away given back: Σ wᵢ wⱼ ρᵢⱼ, which separates into the two axes.
    let x = (vec2<f32>(pixel) + 0.5) / noise.shape.x;
    let base = floor(x);
    let f = x - base;
    let i = vec2<i32>(base) - noise.origin.xy;
    let top = mix(pattern_texel(i), pattern_texel(i + vec2<i32>(1, 0)), f.x);
    let bottom = mix(pattern_texel(i + vec2<i32>(0, 1)), pattern_texel(i + 1), f.x);
    let variance = f * f + (1.0 - f) * (1.0 - f) + 2.0 * f * (1.0 - f) * noise.shape.zw;
    return mix(top, bottom, f.y) * inverseSqrt(variance.x * variance.y);
}

fn apply_noise(p: vec2<i32>, pixel: Mixed) -> Mixed {
    let wanted = sigma_at(pixel.code) * noise.shape.y;
    let missing = max(wanted * wanted - pixel.camera_variance, vec3<f32>(0.0));
    let n = pattern_at(p + composite.origin.xy);
    return Mixed(pixel.code + sqrt(missing) * n / 255.0, pixel.camera_variance + missing);
}
