// The thin lens of a picture, and how it divides work by the size of circles (src/effects/depth_of_field/layered.rs).
struct Lens {
    size: vec4<i32>,      // layer width and height (px), tile side (px), columns of tiles
    circle: vec4<f32>,    // fx · diameter (px·m), 1 / focus distance (1/m), the shape's variance, largest diameter drawn (px)
    texture: vec4<f32>,   // 1 / size of the textures of the layer (1/px), steps of the blur factor (Wang), tiles that a circle reaches to each side
}

// Where there is no surface: the nearest circle, and less it the farthest.
const NOTHING: f32 = 60000.0;
// Radii from which half, a quarter, an eighth of the resolution is enough (px).
const HALF_PX: f32 = 2.8;
const QUARTER_PX: f32 = 8.0;
const EIGHTH_PX: f32 = 32.0;
// Radii up to which four points are enough (px).
const FEW_PX: f32 = 1.6;
// The same where two surfaces are behind each other, which costs more.
const TWO_HALF_PX: f32 = 2.5;
const TWO_QUARTER_PX: f32 = 16.0;
// Radii up to which 16 and 32 points are enough there (px).
const TWO_16_PX: f32 = 4.5;
const TWO_32_PX: f32 = 6.5;
// Circles below this are points (px).
const SHARP_PX: f32 = 0.7;

fn level_of(radius: f32) -> f32 {
    return select(0.0, 1.0, radius >= HALF_PX) + select(0.0, 1.0, radius >= QUARTER_PX) + select(0.0, 1.0, radius >= EIGHTH_PX);
}

fn level_of_two(radius: f32) -> f32 {
    return 1.0 + select(0.0, 1.0, radius >= TWO_QUARTER_PX) + select(0.0, 1.0, radius >= EIGHTH_PX);
}

// vSLRcam (8) in pixels: fx · D · (1/d_s − 1/d_o).
fn circle_of(depth: f32) -> f32 {
    return clamp(lens.circle.x * (lens.circle.y - 1.0 / max(depth, 1e-6)), -lens.circle.w, lens.circle.w);
}
