//! Cost of effects, in multiples of a full-screen copy of the same run.
//!
//! Fixed load: a sphere of 10,000 triangles over a tenth of the picture, and a noisy camera whose
//! rotation blurs the sphere over 12 px at 640 px width. Its pictures are coded as JPEG files are.

use std::f32::consts::{PI, TAU};
use std::sync::Arc;
use std::time::Instant;

use glam::{DAffine3, DQuat, DVec3};

mod changed_setting;
mod example_noise;
mod full_picture;
mod occlusion_and_shadow;
mod shown_frame;

use crate::camera::{Camera, Geometry, NoiseBin, NoiseProfile};
use crate::coding::{BLOCK, BlockQuantization, ChromaSampling, Decoder, PictureCoding, YcbcrColor};
use crate::compositor::{Compositor, FrameStats, Job, Settings, SubmitError, Target};
use crate::fit::quantile::upper_median;
use crate::frame::{Frame, NeighbourFrame};
use crate::gpu::{Gpu, GpuError, PassRecorder, Shader, Texture};
use crate::pixels::{DepthMap, Pixels};
use crate::pose::Pose;
use crate::recording::NEIGHBOURS_EACH_WAY;
use crate::scene::{Environment, Lighting, Material, Mesh, Object, Part, Scene, Sun, Vertex};
use crate::tracking::PoseTrack;

/// One row of the table.
#[derive(Clone, Debug, serde::Serialize)]
pub struct Row {
    pub name: String,
    /// Median, upload to readback, milliseconds.
    pub ms: f64,
    /// Multiples of a full-screen rgba16f copy.
    pub copies: f64,
}

/// The fixed load at a picture size: scene and camera.
#[derive(Clone, Debug)]
pub struct Load {
    pub camera: Camera,
    pub geometry: Geometry,
    pub track: PoseTrack,
    pub scene: Scene,
}

impl Load {
    pub fn new(width: u32, height: u32) -> Self {
        let (camera, geometry) = camera(width, height);
        let track = turning(&geometry, 12.0 * f64::from(width) / 640.0);
        let scene = scene(&geometry);
        Self { camera, geometry, track, scene }
    }
}

/// A JPEG file's, with chroma of half the resolution.
fn coding() -> PictureCoding {
    let steps = std::array::from_fn(|i| 4 + (i / BLOCK + i % BLOCK) as u16);
    PictureCoding {
        color: YcbcrColor::JFIF,
        chroma: Some(ChromaSampling::centered([2, 2])),
        quantization: Some(BlockQuantization::at_corner([steps; 3])),
        decoder: Decoder::ZuneJpeg,
    }
}

/// Name of the row with the default settings.
pub const ALL_EFFECTS: &str = "all effects at their defaults";

/// Largest number of timed rounds.
const MAX_ROUNDS: usize = 15;
/// Number of untimed rounds before.
const WARM_UP_ROUNDS: usize = 3;
/// Approximate time limit of the timed rounds, seconds.
const TIME_LIMIT_S: f64 = 3.0;
/// Frame interval, seconds.
pub const INTERVAL_S: f64 = 1.0 / 30.0;

/// Median time of a call without its preparation, milliseconds.
fn median_ms<T, E>(mut prepare: impl FnMut() -> T, mut call: impl FnMut(T) -> Result<(), E>) -> Result<f64, E> {
    for _ in 0..WARM_UP_ROUNDS {
        call(prepare())?;
    }
    let begun = Instant::now();
    let mut times = Vec::new();
    while times.is_empty() || (times.len() < MAX_ROUNDS && begun.elapsed().as_secs_f64() < TIME_LIMIT_S) {
        let prepared = prepare();
        let start = Instant::now();
        call(prepared)?;
        times.push(start.elapsed().as_secs_f64() * 1e3);
    }
    Ok(upper_median(times).unwrap_or(0.0))
}

/// A sphere of radius 1: 72 × 70 quads, 10,080 triangles (those at the poles have no area).
fn sphere() -> Mesh {
    let (columns, rows) = (72u32, 70u32);
    let mut vertices = Vec::new();
    for j in 0..=rows {
        for i in 0..=columns {
            let (phi, theta) = (i as f32 / columns as f32 * TAU, j as f32 / rows as f32 * PI);
            let n = [theta.sin() * phi.cos(), theta.cos(), theta.sin() * phi.sin()];
            vertices.push(Vertex {
                position: n,
                normal: n,
                tangent: [0.0; 4],
                uv0: [0.0; 2],
                uv1: [0.0; 2],
                color: [1.0; 4],
            });
        }
    }
    let mut indices = Vec::new();
    for j in 0..rows {
        for i in 0..columns {
            let a = j * (columns + 1) + i;
            let b = a + columns + 1;
            indices.extend([a, a + 1, b, a + 1, b + 1, b]);
        }
    }
    Mesh { vertices, indices, material: 0 }
}

