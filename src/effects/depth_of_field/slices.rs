//! The whole picture of a photograph, real and virtual, through one lens.
//!
//! Two layers, a nearer and a farther surface, are enough for an object in front of the camera's
//! picture. The picture itself has receding floors and many objects behind each other. So it is
//! divided into slices by the size of circles (Kraus and Strengert 2007; Wadhwa et al. 2018), each
//! is blurred as a whole, and they are composited from the nearest.
//!
//! 1. Each pixel's position among the slices: of the real surface, of the background behind it, of
//!    the virtual one.
//! 2. For each slice, from the nearest: its share of the pixels, with a linear transition to the
//!    next slice; downsampling to a half, a quarter and so on; convolution with the image of the
//!    aperture; and compositing with mutual occlusion.
//! 3. The virtual layer, and the real part behind it and next to it.
//!
//! Three surfaces are known at a pixel: the virtual one; the real one (complete, since the camera
//! recorded it without virtual objects); and the inpainted background behind the real one
//! (depth/background.rs). Real surfaces share a pixel: the farther ones get the share that the
//! nearer ones leave. Real and virtual surfaces occlude each other: each is attenuated by the
//! nearer slices of the other. Within the same slice or the next, the nearer one at each pixel
//! counts.
//!
//! A slice's kernel is the aperture, drawn at a resolution at which its radius is a few pixels. Its
//! size is set so that its variance is that of (8), minus half of the blur that lower resolutions
//! add.
//!
//! Not modelled: circles wider than 400 px or a quarter of the picture (limited to that width),
//! light from outside the picture (edge pixels are repeated), and surfaces that the lens sees
//! around a near object's sides.

mod kernel;

use kernel::{HALVES, Kernel, MAX_WEIGHTS, noise_left, reach_of};

use crate::camera::{Aperture, Opening, correlations};
use crate::effects::{FrameContext, LayerRun};
use crate::gpu::{Gpu, Shader, ShaderEntry, Texture};
use crate::pixels::Rect;
use crate::render::{COLOR, Layer, RealLayer};

use super::image::Blades;
use super::layered;
use super::settings::SHARP_PX;

/// Growth of diameters from slice to slice, on top of `GROWS_FROM_PX`.
const RATIO: f64 = 1.25;
const GROWS_FROM_PX: f64 = 3.0;
/// Tolerance from which on real surfaces occlude nothing, m.
const NO_OCCLUSION_M: f32 = 1e9;
/// Largest number of slices on either side of the sharp one.
const MAX_SLICES: i32 = 31;

/// The slice of a circle (signed diameter, px): 0 is sharp, negative is nearer than that.
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

crate::uniform! {
    struct SliceUniform {
        size: [i32; 2],
        place: [f32; 2],
        columns: i32,
        side_px: i32,
        fx_diameter: f32,
        per_focus: f32,
        largest_px: f32,
        tolerance_m: f32,
        number: f32,
        noise: f32,
        texel_px: f32,
        with_layer: f32,
    }
}

/// Key of a kernel: the aperture's shape, and the slice.
#[derive(Clone, Debug, PartialEq)]
struct KernelKey {
    blades: Blades,
    slice: i32,
}

/// The largest diameter drawn, px.
fn largest_px(context: &FrameContext<'_>) -> f64 {
    2.0 * f64::from(layered::largest_radius_px(context))
}

/// Distance to which light spreads, px.
pub fn reach_px(context: &FrameContext<'_>) -> f32 {
    // The next slice's circle.
    reach_of(RATIO * 0.5 * largest_px(context) + 0.5) as f32
}

