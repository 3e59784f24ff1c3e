//! Stages of a frame: a changed parameter recomputes the first stage that reads it and those that
//! read its result, and the picture is that of a new compositor.

use std::collections::BTreeSet;

use crate::gpu;
use crate::reused_compositor::PictureInputs;
use crate::shadow::box_scene;
use glam::{DMat3, DQuat, DVec2, DVec3, Vec3};
use locard::camera::Geometry;
use locard::compositor::{Compositor, Job, Settings, Target};
use locard::frame::Frame;
use locard::gpu::Gpu;
use locard::params::{Kind, Spec, Value};
use locard::pixels::{DepthMap, Pixels};
use locard::pose::Pose;
use locard::profile::Rig;
use locard::scene::{Environment, Lighting, Sun};
use locard::stage::Stage;
use locard::tracking::PoseTrack;

const WIDTH: u32 = 96;
const HEIGHT: u32 = 64;

/// A frame, its poses and a view into which it is composited.
struct Display {
    frame: Frame,
    track: PoseTrack,
    texture: wgpu::Texture,
}

/// From half a metre away, looking down at the box.
fn pose(along_m: f64) -> Pose {
    let eye = DVec3::new(0.1 + along_m, -0.45, 0.4);
    let forward = -DVec3::new(0.1, -0.45, 0.4).normalize();
    let right = forward.cross(DVec3::Z).normalize();
    let turn = DQuat::from_mat3(&DMat3::from_cols(right, forward.cross(right), forward));
    Pose::from_camera_in_world(eye, turn)
}

fn geometry() -> Geometry {
    gpu::pinhole(WIDTH, HEIGHT, 110.0)
}

