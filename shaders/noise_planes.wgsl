// Noise by example in the planes Y', Cb and Cr (src/example_noise/synthesis.rs), code values.
// @import shared/fullscreen
// @import shared/example_noise

@group(0) @binding(0) var<uniform> example: Example;
// R'G'B' without noise on the scale of 8-bit codes.
@group(0) @binding(1) var uncoded: texture_2d<f32>;
// Amplitude factor of each px; 0 where no noise is added.
@group(0) @binding(2) var amplitude_factor: texture_2d<f32>;
// Energies of coarse and fine gradients, over blocks of 2 × 2 px.
@group(0) @binding(3) var activity: texture_2d<f32>;
// Rectangles of the target: x0, y0, x1, y1.
@group(0) @binding(4) var<storage, read> parts: array<vec4<i32>>;
@group(0) @binding(5) var<storage, read> sources: array<vec4<u32>>;
// Innovations as half floats, two in a word: of each px the six bands of Y', of each chroma sample
// the four of Cb and the four of Cr.
@group(0) @binding(6) var<storage, read> atlas_luma: array<u32>;
@group(0) @binding(7) var<storage, read> atlas_chroma: array<u32>;
// Standardised features.
@group(0) @binding(8) var features_low: texture_2d<f32>;
@group(0) @binding(9) var features_high: texture_2d<f32>;
// Of px: energies of the gradient and of fine detail.
@group(0) @binding(10) var energies: texture_2d<f32>;

