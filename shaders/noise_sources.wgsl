// Sources of the cells of noise by example in its atlas (src/example_noise/{cells,descriptor}.rs):
// a workgroup for each cell.
// @import shared/example_noise
// @import shared/hash

struct Candidate {
    luma: u32,      // its first px in the atlas
    chroma: u32,    // and its first chroma sample
    stride: u32,    // of its frame, px
    descriptor: array<f32, 5>,
}
@group(0) @binding(0) var<uniform> example: Example;
// R'G'B' on the scale of 8-bit codes; alpha is the changed share, 0 where nothing is drawn.
@group(0) @binding(1) var uncoded: texture_2d<f32>;
@group(0) @binding(2) var<storage, read> candidates: array<Candidate>;
// For each cell: first px and first chroma sample in the atlas, stride, mirroring (1 across, 2
// down).
@group(0) @binding(3) var<storage, read_write> sources: array<vec4<u32>>;

const BLOCK_PX: i32 = 8;
const TILE_BLOCKS: i32 = 10;
const SAMPLES: i32 = 4;
const EXPECTED_RANK: u32 = 24u;
const MAX_DRAWS: u32 = 64u;

// Sums of the weights, y, R − G and B − G; then of the pairs' weights and energies.
var<workgroup> colors: array<vec4<f32>, 64>;
var<workgroup> pairs: array<vec2<f32>, 64>;
var<workgroup> descriptor: array<f32, 5>;
var<workgroup> distances: array<f32, 64>;

fn clamped(k: i32, value: f32) -> f32 {
    let i = k & 3;
    let low = example.descriptors[k >> 2u][i];
    let high = example.descriptors[2 + (k >> 2u)][i];
    let mean = example.descriptors[4 + (k >> 2u)][i];
    return (clamp(value, low, high) - mean) * example.descriptors[6 + (k >> 2u)][i];
}

fn add_block(corner: vec2<i32>, local: u32) {
    var above: array<vec2<f32>, 4>;
    for (var j = 0; j < SAMPLES; j++) {
        var before = vec2<f32>(0.0);
        for (var i = 0; i < SAMPLES; i++) {
            let texel = textureLoad(uncoded, corner + 2 * vec2<i32>(i, j), 0);
            let m = clamp(texel.rgb, vec3<f32>(0.0), vec3<f32>(255.0)) / 255.0;
            let own = vec2<f32>(texel.a, brightness_of(texel.rgb) / 255.0);
            colors[local] += texel.a * vec4<f32>(1.0, own.y, m.r - m.g, m.b - m.g);
            let across = 255.0 * (own.y - before.y);
            let down = 255.0 * (own.y - above[i].y);
            let weights = own.x * vec2<f32>(before.x, select(0.0, above[i].x, j > 0));
            pairs[local] += vec2<f32>(weights.x + weights.y, weights.x * across * across + weights.y * down * down);
            above[i] = own;
            before = own;
        }
    }
}

// The key of the frame in which a cell was last refreshed.
fn key_of(cell: vec2<i32>) -> vec3<u32> {
    var key = example.keys[0].xyz;
    for (var age = 1u; age < example.key_count; age++) {
        if pcg3d(vec3<u32>(vec2<u32>(cell), 0u) + key).z >= example.kept_below {
            break;
        }
        key = example.keys[age].xyz;
    }
    return key;
}

fn hash(cell: vec2<i32>, n: u32, key: vec3<u32>) -> vec3<u32> {
    return pcg3d(vec3<u32>(vec2<u32>(cell), n) + key);
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let cell = example.first_cell + vec2<i32>(group.xy);
    let corner = example.extent.xy + CELL_PX * cell - OVERLAP_PX;
    colors[local] = vec4<f32>(0.0);
    pairs[local] = vec2<f32>(0.0);
    for (var n = i32(local); n < TILE_BLOCKS * TILE_BLOCKS; n += 64) {
        let block = corner + BLOCK_PX * vec2<i32>(n % TILE_BLOCKS, n / TILE_BLOCKS);
        let first = max(example.extent.xy, vec2<i32>(0));
        let end = min(example.extent.zw, example.region);
        if all(block >= first) && all(block + BLOCK_PX <= end) {
            add_block(block, local);
        }
    }
    workgroupBarrier();
    if local == 0u {
        var color = vec4<f32>(0.0);
        var pair = vec2<f32>(0.0);
        for (var i = 0; i < 64; i++) {
            color += colors[i];
            pair += pairs[i];
        }
        // The smallest number that a float holds at full precision.
        let smallest = 1.17549435e-38;
        let mean = color.yzw / max(color.x, smallest);
        descriptor[0] = clamped(0, mean.x);
        descriptor[1] = clamped(1, sqrt(max(mean.x, 0.0) + 0.002));
        descriptor[2] = clamped(2, mean.y);
        descriptor[3] = clamped(3, mean.z);
        descriptor[4] = clamped(4, log(0.5 + 0.5 * pair.y / max(pair.x, smallest)));
    }
    workgroupBarrier();
    let parity = u32((cell.x & 1) + 2 * (cell.y & 1));
    let first = example.classes[0][parity];
    let count = example.classes[1][parity];
    let key = key_of(cell);
    let draws = clamp((count + EXPECTED_RANK - 1u) / EXPECTED_RANK, 1u, MAX_DRAWS);
    if local < draws {
        let candidate = first + hash(cell, 1u + local / 3u, key)[local % 3u] % count;
        var distance = 0.0;
        for (var k = 0; k < 5; k++) {
            let d = candidates[candidate].descriptor[k] - descriptor[k];
            distance += d * d;
        }
        distances[local] = distance;
    }
    workgroupBarrier();
    if local == 0u {
        var nearest = 0u;
        for (var i = 1u; i < draws; i++) {
            if distances[i] < distances[nearest] {
                nearest = i;
            }
        }
        let candidate = candidates[first + hash(cell, 1u + nearest / 3u, key)[nearest % 3u] % count];
        let mirror = hash(cell, 0u, key).xy >> vec2<u32>(31u);
        sources[group.y * u32(example.cells.x) + group.x]
            = vec4<u32>(candidate.luma, candidate.chroma, candidate.stride, mirror.x + 2u * mirror.y);
    }
}