impl Display {
    /// The box's plane, and on the left a real object before the box.
    fn new(gpu: &Gpu) -> Self {
        let (eye, turn) = (pose(0.0).position_in_world_m(), pose(0.0).rotation.inverse());
        let depth_m = (0..WIDTH * HEIGHT).map(|i| {
            let at = DVec2::new(f64::from(i % WIDTH) + 0.5, f64::from(i / WIDTH) + 0.5);
            let ray = geometry().depth_ray(at).unwrap();
            let plane_m = -eye.z / (turn * ray).z;
            (if at.x < 42.0 { 0.4 * plane_m } else { plane_m }) as f32
        });
        let depth = DepthMap { width: WIDTH, height: HEIGHT, depth_m: depth_m.collect(), timestamp_s: 0.0 };
        let codes = (0..WIDTH * HEIGHT).flat_map(|i| match i % WIDTH {
            x if x < 42 => [30, 40, 50],
            x => [150 + (x % 60) as u8, 160, 120 + (i / WIDTH) as u8],
        });
        let frame = gpu::frame(7, 0.0, Pixels::from_u8(WIDTH, HEIGHT, codes.collect()).unwrap());
        let texture = gpu.device.create_texture(&wgpu::TextureDescriptor {
            label: None,
            size: wgpu::Extent3d { width: WIDTH, height: HEIGHT, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: wgpu::TextureFormat::Rgba8Unorm,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC,
            view_formats: &[],
        });
        Self {
            frame: Frame { depth: Some(depth.into()), ..frame },
            track: PoseTrack::new(vec![(-1.0, pose(-0.5)), (1.0, pose(0.5))], 3.0).unwrap(),
            texture,
        }
    }

    /// Shows the frame. Returns the stages that were computed, and the picture.
    fn show(&self, compositor: &mut Compositor, inputs: &PictureInputs) -> Option<(Vec<Stage>, Vec<[u8; 4]>)> {
        let camera = inputs.rig.camera();
        let geometry = camera.geometry.clone().unwrap();
        inputs.settings.check(&camera, &geometry).ok()?;
        let (frame, settings) = (self.frame.clone(), &inputs.settings);
        let job = Job::of_frame(frame, &camera, settings, &geometry, &self.track, 1.0 / 30.0).ok()?;
        let view = self.texture.create_view(&Default::default());
        let target = Target::View(&view, wgpu::TextureFormat::Rgba8Unorm);
        let pending = compositor.submit(job, &camera, settings, target).ok()?;
        pending.await_drawn(compositor.gpu()).unwrap();
        Some((pending.stages().to_vec(), gpu::read_back(compositor.gpu(), &self.texture)))
    }
}

fn compositor(gpu: &Gpu) -> Compositor {
    let sun = Sun {
        towards_light_in_world: Vec3::new(0.5, 0.3, 0.8).normalize(),
        color: Vec3::new(0.9, 0.8, 0.6),
        diameter_rad: 0.1,
    };
    let environment = Environment::Uniform(Vec3::new(0.3, 0.35, 0.5));
    let lighting = Lighting { suns: vec![sun], environment, ..Lighting::default() };
    Compositor::new(gpu.clone(), box_scene(DVec3::new(0.04, 0.03, 0.05), lighting))
}

/// The parameters of a test case, with all effects on.
fn base(case: usize) -> PictureInputs {
    let mut inputs = PictureInputs::new(case);
    inputs.rig.lay_over(&geometry());
    let mut set = |text: &str| inputs.rig.set_text(text, &mut inputs.settings).unwrap();
    ["camera.lens.focus_distance_m=0.5", "camera.lens.f_number=20"].into_iter().for_each(&mut set);
    inputs
}

/// Other values of a parameter, near its own ones first, with what else has to be set for them.
fn changes(table: &str, spec: &Spec, value: &Value) -> Vec<(Option<&'static str>, Value)> {
    let numbers = |min: f64, max: f64, is_whole: bool| -> Vec<Value> {
        let other = |factor: f64| match value {
            Value::Number(number) if is_whole => number + (20.0 * factor).ceil(),
            Value::Number(number) if *number != 0.0 => number * (1.0 + factor),
            _ => min.max(-1.0) + factor * (max.min(1.0) - min.max(-1.0)),
        };
        [0.001, 0.01, 0.05, 0.3, 1.0].map(|factor| Value::Number(other(factor).clamp(min, max))).to_vec()
    };
    let special = match (table, spec.name) {
        ("camera.lens", "aperture_diameter_mm") => Some((Some("camera.lens.f_number=none"), vec![2.0, 3.0])),
        ("camera.exposure", "shutter_angle_deg") => Some((Some("camera.exposure.time_s=none"), vec![200.0, 250.0])),
        ("vignetting", "image_circle_px") => Some((None, vec![50.0, 60.0])),
        ("exposure", "reference_s") => Some((None, vec![0.01])),
        ("noise", "iso") => Some((None, vec![800.0])),
        ("noise", "film_width_mm") => Some((None, vec![10.0])),
        ("noise", "animation_delay") => Some((None, vec![5.0])),
        _ => None,
    };
    if let Some((before, values)) = special {
        return values.into_iter().map(|value| (before, Value::Number(value))).collect();
    }
    let values = match &spec.kind {
        Kind::Bool => vec![Value::Bool(*value != Value::Bool(true))],
        Kind::Choice(names) => names.iter().map(|name| Value::Text((*name).to_owned())).collect(),
        Kind::Number { min, max } => numbers(*min, *max, false),
        Kind::Integer { min, max } => numbers(*min, *max, true),
    };
    values.into_iter().filter(|other| other != value).map(|value| (None, value)).collect()
}

// Slow: renders three pictures for each change of each parameter, with four sets of methods.
#[test]
fn changed_parameter_recomputes_its_stage_and_those_after_it() {
    let gpu = gpu::gpu();
    let display = Display::new(&gpu);
    let (rig, settings) = (Rig::default(), Settings::default());
    let all: BTreeSet<String> = rig
        .tables()
        .into_iter()
        .chain(settings.tables())
        .flat_map(|table| table.specs().into_iter().map(|spec| format!("{}.{}", table.table(), spec.name)))
        .collect();
    // With these, the frame's size is not the camera's; the grain's size is that of a photograph.
    let mut left: BTreeSet<&str> = all.iter().map(String::as_str).collect();
    ["camera.width_px", "camera.height_px"].iter().for_each(|name| assert!(left.remove(name)));
    for case in 0..4 {
        for (table, spec) in base(case).parameters(case) {
            let name = format!("{table}.{}", spec.name);
            let declared = spec.stage.unwrap_or_else(|| panic!("{name} has no stage"));
            for (before, value) in changes(table, &spec, &base(case).value(table, spec.name)) {
                if !left.contains(name.as_str()) {
                    break;
                }
                let (mut from, mut to) = (base(case), base(case));
                for inputs in [&mut from, &mut to] {
                    before.iter().for_each(|text| inputs.rig.set_text(text, &mut inputs.settings).unwrap());
                }
                if to.rig.set_text(&format!("{name}={value}"), &mut to.settings).is_err() {
                    continue;
                }
                let mut reused = compositor(&gpu);
                let Some((first, unchanged)) = display.show(&mut reused, &from) else { continue };
                assert_eq!(first, Stage::ALL, "a new compositor");
                let Some((stages, changed)) = display.show(&mut reused, &to) else { continue };
                let (_, expected) = display.show(&mut compositor(&gpu), &to).unwrap();
                assert!(changed == expected, "case {case}, {name} = {value}: another picture than a new compositor's");
                if changed != unchanged && stages[0] == declared {
                    left.remove(name.as_str());
                }
            }
        }
    }
    assert!(left.is_empty(), "not seen to be recomputed from their stage on: {left:?}");
}

#[test]
fn shown_frame_is_mixed_again_alone_for_another_noise() {
    let gpu = gpu::gpu();
    let (display, mut compositor, mut inputs) = (Display::new(&gpu), compositor(&gpu), base(0));
    display.show(&mut compositor, &inputs).unwrap();
    let (again, unchanged) = display.show(&mut compositor, &inputs).unwrap();
    assert_eq!(again, [Stage::Mix]);
    inputs.rig.set_text("noise.scale=1.5", &mut inputs.settings).unwrap();
    let (noisier, picture) = display.show(&mut compositor, &inputs).unwrap();
    assert_eq!(noisier, [Stage::Mix]);
    assert!(picture != unchanged);
}
