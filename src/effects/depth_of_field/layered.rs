//! The method `layered` on the GPU.
//!
//! 1. Pyramid: the layer at a half, a quarter and so on, with the range of circles in each texel.
//! 2. Tiles, a third as wide as circles reach or wider (in photographs 16 px): from the circles that reach into a tile, and all that is seen
//!    through them, follows what is to be done there. Nothing; copying; one surface with small circles (4 or 12 points of the
//!    opening at full resolution) or with large ones (all texels of the opening's image at a half, a quarter and so on); two
//!    surfaces behind each other, kept apart until the end.
//! 3. Lower resolutions, only in the tiles that need them.
//! 4. The layer's own, which picks up 3.
//!
//! Texels weigh by their share of the opening's image (`image`), and straight lines between them share out each one's light in whole:
//! energy is kept. All that these steps blur besides is taken off the image's size, so that the width of edges is the
//! opening's.

use crate::camera::Opening;
use crate::effects::FrameContext;
use crate::gpu::{Binding, FullscreenPass, Gpu, Options, Slot, assemble, run_listed, run_tiles};
use crate::render::{COLOR, GEOMETRY, Layer, LayerRun};

use super::highlights::{self, Highlights};
use super::image;
use super::surroundings::{PHOTOGRAPHS_TILE_PX, Tiling, lens};
use super::{WIDEST_PX, circles_px};

/// Nearest and farthest circle.
const CIRCLES: wgpu::TextureFormat = wgpu::TextureFormat::Rg16Float;
/// The lower resolutions: a half and so on; and how many of them are drawn at.
const LEVELS: u32 = 4;
const DRAWN: usize = 4;
/// From which radii half, a quarter and so on of the resolution may be asked for, px. As in shaders/shared/lens.wgsl; a test
/// compares them.
const FROM_PX: [f32; DRAWN] = [2.5, 8.0, 32.0, 64.0];

#[derive(Debug)]
pub struct Passes {
    pyramid: [FullscreenPass; 2],
    /// Of each tile; how far away it is touched from; of it and those around; with what those need; their corners.
    tiles: [FullscreenPass; 5],
    /// At each lower resolution for one surface, and for two.
    levels: [[FullscreenPass; 2]; DRAWN],
    /// At the layer's resolution, for each kind of tile.
    full: [FullscreenPass; 6],
    passing: FullscreenPass,
    highlights: Highlights,
    spot: FullscreenPass,
    between: wgpu::Sampler,
    /// The last that was looked through; it seldom changes.
    shape: Option<Shape>,
}

/// What hangs on the opening's blades alone, and not on its size or focus.
#[derive(Debug)]
struct Shape {
    blades: u32,
    rotation_rad: f64,
    image: wgpu::Buffer,
}

impl Shape {
    fn new(gpu: &Gpu, opening: &Opening) -> Self {
        Self { blades: opening.blades, rotation_rad: opening.rotation_rad, image: image::buffer(gpu, opening) }
    }

    fn is_of(&self, opening: &Opening) -> bool {
        (self.blades, self.rotation_rad) == (opening.blades, opening.rotation_rad)
    }
}

/// No circle is drawn wider than a quarter of the picture.
fn widest_px(context: &FrameContext<'_>) -> f32 {
    let i = &context.geometry.intrinsics;
    (i.width_px.max(i.height_px) as f32 / 4.0).min(WIDEST_PX)
}

/// Of what is drawn, px.
pub fn largest_radius_px(context: &FrameContext<'_>) -> f32 {
    0.5 * circles_px(context)[1].min(widest_px(context))
}

/// How far light is spread: by the largest radius, and by the texels that are looked up there, at most half as wide.
pub fn reach_px(context: &FrameContext<'_>) -> f32 {
    1.5 * largest_radius_px(context) + 3.0
}

/// How far is looked: in a photograph the tiles beside a part are to be those of the next one, with all that they see.
pub fn look_px(context: &FrameContext<'_>) -> f32 {
    let tile_px = if context.photograph.is_some() { PHOTOGRAPHS_TILE_PX as f32 } else { 0.0 };
    reach_px(context) + 2.0 * tile_px
}

/// Whether all that is drawn is one surface to a tile: `is_one_surface` of shaders/shared/lens.wgsl.
fn is_one_surface(context: &FrameContext<'_>) -> bool {
    let Some(opening) = context.opening else { return true };
    let [near, far] = context.depths_m.map(|depth| opening.circle_px(context.geometry.intrinsics.fx_px, depth) as f32);
    (far - near).abs() < 1.5 + 0.3 * 0.5 * circles_px(context)[0]
}

