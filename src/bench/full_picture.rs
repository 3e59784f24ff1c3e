//! Cost of depth of field over a whole picture, without the renderer.

use super::{BenchTable, median_ms};
use crate::camera::{Camera, Capture, Geometry, Intrinsics, Opening};
use crate::compositor::SubmitError;
use crate::effects::depth_of_field::DepthOfField;
use crate::effects::{Effect, FrameContext, LayerRun};
use crate::gpu::{Gpu, PassRecorder, Texture, half_texels};
use crate::params::{Params, Value};
use crate::pixels::Rect;
use crate::render::{COLOR, GEOMETRY, Layer};

const FOCAL_PX: f64 = 1000.0;
const FOCUS_M: f64 = 1.0;

const DIAMETER_M: f64 = 0.064;

/// Depth at a signed diameter of the circle of confusion, px: fx · D · (1/d_s − 1/z) solved for z.
fn depth_m(circle_px: f64) -> f64 {
    1.0 / (1.0 / FOCUS_M - circle_px / (FOCAL_PX * DIAMETER_M))
}

/// A layer over the whole picture, with a circle of confusion for each pixel.
fn layer(gpu: &Gpu, width: u32, height: u32, circle_px: impl Fn(f64, f64) -> f64) -> Layer {
    let color = Texture::new(gpu, "colour", width.next_multiple_of(48), height.next_multiple_of(48), COLOR, 1);
    let geometry = Texture::new(gpu, "geometry", color.width, color.height, GEOMETRY, 1);
    let places = || (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    let colors: Vec<_> = places().map(|(x, y)| [(x / 16 % 2) as f32, (y / 16 % 2) as f32, 0.3, 1.0]).collect();
    color.write(gpu, width, height, &half_texels(&colors));
    let depths: Vec<[u16; 4]> = places()
        .map(|(x, y)| {
            let at = (f64::from(x) / f64::from(width), f64::from(y) / f64::from(height));
            let bits = (depth_m(circle_px(at.0, at.1)) as f32).to_bits();
            [bits as u16, (bits >> 16) as u16, 0, 0]
        })
        .collect();
    geometry.write(gpu, width, height, &depths);
    Layer::new(color, geometry, (width, height))
}

/// Circles of confusion of a scene: a floor from the focus plane to circles of 24 px; in front of
/// it four objects in focus and four with circles of 12 px, which cover a tenth of the picture.
fn site(x: f64, y: f64) -> f64 {
    let things = (0..8).map(|i| (f64::from(i) / 8.0 + 0.06, 0.25 + 0.5 * f64::from(i % 2), f64::from(i % 2) * -12.0));
    let mut circle = 24.0 * y;
    for (cx, cy, own) in things {
        if (x - cx).hypot(0.75 * (y - cy)) < 0.055 {
            circle = own;
        }
    }
    circle
}

/// Times the methods over a whole picture: `layered` for several depths and for a scene, the others
/// for one depth.
pub fn depth_of_field(table: &mut BenchTable<'_>) -> Result<(), SubmitError> {
    let gpu = table.gpu;
    let (width, height) = (table.picture[0].width, table.picture[0].height);
    let intrinsics = Intrinsics { width_px: width, height_px: height, fx_px: FOCAL_PX, ..Intrinsics::default() };
    let geometry = Geometry::new(intrinsics, Default::default());
    let camera = Camera { geometry: Some(geometry.clone()), ..Camera::default() };
    let opening = Opening { diameter_m: DIAMETER_M, focus_distance_m: FOCUS_M, blades: 0, rotation_rad: 0.0 };
    let mut recorder = PassRecorder::new(gpu.clone());
    let capture = Capture::frame(&geometry, 0.0, Some(opening));
    type Circles = Box<dyn Fn(f64, f64) -> f64>;
    let flat = |method, circle: f64| {
        (method, format!("circles of {circle} px"), [circle; 2], Box::new(move |_, _| circle) as Circles)
    };
    let mut cases: Vec<_> = [4.0, 8.0, 12.0, 24.0, 48.0].map(|circle| flat("layered", circle)).into();
    cases.push(("layered", "a site with circles up to 24 px".to_owned(), [-12.0, 24.0], Box::new(site)));
    cases.extend(["poisson", "diffusion"].map(|method| flat(method, 24.0)));
    for (method, name, range, circles) in cases {
        let name = format!("depth_of_field {method}, {name}");
        if !table.includes(&name) {
            continue;
        }
        let mut effect = DepthOfField::default();
        let is_set = effect.set("method", &Value::Text(method.to_owned()));
        assert!(is_set.is_ok(), "{method}");
        let layer = layer(gpu, width, height, circles);
        let context = FrameContext {
            camera: &camera,
            picture: &geometry,
            capture: &capture,
            frame: 0,
            seed: 0,
            coding: None,
            max_code: 255,
            recorded: Default::default(),
            interval_s: 1.0,
            resting_frames: 0,
            fastest_px_per_s: 0.0,
            depths_m: range.map(depth_m),
            real_depths_m: None,
            objects: &[],
        };
        let ms = median_ms(
            || (),
            |()| {
                let mut run = LayerRun {
                    recorder: &mut recorder,
                    context: &context,
                    coding: None,
                    drawn: Rect::full(width, height),
                    objects_px: Rect::new(0, 0, 0, 0),
                    geometry_is_read: false,
                };
                effect.run(&mut run, layer.clone());
                let submission = recorder.submit();
                gpu.wait(Some(submission))
            },
        )?;
        table.push(name, ms)?;
    }
    Ok(())
}
