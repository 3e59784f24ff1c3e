//! The whole picture of a photograph, real and virtual, through one lens.
//!
//! A filter that parts what it finds into a nearer and a farther surface does for an object before the camera's picture;
//! the picture itself is floors that recede and many things behind each other. So it is cut into slices by the size
//! of circles (Kraus and Strengert 2007; Wadhwa et al. 2018), each is blurred as a whole, and they are put together from the nearest.
//!
//! 1. Each pixel's place among the slices: of the real surface, of what stands behind it, of the virtual one.
//! 2. For each slice, from the nearest: what belongs to it, shared with the next one so that a surface passes from one
//!    to the other; the same at a half, a quarter and so on; the image of the opening over it; and what it hides and
//!    what hides it.
//! 3. Virtual light as before, and the real part that stands behind it and beside it.
//!
//! Three surfaces are known at a pixel: the virtual one, the real one (all of it, as the camera saw what virtual things
//! now hide), and what was made up behind the real one (depth/behind.rs). Real surfaces share a pixel among them: what the
//! nearer ones leave of it is for the farther. Real and virtual ones hide each other: of each what the nearer slices of
//! the other let through is seen. Where both are in the same slice or the next, the nearer one at each pixel counts.
//!
//! A slice's kernel is the opening, drawn at a resolution of which its radius is a few pixels, its size set so that its
//! variance is that of (8), less half of what smaller pictures blur besides.
//!
//! Not modelled: circles wider than 400 px or a quarter of the picture (drawn that wide), light that a thing before the
//! picture's rim brings in from beside it (as the rim), and what the lens sees round a near thing's sides.

mod kernel;

use kernel::{HALVES, Kernel, LEVELS, MOST_WEIGHTS, noise_left, reach_of};

use crate::camera::{Aperture, Opening, correlations};
use crate::effects::FrameContext;
use crate::gpu::{FullscreenPass, Gpu, Options, Slot, Texture, assemble, constants, run_tiles};
use crate::image::Rect;
use crate::render::{COLOR, Layer, LayerRun, RealLayer};

use super::{SHARP_PX, layered};

/// Diameters grow by this from slice to slice, on top of `GROWS_FROM_PX`.
const RATIO: f64 = 1.25;
const GROWS_FROM_PX: f64 = 3.0;
/// A tolerance from which on real surfaces hide nothing, metres.
const HIDES_NOTHING_M: f32 = 1e9;
/// To either side of what is sharp.
const MOST_SLICES: i32 = 31;

/// Of a circle (signed diameter, px): 0 sharp, below it nearer than what is.
pub fn slice_of(circle_px: f64) -> f64 {
    let beyond = (circle_px.abs() - f64::from(SHARP_PX)).max(0.0);
    (1.0 + beyond / GROWS_FROM_PX).ln() / RATIO.ln() * circle_px.signum()
}

/// The diameter of a slice's circles, px; 0 for the sharp one.
pub fn diameter_px(slice: i32) -> f64 {
    if slice == 0 {
        return 0.0;
    }
    f64::from(SHARP_PX) + GROWS_FROM_PX * (RATIO.powi(slice.abs()) - 1.0)
}

/// `Slice` of shaders/depth_of_field_slices.wgsl.
#[repr(C)]
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
struct SliceUniform {
    size: [i32; 4],
    circle: [f32; 4],
    slice: [f32; 4],
    texture: [f32; 4],
}

#[derive(Debug)]
pub struct Passes {
    places: FullscreenPass,
    share: FullscreenPass,
    /// Without the layer, and with it.
    smaller: [FullscreenPass; 2],
    blur: [[FullscreenPass; HALVES.len()]; 2],
    first: FullscreenPass,
    add: FullscreenPass,
    add_sharp: FullscreenPass,
    finish: FullscreenPass,
    between: wgpu::Sampler,
    kernels: Option<Kernels>,
}

/// Of an opening's shape, by slices' numbers, as they are asked for.
#[derive(Debug)]
struct Kernels {
    blades: u32,
    rotation_rad: f64,
    aperture: Aperture,
    known: std::collections::HashMap<i32, Kernel>,
}

/// Of what is drawn, px.
fn largest_px(context: &FrameContext<'_>) -> f64 {
    2.0 * f64::from(layered::largest_radius_px(context))
}

/// How far light is spread, px.
pub fn reach_px(context: &FrameContext<'_>) -> f32 {
    // The next slice's circle.
    reach_of(RATIO * 0.5 * largest_px(context) + 0.5) as f32
}

