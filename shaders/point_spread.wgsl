// A Gaussian along one axis (src/effects/point_spread.rs), over premultiplied light and coverage.
// @import shared/fullscreen
// @import shared/half
// @import shared/layer

// Taps on each side, and the axis: of the whole run.
override radius: i32 = 1;
override down: i32 = 0;

struct PointSpread {
    size: vec4<i32>,                // of the layer: x, y
    weights: array<vec4<f32>, 40>,  // x: of the taps so far away
}
@group(0) @binding(0) var<uniform> spread: PointSpread;
@group(0) @binding(1) var layer: texture_2d<f32>;

fn light_at(p: vec2<i32>) -> vec4<f32> {
    return light_within(layer, p, spread.size.xy);
}

@fragment
fn main(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let p = vec2<i32>(at.xy);
    let step = vec2<i32>(1 - down, down);
    var sum = spread.weights[0].x * textureLoad(layer, p, 0);
    for (var k = 1; k <= radius; k++) {
        sum += spread.weights[k].x * (light_at(p - k * step) + light_at(p + k * step));
    }
    return rounded_to_half(sum);
}

@group(0) @binding(1) var geometry: texture_2d<u32>;

// The geometry of what is newly covered: of the nearest surface that spreads there.
@fragment
fn passing(@builtin(position) at: vec4<f32>) -> @location(0) vec4<u32> {
    let p = vec2<i32>(at.xy);
    let step = vec2<i32>(1 - down, down);
    let own = textureLoad(geometry, p, 0);
    var nearest = own;
    var nearest_m = select(1e30, 0.0, unpack_geometry(own).x > 0.0);
    for (var k = -radius; k <= radius; k++) {
        let q = p + k * step;
        let met = textureLoad(geometry, q, 0);
        let depth = unpack_geometry(met).x;
        if inside_layer(q, spread.size.xy) && depth > 0.0 && depth < nearest_m {
            nearest = met;
            nearest_m = depth;
        }
    }
    return nearest;
}
