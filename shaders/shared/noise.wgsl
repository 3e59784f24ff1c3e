// Calibrated noise over virtual pixels (Fischer 2006, noise overlay): the pattern, scaled to
// the variance that the pixel lacks.
struct Noise {
    shape: vec4<f32>,   // magnification (px), scale, correlation of lattice neighbours right and below
    origin: vec4<i32>,  // xy: the lattice point of the pattern's first texel
    grain: vec4<f32>,   // film speed over the profile's; where in a patch its lattice point lies; 1: the camera's pixels have another speed than the profile's; that speed over the profile's
    read: vec4<f32>,    // σ of reading out, in linear light where 255 is full scale
}
@group(0) @binding(4) var<uniform> noise: Noise;
@group(0) @binding(5) var noise_pattern: texture_2d<i32>;

fn pattern_texel(p: vec2<i32>) -> vec3<f32> {
    return vec3<f32>(textureLoad(noise_pattern, p, 0).xyz) / 4096.0;
}

fn apply_noise(p: vec2<i32>, pixel: Mixed) -> Mixed {
    let recorded = camera_factor(pixel.code);
    let brought = pixel.camera_variance * recorded;
    let wanted = max(wanted_variance(pixel.code), least_variance(p, pixel.code) * recorded);
    let missing = max(wanted - brought, vec3<f32>(0.0));
    let n = pattern_at(p + composite.origin.xy);
    return Mixed(pixel.code + sqrt(missing) * n / 255.0, brought + missing);
}
