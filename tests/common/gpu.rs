//! Rendering of single frames.

#![allow(dead_code, reason = "each test file uses some of it")]

use std::path::Path;
use std::sync::{LazyLock, Mutex, MutexGuard};

use locard::camera::{Camera, Distortion, Geometry, Intrinsics};
use locard::compositor::{Composited, Compositor, Job, Settings, Target};
use locard::frame::Frame;
use locard::gpu::Gpu;
use locard::params::Value;
use locard::pixels::{LayerImage, Pixels};
use locard::scene::Scene;
use locard::tracking::PoseTrack;

static GPU: LazyLock<Mutex<Gpu>> = LazyLock::new(|| Mutex::new(Gpu::open().expect("tests need a graphics adapter")));

/// The only device of a test process. A test locks it while it draws.
pub fn gpu() -> MutexGuard<'static, Gpu> {
    GPU.lock().unwrap_or_else(|e| e.into_inner())
}

/// Default settings with these parameters set: table, name, value.
pub fn settings(sets: &[(&str, &str, Value)]) -> Settings {
    let mut settings = Settings::default();
    for (table, name, value) in sets {
        settings.set(table, name, value).expect("a known table").expect("a value in range");
    }
    settings
}

pub fn grey(width: u32, height: u32, code: u8) -> Pixels {
    Pixels::from_u8(width, height, vec![code; 3 * (width * height) as usize]).expect("the right length")
}

pub fn frame(index: usize, timestamp_s: f64, pixels: Pixels) -> Frame {
    Frame::new(index, timestamp_s, pixels)
}

/// A camera without distortion, principal point in the middle.
pub fn pinhole(width: u32, height: u32, focal_px: f64) -> Geometry {
    let intrinsics = Intrinsics {
        width_px: width,
        height_px: height,
        fx_px: focal_px,
        fy_px: focal_px,
        cx_px: f64::from(width) / 2.0,
        cy_px: f64::from(height) / 2.0,
        ..Default::default()
    };
    Geometry::new(intrinsics, Distortion::default())
}

/// A camera with a geometry and an exposure time, without noise.
pub fn camera(geometry: &Geometry, exposure_time_s: f64) -> Camera {
    let mut camera = Camera { geometry: Some(geometry.clone()), ..Default::default() };
    camera.exposure.time_s = Some(exposure_time_s);
    camera
}

/// Composites one frame and returns it with its layer.
pub fn composite(
    gpu: &Gpu,
    camera: &Camera,
    settings: Settings,
    scene: Scene,
    track: &PoseTrack,
    frame: Frame,
) -> Composited {
    let geometry = camera.geometry.clone().expect("a camera with geometry");
    let mut compositor = Compositor::new(gpu.clone(), scene);
    let job = Job::of_frame(frame, camera, &settings, &geometry, track, 1.0 / 30.0).expect("a lens that can be");
    let job = Job { want_layer: true, ..job };
    let pending = compositor.submit(job, camera, &settings, Target::Pixels).expect("submitted");
    compositor.collect(pending).expect("collected")
}

/// Writes a layer over mid-grey as a PNG for visual inspection.
pub fn write_layer_png(path: &Path, rgba: &[[f32; 4]], width: u32, height: u32) {
    let encode = |v: f32| (255.0 * v.clamp(0.0, 1.0).powf(1.0 / 2.2)) as u8;
    let bytes = rgba.iter().flat_map(|p| [0, 1, 2].map(|c| encode(p[c] + (1.0 - p[3]) * 0.2))).collect();
    image::RgbImage::from_raw(width, height, bytes).expect("the right length").save(path).expect("written");
}

/// Mean absolute difference of two layers over the pixels where either is not 0.
pub fn mean_absolute_error(a: &LayerImage, b: &[[f32; 4]]) -> f64 {
    let (mut sum, mut count) = (0.0, 0usize);
    for (p, q) in a.rgba.iter().zip(b) {
        if p.iter().chain(q).any(|&v| v != 0.0) {
            sum += p.iter().zip(q).map(|(x, y)| f64::from((x - y).abs())).sum::<f64>() / 4.0;
            count += 1;
        }
    }
    sum / count.max(1) as f64
}

/// Texels of a texture of four bytes each, row by row.
pub fn read_back(gpu: &Gpu, texture: &wgpu::Texture) -> Vec<[u8; 4]> {
    locard::gpu::read_back(gpu, texture).unwrap().as_chunks().0.to_vec()
}