/// The lower resolution at which a radius is gathered.
fn level_of(radius: f32) -> usize {
    FROM_PX.iter().filter(|&&from| radius >= from).count()
}

impl Passes {
    pub fn new(gpu: &Gpu) -> Self {
        use Binding::{Floats, Integers, Sampler, Storage, Uniform};
        let pyramid = |(fragment, ranges)| {
            let options = Options { fragment, bindings: &[Uniform, Floats, ranges], ..Options::default() };
            FullscreenPass::with(gpu, "pyramid", &assemble("depth_of_field_pyramid"), &[COLOR, CIRCLES], &options)
        };
        let tiles = |fragment| {
            let options = Options { fragment, bindings: &[Uniform, Floats, Floats], ..Options::default() };
            FullscreenPass::with(gpu, "circles of tiles", &assemble("depth_of_field_tiles"), &[COLOR], &options)
        };
        let bindings = [
            Uniform, Uniform, Floats, Floats, Floats, Integers, Floats, Floats, Floats, Floats, Floats, Sampler,
            Storage,
        ];
        let shader = assemble("depth_of_field");
        let gather = |vertex, fragment, level: usize, taps: usize, formats: &[wgpu::TextureFormat]| {
            let constants = [("level", level as f64), ("taps", taps as f64)];
            let options =
                Options { vertex, fragment, constants: &constants, bindings: &bindings, ..Options::default() };
            FullscreenPass::with(gpu, "depth of field", &shader, formats, &options)
        };
        Self {
            pyramid: [("first", Integers), ("next", Floats)].map(pyramid),
            tiles: ["own", "touching", "around", "needed", "corners"].map(tiles),
            levels: std::array::from_fn(|i| {
                [("level_one_deep_tiles", "level_one_deep"), ("level_two_deep_tiles", "level_two_deep")]
                    .map(|(vertex, fragment)| gather(vertex, fragment, i + 1, 4, &[COLOR; 3]))
            }),
            full: [
                ("sharp_tiles", "sharp", 4),
                ("fine_tiles", "fine", 4),
                ("wider_tiles", "fine", 12),
                ("coarse_tiles", "coarse", 4),
                ("any_tiles", "any_circles", 12),
                ("two_deep_tiles", "two_deep", 4),
            ]
            .map(|(vertex, fragment, taps)| gather(vertex, fragment, 0, taps, &[COLOR])),
            highlights: Highlights::new(gpu),
            spot: {
                let constants = [("level", 0.0), ("taps", 4.0)];
                let options = Options {
                    vertex: "spot_corner",
                    fragment: "spot",
                    constants: &constants,
                    bindings: &bindings,
                    blend: Some(highlights::ADDED),
                };
                FullscreenPass::with(gpu, "highlights", &shader, &[COLOR], &options)
            },
            passing: gather("all_tiles", "passing", 0, 4, &[GEOMETRY]),
            between: gpu.linear_sampler(),
            shape: None,
        }
    }

