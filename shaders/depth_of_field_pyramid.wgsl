// The layer at a half, a quarter and so on: colour averaged, and the range of its circles of confusion.
// @import shared/fullscreen
// @import shared/layer
// @import shared/lens
@group(0) @binding(0) var<uniform> lens: Lens;
@group(0) @binding(1) var color: texture_2d<f32>;
// Of the layer, then of the level before: nearest and farthest circle.
@group(0) @binding(2) var geometry: texture_2d<u32>;
@group(0) @binding(2) var circles: texture_2d<f32>;

struct Out { @location(0) color: vec4<f32>, @location(1) circles: vec4<f32> }

@fragment
fn first(@builtin(position) at: vec4<f32>) -> Out {
    let low = 2 * vec2<i32>(at.xy);
    var out = Out(vec4<f32>(0.0), vec4<f32>(NOTHING, -NOTHING, 0.0, 0.0));
    for (var i = 0; i < 4; i++) {
        let p = low + vec2<i32>(i & 1, i >> 1);
        let depth = unpack_geometry(textureLoad(geometry, p, 0)).x;
        let circle = circle_of(depth);
        let there = depth > 0.0 && all(p < lens.size.xy);
        out.color += select(vec4<f32>(0.0), 0.25 * textureLoad(color, p, 0), there);
        out.circles.x = min(out.circles.x, select(NOTHING, circle, there));
        out.circles.y = max(out.circles.y, select(-NOTHING, circle, there));
    }
    return out;
}

@fragment
fn next(@builtin(position) at: vec4<f32>) -> Out {
    let low = 2 * vec2<i32>(at.xy);
    var out = Out(vec4<f32>(0.0), vec4<f32>(NOTHING, -NOTHING, 0.0, 0.0));
    let last = vec2<i32>(textureDimensions(color)) - 1;
    for (var i = 0; i < 4; i++) {
        let p = min(low + vec2<i32>(i & 1, i >> 1), last);
        let range = textureLoad(circles, p, 0);
        out.color += 0.25 * textureLoad(color, p, 0);
        out.circles.x = min(out.circles.x, range.x);
        out.circles.y = max(out.circles.y, range.y);
    }
    return out;
}
