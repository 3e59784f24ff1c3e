// The fraction of the real light that virtual objects remove, at each pixel
// (src/compositor/shadow_mask.rs): the planar shadow is sampled where the pixel's ray meets the
// receiver plane, by the pose of its row at several samples of the exposure. The homogeneous texel
// is computed at the corners of tiles of the picture. In between it is interpolated before the
// division, where it is nearly linear.
// @import shared/half
override has_depth: bool = false;   // of the real scene
override has_matte: bool = false;   // second surfaces of pixels at the edges of real objects

const EXPOSURE_SAMPLES: u32 = 4u;
// Spacing of a pixel's four depth samples, relative to that of its four exposure samples: a
// sensor's edges are ragged by two pixels.
const DEPTH_SPREAD: f32 = 6.0;
// Smallest ratio of two depths that belong to two surfaces.
const DEPTH_STEP: f32 = 1.04;

// Faint shadows are removed by a smooth threshold between these fractions of light. On sRGB white,
// 8-bit codes change by 112 per unit of light: by less than half a code at the lower one, by less
// than two at the upper one.
const INVISIBLE_SHADE: f32 = 1.0 / 256.0;
const VISIBLE_SHADE: f32 = 1.0 / 64.0;

struct ShadowMask {
    in_picture: vec2<f32>,   // origin of the part in the picture
    part_px: vec2<f32>,      // size of the part
    in_depth: vec2<f32>,     // origin of the part in the depth
    in_matte: vec2<f32>,     // origin of the part in the matte
    per_texel: vec2<f32>,    // 1 / the atlas's size
    depth_size: vec2<i32>,   // of the depth; its texture may be larger
    matte_size: vec2<i32>,   // of the matte
    size: vec2<i32>,         // of the grid of rays, nodes
    per_step: f32,           // steps of the grid per pixel
    round_px: f32,           // width of a picture whose rims meet, else 0
    strength: f32,
    opacity: f32,
    tolerance_m: f32,
    per_depth2: f32,         // growth of the tolerance with the squared depth, 1/m
    tile_px: i32,            // side of a tile
}

struct PlanarShadow {
    rect_px: vec4<f32>,      // bounds in the picture: x0, y0, x1, y1
    in_atlas: vec2<f32>,
    size: vec2<f32>,         // texels
    height_m: f32,           // of the camera over the receiver plane
    unmeasured: f32,         // receiver weight of a pixel without depth
    unused0: f32,
    unused1: f32,
}

// A tile of the picture that may contain a part of a planar shadow.
struct Tile {
    at_px: vec2<i32>,
    planar_shadow: u32,
    homography: u32,         // the first of EXPOSURE_SAMPLES of the tile's upper edge; those of its lower edge follow
}

// From a ray to (x/t, y/t, 1/t): x, y in texels of the planar shadow, t the distance along the ray.
struct Homography { x: vec4<f32>, y: vec4<f32>, z: vec4<f32> }

@group(0) @binding(0) var<uniform> shadow_mask: ShadowMask;
@group(0) @binding(1) var rays: texture_2d<f32>;
@group(0) @binding(2) var atlas: texture_2d<f32>;
@group(0) @binding(3) var real_depth: texture_2d<f32>;
@group(0) @binding(4) var<storage, read> planar_shadows: array<PlanarShadow>;
@group(0) @binding(5) var<storage, read> tiles: array<Tile>;
@group(0) @binding(6) var<storage, read> homographies: array<Homography>;
@group(0) @binding(7) var between: sampler;
// A pixel's second surface: its share of each channel's light, and its depth, m; 0 if there is
// none.
@group(0) @binding(8) var matte: texture_2d<f32>;

// The rays at the corners of a cell of their grid, and the cell.
struct Cell { upper: array<vec4<f32>, 2>, lower: array<vec4<f32>, 2>, corner: vec2<f32> }

// The cell around a position in the picture.
fn cell_at(at_px: vec2<f32>) -> Cell {
    let on_grid = clamp(at_px * shadow_mask.per_step, vec2<f32>(0.0), vec2<f32>(shadow_mask.size - 1));
    let corner = min(floor(on_grid), vec2<f32>(shadow_mask.size - 2));
    let i = vec2<i32>(corner);
    let right = i + vec2<i32>(1, 0);
    let below = i + vec2<i32>(0, 1);
    return Cell(
        array(textureLoad(rays, i, 0), textureLoad(rays, right, 0)),
        array(textureLoad(rays, below, 0), textureLoad(rays, i + 1, 0)),
        corner,
    );
}