/// The sphere over a tenth of the picture, lit by a sun and a uniform environment.
fn scene(geometry: &Geometry) -> Scene {
    let i = &geometry.intrinsics;
    let radius_px = (0.1 * f64::from(i.width_px) * f64::from(i.height_px) / std::f64::consts::PI).sqrt();
    let (depth_m, radius_m) = (2.0, 2.0 * radius_px / i.fx_px);
    let world_from_mesh = DAffine3::from_scale_rotation_translation(
        DVec3::splat(radius_m),
        DQuat::IDENTITY,
        DVec3::new(0.0, 0.0, depth_m),
    );
    let sun = Sun {
        towards_light_in_world: glam::Vec3::new(0.3, -0.8, -0.5).normalize(),
        color: glam::Vec3::splat(0.6),
        diameter_rad: 0.00925,
    };
    Scene {
        meshes: vec![sphere().into()],
        materials: vec![Material {
            base_color: [0.6, 0.5, 0.4, 1.0],
            metallic: 0.0,
            roughness: 0.5,
            ..Material::default()
        }],
        objects: vec![Object {
            name: "sphere".to_owned(),
            parts: vec![Part { mesh: 0, world_from_mesh }],
            ..Object::default()
        }],
        lighting: Lighting {
            suns: vec![sun],
            points: Vec::new(),
            environment: Environment::Uniform(glam::Vec3::splat(0.4)),
        },
        ..Scene::default()
    }
}

/// A camera with noise, exposed for half the interval.
fn camera(width: u32, height: u32) -> (Camera, Geometry) {
    let geometry = Geometry::pinhole(width, height, 525.0 * f64::from(width) / 640.0);
    let bins = vec![
        NoiseBin { code: 0.0, sigma: 1.5 },
        NoiseBin { code: 128.0, sigma: 3.5 },
        NoiseBin { code: 255.0, sigma: 2.5 },
    ];
    let noise = NoiseProfile {
        example: None,
        bins: [bins.clone(), bins.clone(), bins],
        channel_correlation: [0.4, 0.3, 0.4],
        neighbour_correlation: [0.4, 0.4],
    };
    let mut camera = Camera { geometry: Some(geometry.clone()), noise: Some(noise), ..Camera::default() };
    camera.exposure.time_s = Some(0.5 * INTERVAL_S);
    camera.exposure.iso = Some(100.0);
    (camera, geometry)
}

/// A rotating camera: the picture's centre moves by `px` in half an interval.
fn turning(geometry: &Geometry, px: f64) -> PoseTrack {
    let rate = (px / geometry.intrinsics.fx_px) / (0.5 * INTERVAL_S);
    let poses = (-100..=100)
        .map(|i| {
            let t = f64::from(i) * 1e-3;
            (t, Pose::from_camera_in_world(DVec3::ZERO, DQuat::from_rotation_y(rate * t)))
        })
        .collect();
    // The times above are ascending, so that this does not fail.
    PoseTrack::new(poses, 1.0).unwrap_or_default()
}

/// The rows and the reference, a full-screen copy of rgba16f. The reference is timed before the
/// first row and after each, because the machine's speed may drift.
struct BenchTable<'a> {
    gpu: &'a Gpu,
    /// Filter: rows whose names contain this.
    only: Option<&'a str>,
    recorder: PassRecorder,
    picture: [Texture; 2],
    copies_ms: Vec<f64>,
    rows: Vec<(String, f64)>,
}

impl<'a> BenchTable<'a> {
    fn new(gpu: &'a Gpu, width: u32, height: u32, only: Option<&'a str>) -> Result<Self, GpuError> {
        let format = wgpu::TextureFormat::Rgba16Float;
        let picture = ["from", "to"].map(|label| Texture::new(gpu, label, width, height, format, 1));
        let mut table = Self {
            gpu,
            only,
            recorder: PassRecorder::new(gpu.clone()),
            picture,
            copies_ms: Vec::new(),
            rows: Vec::new(),
        };
        table.time_copy()?;
        Ok(table)
    }

    fn time_copy(&mut self) -> Result<(), GpuError> {
        let (recorder, [from, to]) = (&mut self.recorder, &self.picture);
        let ms = median_ms(
            || (),
            |()| {
                recorder.pass(Shader::Copy, "main").texture("source", from).draw_into(&[to], (to.width, to.height));
                let submission = recorder.submit();
                recorder.gpu.wait(Some(submission))
            },
        )?;
        self.copies_ms.push(ms);
        Ok(())
    }

    fn includes(&self, name: &str) -> bool {
        self.only.is_none_or(|only| name.contains(only))
    }

    fn push(&mut self, name: String, ms: f64) -> Result<(), GpuError> {
        self.rows.push((name, ms));
        self.time_copy()
    }

