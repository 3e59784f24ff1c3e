// @import shared/noise_overlay

// Variance of the camera's noise at a code value, squared 8-bit codes.
fn calibrated_variance(code: vec3<f32>) -> vec3<f32> {
    let s = sigma_at(code);
    return s * s;
}

fn camera_factor(code: vec3<f32>) -> vec3<f32> {
    return vec3<f32>(1.0);
}

// The pattern at a pixel of the picture, variance 1 everywhere.
fn pattern_at(pixel: vec2<i32>) -> vec3<f32> {
    return pattern_texel(pixel - noise.origin);
}
