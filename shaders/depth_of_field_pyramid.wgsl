// The layer at a half, a quarter and so on: averaged colour, and the range of circles of confusion.
// Where a texel contains two surfaces, its colour is the nearer one's alone, with the coverage that
// one has there.
// @import shared/fullscreen
// @import shared/layer
// @import shared/lens
@group(0) @binding(0) var<uniform> lens: Lens;
@group(0) @binding(1) var color: texture_2d<f32>;
// From the layer, then from the previous level: nearest and farthest circle.
@group(0) @binding(2) var geometry: texture_2d<u32>;
@group(0) @binding(2) var circles: texture_2d<f32>;

struct Out { @location(0) color: vec4<f32>, @location(1) circles: vec4<f32> }

// One texel from four: their nearest and farthest circles, and colours.
fn merged(near: vec4<f32>, far: vec4<f32>, colors: mat4x4<f32>) -> Out {
    let nearest = min(min(near.x, near.y), min(near.z, near.w));
    let farthest = max(max(far.x, far.y), max(far.z, far.w));
    let taken_to = select(0.5 * (nearest + farthest), NOTHING, is_one_surface(nearest, farthest));
    let share = select(vec4<f32>(0.0), vec4<f32>(0.25), near < vec4<f32>(taken_to));
    return Out(colors * share, vec4<f32>(nearest, farthest, 0.0, 0.0));
}

fn circle_in_layer(p: vec2<i32>) -> f32 {
    let depth = unpack_geometry(textureLoad(geometry, p, 0)).x;
    return select(NOTHING, circle_of(depth), depth > 0.0 && all(p < lens.size));
}

@fragment
fn first(@builtin(position) at: vec4<f32>) -> Out {
    let p = 2 * vec2<i32>(at.xy);
    let x = vec2<i32>(1, 0);
    let y = vec2<i32>(0, 1);
    let near = vec4<f32>(circle_in_layer(p), circle_in_layer(p + x), circle_in_layer(p + y), circle_in_layer(p + 1));
    let far = select(near, vec4<f32>(-NOTHING), near == vec4<f32>(NOTHING));
    let colors = mat4x4<f32>(
        textureLoad(color, p, 0), textureLoad(color, p + x, 0), textureLoad(color, p + y, 0), textureLoad(color, p + 1, 0),
    );
    return merged(near, far, colors);
}

@fragment
fn next(@builtin(position) at: vec4<f32>) -> Out {
    let last = vec2<i32>(textureDimensions(color)) - 1;
    let p = 2 * vec2<i32>(at.xy);
    let a = min(p, last);
    let b = min(p + vec2<i32>(1, 0), last);
    let c = min(p + vec2<i32>(0, 1), last);
    let d = min(p + 1, last);
    let ranges = mat4x2<f32>(
        textureLoad(circles, a, 0).xy, textureLoad(circles, b, 0).xy,
        textureLoad(circles, c, 0).xy, textureLoad(circles, d, 0).xy,
    );
    let colors =
        mat4x4<f32>(textureLoad(color, a, 0), textureLoad(color, b, 0), textureLoad(color, c, 0), textureLoad(color, d, 0));
    let by_range = transpose(ranges);
    // Outside the layer there is no light and no circle.
    let there = transpose(colors)[3] > vec4<f32>(0.0);
    let near = select(vec4<f32>(NOTHING), by_range[0], there);
    return merged(near, select(vec4<f32>(-NOTHING), by_range[1], there), colors);
}