    pub fn run(
        &mut self,
        run: &mut LayerRun<'_>,
        context: &FrameContext<'_>,
        opening: &Opening,
        layer: Layer,
    ) -> Layer {
        let gpu = run.gpu;
        let (width, height) = layer.size;
        let largest = largest_radius_px(context);
        let tiling = match context.photograph {
            None => Tiling::fine(layer.size, reach_px(context), is_one_surface(context)),
            Some(_) => Tiling::of_photograph(layer.size, reach_px(context)),
        };
        let tiles = tiling.tiles;
        let count = tiles.0 * tiles.1;

        let [own, touched, around, needed] = ["own circles", "touched tiles", "circles around", "circles"]
            .map(|purpose| run.pool.get(gpu, purpose, 0, tiles, COLOR, 1));
        // With a texel beside the layer at the lowest resolution, empty as all that is not drawn: where a driver takes the outermost
        // texel for those beyond it.
        let more = (width + (1 << LEVELS), height + (1 << LEVELS));
        let colors = run.pool.pyramid(gpu, "smaller layer", more, COLOR, LEVELS);
        let circles = run.pool.pyramid(gpu, "smaller circles", more, CIRCLES, LEVELS);
        let blurred = ["smaller blurred", "smaller front", "smaller back"]
            .map(|purpose| run.pool.pyramid(gpu, purpose, layer.size, COLOR, DRAWN as u32));
        let out = run.pool.get(gpu, "focused colour", 0, layer.size, COLOR, 1);

        let lens = lens(gpu, context, opening, &layer, tiling, largest, 0);
        let shape = self.shape.take().filter(|shape| shape.is_of(opening));
        let shape = &*self.shape.insert(shape.unwrap_or_else(|| Shape::new(gpu, opening)));

        // Lights that stand out are seen at the lowest resolution, and taken out of all.
        let stand_out = largest >= highlights::LEAST_RADIUS_PX;
        let of_level = |level: usize| (width.div_ceil(2 << level), height.div_ceil(2 << level));
        for (step, level) in (0..LEVELS as usize).chain(if stand_out { 2..LEVELS as usize } else { 0..0 }).enumerate() {
            if step == LEVELS as usize {
                let [first, second] = [0, 1].map(|level| (&colors.levels[level], of_level(level)));
                self.highlights.find(run, &lens, &layer, [&colors.view, &circles.view]);
                self.highlights.dim(run, &lens, [first, second]);
            }
            let size = of_level(level);
            let before = level.checked_sub(1);
            let from = before.map_or(&layer.color, |l| &colors.levels[l]);
            let range = before.map_or(&layer.geometry, |l| &circles.levels[l]);
            let slots = [Slot::Buffer(&lens), Slot::Texture(&from.view), Slot::Texture(&range.view)];
            let targets = [&colors.levels[level], &circles.levels[level]];
            self.pyramid[level.min(1)].run(gpu, run.encoder, &slots, &targets, size);
        }
        let meeting = (tiles.0 + 1, tiles.1 + 1);
        let corners = run.pool.get(gpu, "corners of tiles", 0, meeting, COLOR, 1);
        // Where only one is read, it stands for the other too.
        for (pass, [from, with], to, size) in [
            (&self.tiles[0], [&circles.levels[1]; 2], &own, tiles),
            (&self.tiles[1], [&own; 2], &touched, tiles),
            (&self.tiles[2], [&own, &touched], &around, tiles),
            (&self.tiles[3], [&around; 2], &needed, tiles),
            (&self.tiles[4], [&own, &needed], &corners, meeting),
        ] {
            let slots = [Slot::Buffer(&lens), Slot::Texture(&from.view), Slot::Texture(&with.view)];
            pass.run(gpu, run.encoder, &slots, &[to], size);
        }

        // What is drawn into cannot be read: other textures stand for the lower resolutions first.
        let mut slots = [
            Slot::Buffer(&lens),
            Slot::Buffer(&shape.image),
            Slot::Texture(&needed.view),
            Slot::Texture(&corners.view),
            Slot::Texture(&layer.color.view),
            Slot::Texture(&layer.geometry.view),
            Slot::Texture(&colors.view),
            Slot::Texture(&circles.view),
            Slot::Texture(&colors.view),
            Slot::Texture(&colors.view),
            Slot::Texture(&colors.view),
            Slot::Sampler(&self.between),
            Slot::Buffer(self.highlights.found()),
        ];
        // The shader's circles are rounded to 16 bits, and none is larger than is drawn.
        let least = (0.5 * circles_px(context)[0]).min(largest);
        for level in 1.max(level_of(0.999 * least))..=level_of(1.001 * largest) {
            let size = (width.div_ceil(1 << level), height.div_ceil(1 << level));
            let targets = blurred.each_ref().map(|b| &b.levels[level - 1]);
            let passes: Vec<_> = self.levels[level - 1].iter().collect();
            run_tiles(gpu, run.encoder, &passes, &slots, &targets, size, count);
        }
        for (slot, blurred) in slots[8..11].iter_mut().zip(&blurred) {
            *slot = Slot::Texture(&blurred.view);
        }
        let full: Vec<_> = self.full.iter().collect();
        run_tiles(gpu, run.encoder, &full, &slots, &[&out], layer.size, count);
        if stand_out {
            let list = self.highlights.found();
            run_listed(gpu, run.encoder, &self.spot, &slots, &[&out], layer.size, list);
        }
        if !run.geometry_is_read {
            return Layer { color: out, ..layer };
        }
        let geometry = run.pool.get(gpu, "focused geometry", 0, layer.size, GEOMETRY, 1);
        run_tiles(gpu, run.encoder, &[&self.passing], &slots, &[&geometry], layer.size, count);
        Layer { color: out, geometry, ..layer }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::constant;

    #[test]
    fn thresholds_are_the_shaders() {
        let shader = assemble("shared/lens");
        let value = |name| constant(&shader, name) as f32;
        let half = value("TWO_HALF_PX").min(value("HALF_PX"));
        assert_eq!(FROM_PX, [half, value("QUARTER_PX"), value("EIGHTH_PX"), value("SIXTEENTH_PX")]);
        assert_eq!(super::super::SHARP_PX, value("SHARP_PX"));
    }
}