/// Blurs both parts. Without `with_layer` only the real part is blurred, and the layer stays as it
/// is.
pub fn run(run: &mut LayerRun<'_>, opening: &Opening, layer: Layer, real: &RealLayer, with_layer: bool) -> Layer {
    let context = run.context;
    let gpu = run.recorder.gpu.clone();
    let size = layer.size;
    let of_level = |level: usize| (size.0.div_ceil(1 << level), size.1.div_ceil(1 << level));
    let largest = largest_px(context);
    let circle = |depth_m: f64| opening.circle_px(context.picture.intrinsics.fx_px, depth_m).clamp(-largest, largest);
    let objects = with_layer.then(|| Objects {
        px: run.objects_px.moved(-run.drawn.x0, -run.drawn.y0),
        circles_px: context.depths_m.map(&circle),
    });
    let tiles = Tiles::new(size, real, &circle, objects);
    let count = tiles.count.0 * tiles.count.1;
    let whole = SliceUniform {
        size: [size.0 as i32, size.1 as i32],
        place: [0.0; 2],
        columns: tiles.count.0 as i32,
        side_px: RealLayer::SIDE_PX as i32,
        fx_diameter: (context.picture.intrinsics.fx_px * opening.diameter_m) as f32,
        per_focus: (1.0 / opening.focus_distance_m) as f32,
        largest_px: largest as f32,
        // Without occlusion, larger than any depth.
        tolerance_m: real.tolerance_m.unwrap_or(NO_OCCLUSION_M).min(NO_OCCLUSION_M),
        number: 0.0,
        noise: 1.0,
        texel_px: 1.0,
        with_layer: f32::from(u8::from(with_layer)),
    };
    let of_texels = |slice: &SliceUniform, level: usize| SliceUniform { texel_px: (1u32 << level) as f32, ..*slice };

    let pass = run.recorder.pass(Shader::DepthOfFieldSlices, "places").uniform("slice", &whole);
    let pass = pass.texture("layer_color", &layer.color).texture("layer_geometry", &layer.geometry);
    let [places] = pass.texture("real_depths", &real.depths).draw([COLOR], size);
    let mut sums =
        run.recorder.pass(Shader::DepthOfFieldSlices, "nothing").uniform("slice", &whole).draw([COLOR; 3], size);
    let neighbours = context.camera.noise.as_ref().map_or([0.0; 2], |noise| noise.neighbour_correlation);
    let neighbours = neighbours.map(correlations);
    let noise_before = context.capture.noise_left.max(1e-6);
    for &slice in &tiles.slices {
        let reached = run.recorder.pool.lend_to_write(&gpu, tiles.count, wgpu::TextureFormat::R32Uint);
        tiles.write(&gpu, &reached, slice);
        let of_slice = SliceUniform { number: slice as f32, ..whole };
        let pass = run
            .recorder
            .pass(Shader::DepthOfFieldSlices, ShaderEntry::with_vertex("tiles", "share"))
            .uniform("slice", &of_slice);
        let pass = pass.texture("reached", &reached).texture("color", &layer.color).texture("light", &real.light);
        let pass = pass.texture("behind_light", &real.behind).texture("place", &places).tiles(count);
        let mut shared = pass.draw([COLOR; 2], size);
        if slice == 0 {
            let pass = run.recorder.pass(Shader::DepthOfFieldSlices, "add_sharp").uniform("slice", &of_slice);
            let pass = pass.texture("slice_real", &shared[0]).texture("slice_layer", &shared[1]);
            let pass =
                pass.texture("sum_real", &sums[0]).texture("sum_layer", &sums[1]).texture("sum_covered", &sums[2]);
            sums = pass.draw([COLOR; 3], size);
            continue;
        }
        let kernel = run.recorder.memoized(KernelKey { blades: Blades::of(opening), slice }, |_, of| {
            let circle_px = f64::from(of.slice.signum()) * diameter_px(of.slice);
            Kernel::new(&Aperture::of(&of.blades.opening()), circle_px)
        });
        let in_layer = tiles.with_layer.is_some_and(|[near, far]| near <= slice && slice <= far);
        let both = |entry, half: i32| {
            ShaderEntry::with_vertex("tiles", entry).choose("layer_too", in_layer).choose("half_side", f64::from(half))
        };
        for level in 1..=kernel.level {
            let pass = run.recorder.pass(Shader::DepthOfFieldSlices, both("smaller", 1));
            let pass = pass.uniform("slice", &of_texels(&of_slice, level)).texture("reached", &reached);
            let pass = pass.texture("before_real", &shared[0]).texture("before_layer", &shared[1]).tiles(count);
            shared = pass.draw([COLOR; 2], of_level(level));
        }
        let level = kernel.level;
        let noise =
            noise_left(noise_before, context.capture.enlargement, &kernel, diameter_px(slice), &neighbours).sqrt();
        let at_level = SliceUniform { noise: noise as f32, ..of_texels(&of_slice, level) };
        // The shader's array is as long as the largest kernel.
        let mut weights = kernel.weights.clone();
        weights.resize(MAX_WEIGHTS, 0.0);
        let weights = run.recorder.uniform(bytemuck::cast_slice(&weights));
        let pass = run.recorder.pass(Shader::DepthOfFieldSlices, both("blur", HALVES[kernel.class]));
        let pass = pass.uniform("slice", &at_level).texture("reached", &reached).buffer("kernel", weights);
        let pass = pass.texture("before_real", &shared[0]).texture("before_layer", &shared[1]).tiles(count);
        let blurred = pass.draw([COLOR; 2], of_level(level));

        let per_texel = 1.0 / f64::from(1u32 << level);
        let place = [blurred[0].width, blurred[0].height].map(|side| per_texel as f32 / side as f32);
        let pass =
            run.recorder.pass(Shader::DepthOfFieldSlices, "add").uniform("slice", &SliceUniform { place, ..at_level });
        let pass = pass.texture("slice_real", &blurred[0]).texture("slice_layer", &blurred[1]);
        let pass = pass.texture("sum_real", &sums[0]).texture("sum_layer", &sums[1]).texture("sum_covered", &sums[2]);
        sums = pass.draw([COLOR; 3], size);
    }
    let pass = run
        .recorder
        .pass(Shader::DepthOfFieldSlices, "finish")
        .uniform("slice", &whole)
        .texture("recorded", &real.light);
    let pass = pass.texture("all_real", &sums[0]).texture("all_layer", &sums[1]).texture("all_held", &sums[2]);
    let [color, light] = pass.draw([COLOR; 2], size);
    let color = if with_layer { color } else { layer.color.clone() };
    Layer { color, real: Some(RealLayer { light, ..real.clone() }), ..layer }
}

