// Camera and virtual layer to one picture, then the enabled effects of the mixed stage.
// Where the layer's alpha is 0 the camera's integers are copied.
// @import shared/fullscreen
// @import shared/mixed
// @import shared/response

// The camera's response: of the whole run, so that the shader holds nothing else.
override curve: f32 = 0.0;
override gamma: f32 = 1.0;
// Whether the whole picture is one photograph: then real pixels have their noise as it was before they were exposed.
override photograph: f32 = 0.0;

struct Composite {
    origin: vec4<i32>,  // of the rectangle in the picture: x, y; of the rectangle in the camera texture: z, w
    size: vec4<i32>,    // of the rectangle: x, y; of the camera texture: z, w
    layer: vec4<i32>,   // of the rectangle in the layer: x, y; the layer's size: z, w
    scale: vec4<f32>,   // largest code value; factor on the real light; of a photograph: share of its noise's variance left
}
@group(0) @binding(0) var camera: texture_2d<u32>;
@group(0) @binding(1) var layer: texture_2d<f32>;
@group(0) @binding(2) var<uniform> composite: Composite;
// σ of the camera's noise at 256 code values, 8-bit codes.
@group(0) @binding(3) var<uniform> sigma_table: array<vec4<f32>, 256>;

// σ at a code value (0..1), in 8-bit codes.
fn sigma_at(code: vec3<f32>) -> vec3<f32> {
    let x = clamp(code, vec3<f32>(0.0), vec3<f32>(1.0)) * 255.0;
    let i = vec3<u32>(min(x, vec3<f32>(254.0)));
    let f = x - vec3<f32>(i);
    let low = vec3<f32>(sigma_table[i.x].x, sigma_table[i.y].y, sigma_table[i.z].z);
    let high = vec3<f32>(sigma_table[i.x + 1u].x, sigma_table[i.y + 1u].y, sigma_table[i.z + 1u].z);
    return mix(low, high, f);
}

// The layer's colour at a pixel of the rectangle; nothing where there is no layer, and where nothing is covered.
fn layer_at(p: vec2<i32>) -> vec4<f32> {
    let q = p + composite.layer.xy;
    if any(q < vec2<i32>(0)) || any(q >= composite.layer.zw) {
        return vec4<f32>(0.0);
    }
    let texel = textureLoad(layer, q, 0);
    return select(vec4<f32>(0.0), texel, texel.a > 0.0);
}

fn inside_picture(p: vec2<i32>) -> bool {
    let q = p + composite.origin.zw;
    return all(q >= vec2<i32>(0)) && all(q < composite.size.zw);
}

fn camera_codes(p: vec2<i32>) -> vec4<u32> {
    return textureLoad(camera, p + composite.origin.zw, 0);
}

// @real
// The camera's light at a pixel, and the share of its noise's σ that is left: as it was recorded.
fn real_at(p: vec2<i32>, recorded: vec3<f32>) -> vec4<f32> {
    return vec4<f32>(recorded, 1.0);
}
// @real

// What a photograph leaves of σ of real pixels of some light, as light: that of the light as it was recorded, brightened.
fn recorded_sigma(light: vec3<f32>) -> vec3<f32> {
    let recorded_light = light / composite.scale.y;
    let recorded = encode(recorded_light, curve, gamma);
    let slope = slope_at(recorded, recorded_light, curve, gamma) / composite.scale.y;
    return sigma_at(recorded) / slope * sqrt(composite.scale.z);
}

// The least variance of virtual pixels of a colour: what the real ones of it around them keep, however slow the film.
fn least_variance(p: vec2<i32>, code: vec3<f32>) -> vec3<f32> {
    if photograph == 0.0 {
        return vec3<f32>(0.0);
    }
    let shown = clamp(code, vec3<f32>(0.0), vec3<f32>(1.0));
    let light = decode(shown, curve, gamma);
    let s = slope_at(shown, light, curve, gamma) * recorded_sigma(light) * real_at(p, light).a;
    return s * s;
}

// Premultiplied over in linear light, encoded again. Each colour has its own coverage. What is brighter than the codes go
// clips after its noise, at the very end: the camera's does.
fn mixed_at(p: vec2<i32>, virtual_light: vec3<f32>, coverage: vec3<f32>) -> Mixed {
    let code = vec3<f32>(camera_codes(p).rgb) / composite.scale.x;
    let w = 1.0 - coverage;
    let real = real_at(p, decode(code, curve, gamma));
    let real_light = composite.scale.y * real.rgb;
    let light = max(virtual_light + w * real_light, vec3<f32>(0.0));
    let mixed = encode(light, curve, gamma);
    let after = slope_at(mixed, light, curve, gamma);
    var s = w * after / slope_at(code, real_light, curve, gamma) * sigma_at(code);
    if photograph > 0.0 {
        s = w * after * recorded_sigma(real_light) * real.a;
    }
    let variance = s * s;
    return Mixed(mixed, variance);
}

// A pixel of the camera's with nothing before it.
fn camera_at(p: vec2<i32>) -> Mixed {
    if photograph > 0.0 {
        return mixed_at(p, vec3<f32>(0.0), vec3<f32>(0.0));
    }
    let code = vec3<f32>(camera_codes(p).rgb) / composite.scale.x;
    let s = sigma_at(code);
    return Mixed(code, s * s);
}

// @effects

@fragment
fn main(@builtin(position) at: vec4<f32>) -> @location(0) vec4<u32> {
    let p = vec2<i32>(at.xy);
    let virtual_light = layer_at(p);
    if virtual_light.a == 0.0 && photograph == 0.0 {
        return camera_codes(p);
    }
    var pixel = mixed_at(p, virtual_light.rgb, vec3<f32>(virtual_light.a));
    // @calls
    let codes = clamp(floor(pixel.code * composite.scale.x + 0.5), vec3<f32>(0.0), vec3<f32>(composite.scale.x));
    return vec4<u32>(vec3<u32>(codes), u32(composite.scale.x));
}
