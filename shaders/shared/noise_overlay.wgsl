// Calibrated noise over virtual pixels (Fischer 2006, noise overlay): the pattern, scaled to the
// missing variance of the pixel. The importing file has `camera_factor` and `pattern_at`.
// @import shared/noise

@group(2) @binding(1) var noise_pattern: texture_2d<i32>;

fn pattern_texel(p: vec2<i32>) -> vec3<f32> {
    return vec3<f32>(textureLoad(noise_pattern, p, 0).xyz) / 4096.0;
}

fn apply_noise(p: vec2<i32>, pixel: Mixed) -> Mixed {
    let recorded = camera_factor(pixel.code);
    let missing = missing_variance(p, pixel, recorded);
    let n = pattern_at(p + composite.in_picture);
    let variance = pixel.camera_variance * recorded + missing;
    return Mixed(pixel.code + sqrt(missing) * n / 255.0, variance, pixel.virtual_share);
}
