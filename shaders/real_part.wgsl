// The real part of a photograph: light, the light behind it, and the depths of both
// (src/compositor/real.rs).
// @import shared/fullscreen
// @import shared/response
// @import shared/shadow_ratio
override curve: f32 = 0.0;
// Whether virtual objects cast shadows on it.
override shadowed: bool = false;

struct Grid {
    size: vec2<i32>,
    in_picture: vec2<i32>,   // where the part begins
    step: f32,               // pixels of the grid per pixel of the picture
    gamma: f32,              // of the camera's response
}
@group(0) @binding(0) var<uniform> grid: Grid;
@group(0) @binding(1) var codes: texture_2d<u32>;
// On the grid: light, light behind, and their depths (m, 32-bit floats in two words each).
@group(0) @binding(2) var near_light: texture_2d<f32>;
@group(0) @binding(3) var far_light: texture_2d<f32>;
@group(0) @binding(4) var depths: texture_2d<u32>;
// The fraction of the light that is removed, over the part.
@group(0) @binding(5) var shadow_mask: texture_2d<f32>;

// σ of colours (square roots of light) within one surface.
const COLOR_SIGMA: f32 = 0.05;
// Depths that differ by more than this factor belong to two surfaces.
const DEPTH_STEP: f32 = 1.04;

struct Out { @location(0) light: vec4<f32>, @location(1) behind: vec4<f32>, @location(2) depths: vec4<u32> }

fn words(z: f32) -> vec2<u32> {
    let bits = bitcast<u32>(z);
    return vec2<u32>(bits & 0xffffu, bits >> 16u);
}

@fragment
fn main(@builtin(position) at: vec4<f32>) -> Out {
    let light = decode(vec3<f32>(textureLoad(codes, vec2<i32>(at.xy), 0).rgb) / 65535.0, curve, grid.gamma);
    // The four grid pixels around it, weighted by nearness and by similarity of colour to this
    // pixel.
    let place = (vec2<f32>(grid.in_picture) + at.xy) * grid.step - 0.5;
    let corner = floor(place);
    let f = place - corner;
    var weight: array<f32, 4>;
    var inverse: array<f32, 4>;
    var nearest = 0.0;
    var farthest = 1e9;
    var behind = vec4<f32>(0.0);
    for (var i = 0; i < 4; i++) {
        let step = vec2<i32>(i & 1, i >> 1);
        let q = clamp(vec2<i32>(corner) + step, vec2<i32>(0), grid.size - 1);
        let share = mix(1.0 - f, f, vec2<f32>(step));
        // Light of logarithmic curves may be below 0.
        let near_color = sqrt(max(textureLoad(near_light, q, 0).rgb, vec3<f32>(0.0)));
        let apart = near_color - sqrt(max(light, vec3<f32>(0.0)));
        weight[i] = share.x * share.y * (1e-3 + exp(-dot(apart, apart) / (2.0 * COLOR_SIGMA * COLOR_SIGMA)));
        let texel = textureLoad(depths, q, 0);
        inverse[i] = 1.0 / max(bitcast<f32>(texel.x | (texel.y << 16u)), 1e-3);
        let there = share.x * share.y > 0.0;
        nearest = select(nearest, max(nearest, inverse[i]), there);
        farthest = select(farthest, min(farthest, inverse[i]), there);
        behind += share.x * share.y
            * vec4<f32>(textureLoad(far_light, q, 0).rgb, 1.0 / max(bitcast<f32>(texel.z | (texel.w << 16u)), 1e-3));
    }
    // The one of two surfaces with more weight; never something between.
    let middle = 0.5 * (nearest + farthest);
    let one = nearest < DEPTH_STEP * farthest;
    var near = vec2<f32>(0.0);
    var far = vec2<f32>(0.0);
    for (var i = 0; i < 4; i++) {
        let both = weight[i] * vec2<f32>(inverse[i], 1.0);
        let is_near = inverse[i] >= middle || one;
        near += select(vec2<f32>(0.0), both, is_near);
        far += select(both, vec2<f32>(0.0), is_near);
    }
    let weighted = select(far, near, near.y >= far.y);
    let depth = weighted.y / max(weighted.x, 1e-12);
    var left = light;
    if shadowed {
        left *= shadow_ratio(textureLoad(shadow_mask, vec2<i32>(at.xy), 0).rgb);
    }
    return Out(vec4<f32>(left, 1.0), vec4<f32>(behind.rgb, 1.0), vec4<u32>(words(depth), words(1.0 / behind.a)));
}
