// The pattern at lattice points: white noise filtered to the camera's neighbour correlation by taps
// (a, 1, a) in both directions, and mixed to its channel correlation. Variance 1, in units of
// σ/4096.
// @import shared/fullscreen
struct Pattern {
    side: vec2<f32>,    // weight of the three-tap filters across and down
    norm: f32,          // factor to variance 1
    // Lower triangle of the channels' Cholesky factor.
    l21: f32,
    l22: f32,
    l31: f32,
    l32: f32,
    l33: f32,
}
@group(0) @binding(0) var<uniform> pattern: Pattern;
// One texel larger than the pattern on each side.
@group(0) @binding(1) var white: texture_2d<i32>;

fn white_at(p: vec2<i32>) -> vec3<f32> {
    return vec3<f32>(textureLoad(white, p, 0).xyz);
}

fn row(p: vec2<i32>) -> vec3<f32> {
    return white_at(p + vec2<i32>(1, 0)) + pattern.side.x * (white_at(p) + white_at(p + vec2<i32>(2, 0)));
}

fn finish(white: vec3<f32>) -> vec4<i32> {
    let n = white * pattern.norm;
    let mixed = vec3<f32>(
        n.x,
        pattern.l21 * n.x + pattern.l22 * n.y,
        pattern.l31 * n.x + pattern.l32 * n.y + pattern.l33 * n.z,
    );
    return vec4<i32>(vec3<i32>(clamp(round(mixed), vec3<f32>(-32767.0), vec3<f32>(32767.0))), 0);
}

@fragment
fn unfiltered(@builtin(position) at: vec4<f32>) -> @location(0) vec4<i32> {
    return finish(white_at(vec2<i32>(at.xy) + 1));
}

@fragment
fn filtered(@builtin(position) at: vec4<f32>) -> @location(0) vec4<i32> {
    let p = vec2<i32>(at.xy);
    return finish(row(p + vec2<i32>(0, 1)) + pattern.side.y * (row(p) + row(p + vec2<i32>(0, 2))));
}
