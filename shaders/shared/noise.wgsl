// Variance of the noise over virtual pixels. The importing file has `calibrated_variance` at a code
// value.
struct Noise {
    neighbours: vec2<f32>,   // correlation of neighbouring lattice points, right and below
    origin: vec2<i32>,       // the lattice point of the pattern's first texel
    read: vec4<f32>,         // σ of the read noise, in linear light where 255 is full scale
    patch_px: f32,           // size of a patch
    in_patch: f32,           // position of the lattice point in a patch
    scale: f32,
    speed: f32,              // film speed relative to the profile's
    recorded: f32,           // 1 if the camera's pixels have another speed than the profile's
    recorded_speed: f32,     // that speed relative to the profile's
}
@group(2) @binding(0) var<uniform> noise: Noise;

// `noise.scale` applies to the virtual share only; real light keeps the camera's noise.
fn scaled(variance: vec3<f32>, virtual_share: vec3<f32>) -> vec3<f32> {
    return variance * (1.0 + (noise.scale * noise.scale - 1.0) * virtual_share);
}

// Variance to add so that a pixel reaches the noise of its code value, squared 8-bit codes.
fn missing_variance(p: vec2<i32>, pixel: Mixed, recorded: vec3<f32>) -> vec3<f32> {
    let present_variance = pixel.camera_variance * recorded;
    let scaled_variance = scaled(calibrated_variance(pixel.code), pixel.virtual_share);
    let opaque_target = max(scaled_variance, min_variance(p, pixel.code) * recorded);
    // A fading object ends with the camera's own noise, at any scale and film.
    let s = sigma_at(pixel.code);
    let fading_target = mix(s * s * recorded, opaque_target, composite.opacity);
    let target_variance = select(opaque_target, fading_target, composite.opacity < 1.0);
    return max(target_variance - present_variance, vec3<f32>(0.0));
}
