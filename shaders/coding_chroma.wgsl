// Cb and Cr at the resolution of the coding's chroma: weighted means over the pixels of a sample.
// @import shared/fullscreen
// @import shared/coding
@group(0) @binding(0) var<uniform> coding: Coding;
// R'G'B' on the scale of 8-bit codes, not clipped.
@group(0) @binding(1) var uncoded: texture_2d<f32>;

// Noise of Cb and Cr.
@group(0) @binding(3) var chroma_noise: texture_2d<f32>;

// Whether noise is added.
override noisy: bool = false;

// Rectangles of the target: x0, y0, x1, y1.
@group(0) @binding(2) var<storage, read> parts: array<vec4<i32>>;

@vertex
fn part(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> @builtin(position) vec4<f32> {
    return corner_of(parts[instance], vertex, vec2<f32>(coding.region / coding.factor));
}

fn row(first: vec2<i32>) -> vec3<f32> {
    var sum = vec3<f32>(0.0);
    for (var i = 0; i < 3; i++) {
        let x = clamp(first.x + i, 0, coding.region.x - 1);
        sum += coding.taps_across[i] * textureLoad(uncoded, vec2<i32>(x, first.y), 0).rgb;
    }
    return sum;
}

@fragment
fn main(@builtin(position) at: vec4<f32>) -> @location(0) vec2<f32> {
    let first = vec2<i32>(at.xy) * coding.factor - 1;
    var sum = vec3<f32>(0.0);
    for (var i = 0; i < 3; i++) {
        let y = clamp(first.y + i, 0, coding.region.y - 1);
        sum += coding.taps_down[i] * row(vec2<i32>(first.x, y));
    }
    var value = vec2<f32>(dot(coding.blue.rgb, sum), dot(coding.red.rgb, sum)) + vec2<f32>(coding.blue.w, coding.red.w);
    if noisy {
        value += textureLoad(chroma_noise, vec2<i32>(at.xy), 0).xy;
    }
    return value;
}
