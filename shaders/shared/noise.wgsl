// Calibrated noise over virtual pixels (Fischer 2006, noise overlay): the pattern, scaled to the
// missing variance of the pixel.
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
@group(2) @binding(1) var noise_pattern: texture_2d<i32>;

fn pattern_texel(p: vec2<i32>) -> vec3<f32> {
    return vec3<f32>(textureLoad(noise_pattern, p, 0).xyz) / 4096.0;
}

// `noise.scale` applies to the virtual share only; real light keeps the camera's noise.
fn scaled(variance: vec3<f32>, virtual_share: vec3<f32>) -> vec3<f32> {
    return variance * (1.0 + (noise.scale * noise.scale - 1.0) * virtual_share);
}

fn apply_noise(p: vec2<i32>, pixel: Mixed) -> Mixed {
    let recorded = camera_factor(pixel.code);
    let present_variance = pixel.camera_variance * recorded;
    let scaled_variance = scaled(calibrated_variance(pixel.code), pixel.virtual_share);
    let opaque_target = max(scaled_variance, least_variance(p, pixel.code) * recorded);
    // A fading object ends with the camera's own noise, at any scale and film.
    let s = sigma_at(pixel.code);
    let fading_target = mix(s * s * recorded, opaque_target, composite.opacity);
    let target_variance = select(opaque_target, fading_target, composite.opacity < 1.0);
    let missing = max(target_variance - present_variance, vec3<f32>(0.0));
    let n = pattern_at(p + composite.in_picture);
    return Mixed(pixel.code + sqrt(missing) * n / 255.0, present_variance + missing, pixel.virtual_share);
}
