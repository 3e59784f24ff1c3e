// Mixes the camera's picture and the virtual layer, then runs the enabled effects of the mixed
// stage. Where the layer is empty, the camera's codes are copied.
// @import shared/fullscreen
// @import shared/mixed
// @import shared/response
// @import shared/shadow_ratio

// The curve of the camera's response: constant for the whole run, so that other curves compile to
// nothing.
override curve: f32 = 0.0;
// Whether the whole picture is composited. If so, real pixels have the noise of the recording.
override whole: bool = false;
// Whether each channel has its own coverage.
override parted: bool = false;
// Whether there may be light without coverage.
override light_alone: bool = false;
// Whether virtual objects cast shadows on the real part.
override shadowed: bool = false;
// Whether real objects occlude the layer with a matte.
override fringed: bool = false;

// Pixel (0, 0) is the upper left of the rectangle that is composited.
struct Composite {
    in_picture: vec2<i32>,   // its origin in the picture
    in_camera: vec2<i32>,    // in the camera's texture
    in_layer: vec2<i32>,     // in the layer
    in_shadow_mask: vec2<i32>,
    camera_size: vec2<i32>,
    layer_size: vec2<i32>,
    shadow_mask_size: vec2<i32>,
    made_size: vec2<i32>,    // of the rectangle
    max_code: f32,
    gain: f32,               // on the real light
    noise_left: f32,         // share of the variance of the real pixels' noise
    gamma: f32,              // of the camera's response
    opacity: f32,           // opacity of the layer
}
@group(0) @binding(0) var camera: texture_2d<u32>;
@group(0) @binding(1) var layer: texture_2d<f32>;
@group(0) @binding(2) var<uniform> composite: Composite;
// σ of the camera's noise at 256 code values, 8-bit codes.
@group(0) @binding(3) var<uniform> sigma_table: array<vec4<f32>, 256>;
// Coverage of red, green and blue.
@group(0) @binding(4) var coverage: texture_2d<f32>;
// The fraction of the real light that is removed.
@group(0) @binding(6) var shadow_mask: texture_2d<f32>;
// α·(F − B) at the edges of real foreground objects (src/compositor/foreground_matte.rs).
@group(0) @binding(7) var fringes: texture_2d<f32>;

// The parts of the rectangle that are composited: x0, y0, x1, y1. Elsewhere the target already
// holds the camera's codes.
@group(0) @binding(8) var<storage, read> parts: array<vec4<i32>>;

