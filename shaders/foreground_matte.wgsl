// Occludes the layer by nearer real surfaces, with their alpha matte
// (src/compositor/foreground_matte.rs).
// @import shared/fullscreen
// @import shared/layer
struct Real { size: vec2<i32>, tolerance_m: f32 }
@group(0) @binding(0) var<uniform> real: Real;
@group(0) @binding(1) var color: texture_2d<f32>;
@group(0) @binding(2) var geometry: texture_2d<u32>;
// Depth of the nearer and of the farther surface, m (0: unknown), and the nearer one's alpha.
@group(0) @binding(3) var surfaces: texture_2d<f32>;
@group(0) @binding(4) var fringes: texture_2d<f32>;

struct Out { @location(0) color: vec4<f32>, @location(1) geometry: vec4<u32>, @location(2) fringe: vec4<f32> }

// The share of a pixel in which a surface at this depth is hidden.
fn hidden(there: vec4<f32>, depth: f32) -> f32 {
    let is_behind = vec2<bool>(depth > there.x + real.tolerance_m, depth > there.y + real.tolerance_m);
    return select(0.0, select(there.z, 1.0, is_behind.y), there.x > 0.0 && is_behind.x);
}

@fragment
fn main(@builtin(position) at: vec4<f32>) -> Out {
    let p = vec2<i32>(at.xy);
    let whole = textureLoad(color, p, 0);
    if all(whole == vec4<f32>(0.0)) {
        return Out(vec4<f32>(0.0), vec4<u32>(0u), vec4<f32>(0.0));
    }
    let own = textureLoad(geometry, p, 0);
    let depth = unpack_geometry(own).x;
    let here = textureLoad(surfaces, p, 0);
    var behind = hidden(here, depth);
    var fringe = vec4<f32>(0.0);
    if here.x < here.y {
        // Between the two surfaces.
        if depth <= here.y + real.tolerance_m {
            fringe = select(vec4<f32>(0.0), textureLoad(fringes, p, 0), behind > 0.0);
        }
    } else {
        // Intersecting surfaces, or surfaces without a matte: a soft edge one pixel wide.
        behind = 0.0;
        for (var i = 0; i < 9; i++) {
            let beside = vec2<i32>(i % 3 - 1, i / 3 - 1);
            let weight = f32((2 - abs(beside.x)) * (2 - abs(beside.y))) / 16.0;
            behind += weight * hidden(textureLoad(surfaces, clamp(p + beside, vec2<i32>(0), real.size - 1), 0), depth);
        }
    }
    let out = (1.0 - behind) * whole;
    return Out(out, select(vec4<u32>(0u), own, out.a > 0.0), fringe);
}
