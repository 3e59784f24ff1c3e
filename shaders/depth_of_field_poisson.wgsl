// vSLRcam's depth of field (src/effects/depth_of_field/poisson.rs): the mean over a Poisson disc as
// wide as the pixel's own circle, then the mean of the result over a smaller disc.
// @import shared/fullscreen
// @import shared/half
// @import shared/layer
// @import shared/lens

const SECOND_POINTS: u32 = 16u;

struct Discs {
    radii: vec2<f32>,                // of both discs, relative to the circle's
    second: array<vec2<f32>, SECOND_POINTS>,    // in radii
    first: array<vec2<f32>>,
}
@group(0) @binding(0) var<uniform> lens: Lens;
@group(0) @binding(1) var<storage, read> discs: Discs;
@group(0) @binding(2) var color: texture_2d<f32>;
@group(0) @binding(3) var between: sampler;
@group(0) @binding(4) var geometry: texture_2d<u32>;
@group(0) @binding(5) var around_tiles: texture_2d<f32>;
@group(0) @binding(4) var radii: texture_2d<f32>;

struct Filtered { @location(0) color: vec4<f32>, @location(1) radius: vec4<f32> }

@fragment
fn first(@builtin(position) at: vec4<f32>) -> Filtered {
    let p = vec2<i32>(at.xy);
    let depth = unpack_geometry(textureLoad(geometry, p, 0)).x;
    // Where nothing was drawn, the widest circle around may reach this pixel.
    let around = textureLoad(around_tiles, p / lens.side_px, 0).y;
    let wide = select(around, 0.5 * abs(circle_of(depth)), depth > 0.0);
    let radius = select(wide, 0.0, 2.0 * wide < SHARP_PX);
    var sum = vec4<f32>(0.0);
    let points = i32(arrayLength(&discs.first));
    for (var i = 0; i < points; i++) {
        let from_px = at.xy + radius * discs.radii.x * discs.first[i];
        sum += textureSampleLevel(color, between, from_px * lens.texel, 0.0);
    }
    return Filtered(rounded_to_half(sum / f32(points)), vec4<f32>(radius, 0.0, 0.0, 0.0));
}

@fragment
fn second(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let radius = discs.radii.y * textureLoad(radii, vec2<i32>(at.xy), 0).x;
    var sum = vec4<f32>(0.0);
    for (var i = 0u; i < SECOND_POINTS; i++) {
        sum += textureSampleLevel(color, between, (at.xy + radius * discs.second[i]) * lens.texel, 0.0);
    }
    return rounded_to_half(sum / f32(SECOND_POINTS));
}