@vertex
fn part(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> @builtin(position) vec4<f32> {
    return corner_of(parts[instance], vertex, vec2<f32>(composite.made_size));
}

// σ at a code value (0..1), in 8-bit codes.
fn sigma_at(code: vec3<f32>) -> vec3<f32> {
    let x = clamp(code, vec3<f32>(0.0), vec3<f32>(1.0)) * 255.0;
    let i = vec3<u32>(min(x, vec3<f32>(254.0)));
    let f = x - vec3<f32>(i);
    let low = vec3<f32>(sigma_table[i.x].x, sigma_table[i.y].y, sigma_table[i.z].z);
    let high = vec3<f32>(sigma_table[i.x + 1u].x, sigma_table[i.y + 1u].y, sigma_table[i.z + 1u].z);
    return mix(low, high, f);
}

// The layer's colour at a pixel of the rectangle; 0 outside the layer. Light whose coverage was
// rounded to 0 is dropped, unless light alone is allowed.
fn layer_at(p: vec2<i32>) -> vec4<f32> {
    let q = p + composite.in_layer;
    if any(q < vec2<i32>(0)) || any(q >= composite.layer_size) {
        return vec4<f32>(0.0);
    }
    let texel = textureLoad(layer, q, 0);
    return present(select(vec4<f32>(0.0), texel, texel.a > 0.0 || light_alone));
}

// The layer's light or coverage, times its opacity. Opaque layers stay bit-exact.
fn present(whole_layer: vec4<f32>) -> vec4<f32> {
    return select(whole_layer, composite.opacity * whole_layer, composite.opacity < 1.0);
}

// Coverage of each channel at a pixel. `mean` is the layer's alpha.
fn coverage_at(p: vec2<i32>, mean: f32) -> vec3<f32> {
    if !parted {
        return vec3<f32>(mean);
    }
    let q = p + composite.in_layer;
    // If the whole picture is composited, there are pixels outside the layer too.
    let inside = all(q >= vec2<i32>(0)) && all(q < composite.layer_size);
    return select(vec3<f32>(0.0), present(textureLoad(coverage, q, 0)).rgb, inside);
}

// Shadow ratio at a pixel of the rectangle.
fn shadow_ratio_at(p: vec2<i32>) -> vec3<f32> {
    if !shadowed {
        return vec3<f32>(1.0);
    }
    let q = p + composite.in_shadow_mask;
    let inside = all(q >= vec2<i32>(0)) && all(q < composite.shadow_mask_size);
    return select(vec3<f32>(1.0), shadow_ratio(textureLoad(shadow_mask, q, 0).rgb), inside);
}

// Fringe of real foreground objects at a pixel, exposed as the real light.
fn fringe_at(p: vec2<i32>) -> vec3<f32> {
    if !fringed {
        return vec3<f32>(0.0);
    }
    let q = p + composite.in_layer;
    let inside = all(q >= vec2<i32>(0)) && all(q < composite.layer_size);
    return select(vec3<f32>(0.0), composite.gain * textureLoad(fringes, q, 0).rgb, inside);
}

fn inside_picture(p: vec2<i32>) -> bool {
    let q = p + composite.in_camera;
    return all(q >= vec2<i32>(0)) && all(q < composite.camera_size);
}

fn camera_codes(p: vec2<i32>) -> vec4<u32> {
    return textureLoad(camera, p + composite.in_camera, 0);
}

// σ of the noise that remains on real pixels of a photograph at a linear light, in linear light: σ
// of the recorded light, scaled by the gain.
fn recorded_sigma(light: vec3<f32>) -> vec3<f32> {
    let recorded_light = light / composite.gain;
    let recorded = encode(recorded_light, curve, composite.gamma);
    let slope = slope_at(recorded, recorded_light, curve, composite.gamma) / composite.gain;
    return sigma_at(recorded) / slope * sqrt(composite.noise_left);
}

// The smallest variance of virtual pixels of a colour: that of the real pixels of the same colour
// around them, at any film speed.
fn min_variance(p: vec2<i32>, code: vec3<f32>) -> vec3<f32> {
    if !whole {
        return vec3<f32>(0.0);
    }
    let shown = clamp(code, vec3<f32>(0.0), vec3<f32>(1.0));
    let light = decode(shown, curve, composite.gamma);
    let s = slope_at(shown, light, curve, composite.gamma) * recorded_sigma(light) * real_at(p, light).a;
    return s * s;
}

// Premultiplied "over" in linear light, then encoded. Each channel has its own coverage. Values
// above the largest code clip after the noise, at the very end, as in the camera.
fn mixed_at(p: vec2<i32>, virtual_light: vec3<f32>, coverage: vec3<f32>) -> Mixed {
    let code = vec3<f32>(camera_codes(p).rgb) / composite.max_code;
    let w = 1.0 - coverage;
    let ratio = shadow_ratio_at(p);
    let recorded = decode(code, curve, composite.gamma);
    let real = real_at(p, ratio * recorded);
    let real_light = composite.gain * real.rgb;
    let light = max(virtual_light + w * real_light + coverage * ratio * fringe_at(p), vec3<f32>(min_light(curve)));
    let mixed = encode(light, curve, composite.gamma);
    let slope = slope_at(mixed, light, curve, composite.gamma);
    // Shade scales the noise with the light.
    let noise_scale = w * ratio * slope;
    var s = noise_scale * composite.gain / slope_at(code, recorded, curve, composite.gamma) * sigma_at(code);
    if whole {
        s = noise_scale * recorded_sigma(real_light / max(ratio, vec3<f32>(1e-3))) * real.a;
    }
    let variance = s * s;
    let virtual_share = max(coverage, clamp(virtual_light / max(light, vec3<f32>(1e-6)), vec3<f32>(0.0), vec3<f32>(1.0)));
    return Mixed(mixed, variance, virtual_share);
}

// A camera pixel without the layer.
fn camera_at(p: vec2<i32>) -> Mixed {
    if whole || shadowed {
        return mixed_at(p, vec3<f32>(0.0), vec3<f32>(0.0));
    }
    let code = vec3<f32>(camera_codes(p).rgb) / composite.max_code;
    let s = sigma_at(code);
    return Mixed(code, s * s, vec3<f32>(0.0));
}

// `apply_effects`, with the enabled effects of the mixed stage, is appended.

// Whether the picture keeps the camera's codes at a pixel.
fn is_unchanged(p: vec2<i32>, virtual_light: vec4<f32>) -> bool {
    return all(virtual_light == vec4<f32>(0.0)) && all(shadow_ratio_at(p) == vec3<f32>(1.0)) && !whole;
}

// Share of the coded picture at pixels that hardly change: not 0, which marks those that stay.
const SMALLEST_SHARE: f32 = 1e-4;

// Factor on the amplitude of noise by example, which apply_noise of that method sets.
var<private> amplitude_factor: f32 = 0.0;

// The picture before it is coded (src/compositor/coded.rs): R'G'B' on the scale of 8-bit codes, not
// clipped. Alpha is the share of the coded picture in the result, 0 where the camera's codes stay:
// real light has come through the coding already, so only the virtual share and the shadow need it,
// in full from a half on. Beyond the picture its rim continues, as encoders pad it.
fn uncoded_at(at: vec4<f32>) -> vec4<f32> {
    let rim = composite.camera_size - composite.in_camera - 1;
    let p = clamp(vec2<i32>(at.xy), -composite.in_camera, rim);
    let virtual_light = layer_at(p);
    if is_unchanged(p, virtual_light) {
        return vec4<f32>(vec3<f32>(camera_codes(p).rgb), 0.0);
    }
    let pixel = apply_effects(p, mixed_at(p, virtual_light.rgb, coverage_at(p, virtual_light.a)));
    let changed = max(pixel.virtual_share, 1.0 - shadow_ratio_at(p));
    let share = max(changed.x, max(changed.y, changed.z));
    return vec4<f32>(255.0 * pixel.code, clamp(2.0 * share, SMALLEST_SHARE, 1.0));
}

@fragment
fn uncoded(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    return uncoded_at(at);
}

struct UncodedWithFactor {
    @location(0) picture: vec4<f32>,
    @location(1) amplitude_factor: f32,
}

@fragment
fn uncoded_with_factor(@builtin(position) at: vec4<f32>) -> UncodedWithFactor {
    let picture = uncoded_at(at);
    return UncodedWithFactor(picture, amplitude_factor);
}

@fragment
fn main(@builtin(position) at: vec4<f32>) -> @location(0) vec4<u32> {
    let p = vec2<i32>(at.xy);
    let virtual_light = layer_at(p);
    if is_unchanged(p, virtual_light) {
        return camera_codes(p);
    }
    let pixel = apply_effects(p, mixed_at(p, virtual_light.rgb, coverage_at(p, virtual_light.a)));
    let codes = clamp(floor(pixel.code * composite.max_code + 0.5), vec3<f32>(0.0), vec3<f32>(composite.max_code));
    return vec4<u32>(vec3<u32>(codes), u32(composite.max_code));
}
