// Variance of noise at another film speed than the calibrated one (src/camera/grain.rs).
// @import shared/noise

// Shot noise grows with the speed's ratio k, read noise with k². At k = 1 it is the calibrated
// variance, bit for bit.
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
