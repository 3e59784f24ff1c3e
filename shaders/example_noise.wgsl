// Noise by example over virtual pixels: its amplitude factor alone. The noise is added to the
// planes of the coding later (src/compositor/example_noise.rs).
// @import shared/noise

// Variance of the camera's noise at a code value, squared 8-bit codes.
fn calibrated_variance(code: vec3<f32>) -> vec3<f32> {
    let s = sigma_at(code);
    return s * s;
}

// f² = Σ missing variance / Σ calibrated variance, over the channels.
fn apply_noise(p: vec2<i32>, pixel: Mixed) -> Mixed {
    let missing = missing_variance(p, pixel, vec3<f32>(1.0));
    let whole = dot(calibrated_variance(pixel.code), vec3<f32>(1.0));
    amplitude_factor = sqrt(dot(missing, vec3<f32>(1.0)) / max(whole, 1e-6));
    return Mixed(pixel.code, pixel.camera_variance + missing, pixel.virtual_share);
}
