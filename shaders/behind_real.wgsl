// Removes from a blurred layer what nearer real things hide. They are in focus: each pixel is theirs or not, apart from
// an edge one pixel wide.
// @import shared/fullscreen
// @import shared/layer
struct Real { size: vec2<i32>, tolerance_m: f32 }
@group(0) @binding(0) var<uniform> real: Real;
@group(0) @binding(1) var color: texture_2d<f32>;
@group(0) @binding(2) var geometry: texture_2d<u32>;
@group(0) @binding(3) var real_depth: texture_2d<f32>;   // m; 0: unknown

struct Out { @location(0) color: vec4<f32>, @location(1) geometry: vec4<u32> }

@fragment
fn main(@builtin(position) at: vec4<f32>) -> Out {
    let p = vec2<i32>(at.xy);
    let own = textureLoad(geometry, p, 0);
    let depth = unpack_geometry(own).x;
    var seen = 0.0;
    for (var i = 0; i < 9; i++) {
        let beside = vec2<i32>(i % 3 - 1, i / 3 - 1);
        let wall = textureLoad(real_depth, clamp(p + beside, vec2<i32>(0), real.size - 1), 0).x;
        let weight = f32((2 - abs(beside.x)) * (2 - abs(beside.y))) / 16.0;
        seen += select(weight, 0.0, wall > 0.0 && depth > wall + real.tolerance_m);
    }
    let out = seen * textureLoad(color, p, 0);
    return Out(out, select(vec4<u32>(0u), own, out.a > 0.0));
}
