// Noise by example (src/example_noise/) over a region that begins on the coded picture's grid.
struct Example {
    extent: vec4<i32>,      // the coded picture, px of the region: x0, y0, x1, y1
    first_cell: vec2<i32>,
    cells: vec2<i32>,       // cells across and down that the region needs
    region: vec2<i32>,      // its size, px
    factor: vec2<i32>,      // luma px per chroma sample
    // Hash keys of this frame and of the resting frames before it
    // (src/example_noise/persistence.rs).
    keys: array<vec4<u32>, 16>,
    key_count: u32,
    kept_below: u32,
    unused: vec2<u32>,
    // First candidate of each class, then their numbers.
    classes: array<vec4<u32>, 2>,
    // Latent R', G' and B' of each node, and the node.
    latent: array<vec4<f32>, 20>,
    // Seven features each: lowest and highest value, mean, reciprocal of the deviation.
    features: array<vec4<f32>, 8>,
    // Eight coefficients of each of the 14 bands.
    gains: array<vec4<f32>, 28>,
    // Five numbers of the descriptor each: lowest and highest, mean, reciprocal of the deviation.
    descriptors: array<vec4<f32>, 8>,
}

// Distance and overlap of cells, and the side of their tiles, luma px.
const CELL_PX: i32 = 64;
const OVERLAP_PX: i32 = 16;
const TILE_PX: i32 = 80;

// Brightness of the content, codes.
fn brightness_of(rgb: vec3<f32>) -> f32 {
    return dot(clamp(rgb, vec3<f32>(0.0), vec3<f32>(255.0)), vec3<f32>(0.25, 0.5, 0.25));
}
