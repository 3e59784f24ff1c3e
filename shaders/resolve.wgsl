// Four samples to one pixel: colour averaged, geometry of the nearest sample kept.
// @import shared/fullscreen
// @import shared/layer
@group(0) @binding(0) var color: texture_multisampled_2d<f32>;
@group(0) @binding(1) var geometry: texture_multisampled_2d<f32>;

struct Out { @location(0) color: vec4<f32>, @location(1) geometry: vec4<f32> }

@fragment
fn main(@builtin(position) at: vec4<f32>) -> Out {
    let p = vec2<i32>(at.xy);
    var sum = vec4<f32>(0.0);
    var nearest = vec4<f32>(0.0);
    for (var i = 0; i < 4; i++) {
        let c = textureLoad(color, p, i);
        if c.a > 0.0 {
            sum += c;
            let g = textureLoad(geometry, p, i);
            if nearest.x == 0.0 || depth_m(g) < depth_m(nearest) {
                nearest = g;
            }
        }
    }
    return Out(sum * 0.25, nearest);
}
