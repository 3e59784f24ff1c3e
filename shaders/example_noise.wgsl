// Noise by example over virtual pixels: its amplitude factor alone. The noise is added to the
// planes of the coding later (src/compositor/example_noise.rs).
// @import shared/noise_speed

// f² = Σ missing variance / Σ variance of the model, over the channels. The model is that of the
// calibrated speed.
fn apply_noise(p: vec2<i32>, pixel: Mixed) -> Mixed {
    let recorded = camera_factor(pixel.code);
    let missing = missing_variance(p, pixel, recorded);
    let s = sigma_at(pixel.code);
    amplitude_factor = sqrt(dot(missing, vec3<f32>(1.0)) / max(dot(s, s), 1e-6));
    return Mixed(pixel.code, pixel.camera_variance * recorded + missing, pixel.virtual_share);
}
