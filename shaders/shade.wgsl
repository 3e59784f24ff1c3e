// The share of the real light that virtual things take, at each pixel (src/compositor/shade.rs): where the pixel's ray meets a
// floor, by the pose of its row at several moments of the exposure, its shadow map is looked up. Where rays meet the floor is
// computed at the corners of cells of the picture. In between it is interpolated: before the division it is nearly linear.
// @import shared/half
override has_depth: bool = false;   // of the real scene
override has_matte: bool = false;   // second surfaces of pixels at the edges of real things

const MOMENTS: u32 = 4u;
// How far apart the four places are at which a pixel's depth is asked, against those in the pixel: a sensor's edges are torn
// by two pixels.
const BESIDE_PX: f32 = 6.0;
// Depths that differ by more than this factor belong to two surfaces.
const JUMP: f32 = 1.04;

// A shadow ends where it is too faint to be seen. On sRGB white, 8-bit codes change by 112 per unit of light: less than
// half a code below FAINT. It fades in up to VISIBLE, where it is worth less than two.
const FAINT: f32 = 1.0 / 256.0;
const VISIBLE: f32 = 1.0 / 64.0;

struct Shade {
    in_picture: vec2<f32>,   // where the part begins
    part_px: vec2<f32>,      // its size
    in_depth: vec2<f32>,     // where it begins in the depth
    in_matte: vec2<f32>,     // and in the matte
    per_texel: vec2<f32>,    // 1 / the atlas's size
    depth_size: vec2<i32>,   // of the depth; its texture may be larger
    matte_size: vec2<i32>,   // of the matte
    size: vec2<i32>,         // of the grid of rays, nodes
    per_step: f32,           // steps of the grid per pixel
    round_px: f32,           // width of a picture whose rims meet, else 0
    strength: f32,
    presence: f32,
    tolerance_m: f32,
    per_depth2: f32,         // of the depth's error, 1/m
    piece_px: i32,           // side of a piece
}

struct ShadowMap {
    rect_px: vec4<f32>,      // where in the picture it can be seen: x0, y0, x1, y1
    in_atlas: vec2<f32>,
    size: vec2<f32>,         // texels
    height_m: f32,           // of the camera over the floor
    unmeasured: f32,         // of it where nothing was measured
    unused0: f32,
    unused1: f32,
}

// A piece of the picture where a shadow map can be seen.
struct Piece {
    at_px: vec2<i32>,
    shadow_map: u32,
    turn: u32,               // the first of its upper line's MOMENTS turns; those of its lower line follow
}

// From a ray to (x/t, y/t, 1/t): texels of the shadow map, and how many rays long the way to the floor is.
struct Turn { x: vec4<f32>, y: vec4<f32>, z: vec4<f32> }

@group(0) @binding(0) var<uniform> shade: Shade;
@group(0) @binding(1) var rays: texture_2d<f32>;
@group(0) @binding(2) var atlas: texture_2d<f32>;
@group(0) @binding(3) var real_depth: texture_2d<f32>;
@group(0) @binding(4) var<storage, read> shadow_maps: array<ShadowMap>;
@group(0) @binding(5) var<storage, read> pieces: array<Piece>;
@group(0) @binding(6) var<storage, read> turns: array<Turn>;
@group(0) @binding(7) var between: sampler;
// A pixel's second surface: its share of each colour's light, and its depth, m; 0 where there is none.
@group(0) @binding(8) var matte: texture_2d<f32>;

// The rays at the corners of a cell of their grid, and the cell.
struct Cell { upper: array<vec4<f32>, 2>, lower: array<vec4<f32>, 2>, corner: vec2<f32> }

// The cell around a place in the picture.
fn cell_at(at_px: vec2<f32>) -> Cell {
    let on_grid = clamp(at_px * shade.per_step, vec2<f32>(0.0), vec2<f32>(shade.size - 1));
    let corner = min(floor(on_grid), vec2<f32>(shade.size - 2));
    let i = vec2<i32>(corner);
    let right = i + vec2<i32>(1, 0);
    let below = i + vec2<i32>(0, 1);
    return Cell(
        array(textureLoad(rays, i, 0), textureLoad(rays, right, 0)),
        array(textureLoad(rays, below, 0), textureLoad(rays, i + 1, 0)),
        corner,
    );
}

