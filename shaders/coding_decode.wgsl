// Decodes the coded samples to R'G'B' codes as the frame's decoder did (src/coding/), and mixes
// them by their share. Pixels that nothing virtual changes keep the camera's codes.
// @import shared/fullscreen
// @import shared/coding

// The decoder: its upsampling of chroma and its arithmetic.
const ZUNE: u32 = 0u;
const LIBJPEG: u32 = 1u;
const NEAREST: u32 = 2u;
const SWSCALE: u32 = 3u;
// No coding.
const UNROUNDED: u32 = 4u;
override decoder: u32 = 0u;
// Whether noise was added to the planes.
override noisy: bool = false;

@group(0) @binding(0) var<uniform> coding: Coding;
@group(0) @binding(1) var uncoded: texture_2d<f32>;
@group(0) @binding(2) var camera: texture_2d<u32>;
@group(0) @binding(3) var<storage, read> samples: array<u32>;
// Rectangles of the target: x0, y0, x1, y1.
@group(0) @binding(4) var<storage, read> parts: array<vec4<i32>>;
struct Placement {
    made_size: vec2<i32>,
    in_region: vec2<i32>,   // the target's origin in the region
    in_camera: vec2<i32>,   // and in the camera's texture
}
@group(0) @binding(5) var<uniform> placement: Placement;

// The integers of SWSCALE (src/coding/swscale.rs).
struct Scaler {
    // Weights across, of the first and of the second pixel of a chroma sample, and down.
    across: array<vec4<i32>, 2>,
    down: array<vec4<i32>, 2>,
    // The first weight's sample relative to the pixel's own, for both pixels.
    first_across: vec2<i32>,
    first_down: vec2<i32>,
    // Factors of Cr in R', of Cb and Cr in G', and of Cb in B'.
    chroma: vec4<i32>,
    black: i32,
    luma: i32,
}
@group(0) @binding(6) var<uniform> scaler: Scaler;

// Noise of Y', and of Cb and Cr.
@group(0) @binding(7) var luma_noise: texture_2d<f32>;
@group(0) @binding(8) var chroma_noise: texture_2d<f32>;

@vertex
fn part(@builtin(vertex_index) vertex: u32, @builtin(instance_index) instance: u32) -> @builtin(position) vec4<f32> {
    return corner_of(parts[instance], vertex, vec2<f32>(placement.made_size));
}

fn luma_at(at: vec2<i32>) -> i32 {
    let i = u32(at.y * coding.region.x + at.x);
    return i32((samples[i >> 2u] >> (8u * (i & 3u))) & 255u);
}

// Cb and Cr of a sample.
fn chroma_at(at: vec2<i32>) -> vec2<i32> {
    let p = clamp(at, coding.inside.xy / coding.factor, (coding.inside.zw - 1) / coding.factor);
    let size = coding.region / coding.factor;
    let i = u32(p.y * size.x + p.x);
    let blue = u32(coding.region.x * coding.region.y) + i;
    let red = blue + u32(size.x * size.y);
    return vec2<i32>(
        i32((samples[blue >> 2u] >> (8u * (blue & 3u))) & 255u),
        i32((samples[red >> 2u] >> (8u * (red & 3u))) & 255u),
    );
}

// Cb and Cr at a pixel. Interpolating decoders weigh the sample of the pixel 3 to 1 against the
// nearest other along each axis.
fn upsampled(p: vec2<i32>) -> vec2<i32> {
    let own = p / coding.factor;
    if decoder == NEAREST || all(coding.factor == vec2<i32>(1)) {
        return chroma_at(own);
    }
    let is_second = (p % coding.factor) != vec2<i32>(0);
    let other = own + select(vec2<i32>(-1), vec2<i32>(1), is_second);
    let beside = vec2<i32>(other.x, own.y);
    let below = vec2<i32>(own.x, other.y);
    if coding.factor.y == 1 {
        let rounding = select(2, select(1, 2, is_second.x), decoder == LIBJPEG);
        return (3 * chroma_at(own) + chroma_at(beside) + rounding) >> vec2<u32>(2u);
    }
    if coding.factor.x == 1 {
        let rounding = select(2, select(1, 2, is_second.y), decoder == LIBJPEG);
        return (3 * chroma_at(own) + chroma_at(below) + rounding) >> vec2<u32>(2u);
    }
    let near = 3 * chroma_at(own) + chroma_at(below);
    let far = 3 * chroma_at(beside) + chroma_at(other);
    if decoder == LIBJPEG {
        return (3 * near + far + select(8, 7, is_second.x)) >> vec2<u32>(4u);
    }
    return (3 * ((near + 2) >> vec2<u32>(2u)) + ((far + 2) >> vec2<u32>(2u)) + 2) >> vec2<u32>(2u);
}