// The ray through a position in the cell or close to it; w is 1 if it exists.
fn ray_at(cell: Cell, at_px: vec2<f32>) -> vec4<f32> {
    let f = at_px * shadow_mask.per_step - cell.corner;
    return mix(mix(cell.upper[0], cell.upper[1], f.x), mix(cell.lower[0], cell.lower[1], f.x), f.y);
}

// Subpixel offset of each exposure sample: a rotated grid.
fn offset_px(index: u32) -> vec2<f32> {
    let offsets = array<vec2<f32>, EXPOSURE_SAMPLES>(
        vec2<f32>(-0.375, -0.125), vec2<f32>(0.125, -0.375), vec2<f32>(0.375, 0.125), vec2<f32>(-0.125, 0.375),
    );
    return offsets[index];
}

// Depth of unmeasured pixels behind a proxy model (depth/proxies.rs), m.
const FAR_M: f32 = 1e4;

// The receiver plane at a pixel, with which depth samples are compared.
struct ReceiverDepth {
    nearness: f32,           // inverse depth of the plane, 1/m
    per_off: f32,            // receiver weight lost per unit of relative depth difference
    unmeasured: f32,         // receiver weight of a pixel without depth
}

fn receiver_depth(nearness: f32, planar_shadow: PlanarShadow) -> ReceiverDepth {
    let near_m = max(shadow_mask.tolerance_m, shadow_mask.per_depth2 / max(nearness * nearness, 1e-6));
    return ReceiverDepth(nearness, 0.5 * planar_shadow.height_m / near_m, planar_shadow.unmeasured);
}

// Receiver weight of a depth sample: 1 within the tolerance of the plane, 0 beyond three times
// that.
fn receiver_weight(real_m: f32, receiver: ReceiverDepth) -> f32 {
    let weight = clamp(1.5 - receiver.per_off * abs(real_m * receiver.nearness - 1.0), 0.0, 1.0);
    return select(weight, receiver.unmeasured, real_m <= 0.0 || real_m >= FAR_M);
}

fn depth_at(at_px: vec2<f32>) -> f32 {
    return textureLoad(real_depth, clamp(vec2<i32>(floor(at_px)), vec2<i32>(0), shadow_mask.depth_size - 1), 0).x;
}

// Receiver weight of the depth around a pixel. Where nothing was measured, the support plane
// receives and facets do not.
fn weight_around(at_px: vec2<f32>, receiver: ReceiverDepth) -> f32 {
    if !has_depth {
        return receiver.unmeasured;
    }
    var share = 0.0;
    for (var i = 0u; i < EXPOSURE_SAMPLES; i++) {
        share += receiver_weight(depth_at(at_px + DEPTH_SPREAD * offset_px(i)), receiver);
    }
    return share / f32(EXPOSURE_SAMPLES);
}

// Receiver weight of the pixel's own surface, averaged over the sensor's noise.
fn weight_of_surface(at_px: vec2<f32>, receiver: ReceiverDepth) -> f32 {
    let own_m = depth_at(at_px);
    var share = receiver_weight(own_m, receiver);
    var count = 1.0;
    for (var i = 0u; i < EXPOSURE_SAMPLES; i++) {
        let real_m = depth_at(at_px + DEPTH_SPREAD * offset_px(i));
        if max(real_m, own_m) <= DEPTH_STEP * min(real_m, own_m) {
            share += receiver_weight(real_m, receiver);
            count += 1.0;
        }
    }
    return share / count;
}

// The share of each channel's light in a pixel that comes from the receiver.
fn receiver_share(at_px: vec2<f32>, receiver: ReceiverDepth) -> vec3<f32> {
    if has_matte {
        let q = vec2<i32>(floor(at_px + shadow_mask.in_matte));
        if all(q >= vec2<i32>(0)) && all(q < shadow_mask.matte_size) {
            let own = vec3<f32>(weight_of_surface(at_px + shadow_mask.in_depth, receiver));
            let second = textureLoad(matte, q, 0);
            return mix(own, vec3<f32>(receiver_weight(second.w, receiver)), select(vec3<f32>(0.0), second.rgb, second.w > 0.0));
        }
    }
    return vec3<f32>(weight_around(at_px + shadow_mask.in_depth, receiver));
}

