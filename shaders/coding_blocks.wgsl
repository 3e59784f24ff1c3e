// Codes the 8×8 blocks of Y', Cb and Cr: forward DCT, quantiser, and the inverse DCT of the decoder
// in its integers. Without quantisation the samples are rounded to 8 bits.
//
// Forward and inverse DCT: ITU-T T.81, A.3.3. The inverse is the factorisation of Loeffler,
// Ligtenberg and Moschytz 1989 in fixed point, columns first, as in both decoders.
// @import shared/coding

override quantized: bool = true;
// Whether noise is added to luma; that of chroma is in it already.
override noisy: bool = false;
// Bits of the inverse DCT's factors, and the bias before the last shift, besides a half.
override factor_bits: u32 = 12u;
// Added to the magnitude of a negative factor before it is rounded down: ½ rounds to the nearest,
// as in libjpeg. The other decoder adds ½ to the negative number and drops its fraction.
override negative_half: f32 = -0.5;
override last_bias: i32 = 512;

@group(0) @binding(0) var<uniform> coding: Coding;
// R'G'B' on the scale of 8-bit codes, not clipped.
@group(0) @binding(1) var uncoded: texture_2d<f32>;
// Cb and Cr.
@group(0) @binding(2) var chroma: texture_2d<f32>;
// Upper left corners of the tiles of 16×16 px that are coded, in the region.
@group(0) @binding(3) var<storage, read> tiles: array<vec2<i32>>;
// Quantisation tables of Y', Cb and Cr, row by row.
@group(0) @binding(4) var<storage, read> quantizers: array<f32, 192>;
// Decoded samples of Y', Cb and Cr, four in a word, row by row.
@group(0) @binding(5) var<storage, read_write> samples: array<u32>;
// Noise of Y'.
@group(0) @binding(6) var luma_noise: texture_2d<f32>;

// Eight blocks; each thread has a row, then a column of one.
var<workgroup> coefficients: array<f32, 512>;
var<workgroup> columns: array<i32, 512>;

struct Block {
    component: u32,
    corner: vec2<i32>,  // in the component's samples
}

// The n-th block: for each tile four blocks of luma, then those of Cb, then those of Cr.
fn block_at(n: u32) -> Block {
    let across = 2u / u32(coding.factor.x);
    let of_chroma = across * (2u / u32(coding.factor.y));
    let per_tile = 4u + 2u * of_chroma;
    let tile = tiles[n / per_tile];
    let i = n % per_tile;
    if i < 4u {
        return Block(0u, tile + 8 * vec2<i32>(vec2<u32>(i & 1u, i >> 1u)));
    }
    let j = (i - 4u) % of_chroma;
    return Block(1u + (i - 4u) / of_chroma, tile / coding.factor + 8 * vec2<i32>(vec2<u32>(j % across, j / across)));
}

fn block_count() -> u32 {
    return coding.tile_count * (4u + 8u / u32(coding.factor.x * coding.factor.y));
}

// A sample, rounded to 8 bits.
fn sample_at(component: u32, at: vec2<i32>) -> f32 {
    var value: f32;
    if component == 0u {
        value = dot(coding.luma.rgb, textureLoad(uncoded, at, 0).rgb) + coding.luma.w;
        if noisy {
            value += textureLoad(luma_noise, at, 0).x;
        }
    } else {
        let pair = textureLoad(chroma, at, 0).xy;
        value = select(pair.x, pair.y, component == 2u);
    }
    return clamp(floor(value + 0.5), 0.0, 255.0);
}

// Number of the word that has a sample and the three after it.
fn word_of(component: u32, at: vec2<i32>) -> u32 {
    if component == 0u {
        return u32(at.y * coding.region.x + at.x) / 4u;
    }
    let size = coding.region / coding.factor;
    let before = coding.region.x * coding.region.y + (i32(component) - 1) * size.x * size.y;
    return u32(before + at.y * size.x + at.x) / 4u;
}

fn pack(v: vec4<i32>) -> u32 {
    let c = vec4<u32>(clamp(v, vec4<i32>(0), vec4<i32>(255)));
    return c.x | (c.y << 8u) | (c.z << 16u) | (c.w << 24u);
}

struct Eight { low: vec4<f32>, high: vec4<f32> }

// The forward DCT of eight values, times √8, by its even and odd halves:
// X_u = a_u Σ x_i cos((2i + 1) u π / 16), a_0 = 1, else √2. Frequencies 0 and 4 of whole numbers
// are exact, so that halves of a step are rounded as an encoder rounds them.
fn forward(x: Eight) -> Eight {
    let turned = x.high.wzyx;
    let e = x.low + turned;
    let o = x.low - turned;
    // √2 cos(kπ/16).
    let c1 = 1.387039845;
    let c2 = 1.306562965;
    let c3 = 1.175875602;
    let c5 = 0.785694958;
    let c6 = 0.541196100;
    let c7 = 0.275899379;
    return Eight(
        vec4<f32>(
            e.x + e.y + e.z + e.w,
            dot(o, vec4<f32>(c1, c3, c5, c7)),
            dot(e, vec4<f32>(c2, c6, -c6, -c2)),
            dot(o, vec4<f32>(c3, -c7, -c1, -c5)),
        ),
        vec4<f32>(
            e.x - e.y - e.z + e.w,
            dot(o, vec4<f32>(c5, -c1, c7, c3)),
            dot(e, vec4<f32>(c6, -c2, c2, -c6)),
            dot(o, vec4<f32>(c7, -c5, c3, -c1)),
        ),
    );
}