// Cb and Cr at a pixel by SWSCALE, in units of 2⁻¹⁹ codes.
fn scaled(p: vec2<i32>) -> vec2<i32> {
    let phase = p % coding.factor;
    let own = p / coding.factor;
    let first = own + vec2<i32>(scaler.first_across[phase.x], scaler.first_down[phase.y]);
    let across = scaler.across[phase.x];
    let down = scaler.down[phase.y];
    var sum = vec2<i32>(0);
    for (var row = 0; row < 4; row++) {
        let at = first + vec2<i32>(0, row);
        let wide = across.x * chroma_at(at) + across.y * chroma_at(at + vec2<i32>(1, 0))
            + across.z * chroma_at(at + vec2<i32>(2, 0)) + across.w * chroma_at(at + vec2<i32>(3, 0));
        sum += down[row] * min(wide >> vec2<u32>(7u), vec2<i32>(32767));
    }
    return sum;
}

fn scaled_rgb(p: vec2<i32>) -> vec3<i32> {
    let c = (scaled(p) + 512 - (128 << 19u)) >> vec2<u32>(10u);
    let light = ((luma_at(p) - scaler.black) << 9u) * scaler.luma + (1 << 21u);
    let sum = light + vec3<i32>(
        scaler.chroma.x * c.y,
        scaler.chroma.y * c.x + scaler.chroma.z * c.y,
        scaler.chroma.w * c.x,
    );
    return clamp(sum, vec3<i32>(0), vec3<i32>((1 << 30u) - 1)) >> vec3<u32>(22u);
}

fn rgb_of(y: i32, chroma: vec2<i32>) -> vec3<i32> {
    let c = chroma - vec2<i32>(vec2<f32>(coding.blue.w, coding.red.w));
    if decoder == ZUNE {
        // In units of 2⁻¹⁴, rounded with a little less than a half.
        let light = 16384 * y + 8191;
        return vec3<i32>(light + 22970 * c.y, light - 5638 * c.x - 11700 * c.y, light + 29032 * c.x) >> vec3<u32>(14u);
    }
    if decoder == LIBJPEG {
        let half = 32768;
        return y + (vec3<i32>(91881 * c.y + half, half - 22554 * c.x - 46802 * c.y, 116130 * c.x + half) >> vec3<u32>(16u));
    }
    let light = f32(y) - coding.luma.w;
    let rgb = light * coding.from_luma + f32(c.x) * coding.from_blue + f32(c.y) * coding.from_red;
    return vec3<i32>(floor(rgb.rgb + 0.5));
}

@fragment
fn main(@builtin(position) at: vec4<f32>) -> @location(0) vec4<u32> {
    let q = vec2<i32>(at.xy);
    let p = q + placement.in_region;
    let own = textureLoad(uncoded, p, 0);
    if own.a == 0.0 {
        return textureLoad(camera, q + placement.in_camera, 0);
    }
    var content = own.rgb;
    if noisy && (own.a < 1.0 || decoder == UNROUNDED) {
        let n = textureLoad(chroma_noise, p / coding.factor, 0).xy;
        let rgb = textureLoad(luma_noise, p, 0).x * coding.from_luma + n.x * coding.from_blue + n.y * coding.from_red;
        content += rgb.rgb;
    }
    if decoder == UNROUNDED {
        return vec4<u32>(vec3<u32>(clamp(floor(content + 0.5), vec3<f32>(0.0), vec3<f32>(255.0))), 255u);
    }
    var codes: vec3<i32>;
    if decoder == SWSCALE {
        codes = scaled_rgb(p);
    } else {
        codes = clamp(rgb_of(luma_at(p), upsampled(p)), vec3<i32>(0), vec3<i32>(255));
    }
    let coded = vec3<f32>(codes);
    let rgb = select(mix(content, coded, own.a), coded, own.a == 1.0);
    return vec4<u32>(vec3<u32>(clamp(floor(rgb + 0.5), vec3<f32>(0.0), vec3<f32>(255.0))), 255u);
}
