// The circles of confusion around each tile: those that can reach its empty pixels.
// @import shared/fullscreen
// @import shared/layer
// @import shared/lens
@group(0) @binding(0) var<uniform> lens: Lens;
@group(0) @binding(1) var geometry: texture_2d<u32>;
@group(0) @binding(1) var before: texture_2d<f32>;
@group(0) @binding(2) var around_tiles: texture_2d<f32>;

fn nothing() -> vec4<f32> {
    return vec4<f32>(NOTHING, 0.0, 0.0, 0.0);
}

fn joined(a: vec4<f32>, b: vec4<f32>) -> vec4<f32> {
    return vec4<f32>(min(a.x, b.x), max(a.yzw, b.yzw));
}

// For each tile: nearest circle (signed), largest radius, and 1 (0 where the tile is empty).
@fragment
fn own(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let low = vec2<i32>(at.xy) * lens.side_px;
    let high = min(low + lens.side_px, lens.size);
    var all = nothing();
    for (var y = low.y; y < high.y; y++) {
        for (var x = low.x; x < high.x; x++) {
            let depth = unpack_geometry(textureLoad(geometry, vec2<i32>(x, y), 0)).x;
            let circle = circle_of(depth);
            let one = vec4<f32>(circle, 0.5 * abs(circle), 0.0, 1.0);
            all = joined(all, select(nothing(), one, depth > 0.0));
        }
    }
    return all;
}

// The same for the tile and its neighbours.
@fragment
fn around(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let p = vec2<i32>(at.xy);
    let last = (lens.size - 1) / lens.side_px;
    var all = nothing();
    for (var y = max(p.y - 1, 0); y <= min(p.y + 1, last.y); y++) {
        for (var x = max(p.x - 1, 0); x <= min(p.x + 1, last.x); x++) {
            all = joined(all, textureLoad(before, vec2<i32>(x, y), 0));
        }
    }
    return all;
}

// The geometry of newly covered pixels: that of the nearest surface around.
@fragment
fn passing(@builtin(position) at: vec4<f32>) -> @location(0) vec4<u32> {
    let p = vec2<i32>(at.xy);
    let own = textureLoad(geometry, p, 0);
    let near = textureLoad(around_tiles, p / lens.side_px, 0);
    let depth = select(0.0, 1.0 / max(lens.per_focus - near.x / lens.fx_diameter, 1e-6), near.w > 0.0);
    return select(pack_geometry(depth, vec2<f32>(0.0)), own, unpack_geometry(own).x > 0.0);
}
