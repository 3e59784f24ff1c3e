//! Shared by the methods: the lens as a uniform, and the circles of confusion around each tile.

use crate::camera::{Aperture, Opening};
use crate::effects::LayerRun;
use crate::gpu::{Shader, Texture};
use crate::render::{COLOR, GEOMETRY, Layer};

/// The side of a photograph's tiles, px.
pub const PHOTOGRAPHS_TILE_PX: u32 = 16;

/// Squares into which a layer is divided.
#[derive(Clone, Copy, Debug)]
pub struct Tiling {
    pub side_px: u32,
    pub tiles: (u32, u32),
    /// Circles reach no further than this many tiles to each side.
    pub reach_tiles: u32,
}

impl Tiling {
    /// Tiles so large that circles reach one tile to each side.
    pub fn coarse(size: (u32, u32), reach_px: f32) -> Self {
        let side_px = ((reach_px.ceil() as u32).div_ceil(8) * 8).max(32);
        Self::of(size, side_px, 1)
    }

    /// Tiles so small that circles reach several to each side, which limits the work to the pixels
    /// that need it. Larger for a single surface. A power of two, so that they divide into texels
    /// of an eighth of the resolution.
    pub fn fine(size: (u32, u32), reach_px: f32, one_surface: bool) -> Self {
        let min_px = if one_surface { 64.0 } else { 16.0 };
        Self::reaching(size, reach_px, ((reach_px / 3.0).ceil().max(min_px) as u32).next_power_of_two())
    }

    /// Tiles of which all parts of a photograph are multiples.
    pub fn of_photograph(size: (u32, u32), reach_px: f32) -> Self {
        Self::reaching(size, reach_px, PHOTOGRAPHS_TILE_PX)
    }

    fn reaching(size: (u32, u32), reach_px: f32, side_px: u32) -> Self {
        Self::of(size, side_px, (reach_px.ceil() as u32).div_ceil(side_px))
    }

    fn of((width, height): (u32, u32), side_px: u32, reach_tiles: u32) -> Self {
        Self { side_px, tiles: (width.div_ceil(side_px), height.div_ceil(side_px)), reach_tiles }
    }
}

crate::uniform! {
    /// A frame's lens and tiles.
    pub struct LensUniform {
        size: [i32; 2],
        texel: [f32; 2],
        side_px: i32,
        columns: i32,
        fx_diameter: f32,
        per_focus: f32,
        variance: f32,
        largest_px: f32,
        steps: f32,
        reach_tiles: f32,
    }
}

impl LensUniform {
    /// `largest_radius_px` limits the circles drawn; `steps` is the number of steps of the blur
    /// factor.
    pub fn new(
        run: &LayerRun<'_>,
        opening: &Opening,
        layer: &Layer,
        tiling: Tiling,
        largest_radius_px: f32,
        steps: u32,
    ) -> Self {
        Self {
            size: [layer.size.0 as i32, layer.size.1 as i32],
            texel: [1.0 / layer.color.width as f32, 1.0 / layer.color.height as f32],
            side_px: tiling.side_px as i32,
            columns: tiling.tiles.0 as i32,
            fx_diameter: (run.context.picture.intrinsics.fx_px * opening.diameter_m) as f32,
            per_focus: (1.0 / opening.focus_distance_m) as f32,
            variance: Aperture::of(opening).variance() as f32,
            largest_px: 2.0 * largest_radius_px,
            steps: steps as f32,
            reach_tiles: tiling.reach_tiles as f32,
        }
    }
}

/// The circles that can reach into each tile: nearest circle (signed) and largest radius among the
/// tile and its neighbours, px.
pub fn surroundings(run: &mut LayerRun<'_>, lens: &LensUniform, layer: &Layer, tiling: Tiling) -> Texture {
    let pass = run.recorder.pass(Shader::DepthOfFieldSurroundings, "own").uniform("lens", lens);
    let [own] = pass.texture("geometry", &layer.geometry).draw([COLOR], tiling.tiles);
    let pass = run.recorder.pass(Shader::DepthOfFieldSurroundings, "around").uniform("lens", lens);
    let [around] = pass.texture("before", &own).draw([COLOR], tiling.tiles);
    around
}

/// The layer with its new colour, and with geometry spread over newly covered pixels if anything
/// reads it.
pub fn with_color(run: &mut LayerRun<'_>, lens: &LensUniform, around: &Texture, layer: Layer, color: Texture) -> Layer {
    if !run.geometry_is_read {
        return Layer { color, ..layer };
    }
    let pass = run.recorder.pass(Shader::DepthOfFieldSurroundings, "passing").uniform("lens", lens);
    let pass = pass.texture("geometry", &layer.geometry).texture("around_tiles", around);
    let [geometry] = pass.draw([GEOMETRY], layer.size);
    Layer { color, geometry, ..layer }
}