impl Passes {
    pub fn new(gpu: &Gpu) -> Self {
        let shader = assemble("depth_of_field_slices");
        let pass = |vertex, fragment, constants: &[_], formats: &[_]| {
            let options = Options { vertex, fragment, constants, ..Options::default() };
            FullscreenPass::with(gpu, "slices", &shader, formats, &options)
        };
        let full = "fullscreen_vertex";
        let both = |layer: f64, fragment, half: i32| {
            pass("tiles", fragment, &[("layer_too", layer), ("half_side", f64::from(half))], &[COLOR; 2])
        };
        Self {
            places: pass(full, "places", &[], &[COLOR]),
            share: pass("tiles", "share", &[], &[COLOR; 2]),
            smaller: [0.0, 1.0].map(|layer| both(layer, "smaller", 1)),
            blur: [0.0, 1.0].map(|layer| HALVES.map(|half| both(layer, "blur", half))),
            first: pass(full, "nothing", &[], &[COLOR; 3]),
            add: pass(full, "add", &[], &[COLOR; 3]),
            add_sharp: pass(full, "add_sharp", &[], &[COLOR; 3]),
            finish: pass(full, "finish", &[], &[COLOR; 2]),
            between: gpu.device.create_sampler(&wgpu::SamplerDescriptor {
                label: Some("between texels"),
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                ..Default::default()
            }),
            kernels: None,
        }
    }

