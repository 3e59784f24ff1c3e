// The fastest motion and the range of motions in each tile, then the same over 3×3 tiles.
// @import shared/fullscreen
// @import shared/layer
struct Tiles {
    size: vec2<i32>,      // of the layer
    side_px: i32,         // of a tile
    exposure_s: f32,
}
@group(0) @binding(0) var<uniform> tiles: Tiles;
// Over tiles: the ranges of the tiles. Over pixels: the layer's geometry.
@group(0) @binding(1) var second: texture_2d<f32>;
@group(0) @binding(1) var geometry: texture_2d<u32>;
// Over tiles: the fastest motion of each tile.
@group(0) @binding(2) var first: texture_2d<f32>;

struct Out { @location(0) fastest: vec4<f32>, @location(1) range: vec4<f32> }

fn merge(sum: Out, velocity: vec4<f32>, range: vec4<f32>) -> Out {
    if sum.fastest.z == 0.0 {
        return Out(vec4<f32>(velocity.xy, 1.0, 0.0), range);
    }
    var out = sum;
    if dot(velocity.xy, velocity.xy) > dot(sum.fastest.xy, sum.fastest.xy) {
        out.fastest = vec4<f32>(velocity.xy, 1.0, 0.0);
    }
    out.range = vec4<f32>(min(sum.range.xy, range.xy), max(sum.range.zw, range.zw));
    return out;
}

@fragment
fn over_pixels(@builtin(position) at: vec4<f32>) -> Out {
    var sum = Out(vec4<f32>(0.0), vec4<f32>(0.0));
    let low = vec2<i32>(at.xy) * tiles.side_px;
    let high = min(low + tiles.side_px, tiles.size);
    for (var y = low.y; y < high.y; y++) {
        for (var x = low.x; x < high.x; x++) {
            let g = unpack_geometry(textureLoad(geometry, vec2<i32>(x, y), 0));
            if g.x > 0.0 {
                sum = merge(sum, g.zwzw, g.zwzw);
            }
        }
    }
    return sum;
}

// The fastest motion in each tile's neighbourhood, and the tile's kind (shaders/motion_blur.wgsl):
// 0 no motion, 1 one motion, 2 many motions.
@fragment
fn over_tiles(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    var sum = Out(vec4<f32>(0.0), vec4<f32>(0.0));
    let p = vec2<i32>(at.xy);
    let last = (tiles.size - 1) / tiles.side_px;
    for (var y = max(p.y - 1, 0); y <= min(p.y + 1, last.y); y++) {
        for (var x = max(p.x - 1, 0); x <= min(p.x + 1, last.x); x++) {
            let f = textureLoad(first, vec2<i32>(x, y), 0);
            if f.z > 0.0 {
                sum = merge(sum, f, textureLoad(second, vec2<i32>(x, y), 0));
            }
        }
    }
    // Motions that end within a pixel of each other count as one: each pixel uses its own.
    let span = (sum.range.zw - sum.range.xy) * tiles.exposure_s;
    let kind = select(2.0, 1.0, max(span.x, span.y) < 1.0);
    return vec4<f32>(sum.fastest.xyz, kind * sum.fastest.z);
}
