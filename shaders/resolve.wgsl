// Four samples to one pixel: colour averaged, geometry of the nearest sample kept.
// @import shared/fullscreen
// @import shared/layer
@group(0) @binding(0) var color: texture_multisampled_2d<f32>;
@group(0) @binding(1) var geometry: texture_multisampled_2d<u32>;

struct Out { @location(0) color: vec4<f32>, @location(1) geometry: vec4<u32> }

@fragment
fn main(@builtin(position) at: vec4<f32>) -> Out {
    let p = vec2<i32>(at.xy);
    var sum = vec4<f32>(0.0);
    var nearest = vec4<u32>(0u);
    var nearest_m = 1e30;
    for (var i = 0; i < 4; i++) {
        let c = textureLoad(color, p, i);
        sum += c;
        // Geometry is not cleared: it tells something where there is colour.
        let g = textureLoad(geometry, p, i);
        let depth = unpack_geometry(g).x;
        if c.a > 0.0 && depth < nearest_m {
            nearest = g;
            nearest_m = depth;
        }
    }
    return Out(sum * 0.25, nearest);
}
