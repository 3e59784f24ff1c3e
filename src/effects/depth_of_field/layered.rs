//! The method `layered` on the GPU.
//!
//! 1. Pyramid: the layer at a half, a quarter and so on, with the range of circles in each texel.
//! 2. Tiles, at least a third as wide as circles reach (16 px in photographs). The circles that
//!    reach into a tile, and the surfaces visible through them, determine its kind: empty; copied;
//!    one surface with small circles (4 or 12 points of the aperture at full resolution) or with
//!    large ones (all texels of the aperture's image at a half, a quarter and so on); two surfaces
//!    behind each other, in separate layers until the end.
//! 3. Lower resolutions, only in the tiles that need them.
//! 4. The layer's own resolution, which uses the results of 3.
//!
//! Texels are weighted by their share of the aperture's image (`image`), and linear interpolation
//! distributes all of each texel's light: energy is conserved. The blur that these steps add is
//! subtracted from the image's size, so that the width of edges is the aperture's.

use crate::camera::Opening;
use crate::effects::{FrameContext, LayerRun};
use crate::gpu::{Bytes, Pass, PassRecorder, Shader, ShaderEntry, Texture};
use crate::render::{COLOR, GEOMETRY, Layer};

use super::highlights;
use super::image::{self, Blades};
use super::settings::{MAX_CIRCLE_PX, circles_px};
use super::surroundings::{LensUniform, PHOTOGRAPHS_TILE_PX, Tiling};

/// Nearest and farthest circle.
const CIRCLES: wgpu::TextureFormat = wgpu::TextureFormat::Rg16Float;
/// Number of lower resolutions (a half and so on), and number of those that are drawn.
const LEVELS: u32 = 4;
const DRAWN: usize = 4;
/// Radii from which half, a quarter and so on of the resolution may be needed, px. The same as in
/// shaders/shared/lens.wgsl; a test compares them.
const FROM_PX: [f32; DRAWN] = [2.5, 8.0, 32.0, 64.0];

/// Largest diameter that is drawn, px: a quarter of the picture at most.
fn max_circle_px(context: &FrameContext<'_>) -> f32 {
    let i = &context.picture.intrinsics;
    (i.width_px.max(i.height_px) as f32 / 4.0).min(MAX_CIRCLE_PX)
}

/// The largest radius drawn, px.
pub fn largest_radius_px(context: &FrameContext<'_>) -> f32 {
    0.5 * circles_px(context)[1].min(max_circle_px(context))
}

/// Distance to which light spreads, px: the largest radius, plus the texels that are read there, at
/// most half as wide.
pub fn reach_px(context: &FrameContext<'_>) -> f32 {
    1.5 * largest_radius_px(context) + 3.0
}

/// Radius over which pixels are read, px. In a photograph, tiles next to a part must equal those of
/// the next part, with all that reaches them.
pub fn read_px(context: &FrameContext<'_>) -> f32 {
    let tile_px = if context.capture.whole { PHOTOGRAPHS_TILE_PX as f32 } else { 0.0 };
    reach_px(context) + 2.0 * tile_px
}

/// Whether everything drawn counts as one surface in a tile: `is_one_surface` of
/// shaders/shared/lens.wgsl.
fn is_one_surface(context: &FrameContext<'_>) -> bool {
    let Some(opening) = context.capture.opening else { return true };
    let [near, far] = context.depths_m.map(|depth| opening.circle_px(context.picture.intrinsics.fx_px, depth) as f32);
    (far - near).abs() < 1.5 + 0.3 * 0.5 * circles_px(context)[0]
}

/// The lower resolution at which a radius is gathered.
fn level_of(radius: f32) -> usize {
    FROM_PX.iter().filter(|&&from| radius >= from).count()
}

/// Sharp, few points, more points, one lower resolution, any of them, two surfaces: vertex entry,
/// fragment entry, points.
const KINDS: [(&str, &str, f64); 6] = [
    ("sharp_tiles", "sharp", 4.0),
    ("fine_tiles", "fine", 4.0),
    ("wider_tiles", "fine", 12.0),
    ("coarse_tiles", "coarse", 4.0),
    ("any_tiles", "any_circles", 12.0),
    ("two_deep_tiles", "two_deep", 4.0),
];

/// An entry of the gathering shader, at a level of resolution with this number of points.
fn gather(vertex: &'static str, fragment: &'static str, level: usize, taps: f64) -> ShaderEntry {
    ShaderEntry::with_vertex(vertex, fragment).choose("level", level as f64).choose("taps", taps)
}

/// The inputs of gathering.
struct Gathering {
    lens: LensUniform,
    aperture: Bytes,
    tiles: Texture,
    count: u32,
    corners: Texture,
    layer: [Texture; 2],
    smaller: [Texture; 2],
    highlights: wgpu::Buffer,
}

impl Gathering {
    /// A pass over its tiles. `lower` are the results of lower resolutions: the picture, and in
    /// tiles with two surfaces the nearer and the farther one.
    fn pass<'a>(&self, recorder: &'a mut PassRecorder, entry: ShaderEntry, lower: [&Texture; 3]) -> Pass<'a> {
        recorder
            .pass(Shader::DepthOfField, entry)
            .uniform("lens", &self.lens)
            .buffer("aperture", self.aperture.clone())
            .texture("tiles", &self.tiles)
            .texture("corners", &self.corners)
            .texture("color", &self.layer[0])
            .texture("geometry", &self.layer[1])
            .texture("colors", &self.smaller[0])
            .texture("circles", &self.smaller[1])
            .texture("blurred", lower[0])
            .texture("blurred_front", lower[1])
            .texture("blurred_back", lower[2])
            .buffer("highlights", &self.highlights)
            .tiles(self.count)
    }
}

