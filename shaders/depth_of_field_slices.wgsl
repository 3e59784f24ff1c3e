// Depth of field of a whole picture, slice by slice from the nearest
// (src/effects/depth_of_field/slices.rs).
// @import shared/fullscreen
// @import shared/layer
override half_side: i32 = 1;
// Whether the layer has something in the slice.
override layer_too: f32 = 1.0;

struct Slice {
    size: vec2<i32>,     // of the layer
    place: vec2<f32>,    // sampler coordinates per pixel
    columns: i32,        // of tiles
    side_px: i32,        // of a tile
    fx_diameter: f32,    // fx · diameter, px·m
    per_focus: f32,      // 1 / focus distance, 1/m
    largest_px: f32,     // diameter
    tolerance_m: f32,    // how much nearer a real surface must be to occlude
    number: f32,
    noise: f32,          // share of the noise's σ that the slice's blur leaves
    texel_px: f32,       // pixels in a texel
    with_layer: f32,     // 1 if the layer is blurred too
}
@group(0) @binding(0) var<uniform> slice: Slice;

// The same as in slices.rs; a test compares them.
const SHARP_PX: f32 = 0.7;
const GROWS_FROM_PX: f32 = 3.0;
const RATIO: f32 = 1.25;
const MAX_SLICES: f32 = 31.0;
// Tolerance from which on real surfaces occlude nothing (m).
const NO_OCCLUSION_M: f32 = 1e9;
// Position of a pixel without a virtual surface.
const NO_SLICE: f32 = 100.0;

// Position of a depth among the slices.
fn place_of(depth_m: f32) -> f32 {
    let circle = clamp(slice.fx_diameter * (slice.per_focus - 1.0 / max(depth_m, 1e-6)), -slice.largest_px, slice.largest_px);
    let beyond = max(abs(circle) - SHARP_PX, 0.0);
    return clamp(log(1.0 + beyond / GROWS_FROM_PX) / log(RATIO) * sign(circle), -MAX_SLICES, MAX_SLICES);
}

// --- Each pixel's positions among the slices: of the real surface, of the background behind it, of
// the virtual one; and 1 if the virtual one is occluded.

@group(0) @binding(1) var layer_color: texture_2d<f32>;
@group(0) @binding(2) var layer_geometry: texture_2d<u32>;
@group(0) @binding(3) var real_depths: texture_2d<u32>;

@fragment
fn places(@builtin(position) at: vec4<f32>) -> @location(0) vec4<f32> {
    let p = vec2<i32>(at.xy);
    let words = textureLoad(real_depths, p, 0);
    let real = bitcast<f32>(words.x | (words.y << 16u));
    let behind = bitcast<f32>(words.z | (words.w << 16u));
    let drawn = unpack_geometry(textureLoad(layer_geometry, p, 0)).x;
    let there = drawn > 0.0 && textureLoad(layer_color, p, 0).a > 0.0 && slice.with_layer > 0.0;
    let hidden = select(0.0, 1.0, there && real < drawn - slice.tolerance_m);
    return vec4<f32>(place_of(real), place_of(behind), select(NO_SLICE, place_of(drawn), there), hidden);
}

// --- A slice's share of the real part and of the layer, in the tiles that it reaches.

@group(0) @binding(1) var reached: texture_2d<u32>;