// The ray through a place in the cell or close to it; w is 1 where there is one.
fn ray_at(cell: Cell, at_px: vec2<f32>) -> vec4<f32> {
    let f = at_px * shade.per_step - cell.corner;
    return mix(mix(cell.upper[0], cell.upper[1], f.x), mix(cell.lower[0], cell.lower[1], f.x), f.y);
}

// A place within the pixel for each moment: together they cover it.
fn beside(moment: u32) -> vec2<f32> {
    let turned = array<vec2<f32>, MOMENTS>(
        vec2<f32>(-0.375, -0.125), vec2<f32>(0.125, -0.375), vec2<f32>(0.375, 0.125), vec2<f32>(-0.125, 0.375),
    );
    return turned[moment];
}

// Behind a stand-in model, where nothing was measured (depth/proxies.rs), m.
const FAR_M = 1e4;

// The receiver plane at a pixel, with which depth samples are compared.
struct FloorDepth {
    nearness: f32,           // inverse depth of the plane, 1/m
    per_off: f32,            // receiver weight lost per unit of relative depth difference
    unmeasured: f32,         // receiver weight of a pixel without depth
}

fn floor_depth(nearness: f32, shadow_map: ShadowMap) -> FloorDepth {
    let near_m = max(shade.tolerance_m, shade.per_depth2 / max(nearness * nearness, 1e-6));
    return FloorDepth(nearness, 0.5 * shadow_map.height_m / near_m, shadow_map.unmeasured);
}

// Receiver weight of a depth sample: 1 within the tolerance of the floor, 0 beyond three times that.
fn floor_at(real_m: f32, receiver: FloorDepth) -> f32 {
    let weight = clamp(1.5 - receiver.per_off * abs(real_m * receiver.nearness - 1.0), 0.0, 1.0);
    return select(weight, receiver.unmeasured, real_m <= 0.0 || real_m >= FAR_M);
}

fn depth_at(at_px: vec2<f32>) -> f32 {
    return textureLoad(real_depth, clamp(vec2<i32>(floor(at_px)), vec2<i32>(0), shade.depth_size - 1), 0).x;
}

// Receiver weight of the depth around a pixel. Where nothing was measured, the support plane receives and facets do not.
fn floor_around(at_px: vec2<f32>, receiver: FloorDepth) -> f32 {
    if !has_depth {
        return receiver.unmeasured;
    }
    var share = 0.0;
    for (var i = 0u; i < MOMENTS; i++) {
        share += floor_at(depth_at(at_px + BESIDE_PX * beside(i)), receiver);
    }
    return share / f32(MOMENTS);
}

// Receiver weight of the pixel's own surface, averaged over the sensor's noise.
fn floor_of_surface(at_px: vec2<f32>, receiver: FloorDepth) -> f32 {
    let own_m = depth_at(at_px);
    var share = floor_at(own_m, receiver);
    var count = 1.0;
    for (var i = 0u; i < MOMENTS; i++) {
        let real_m = depth_at(at_px + BESIDE_PX * beside(i));
        if max(real_m, own_m) <= JUMP * min(real_m, own_m) {
            share += floor_at(real_m, receiver);
            count += 1.0;
        }
    }
    return share / count;
}

// The share of each colour's light in a pixel that comes from the floor.
fn light_of_floor(at_px: vec2<f32>, receiver: FloorDepth) -> vec3<f32> {
    if has_matte {
        let q = vec2<i32>(floor(at_px + shade.in_matte));
        if all(q >= vec2<i32>(0)) && all(q < shade.matte_size) {
            let own = vec3<f32>(floor_of_surface(at_px + shade.in_depth, receiver));
            let second = textureLoad(matte, q, 0);
            return mix(own, vec3<f32>(floor_at(second.w, receiver)), select(vec3<f32>(0.0), second.rgb, second.w > 0.0));
        }
    }
    return vec3<f32>(floor_around(at_px + shade.in_depth, receiver));
}

