// Highlights, drawn as sprites (src/effects/depth_of_field/highlights.rs).
struct Highlight {
    place: vec4<f32>,   // column and row of its block, share left of the block's light, its circle (px)
    light: vec4<f32>,   // removed light of the block, summed over its pixels; 1 if it is the farther surface's
}
struct Highlights {
    draw: vec4<u32>,    // corners, number of highlights, two zeros: arguments of the indirect draw
    all: array<Highlight>,
}

// Pixels per side of a block: the second level of the pyramid.
const BLOCK_PX: i32 = 4;

fn brightest(light: vec4<f32>) -> f32 {
    return max(light.r, max(light.g, light.b));
}