struct EightInts { low: vec4<i32>, high: vec4<i32> }

fn fixed(x: f32) -> i32 {
    return i32(floor(x * f32(1u << factor_bits) + 0.5));
}

// The magnitude of a negative factor.
fn fixed_negative(x: f32) -> i32 {
    return i32(floor(x * f32(1u << factor_bits) + negative_half));
}

// The inverse DCT of eight values, times 2^factor_bits and √8. `bias` is added to every result
// before the shift.
fn inverse(v: EightInts, bias: i32, shift: u32) -> EightInts {
    // Even part.
    let turn = (v.low.z + v.high.z) * fixed(0.541196100);
    let t2 = turn - v.high.z * fixed_negative(1.847759065);
    let t3 = turn + v.low.z * fixed(0.765366865);
    let t0 = (v.low.x + v.high.x) << factor_bits;
    let t1 = (v.low.x - v.high.x) << factor_bits;
    let even = vec4<i32>(t0 + t3, t1 + t2, t1 - t2, t0 - t3) + bias;
    // Odd part.
    let x7 = v.high.w;
    let x5 = v.high.y;
    let x3 = v.low.w;
    let x1 = v.low.y;
    let all = (x7 + x3 + x5 + x1) * fixed(1.175875602);
    let z1 = -(x7 + x1) * fixed_negative(0.899976223);
    let z2 = -(x5 + x3) * fixed_negative(2.562915447);
    let z3 = all - (x7 + x3) * fixed_negative(1.961570560);
    let z4 = all - (x5 + x1) * fixed_negative(0.390180644);
    let odd = vec4<i32>(
        x1 * fixed(1.501321110) + z1 + z4,
        x3 * fixed(3.072711026) + z2 + z3,
        x5 * fixed(2.053119869) + z2 + z4,
        x7 * fixed(0.298631336) + z1 + z3,
    );
    return EightInts((even + odd) >> vec4<u32>(shift), (even - odd).wzyx >> vec4<u32>(shift));
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let first = (group.y * coding.groups_in_row + group.x) * 8u;
    let line = i32(local & 7u);
    let start = (local >> 3u) * 64u;
    let number = first + (local >> 3u);
    let counted = number < block_count();
    let block = block_at(min(number, block_count() - 1u));
    let corner = block.corner + vec2<i32>(0, line);
    var row: Eight;
    row.low = vec4<f32>(
        sample_at(block.component, corner),
        sample_at(block.component, corner + vec2<i32>(1, 0)),
        sample_at(block.component, corner + vec2<i32>(2, 0)),
        sample_at(block.component, corner + vec2<i32>(3, 0)),
    );
    row.high = vec4<f32>(
        sample_at(block.component, corner + vec2<i32>(4, 0)),
        sample_at(block.component, corner + vec2<i32>(5, 0)),
        sample_at(block.component, corner + vec2<i32>(6, 0)),
        sample_at(block.component, corner + vec2<i32>(7, 0)),
    );
    var decoded = EightInts(vec4<i32>(row.low), vec4<i32>(row.high));
    if quantized {
        let along = forward(Eight(row.low - 128.0, row.high - 128.0));
        for (var i = 0u; i < 4u; i++) {
            coefficients[start + u32(line) * 8u + i] = along.low[i];
            coefficients[start + u32(line) * 8u + 4u + i] = along.high[i];
        }
        workgroupBarrier();
        let c = start + u32(line);
        let down = forward(Eight(
            vec4<f32>(coefficients[c], coefficients[c + 8u], coefficients[c + 16u], coefficients[c + 24u]),
            vec4<f32>(coefficients[c + 32u], coefficients[c + 40u], coefficients[c + 48u], coefficients[c + 56u]),
        ));
        let q = block.component * 64u + u32(line);
        let low_step = vec4<f32>(quantizers[q], quantizers[q + 8u], quantizers[q + 16u], quantizers[q + 24u]);
        let high_step = vec4<f32>(quantizers[q + 32u], quantizers[q + 40u], quantizers[q + 48u], quantizers[q + 56u]);
        let low = sign(down.low) * floor(0.125 * abs(down.low) / low_step + 0.5) * low_step;
        let high = sign(down.high) * floor(0.125 * abs(down.high) / high_step + 0.5) * high_step;
        // Two more bits than whole codes.
        let shift = factor_bits - 2u;
        let column = inverse(EightInts(vec4<i32>(low), vec4<i32>(high)), 1 << (shift - 1u), shift);
        for (var i = 0u; i < 4u; i++) {
            columns[c + 8u * i] = column.low[i];
            columns[c + 8u * (4u + i)] = column.high[i];
        }
        workgroupBarrier();
        let r = start + u32(line) * 8u;
        let last = factor_bits + 5u;
        let bias = (1 << (last - 1u)) + (128 << last) + last_bias;
        decoded = inverse(EightInts(
            vec4<i32>(columns[r], columns[r + 1u], columns[r + 2u], columns[r + 3u]),
            vec4<i32>(columns[r + 4u], columns[r + 5u], columns[r + 6u], columns[r + 7u]),
        ), bias, last);
    }
    if counted {
        let word = word_of(block.component, corner);
        samples[word] = pack(decoded.low);
        samples[word + 1u] = pack(decoded.high);
    }
}
