// The thin lens of a picture, and the resolution of work by the size of circles
// (src/effects/depth_of_field/layered.rs).
struct Lens {
    size: vec2<i32>,          // of the layer, px
    texel: vec2<f32>,         // 1 / size of the textures of the layer, 1/px
    side_px: i32,             // of a tile
    columns: i32,             // of tiles
    fx_diameter: f32,         // fx · diameter, px·m
    per_focus: f32,           // 1 / focus distance, 1/m
    variance: f32,            // the shape's
    largest_px: f32,          // diameter drawn
    steps: f32,               // of the blur factor (Wang)
    reach_tiles: f32,         // tiles to each side that a circle reaches
}

// The nearest circle where there is no surface; the farthest is minus this.
const NOTHING: f32 = 60000.0;
// Radii from which on half, a quarter, an eighth, a sixteenth of the resolution is enough (px).
const HALF_PX: f32 = 2.8;
const QUARTER_PX: f32 = 8.0;
const EIGHTH_PX: f32 = 32.0;
const SIXTEENTH_PX: f32 = 64.0;
// Largest radius at which texels of half the resolution are sampled where a quarter is drawn (px).
const FINER_PX: f32 = 16.0;
// Radii up to which four points are enough (px).
const FINE_CIRCLE_PX: f32 = 1.6;
// HALF_PX where two surfaces lie behind each other, which costs more.
const TWO_HALF_PX: f32 = 2.5;
// Circles below this are points (px).
const SHARP_PX: f32 = 0.7;

fn level_of_two(radius: f32) -> f32 {
    let over = vec3<bool>(radius >= QUARTER_PX, radius >= EIGHTH_PX, radius >= SIXTEENTH_PX);
    return 1.0 + dot(select(vec3<f32>(0.0), vec3<f32>(1.0), over), vec3<f32>(1.0));
}

fn level_of(radius: f32) -> f32 {
    return select(0.0, level_of_two(radius), radius >= HALF_PX);
}

// The largest radius that is sampled at a level, plus a margin for neighbouring texels (px).
fn max_radius_of_level(level: i32) -> f32 {
    return 1.25 * select(select(select(1e6, SIXTEENTH_PX, level < 4), EIGHTH_PX, level < 3), QUARTER_PX, level < 2);
}

// Whether a range of circles belongs to one surface. A receding surface counts as one as long as
// its circles differ invisibly.
fn is_one_surface(near: f32, far: f32) -> bool {
    return far - near < 1.5 + 0.3 * smallest_radius(near, far);
}

fn smallest_radius(near: f32, far: f32) -> f32 {
    return select(0.0, 0.5 * min(abs(near), abs(far)), near * far > 0.0);
}

// vSLRcam (8) in pixels: fx · D · (1/d_s − 1/d_o).
fn circle_of(depth: f32) -> f32 {
    return clamp(lens.fx_diameter * (lens.per_focus - 1.0 / max(depth, 1e-6)), -lens.largest_px, lens.largest_px);
}