    /// Blurs both; without `with_layer` the real part alone, and the layer stays as it is.
    pub fn run(
        &mut self,
        run: &mut LayerRun<'_>,
        context: &FrameContext<'_>,
        opening: &Opening,
        layer: Layer,
        real: &RealLayer,
        with_layer: bool,
    ) -> Layer {
        let gpu = run.gpu;
        let size = layer.size;
        let largest = largest_px(context);
        let circle =
            |depth_m: f64| opening.circle_px(context.geometry.intrinsics.fx_px, depth_m).clamp(-largest, largest);
        let objects = with_layer.then(|| Objects {
            px: context.objects_px.moved(-context.drawn.x0, -context.drawn.y0),
            circles_px: context.depths_m.map(&circle),
        });
        let tiles = Tiles::new(size, real, &circle, objects);
        let shape = (opening.blades, opening.rotation_rad);
        let known = self.kernels.take().filter(|k| (k.blades, k.rotation_rad) == shape);
        let kernels = self.kernels.insert(known.unwrap_or_else(|| Kernels {
            blades: shape.0,
            rotation_rad: shape.1,
            aperture: Aperture::of(opening),
            known: Default::default(),
        }));

        let get = |run: &mut LayerRun<'_>, purpose, slot| run.pool.get(gpu, purpose, slot, size, COLOR, 1);
        let places = get(run, "slices: places", 0);
        let sums: [[Texture; 3]; 2] = [0, 3].map(|first| [0, 1, 2].map(|i| get(run, "slices: sums", first + i)));
        let shared: Vec<[Texture; 2]> = (0..=LEVELS)
            .map(|level| {
                let size = (size.0.div_ceil(1 << level), size.1.div_ceil(1 << level));
                [0, 1].map(|i| run.pool.get(gpu, "slices: share", 2 * level + i, size, COLOR, 1))
            })
            .collect();
        let blurred: Vec<[Texture; 2]> = (0..=LEVELS)
            .map(|level| {
                let size = (size.0.div_ceil(1 << level), size.1.div_ceil(1 << level));
                [0, 1].map(|i| run.pool.get(gpu, "slices: blurred", 2 * level + i, size, COLOR, 1))
            })
            .collect();
        let uniform = |slice: i32, level: usize, amplitude: f64, of: &Texture| {
            let texel = f64::from(1u32 << level);
            let uniform = SliceUniform {
                size: [size.0 as i32, size.1 as i32, tiles.count.0 as i32, RealLayer::SIDE_PX as i32],
                circle: [
                    (context.geometry.intrinsics.fx_px * opening.diameter_m) as f32,
                    (1.0 / opening.focus_distance_m) as f32,
                    largest as f32,
                    // More than any depth where nothing is hidden.
                    real.tolerance_m.unwrap_or(HIDES_NOTHING_M).min(HIDES_NOTHING_M),
                ],
                slice: [slice as f32, amplitude as f32, texel as f32, f32::from(u8::from(with_layer))],
                texture: [(1.0 / texel) as f32 / of.width as f32, (1.0 / texel) as f32 / of.height as f32, 0.0, 0.0],
            };
            constants(gpu, "slice", bytemuck::bytes_of(&uniform))
        };
        let whole = uniform(0, 0, 1.0, &places);
        let slots = [
            Slot::Buffer(&whole),
            Slot::Texture(&layer.color.view),
            Slot::Texture(&layer.geometry.view),
            Slot::Texture(&real.depths.view),
        ];
        self.places.run(gpu, run.encoder, &slots, &[&places], size);
        let mut now = 0;
        self.first.run(gpu, run.encoder, &[Slot::Buffer(&whole)], &sums[now].each_ref(), size);
        let neighbours = context.camera.noise.as_ref().map_or([0.0; 2], |noise| noise.neighbour_correlation);
        let neighbours = neighbours.map(correlations);
        let noise_before = context.photograph.map_or(1.0, |p| p.noise_left).max(1e-6);
        for &slice in &tiles.slices {
            // Written before anything is drawn: each slice has its own.
            let slot = (slice + MOST_SLICES) as usize;
            let reached = run.pool.get(gpu, "slices: tiles", slot, tiles.count, wgpu::TextureFormat::R32Uint, 1);
            tiles.write(gpu, &reached, slice);
            let layer_too = usize::from(tiles.with_layer.is_some_and(|[near, far]| near <= slice && slice <= far));
            let of_slice = uniform(slice, 0, 1.0, &places);
            let slots = [
                Slot::Buffer(&of_slice),
                Slot::Texture(&reached.view),
                Slot::Texture(&layer.color.view),
                Slot::Texture(&real.light.view),
                Slot::Texture(&real.behind.view),
                Slot::Texture(&places.view),
            ];
            let count = tiles.count.0 * tiles.count.1;
            run_tiles(gpu, run.encoder, &[&self.share], &slots, &shared[0].each_ref(), size, count);
            let [before, after] = [&sums[now], &sums[1 - now]];
            let sums_slots = before.each_ref().map(|t| Slot::Texture(&t.view));
            if slice == 0 {
                let [a, b] = shared[0].each_ref().map(|t| Slot::Texture(&t.view));
                let [x, y, z] = sums_slots;
                self.add_sharp.run(
                    gpu,
                    run.encoder,
                    &[Slot::Buffer(&of_slice), a, b, x, y, z],
                    &after.each_ref(),
                    size,
                );
                now = 1 - now;
                continue;
            }
            let kernel = kernels
                .known
                .entry(slice)
                .or_insert_with(|| Kernel::new(&kernels.aperture, f64::from(slice.signum()) * diameter_px(slice)));
            for level in 1..=kernel.level {
                let size = (size.0.div_ceil(1 << level), size.1.div_ceil(1 << level));
                let of_level = uniform(slice, level, 1.0, &places);
                let [a, b] = shared[level - 1].each_ref().map(|t| Slot::Texture(&t.view));
                let slots = [Slot::Buffer(&of_level), Slot::Texture(&reached.view), a, b];
                run_tiles(
                    gpu,
                    run.encoder,
                    &[&self.smaller[layer_too]],
                    &slots,
                    &shared[level].each_ref(),
                    size,
                    count,
                );
            }
            let level = kernel.level;
            let at_level = (size.0.div_ceil(1 << level), size.1.div_ceil(1 << level));
            let amplitude =
                noise_left(noise_before, context.enlargement(), kernel, diameter_px(slice), &neighbours).sqrt();
            let of_level = uniform(slice, level, amplitude, &blurred[level][0]);
            let mut weights = kernel.weights.clone();
            weights.resize(weights.len().div_ceil(4) * 4, 0.0);
            // The shader's array is as long as the largest kernel.
            weights.resize(MOST_WEIGHTS, 0.0);
            let weights = constants(gpu, "kernel", bytemuck::cast_slice(&weights));
            let [a, b] = shared[level].each_ref().map(|t| Slot::Texture(&t.view));
            let slots = [Slot::Buffer(&of_level), Slot::Texture(&reached.view), a, b, Slot::Buffer(&weights)];
            let pass = &self.blur[layer_too][kernel.class];
            run_tiles(gpu, run.encoder, &[pass], &slots, &blurred[level].each_ref(), at_level, count);

            let [a, b] = blurred[level].each_ref().map(|t| Slot::Texture(&t.view));
            let [x, y, z] = sums_slots;
            let slots = [Slot::Buffer(&of_level), a, b, x, y, z, Slot::Sampler(&self.between)];
            self.add.run(gpu, run.encoder, &slots, &after.each_ref(), size);
            now = 1 - now;
        }
        let out = [0, 1].map(|i| run.pool.get(gpu, "slices: focused", i, size, COLOR, 1));
        let [x, y, z] = sums[now].each_ref().map(|t| Slot::Texture(&t.view));
        let slots = [Slot::Buffer(&whole), Slot::Texture(&real.light.view), x, y, z];
        self.finish.run(gpu, run.encoder, &slots, &out.each_ref(), size);
        let [color, light] = out;
        let color = if with_layer { color } else { layer.color.clone() };
        Layer { color, real: Some(RealLayer { light, ..real.clone() }), ..layer }
    }
}

