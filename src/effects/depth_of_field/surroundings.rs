//! What the methods share: the lens as shaders see it, and the circles around each tile.

use crate::camera::{Aperture, Opening};
use crate::effects::FrameContext;
use crate::gpu::{FullscreenPass, Gpu, Options, Slot, Texture, assemble, constants};
use crate::render::{COLOR, GEOMETRY, Layer, LayerRun};

/// The side of a photograph's tiles, px.
pub const PHOTOGRAPHS_TILE_PX: u32 = 16;

/// Squares into which a layer is divided.
#[derive(Clone, Copy, Debug)]
pub struct Tiling {
    pub side_px: u32,
    pub tiles: (u32, u32),
    /// To each side, so many tiles and a circle reach no further.
    pub reach_tiles: u32,
}

impl Tiling {
    /// Tiles of which one to each side is enough.
    pub fn coarse(size: (u32, u32), reach_px: f32) -> Self {
        let side_px = ((reach_px.ceil() as u32).div_ceil(8) * 8).max(32);
        Self::of(size, side_px, 1)
    }

    /// Tiles of which several to each side are looked at: what is to be done changes close to where it must. Large ones
    /// where one surface is all there is. A power of two, that an eighth of the resolution divides them.
    pub fn fine(size: (u32, u32), reach_px: f32, one_surface: bool) -> Self {
        let least_px = if one_surface { 64.0 } else { 16.0 };
        Self::reaching(size, reach_px, ((reach_px / 3.0).ceil().max(least_px) as u32).next_power_of_two())
    }

    /// The same, small enough that the parts of a photograph divide them all.
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

/// `Lens` of shaders/shared/lens.wgsl.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct LensUniform {
    size: [i32; 4],
    circle: [f32; 4],
    texture: [f32; 4],
}

/// `Lens` of a frame: no circle is drawn wider than `largest_radius_px`, and as many steps of the blur factor are told.
pub fn lens(
    gpu: &Gpu,
    context: &FrameContext<'_>,
    opening: &Opening,
    layer: &Layer,
    tiling: Tiling,
    largest_radius_px: f32,
    steps: u32,
) -> wgpu::Buffer {
    let uniform = LensUniform {
        size: [layer.size.0 as i32, layer.size.1 as i32, tiling.side_px as i32, tiling.tiles.0 as i32],
        circle: [
            (context.geometry.intrinsics.fx_px * opening.diameter_m) as f32,
            (1.0 / opening.focus_distance_m) as f32,
            Aperture::of(opening).variance() as f32,
            2.0 * largest_radius_px,
        ],
        texture: [
            1.0 / layer.color.width as f32,
            1.0 / layer.color.height as f32,
            steps as f32,
            tiling.reach_tiles as f32,
        ],
    };
    constants(gpu, "lens", bytemuck::bytes_of(&uniform))
}

/// Finds the circles that can reach into each tile.
#[derive(Debug)]
pub struct Surroundings {
    tiles: [FullscreenPass; 2],
    passing: FullscreenPass,
}

impl Surroundings {
    pub fn new(gpu: &Gpu) -> Self {
        let shader = assemble("depth_of_field_surroundings");
        let pass = |fragment, format| {
            let options = Options { fragment, ..Options::default() };
            FullscreenPass::with(gpu, "surroundings", &shader, &[format], &options)
        };
        Self { tiles: ["own", "around"].map(|f| pass(f, COLOR)), passing: pass("passing", GEOMETRY) }
    }

    /// Nearest circle (signed) and largest radius of each tile and those around it, px.
    pub fn run(&self, run: &mut LayerRun<'_>, lens: &wgpu::Buffer, layer: &Layer, tiling: Tiling) -> Texture {
        let gpu = run.gpu;
        let [own, around] = [0, 1].map(|slot| run.pool.get(gpu, "surroundings", slot, tiling.tiles, COLOR, 1));
        for (pass, view, to) in [(&self.tiles[0], &layer.geometry.view, &own), (&self.tiles[1], &own.view, &around)] {
            pass.run(gpu, run.encoder, &[Slot::Buffer(lens), Slot::Texture(view)], &[to], tiling.tiles);
        }
        around
    }

    /// The layer with its new colour, and with geometry where that is read and was none.
    pub fn passed(
        &self,
        run: &mut LayerRun<'_>,
        lens: &wgpu::Buffer,
        around: &Texture,
        layer: Layer,
        color: Texture,
    ) -> Layer {
        if !run.geometry_is_read {
            return Layer { color, ..layer };
        }
        let geometry = run.pool.get(run.gpu, "focused geometry", 0, layer.size, GEOMETRY, 1);
        let slots = [Slot::Buffer(lens), Slot::Texture(&layer.geometry.view), Slot::Texture(&around.view)];
        self.passing.run(run.gpu, run.encoder, &slots, &[&geometry], layer.size);
        Layer { color, geometry, ..layer }
    }
}