/// The slices in use, by tile.
struct Tiles {
    count: (u32, u32),
    /// Slices in order of distance, the nearest first.
    slices: Vec<i32>,
    /// Smallest and largest slice of virtual objects, if there are any.
    with_layer: Option<[i32; 2]>,
    /// Smallest and largest slice in each tile.
    ranges: Vec<[i32; 2]>,
}

/// Virtual objects: their bounds in the layer, and their nearest and farthest circle.
struct Objects {
    px: Rect,
    circles_px: [f64; 2],
}

impl Tiles {
    fn new(size: (u32, u32), real: &RealLayer, circle: &impl Fn(f64) -> f64, objects: Option<Objects>) -> Self {
        let side = RealLayer::SIDE_PX;
        let count = (size.0.div_ceil(side), size.1.div_ceil(side));
        let slices = |near: f64, far: f64| {
            let clamped = |slice: f64| (slice as i32).clamp(-MAX_SLICES, MAX_SLICES);
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

    /// Writes 1 for the tiles that a slice's light reaches.
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
    fn constants_equal_the_shaders() {
        let shader = Shader::DepthOfFieldSlices.module();
        let value = |name| constant(&shader, name);
        assert_eq!([value("GROWS_FROM_PX"), value("RATIO")], [GROWS_FROM_PX, RATIO]);
        assert_eq!((value("SHARP_PX") as f32, value("MAX_SLICES") as i32), (SHARP_PX, MAX_SLICES));
        assert_eq!(value("NO_OCCLUSION_M") as f32, NO_OCCLUSION_M);
        assert!(shader.contains(&format!("array<vec4<f32>, {}>", MAX_WEIGHTS / 4)));
        let largest = (2 * HALVES[HALVES.len() - 1] + 1).pow(2) as usize;
        assert_eq!(MAX_WEIGHTS, largest.div_ceil(4) * 4);
    }

    #[test]
    fn slice_of_a_slices_diameter_is_the_slice() {
        // 0.7 + 3 · (1.25 − 1) = 1.45; 0.7 + 3 · (1.25² − 1) = 2.3875
        assert!((diameter_px(1) - 1.45).abs() < 1e-6 && (diameter_px(-2) - 2.3875).abs() < 1e-6);
        assert_eq!((slice_of(0.6), slice_of(-0.6)), (0.0, 0.0));
        for slice in -20..=20i32 {
            let circle = f64::from(slice.signum()) * diameter_px(slice);
            assert!((slice_of(circle) - f64::from(slice)).abs() < 1e-6, "{slice}");
        }
    }
}
