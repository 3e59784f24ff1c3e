// Exposure change by stops: vSLRcam (11) and its correction.
// @import shared/fullscreen
// @import shared/response

// The camera's response curve, for equation (11).
override curve: f32 = 0.0;

struct Exposure {
    gain: f32,     // on light
    step: f32,     // added to display values
    picture: f32,  // exposure factor of the whole picture
    gamma: f32,    // of the camera's response
    factors: vec4<f32>,  // estimated gain of the frame, on light
    share: vec2<f32>,       // of the recorded picture's width and height, per pixel
    share_at_0: vec2<f32>,  // where the layer begins
    across: array<vec4<f32>, 5>,  // stops at the nodes from corner to corner of the recorded picture, row by row
}
@group(0) @binding(0) var<uniform> exposure: Exposure;
@group(0) @binding(1) var layer: texture_2d<f32>;

// The largest light kept in 16-bit floats, so that it stays finite.
const MAX_LIGHT: f32 = 60000.0;
const NODES_ACROSS: u32 = 5u;
const NODES_DOWN: u32 = 4u;

fn node(x: u32, y: u32) -> f32 {
    let i = y * NODES_ACROSS + x;
    return exposure.across[i / 4u][i % 4u];
}

// Estimated gain of the frame at a pixel, on light.
fn frame_gain(at: vec2<f32>) -> vec3<f32> {
    let cells = vec2<f32>(f32(NODES_ACROSS - 1u), f32(NODES_DOWN - 1u));
    let place = clamp(exposure.share_at_0 + at * exposure.share, vec2<f32>(0.0), vec2<f32>(1.0)) * cells;
    let cell = min(floor(place), cells - 1.0);
    let f = place - cell;
    let i = vec2<u32>(cell);
    let upper = mix(node(i.x, i.y), node(i.x + 1u, i.y), f.x);
    let lower = mix(node(i.x, i.y + 1u), node(i.x + 1u, i.y + 1u), f.x);
    return exposure.factors.rgb * exp2(mix(upper, lower, f.y));
}

@fragment
fn photographic(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let light = textureLoad(layer, vec2<i32>(at.xy), 0);
    return vec4<f32>(min(light.rgb * frame_gain(at.xy) * (exposure.gain * exposure.picture), vec3<f32>(MAX_LIGHT)), light.a);
}

// Works on display values, which have no coverage: on the surface's unpremultiplied colour.
@fragment
fn additive(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let light = textureLoad(layer, vec2<i32>(at.xy), 0);
    let lit = light.rgb * frame_gain(at.xy) / max(light.a, 1e-6);
    let shown = encode(min(lit, vec3<f32>(max_light(curve))), curve, exposure.gamma);
    let moved = clamp(shown + exposure.step, vec3<f32>(0.0), vec3<f32>(1.0));
    let exposed = decode(moved, curve, exposure.gamma) * light.a * exposure.picture;
    return vec4<f32>(min(exposed, vec3<f32>(MAX_LIGHT)), light.a);
}