pub fn run(run: &mut LayerRun<'_>, opening: &Opening, layer: Layer) -> Layer {
    let context = run.context;
    let (width, height) = layer.size;
    let largest = largest_radius_px(context);
    let tiling = if context.capture.whole {
        Tiling::of_photograph(layer.size, reach_px(context))
    } else {
        Tiling::fine(layer.size, reach_px(context), is_one_surface(context))
    };
    let tiles = tiling.tiles;
    let count = tiles.0 * tiles.1;

    let recorder = &run.recorder;
    // One texel larger than the layer at the lowest resolution, and empty there, for drivers that
    // repeat the outermost texel beyond the border.
    let more = (width + (1 << LEVELS), height + (1 << LEVELS));
    let colors = recorder.pool.lend_pyramid(&recorder.gpu, more, COLOR, LEVELS);
    let circles = recorder.pool.lend_pyramid(&recorder.gpu, more, CIRCLES, LEVELS);
    let blurred: [_; 3] =
        std::array::from_fn(|_| recorder.pool.lend_pyramid(&recorder.gpu, layer.size, COLOR, DRAWN as u32));

    let lens = LensUniform::new(run, opening, &layer, tiling, largest, 0);

    // Highlights are found at the lowest resolution, and removed from all.
    let has_highlights = largest >= highlights::MIN_RADIUS_PX;
    let of_level = |level: usize| (width.div_ceil(2 << level), height.div_ceil(2 << level));
    let highlight_list = highlights::list(run.recorder);
    for (step, level) in (0..LEVELS as usize).chain(if has_highlights { 2..LEVELS as usize } else { 0..0 }).enumerate()
    {
        if step == LEVELS as usize {
            highlights::find(run.recorder, &lens, &layer, [&colors.all, &circles.all], &highlight_list);
            let first_two = [0, 1].map(|level| (&colors.levels[level], of_level(level)));
            highlights::dim(run.recorder, &lens, &highlight_list, first_two);
        }
        let entry = if level == 0 { "first" } else { "next" };
        let pass = run.recorder.pass(Shader::DepthOfFieldPyramid, entry).uniform("lens", &lens);
        let pass = match level.checked_sub(1) {
            None => pass.texture("color", &layer.color).texture("geometry", &layer.geometry),
            Some(l) => pass.texture("color", &colors.levels[l]).texture("circles", &circles.levels[l]),
        };
        pass.draw_into(&[&colors.levels[level], &circles.levels[level]], of_level(level));
    }
    let mut of_tiles = |entry, [before, with]: [&_; 2], size| {
        let pass = run.recorder.pass(Shader::DepthOfFieldTiles, entry).uniform("lens", &lens);
        let [out] = pass.texture("before", before).texture("touched", with).draw([COLOR], size);
        out
    };
    // A pass that reads one texture has it bound as the other too.
    let own = of_tiles("own", [&circles.levels[1]; 2], tiles);
    let touched = of_tiles("touching", [&own; 2], tiles);
    let around = of_tiles("around", [&own, &touched], tiles);
    let needed = of_tiles("needed", [&around; 2], tiles);
    let corners = of_tiles("corners", [&own, &needed], (tiles.0 + 1, tiles.1 + 1));

    let gathering = Gathering {
        lens,
        aperture: run.recorder.memoized(Blades::of(opening), image::buffer),
        tiles: needed,
        count,
        corners,
        layer: [layer.color.clone(), layer.geometry.clone()],
        smaller: [colors.all.clone(), circles.all],
        highlights: highlight_list,
    };
    // A render target cannot be read: at first, other textures are bound as the lower resolutions.
    let nothing = [&colors.all; 3];
    // The shader's circles are rounded to 16 bits, and none is larger than the largest drawn.
    let smallest = (0.5 * circles_px(context)[0]).min(largest);
    for level in 1.max(level_of(0.999 * smallest))..=level_of(1.001 * largest) {
        let size = (width.div_ceil(1 << level), height.div_ceil(1 << level));
        let targets = blurred.each_ref().map(|b| &b.levels[level - 1]);
        gathering
            .pass(run.recorder, gather("level_one_deep_tiles", "level_one_deep", level, 4.0), nothing)
            .also(gather("level_two_deep_tiles", "level_two_deep", level, 4.0))
            .draw_into(&targets, size);
    }
    let lower = blurred.each_ref().map(|b| &b.all);
    let [first, rest @ ..] = KINDS.map(|(vertex, fragment, taps)| gather(vertex, fragment, 0, taps));
    let sharpest = gathering.pass(run.recorder, first, lower);
    let [color] = rest.into_iter().fold(sharpest, Pass::also).draw([COLOR], layer.size);
    if has_highlights {
        let spots = gathering.pass(run.recorder, gather("spot_corner", "spot", 0, 4.0), lower);
        spots.blend(highlights::ADDED).indirect(&gathering.highlights).draw_into(&[&color], layer.size);
    }
    if !run.geometry_is_read {
        return Layer { color, ..layer };
    }
    let passing = gathering.pass(run.recorder, gather("all_tiles", "passing", 0, 4.0), lower);
    let [geometry] = passing.draw([GEOMETRY], layer.size);
    Layer { color, geometry, ..layer }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::constant;

    #[test]
    fn thresholds_equal_the_shaders() {
        let shader = Shader::SharedLens.module();
        let value = |name| constant(&shader, name) as f32;
        let half = value("TWO_HALF_PX").min(value("HALF_PX"));
        assert_eq!(FROM_PX, [half, value("QUARTER_PX"), value("EIGHTH_PX"), value("SIXTEENTH_PX")]);
        assert_eq!(super::super::settings::SHARP_PX, value("SHARP_PX"));
    }
}
