// Draws a whole picture of code values for display.
// @import shared/fullscreen
// @import shared/srgb

// Whether the target encodes linear light itself, by the sRGB curve.
override encodes: bool = false;

struct Show { max_code: f32 }
@group(0) @binding(0) var<uniform> show: Show;
@group(0) @binding(1) var codes: texture_2d<u32>;

@fragment
fn main(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let code = vec3<f32>(textureLoad(codes, vec2<i32>(at.xy), 0).rgb) / show.max_code;
    if encodes {
        return vec4<f32>(srgb_light(code), 1.0);
    }
    return vec4<f32>(code, 1.0);
}