@vertex
fn tiles(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> @builtin(position) vec4<f32> {
    let columns = f32(slice.columns);
    // In floats: software drivers divide integers one by one.
    let row = floor((f32(instance) + 0.5) / columns);
    let tile = vec2<f32>(f32(instance) - row * columns, row);
    let is_reached = textureLoad(reached, vec2<i32>(tile), 0).x > 0u;
    let corner = (tile + vec2<f32>(f32(vertex & 1u), f32(vertex >> 1u))) * f32(slice.side_px) / slice.texel_px;
    let size = ceil(vec2<f32>(slice.size) / slice.texel_px);
    let device = min(corner, size) / size * vec2<f32>(2.0, -2.0) + vec2<f32>(-1.0, 1.0);
    return vec4<f32>(select(vec2<f32>(0.0), device, is_reached), 0.0, 1.0);
}

@group(0) @binding(2) var color: texture_2d<f32>;
@group(0) @binding(3) var light: texture_2d<f32>;
@group(0) @binding(4) var behind_light: texture_2d<f32>;
@group(0) @binding(5) var place: texture_2d<f32>;

struct Both { @location(0) real: vec4<f32>, @location(1) layer: vec4<f32> }

// 1 at the slice, 0 at its neighbours.
fn belongs(place: f32) -> f32 {
    return max(1.0 - abs(place - slice.number), 0.0);
}

@fragment
fn share(@builtin(position) at: vec4<f32>) -> Both {
    let p = vec2<i32>(at.xy);
    let s = textureLoad(place, p, 0);
    let drawn = select(vec4<f32>(0.0), textureLoad(color, p, 0), s.z < NO_SLICE);
    // To the extent that both lie in the same slices, only the nearer one at this pixel counts.
    let together = clamp(2.0 - abs(s.x - s.z), 0.0, 1.0);
    let of_real = belongs(s.x) * (1.0 - together * drawn.a * (1.0 - s.w));
    // Never in a slice that contains the nearer one: there they would show side by side, not one
    // behind the other.
    let of_behind = belongs(max(s.y, floor(s.x) + 2.0)) * clamp(s.y - s.x - 1.0, 0.0, 1.0);
    let real = of_real * textureLoad(light, p, 0).rgb + of_behind * textureLoad(behind_light, p, 0).rgb;
    // The same applies to a virtual surface that the real one occludes.
    let of_hidden = belongs(max(s.z, floor(s.x) + 2.0)) * clamp(s.z - s.x - 1.0, 0.0, 1.0);
    return Both(vec4<f32>(real, of_real + of_behind), select(belongs(s.z), of_hidden, s.w > 0.0) * drawn);
}

// --- At half the previous resolution.

@group(0) @binding(2) var before_real: texture_2d<f32>;
@group(0) @binding(3) var before_layer: texture_2d<f32>;

@fragment
fn smaller(@builtin(position) at: vec4<f32>) -> Both {
    let low = 2 * vec2<i32>(at.xy);
    let last = vec2<i32>(ceil(2.0 * vec2<f32>(slice.size) / slice.texel_px)) - 1;
    var out = Both(vec4<f32>(0.0), vec4<f32>(0.0));
    for (var i = 0; i < 4; i++) {
        let q = min(low + vec2<i32>(i & 1, i >> 1), last);
        out.real += 0.25 * textureLoad(before_real, q, 0);
        if layer_too > 0.0 {
            out.layer += 0.25 * textureLoad(before_layer, q, 0);
        }
    }
    return out;
}

// --- Convolved with the opening's image.

@group(0) @binding(4) var<uniform> kernel: array<vec4<f32>, 183>;

@fragment
fn blur(@builtin(position) at: vec4<f32>) -> Both {
    let p = vec2<i32>(at.xy);
    let last = vec2<i32>(ceil(vec2<f32>(slice.size) / slice.texel_px)) - 1;
    var out = Both(vec4<f32>(0.0), vec4<f32>(0.0));
    var i = 0;
    for (var y = -half_side; y <= half_side; y++) {
        for (var x = -half_side; x <= half_side; x++) {
            let w = kernel[i >> 2u][i & 3];
            let q = clamp(p - vec2<i32>(x, y), vec2<i32>(0), last);
            out.real += w * textureLoad(before_real, q, 0);
            if layer_too > 0.0 {
                out.layer += w * textureLoad(before_layer, q, 0);
            }
            i++;
        }
    }
    return out;
}

// --- Composited from the nearest: visible light of both, with coverage, and the accumulated share
// of each in the slices so far, visible or not (x real, y layer; z: σ of noise, weighted by
// visibility).

struct Sums { @location(0) real: vec4<f32>, @location(1) layer: vec4<f32>, @location(2) covered: vec4<f32> }

@fragment
fn nothing(@builtin(position) at: vec4<f32>) -> Sums {
    return Sums(vec4<f32>(0.0), vec4<f32>(0.0), vec4<f32>(0.0 * slice.number));
}

@group(0) @binding(1) var slice_real: texture_2d<f32>;
@group(0) @binding(2) var slice_layer: texture_2d<f32>;
@group(0) @binding(3) var sum_real: texture_2d<f32>;
@group(0) @binding(4) var sum_layer: texture_2d<f32>;
@group(0) @binding(5) var sum_covered: texture_2d<f32>;
@group(0) @binding(6) var between: sampler;

fn added(p: vec2<i32>, real: vec4<f32>, layer: vec4<f32>) -> Sums {
    let covered = textureLoad(sum_covered, p, 0);
    // Surfaces of the same kind share a pixel.
    let fresh = min(vec2<f32>(real.a, layer.a), max(vec2<f32>(1.0) - covered.xy, vec2<f32>(0.0)));
    let fits = fresh / max(vec2<f32>(real.a, layer.a), vec2<f32>(1e-6));
    // Attenuation by the nearer slices of the other kind.
    let hides = select(1.0, 0.0, slice.tolerance_m >= NO_OCCLUSION_M);
    let visible = fits * max(vec2<f32>(1.0) - covered.yx * vec2<f32>(1.0, hides), vec2<f32>(0.0));
    let noise = slice.noise * visible.x * real.a;
    return Sums(
        textureLoad(sum_real, p, 0) + visible.x * real,
        textureLoad(sum_layer, p, 0) + visible.y * layer,
        covered + vec4<f32>(fresh, noise, 0.0),
    );
}

@fragment
fn add(@builtin(position) at: vec4<f32>) -> Sums {
    let uv = at.xy * slice.place;
    let real = textureSampleLevel(slice_real, between, uv, 0.0);
    return added(vec2<i32>(at.xy), real, textureSampleLevel(slice_layer, between, uv, 0.0));
}

@fragment
fn add_sharp(@builtin(position) at: vec4<f32>) -> Sums {
    let p = vec2<i32>(at.xy);
    return added(p, textureLoad(slice_real, p, 0), textureLoad(slice_layer, p, 0));
}

// --- The layer, and the real part next to and behind it.

@group(0) @binding(1) var recorded: texture_2d<f32>;
@group(0) @binding(2) var all_real: texture_2d<f32>;
@group(0) @binding(3) var all_layer: texture_2d<f32>;
@group(0) @binding(4) var all_held: texture_2d<f32>;

struct Finished { @location(0) layer: vec4<f32>, @location(1) real: vec4<f32> }

@fragment
fn finish(@builtin(position) at: vec4<f32>) -> Finished {
    let p = vec2<i32>(at.xy);
    let real = textureLoad(all_real, p, 0);
    let noise = textureLoad(all_held, p, 0).z / max(real.a, 1e-6);
    // Without any visible light, its colour is unknown and hardly needed.
    let has_light = real.a > 1e-3 && slice.size.x > 0;
    let light = select(textureLoad(recorded, p, 0), vec4<f32>(real.rgb / max(real.a, 1e-6), noise), has_light);
    return Finished(textureLoad(all_layer, p, 0), light);
}
