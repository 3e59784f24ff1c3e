// Brighter or darker by stops: vSLRcam (11) and its correction.
// @import shared/fullscreen
// @import shared/response

// The camera's response curve, for equation (11).
override curve: f32 = 0.0;

struct Exposure {
    gain: f32,     // on light
    step: f32,     // added to display values
    picture: f32,  // exposure factor of the whole picture
    gamma: f32,    // of the camera's response
    factors: vec4<f32>,  // on light, as the footage changes
}
@group(0) @binding(0) var<uniform> exposure: Exposure;
@group(0) @binding(1) var layer: texture_2d<f32>;

// The largest light kept in 16-bit floats, so that it stays finite.
const BRIGHTEST: f32 = 60000.0;

@fragment
fn photographic(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let light = textureLoad(layer, vec2<i32>(at.xy), 0);
    return vec4<f32>(min(light.rgb * exposure.factors.rgb * (exposure.gain * exposure.picture), vec3<f32>(BRIGHTEST)), light.a);
}

// Works on display values, which carry no coverage, so on the surface's own colour.
@fragment
fn additive(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let light = textureLoad(layer, vec2<i32>(at.xy), 0);
    let shown = encode(min(light.rgb * exposure.factors.rgb / max(light.a, 1e-6), vec3<f32>(1.0)), curve, exposure.gamma);
    let moved = clamp(shown + exposure.step, vec3<f32>(0.0), vec3<f32>(1.0));
    let exposed = decode(moved, curve, exposure.gamma) * light.a * exposure.picture;
    return vec4<f32>(min(exposed, vec3<f32>(BRIGHTEST)), light.a);
}