@vertex
fn part(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> @builtin(position) vec4<f32> {
    return corner_of(parts[instance], vertex, vec2<f32>(example.region));
}

fn standardised(half_of: i32, values: vec4<f32>) -> vec4<f32> {
    let shown = clamp(values, example.features[half_of], example.features[2 + half_of]);
    return (shown - example.features[4 + half_of]) * example.features[6 + half_of];
}

// Energies between the centres of blocks; the border of the coded picture repeats.
fn activity_at(p: vec2<i32>) -> vec2<f32> {
    let at = (vec2<f32>(p - example.extent.xy) + 0.5) / 2.0 - 0.5;
    let first = floor(at);
    let share = at - first;
    let origin = example.extent.xy / 2;
    let last = (example.extent.zw - example.extent.xy) / 2 - 1;
    let low = clamp(vec2<i32>(first), vec2<i32>(0), last) + origin;
    let high = clamp(vec2<i32>(first) + 1, vec2<i32>(0), last) + origin;
    let top = mix(textureLoad(activity, low, 0), textureLoad(activity, vec2<i32>(high.x, low.y), 0), share.x);
    let bottom = mix(textureLoad(activity, vec2<i32>(low.x, high.y), 0), textureLoad(activity, high, 0), share.x);
    return mix(top, bottom, share.y).xy;
}

// Smoothed energy of fine detail.
fn detail_at(p: vec2<i32>) -> f32 {
    var sum = 0.0;
    for (var j = -1; j <= 1; j++) {
        for (var i = -1; i <= 1; i++) {
            let inside = clamp(p + vec2<i32>(i, j), example.extent.xy, example.extent.zw - 1);
            let weight = select(0.25, 0.5, i == 0) * select(0.25, 0.5, j == 0);
            sum += weight * textureLoad(energies, clamp(inside, vec2<i32>(0), example.region - 1), 0).y;
        }
    }
    return sum;
}

// Amplitude of a band: exp(g · φ / 2).
fn amplitude(band: i32, low: vec4<f32>, high: vec4<f32>) -> f32 {
    let g = example.gains[2 * band];
    let h = example.gains[2 * band + 1];
    let exponent = g.x + dot(g.yzw, low.xyz) + h.x * low.w + dot(h.yzw, high.xyz);
    return exp(0.5 * clamp(exponent, -12.0, 12.0));
}

fn rise(t: i32, overlap: i32) -> f32 {
    return sin(1.5707963 * (f32(t) + 0.5) / f32(overlap));
}

// Weight of a cell at the t-th sample of its tile along an axis.
fn weight(t: i32, cell: i32, overlap: i32) -> f32 {
    if t < overlap {
        return rise(t, overlap);
    }
    return select(1.0, rise(cell + overlap - 1 - t, overlap), t >= cell);
}

// The samples of the atlas that a place reads: of the up to four cells that cover it.
struct Taps {
    cells: array<u32, 4>,
    at: array<vec2<i32>, 4>,
    weights: array<f32, 4>,
    count: i32,
}

// `p` is a sample of the coded plane, `factor` luma px per sample.
fn taps_at(p: vec2<i32>, factor: vec2<i32>) -> Taps {
    let cell = vec2<i32>(CELL_PX) / factor;
    let overlap = vec2<i32>(OVERLAP_PX) / factor;
    let last = (p + overlap) / cell;
    let t = p + overlap - last * cell;
    var taps: Taps;
    for (var n = 0; n < 4; n++) {
        // The later cell of an overlap first.
        let before = vec2<i32>(n & 1, n >> 1u);
        let number = last - before;
        let s = t + before * cell;
        if any(s >= cell + overlap) || any(number < vec2<i32>(0)) {
            continue;
        }
        let place = number - example.first_cell;
        taps.cells[taps.count] = u32(place.y * example.cells.x + place.x);
        taps.at[taps.count] = s;
        taps.weights[taps.count] = weight(s.x, cell.x, overlap.x) * weight(s.y, cell.y, overlap.y);
        taps.count += 1;
    }
    return taps;
}

// Place of a tile's sample in its source.
fn mirrored(source: vec4<u32>, s: vec2<i32>, factor: vec2<i32>) -> vec2<u32> {
    let end = vec2<i32>(TILE_PX) / factor - 1;
    return vec2<u32>(select(s, end - s, vec2<bool>((source.w & 1u) == 1u, (source.w & 2u) == 2u)));
}

struct Luma {
    @location(0) noise: f32,
    @location(1) features_low: vec4<f32>,
    @location(2) features_high: vec4<f32>,
}

@fragment
fn luma(@builtin(position) at: vec4<f32>) -> Luma {
    let p = vec2<i32>(at.xy);
    let content = textureLoad(uncoded, p, 0).rgb;
    let m = clamp(content, vec3<f32>(0.0), vec3<f32>(255.0)) / 255.0;
    let y = brightness_of(content) / 255.0;
    let gradients = activity_at(p);
    let low = standardised(0, vec4<f32>(y, sqrt(y + 0.002), m.r - m.g, m.b - m.g));
    let high = standardised(1, vec4<f32>(log(vec3<f32>(vec2<f32>(0.5), 0.05) + vec3<f32>(gradients, detail_at(p))), 0.0));
    let factor = textureLoad(amplitude_factor, p, 0).x;
    if factor <= 0.0 {
        return Luma(0.0, low, high);
    }
    let taps = taps_at(p - example.extent.xy, vec2<i32>(1));
    var first = vec2<f32>(0.0);
    var second = vec2<f32>(0.0);
    var third = vec2<f32>(0.0);
    for (var n = 0; n < taps.count; n++) {
        let source = sources[taps.cells[n]];
        let s = mirrored(source, taps.at[n], vec2<i32>(1));
        let word = 3u * (source.x + s.y * source.z + s.x);
        first += taps.weights[n] * unpack2x16float(atlas_luma[word]);
        second += taps.weights[n] * unpack2x16float(atlas_luma[word + 1u]);
        third += taps.weights[n] * unpack2x16float(atlas_luma[word + 2u]);
    }
    let noise = first.x * amplitude(0, low, high) + first.y * amplitude(1, low, high)
        + second.x * amplitude(2, low, high) + second.y * amplitude(3, low, high)
        + third.x * amplitude(4, low, high) + third.y * amplitude(5, low, high);
    return Luma(factor * noise, low, high);
}

// Cb and Cr of a chroma sample, with the means of features and factor over its pixels.
@fragment
fn chroma(@builtin(position) at: vec4<f32>) -> @location(0) vec2<f32> {
    let p = vec2<i32>(at.xy);
    var factor = 0.0;
    var low = vec4<f32>(0.0);
    var high = vec4<f32>(0.0);
    for (var j = 0; j < example.factor.y; j++) {
        for (var i = 0; i < example.factor.x; i++) {
            let q = p * example.factor + vec2<i32>(i, j);
            factor += textureLoad(amplitude_factor, q, 0).x;
            low += textureLoad(features_low, q, 0);
            high += textureLoad(features_high, q, 0);
        }
    }
    if factor <= 0.0 {
        return vec2<f32>(0.0);
    }
    let share = 1.0 / f32(example.factor.x * example.factor.y);
    low *= share;
    high *= share;
    let taps = taps_at(p - example.extent.xy / example.factor, example.factor);
    var blue = vec4<f32>(0.0);
    var red = vec4<f32>(0.0);
    for (var n = 0; n < taps.count; n++) {
        let source = sources[taps.cells[n]];
        let s = mirrored(source, taps.at[n], example.factor);
        let word = 4u * (source.y + s.y * (source.z / u32(example.factor.x)) + s.x);
        let w = taps.weights[n];
        blue += w * vec4<f32>(unpack2x16float(atlas_chroma[word]), unpack2x16float(atlas_chroma[word + 1u]));
        red += w * vec4<f32>(unpack2x16float(atlas_chroma[word + 2u]), unpack2x16float(atlas_chroma[word + 3u]));
    }
    var noise = vec2<f32>(0.0);
    for (var band = 0; band < 4; band++) {
        noise += vec2<f32>(blue[band] * amplitude(6 + band, low, high), red[band] * amplitude(10 + band, low, high));
    }
    return share * factor * noise;
}