/// Which slices there are, and where they reach.
struct Tiles {
    count: (u32, u32),
    /// From the nearest.
    slices: Vec<i32>,
    /// Least and largest slice of virtual things, where there are some.
    with_layer: Option<[i32; 2]>,
    /// Least and largest slice in each tile.
    ranges: Vec<[i32; 2]>,
}

/// Virtual things: where they are in the layer, and their nearest and farthest circle.
struct Objects {
    px: Rect,
    circles_px: [f64; 2],
}

impl Tiles {
    fn new(size: (u32, u32), real: &RealLayer, circle: &impl Fn(f64) -> f64, objects: Option<Objects>) -> Self {
        let side = RealLayer::SIDE_PX;
        let count = (size.0.div_ceil(side), size.1.div_ceil(side));
        let slices = |near: f64, far: f64| {
            let clamped = |slice: f64| (slice as i32).clamp(-MOST_SLICES, MOST_SLICES);
            [clamped(slice_of(near).floor()), clamped(slice_of(far).ceil())]
        };
        let joined = |a: [i32; 2], b: [i32; 2]| [a[0].min(b[0]), a[1].max(b[1])];
        let layer = Rect::full(size.0, size.1);
        let objects = objects.filter(|o| !o.px.intersection(&layer).is_empty());
        let with_layer = objects.as_ref().map(|o| slices(o.circles_px[0], o.circles_px[1]));
        let of_tile = |(i, [near, far]): (usize, &[f32; 2])| {
            let range = slices(circle(f64::from(*near)), circle(f64::from(*far)));
            let (x, y) = (i as u32 % count.0 * side, i as u32 / count.0 * side);
            let tile = Rect::full(side, side).moved(x as i32, y as i32);
            let met = objects.as_ref().is_some_and(|o| !o.px.intersection(&tile).is_empty());
            with_layer.filter(|_| met).map_or(range, |layer| joined(range, layer))
        };
        let ranges: Vec<[i32; 2]> = real.ranges_m.iter().enumerate().map(of_tile).collect();
        let all = ranges.iter().copied().reduce(joined).unwrap_or([0, 0]);
        let there = |slice: &i32| ranges.iter().any(|[near, far]| near <= slice && slice <= far);
        Self { count, slices: (all[0]..=all[1]).filter(there).collect(), with_layer, ranges }
    }

    /// 1 where a slice reaches.
    fn write(&self, gpu: &Gpu, to: &Texture, slice: i32) {
        let (columns, rows) = (self.count.0 as i32, self.count.1 as i32);
        let radius = 0.5 * diameter_px(slice);
        let reach = (reach_of(radius) / f64::from(RealLayer::SIDE_PX)).ceil() as i32;
        let mut reached = vec![0u32; self.ranges.len()];
        for (i, [near, far]) in self.ranges.iter().enumerate() {
            if *near <= slice && slice <= *far {
                let (x, y) = (i as i32 % columns, i as i32 / columns);
                for row in (y - reach).max(0)..=(y + reach).min(rows - 1) {
                    for column in (x - reach).max(0)..=(x + reach).min(columns - 1) {
                        reached[(row * columns + column) as usize] = 1;
                    }
                }
            }
        }
        to.write(gpu, self.count.0, self.count.1, &reached);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::constant;

    #[test]
    fn numbers_are_the_shaders() {
        let shader = assemble("depth_of_field_slices");
        let value = |name| constant(&shader, name);
        assert_eq!([value("GROWS_FROM_PX"), value("RATIO")], [GROWS_FROM_PX, RATIO]);
        assert_eq!((value("SHARP_PX") as f32, value("MOST") as i32), (SHARP_PX, MOST_SLICES));
        assert_eq!(value("HIDES_NOTHING") as f32, HIDES_NOTHING_M);
        assert!(shader.contains(&format!("array<vec4<f32>, {}>", MOST_WEIGHTS / 4)));
        let largest = (2 * HALVES[HALVES.len() - 1] + 1).pow(2) as usize;
        assert_eq!(MOST_WEIGHTS, largest.div_ceil(4) * 4);
    }

    #[test]
    fn a_slice_has_the_circles_that_lie_in_it() {
        // 0.7 + 3 · (1.25 − 1) = 1.45; 0.7 + 3 · (1.25² − 1) = 2.3875
        assert!((diameter_px(1) - 1.45).abs() < 1e-6 && (diameter_px(-2) - 2.3875).abs() < 1e-6);
        assert_eq!((slice_of(0.6), slice_of(-0.6)), (0.0, 0.0));
        for slice in -20..=20i32 {
            let circle = f64::from(slice.signum()) * diameter_px(slice);
            assert!((slice_of(circle) - f64::from(slice)).abs() < 1e-6, "{slice}");
        }
    }
}