struct Corner {
    @builtin(position) at: vec4<f32>,
    @location(0) @interpolate(flat) shadow_map: u32,
    // For each moment what its turn makes of the ray, and 1 where there is a ray.
    @location(1) @interpolate(linear) first: vec4<f32>,
    @location(2) @interpolate(linear) second: vec4<f32>,
    @location(3) @interpolate(linear) third: vec4<f32>,
    @location(4) @interpolate(linear) fourth: vec4<f32>,
}

// What a turn makes of the ray through a place in the cell.
fn turned(cell: Cell, at_px: vec2<f32>, turn: Turn) -> vec4<f32> {
    let ray = ray_at(cell, at_px);
    return vec4<f32>(dot(turn.x.xyz, ray.xyz), dot(turn.y.xyz, ray.xyz), dot(turn.z.xyz, ray.xyz), ray.w);
}

@vertex
fn seen(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> Corner {
    let piece = pieces[instance];
    let corner = vec2<u32>(vertex & 1u, vertex >> 1u);
    var place = vec2<f32>(piece.at_px + vec2<i32>(corner) * shade.piece_px);
    let at = (place - shade.in_picture) / shade.part_px * vec2<f32>(2.0, -2.0) + vec2<f32>(-1.0, 1.0);
    if shade.round_px > 0.0 {
        place.x -= floor(place.x / shade.round_px) * shade.round_px;
    }
    // The cell within the piece, for beyond it there may be no rays.
    let cell = cell_at(place + 0.5 - vec2<f32>(corner));
    let turn = piece.turn + corner.y * MOMENTS;
    return Corner(
        vec4<f32>(at, 0.0, 1.0),
        piece.shadow_map,
        turned(cell, place + beside(0u), turns[turn]),
        turned(cell, place + beside(1u), turns[turn + 1u]),
        turned(cell, place + beside(2u), turns[turn + 2u]),
        turned(cell, place + beside(3u), turns[turn + 3u]),
    );
}

// Transmittances 1 − d of overlapping shadow maps multiply: the pass blends by D + (1 − D)·d.
@fragment
fn main(corner: Corner) -> @location(0) vec4<f32> {
    let shadow_map = shadow_maps[corner.shadow_map];
    let turned = array<vec4<f32>, MOMENTS>(corner.first, corner.second, corner.third, corner.fourth);
    var taken = vec3<f32>(0.0);
    var nearness = 0.0;
    for (var moment = 0u; moment < MOMENTS; moment++) {
        let found = turned[moment];
        let texel = found.xy / max(found.z, 1e-9);
        let is_on = found.w > 0.999 && found.z > 1e-6 && all(texel > vec2<f32>(0.0)) && all(texel < shadow_map.size);
        let inside = shadow_map.in_atlas + clamp(texel, vec2<f32>(0.5), shadow_map.size - 0.5);
        let share = textureSampleLevel(atlas, between, inside * shade.per_texel, 0.0).rgb;
        taken += select(vec3<f32>(0.0), share, is_on);
        nearness += found.z;
    }
    taken /= f32(MOMENTS);
    taken *= smoothstep(FAINT, VISIBLE, max(abs(taken.r), max(abs(taken.g), abs(taken.b))));
    // Pieces reach beyond it.
    let at = corner.at.xy + shade.in_picture;
    taken *= f32(all(at > shadow_map.rect_px.xy) && all(at < shadow_map.rect_px.zw));
    // Depth is read only where there is a shadow.
    if any(taken != vec3<f32>(0.0)) {
        taken *= light_of_floor(corner.at.xy, floor_depth(nearness / f32(MOMENTS), shadow_map));
    }
    let share = clamp(shade.strength * shade.presence * taken, vec3<f32>(-1.0), vec3<f32>(1.0));
    return rounded_to_half(vec4<f32>(share, 0.0));
}