struct Corner {
    @builtin(position) at: vec4<f32>,
    @location(0) @interpolate(flat) planar_shadow: u32,
    // For each exposure sample, the homogeneous texel of the ray, and 1 if the ray exists.
    @location(1) @interpolate(linear) first: vec4<f32>,
    @location(2) @interpolate(linear) second: vec4<f32>,
    @location(3) @interpolate(linear) third: vec4<f32>,
    @location(4) @interpolate(linear) fourth: vec4<f32>,
}

// The homography of the ray through a position in the cell, and 1 if the ray exists.
fn texel_of_ray(cell: Cell, at_px: vec2<f32>, h: Homography) -> vec4<f32> {
    let ray = ray_at(cell, at_px);
    return vec4<f32>(dot(h.x.xyz, ray.xyz), dot(h.y.xyz, ray.xyz), dot(h.z.xyz, ray.xyz), ray.w);
}

@vertex
fn tile(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> Corner {
    let own = tiles[instance];
    let corner = vec2<u32>(vertex & 1u, vertex >> 1u);
    var at_px = vec2<f32>(own.at_px + vec2<i32>(corner) * shadow_mask.tile_px);
    let at = (at_px - shadow_mask.in_picture) / shadow_mask.part_px * vec2<f32>(2.0, -2.0) + vec2<f32>(-1.0, 1.0);
    if shadow_mask.round_px > 0.0 {
        at_px.x -= floor(at_px.x / shadow_mask.round_px) * shadow_mask.round_px;
    }
    // The cell within the tile: beyond it rays may not exist.
    let cell = cell_at(at_px + 0.5 - vec2<f32>(corner));
    let first = own.homography + corner.y * EXPOSURE_SAMPLES;
    return Corner(
        vec4<f32>(at, 0.0, 1.0),
        own.planar_shadow,
        texel_of_ray(cell, at_px + offset_px(0u), homographies[first]),
        texel_of_ray(cell, at_px + offset_px(1u), homographies[first + 1u]),
        texel_of_ray(cell, at_px + offset_px(2u), homographies[first + 2u]),
        texel_of_ray(cell, at_px + offset_px(3u), homographies[first + 3u]),
    );
}

// Transmittances 1 − d of overlapping planar shadows multiply: the pass blends by D + (1 − D)·d.
@fragment
fn main(corner: Corner) -> @location(0) vec4<f32> {
    let planar_shadow = planar_shadows[corner.planar_shadow];
    let texels = array<vec4<f32>, EXPOSURE_SAMPLES>(corner.first, corner.second, corner.third, corner.fourth);
    var removed = vec3<f32>(0.0);
    var nearness = 0.0;
    for (var i = 0u; i < EXPOSURE_SAMPLES; i++) {
        let homogeneous = texels[i];
        let texel = homogeneous.xy / max(homogeneous.z, 1e-9);
        let is_on = homogeneous.w > 0.999 && homogeneous.z > 1e-6
            && all(texel > vec2<f32>(0.0)) && all(texel < planar_shadow.size);
        let inside = planar_shadow.in_atlas + clamp(texel, vec2<f32>(0.5), planar_shadow.size - 0.5);
        let sampled = textureSampleLevel(atlas, between, inside * shadow_mask.per_texel, 0.0).rgb;
        removed += select(vec3<f32>(0.0), sampled, is_on);
        nearness += homogeneous.z;
    }
    removed /= f32(EXPOSURE_SAMPLES);
    removed *= smoothstep(INVISIBLE_SHADE, VISIBLE_SHADE, max(abs(removed.r), max(abs(removed.g), abs(removed.b))));
    // Tiles extend beyond the bounds.
    let at = corner.at.xy + shadow_mask.in_picture;
    removed *= f32(all(at > planar_shadow.rect_px.xy) && all(at < planar_shadow.rect_px.zw));
    // Depth is read only where there is a shadow.
    if any(removed != vec3<f32>(0.0)) {
        removed *= receiver_share(corner.at.xy, receiver_depth(nearness / f32(EXPOSURE_SAMPLES), planar_shadow));
    }
    let fraction = clamp(shadow_mask.strength * shadow_mask.opacity * removed, vec3<f32>(-1.0), vec3<f32>(1.0));
    return rounded_to_half(vec4<f32>(fraction, 0.0));
}
