// How a picture was coded (src/coding/), over the region that is coded anew. The region begins on
// the grid of the coding's blocks, and its sides are multiples of 16 px.
struct Coding {
    // R'G'B' to Y', Cb and Cr, on the scale of 8-bit codes; w is the level of black or no colour.
    luma: vec4<f32>,
    blue: vec4<f32>,
    red: vec4<f32>,
    // Y', Cb and Cr, less that level, to R'G'B'.
    from_luma: vec4<f32>,
    from_blue: vec4<f32>,
    from_red: vec4<f32>,
    // Weights of the pixels of a chroma sample, from the one before its first.
    taps_across: vec4<f32>,
    taps_down: vec4<f32>,
    // Part of the region within the picture, px: x0, y0, x1, y1. Decoders repeat its rim.
    inside: vec4<i32>,
    region: vec2<i32>,      // size of the region, px
    factor: vec2<i32>,      // luma samples per chroma sample, across and down
    tile_count: u32,
    groups_in_row: u32,
}