    /// The rows, with the copy first.
    fn rows(self) -> Vec<Row> {
        let copy = upper_median(self.copies_ms).unwrap_or(0.0);
        let first = ("full-screen copy".to_owned(), copy);
        let row = |(name, ms): (String, f64)| Row { name, ms, copies: ms / copy };
        std::iter::once(first).chain(self.rows).map(row).collect()
    }
}

/// Median time of a frame from upload to readback, milliseconds. `observe` gets the statistics of
/// each.
fn median_frame_ms(
    gpu: &Gpu,
    load: &Load,
    scene: &Scene,
    (pixels, depth): (&Pixels, Option<&DepthMap>),
    settings: &Settings,
    observe: &mut dyn FnMut(&FrameStats),
) -> Result<f64, SubmitError> {
    let Load { camera, geometry, track, .. } = load;
    let mut compositor = Compositor::new(gpu.clone(), scene.clone());
    let mut index = 0;
    // A frame with depth has its neighbours.
    let neighbour = depth.map(|depth| {
        let (pixels, depth) = (pixels.clone().into(), depth.clone().into());
        NeighbourFrame { index, timestamp_s: 0.0, pixels, depth }
    });
    let neighbours: Vec<_> = neighbour.map(Arc::new).into_iter().cycle().take(2 * NEIGHBOURS_EACH_WAY).collect();
    let frame = || {
        index += 1;
        let depth = depth.map(|depth| depth.clone().into());
        Frame { depth, neighbours: neighbours.clone(), ..Frame::new(index, 0.0, pixels.clone()) }
    };
    median_ms(frame, |frame| {
        let job = Job::of_frame(frame, camera, settings, geometry, track, INTERVAL_S)?;
        let pending = compositor.submit(job, camera, settings, Target::Pixels)?;
        let done = compositor.collect(pending)?;
        observe(&done.stats);
        Ok::<_, SubmitError>(())
    })
}

/// Times all rows at a picture size: the copy, the plain composite, each effect alone over it, all
/// effects at their defaults, occlusion and shadows, a shown frame, a changed setting, and depth of
/// field over a whole picture. With `only`, the copy and the rows whose names contain it.
pub fn bench(gpu: &Gpu, width: u32, height: u32, only: Option<&str>) -> Result<Vec<Row>, SubmitError> {
    let mut table = BenchTable::new(gpu, width, height, only)?;
    let load = Load::new(width, height);
    let scene = &load.scene;
    let pixels = Pixels::from_u8(width, height, vec![120; 3 * width as usize * height as usize])
        .ok_or_else(|| GpuError::Failed("no picture".to_owned()))?;
    let pixels = Pixels { coding: Some(Arc::new(coding())), ..pixels };
    // An effect that does not run with this load has no row.
    let mut time = |name: String, settings: Settings, effect: Option<&str>| -> Result<(), SubmitError> {
        if !table.includes(&name) {
            return Ok(());
        }
        let mut runs = true;
        let mut observe = |stats: &FrameStats| runs &= effect.is_none_or(|effect| stats.effects.contains(&effect));
        let ms = median_frame_ms(gpu, &load, scene, (&pixels, None), &settings, &mut observe)?;
        if !runs {
            return Ok(());
        }
        Ok(table.push(name, ms)?)
    };
    let mut plain = Settings::default();
    plain.plain();
    time("plain composite".to_owned(), plain, None)?;
    for effect in crate::effects::all() {
        let effect_name = effect.table();
        for (label, sets) in effect.cases() {
            let mut settings = Settings::default();
            settings.plain();
            let are_set = settings.switch(effect_name, true).is_ok()
                && sets.iter().all(|(name, value)| matches!(settings.set(effect_name, name, value), Some(Ok(()))));
            debug_assert!(are_set, "{effect_name} {label}");
            time(format!("plain + {effect_name} {label}").trim_end().to_owned(), settings, Some(effect_name))?;
        }
    }
    time(ALL_EFFECTS.to_owned(), Settings::default(), None)?;
    example_noise::time(&mut table, &load, &pixels)?;
    occlusion_and_shadow::time(&mut table, &load, &pixels)?;
    shown_frame::time(&mut table, &load, &pixels)?;
    changed_setting::time(&mut table, &load, &pixels)?;
    full_picture::depth_of_field(&mut table)?;
    Ok(table.rows())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_multiples_of_the_median_copy() {
        let gpu = Gpu::open().expect("an adapter");
        let mut table = BenchTable::new(&gpu, 8, 8, None).unwrap();
        table.copies_ms = vec![0.5, 9.0, 0.25];
        table.rows = vec![("plain composite".to_owned(), 2.0), ("cheap".to_owned(), 0.125)];
        let rows: Vec<_> = table.rows().into_iter().map(|row| (row.name, row.ms, row.copies)).collect();
        let expected = [("full-screen copy", 0.5, 1.0), ("plain composite", 2.0, 4.0), ("cheap", 0.125, 0.25)];
        assert_eq!(rows, expected.map(|(name, ms, copies)| (name.to_owned(), ms, copies)));
    }
}
