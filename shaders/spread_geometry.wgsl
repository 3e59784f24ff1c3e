// The geometry of newly covered pixels: that of the nearest surface around, along one axis
// (src/effects/spread_geometry.rs).
// @import shared/fullscreen
// @import shared/layer

// Along columns; otherwise along rows.
override down: i32 = 0;

// In a storage buffer: software drivers compile a loop bound from a uniform into the shader.
struct SpreadGeometry { size: vec2<i32>, radius: i32 }  // of the layer; of the search, px
@group(0) @binding(0) var<storage, read> spread: SpreadGeometry;
@group(0) @binding(1) var geometry: texture_2d<u32>;

@fragment
fn main(@builtin(position) at: vec4<f32>) -> @location(0) vec4<u32> {
    let p = vec2<i32>(at.xy);
    let step = vec2<i32>(1 - down, down);
    let own = textureLoad(geometry, p, 0);
    var nearest = own;
    var nearest_m = select(1e30, 0.0, unpack_geometry(own).x > 0.0);
    for (var k = -spread.radius; k <= spread.radius; k++) {
        let q = p + k * step;
        let met = textureLoad(geometry, q, 0);
        let depth = unpack_geometry(met).x;
        if inside_layer(q, spread.size) && depth > 0.0 && depth < nearest_m {
            nearest = met;
            nearest_m = depth;
        }
    }
    return nearest;
}
