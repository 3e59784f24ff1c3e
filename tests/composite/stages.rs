//! Stages of a frame: a changed parameter recomputes the first stage that reads it and those that
//! read its result, and the picture is that of a new compositor.

use std::collections::BTreeSet;
use std::sync::Arc;

use crate::gpu;
use crate::reused_compositor::PictureInputs;
use crate::shadow::box_scene;
use glam::{DMat3, DQuat, DVec2, DVec3, Vec3};
use locard::camera::Geometry;
use locard::coding::{BlockQuantization, ChromaSampling, Decoder, PictureCoding, YcbcrColor};
use locard::compositor::{Compositor, Job, Settings, Target};
use locard::frame::{Frame, FrameExposure, PhotoSettings, RelativeBrightness, SpatialGain};
use locard::gpu::Gpu;
use locard::params::{ActsIf, Kind, Spec, Value};
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

/// Pose of a camera half a metre away that points down at the box.
fn pose(along_m: f64) -> Pose {
    let eye = DVec3::new(0.1 + along_m, -0.45, 0.4);
    let forward = -DVec3::new(0.1, -0.45, 0.4).normalize();
    let right = forward.cross(DVec3::Z).normalize();
    let turn = DQuat::from_mat3(&DMat3::from_cols(right, forward.cross(right), forward));
    Pose::from_camera_in_world(eye, turn)
}

/// A JPEG's, with coarse steps.
fn coding() -> PictureCoding {
    PictureCoding {
        color: YcbcrColor::JFIF,
        chroma: Some(ChromaSampling::centered([2, 2])),
        quantization: Some(BlockQuantization::at_corner([[16; 64]; 3])),
        decoder: Decoder::ZuneJpeg,
    }
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
        let pixels = Pixels::from_u8(WIDTH, HEIGHT, codes.collect()).unwrap();
        let frame = gpu::frame(7, 0.0, Pixels { coding: Some(Arc::new(coding())), ..pixels });
        let texture = gpu.render_target((WIDTH, HEIGHT), wgpu::TextureFormat::Rgba8Unorm);
        // Exposure and brightness are known; the exposure time is the camera's.
        let brightness =
            RelativeBrightness { factors: [1.3, 1.2, 1.1], median_s: Some(0.01), spatial_gain: SpatialGain::default() };
        let photo = PhotoSettings { iso: Some(200.0), f_number: Some(2.0), time_s: Some(0.02), ..Default::default() };
        let exposure = FrameExposure { brightness: Some(brightness), photo, ..FrameExposure::default() };
        Self {
            frame: Frame { depth: Some(depth.into()), exposure, ..frame },
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
    let mut scene = box_scene(DVec3::new(0.04, 0.03, 0.05), lighting);
    // Grey is the same in all primaries.
    scene.materials[0].base_color = [1.0, 0.95, 0.9, 1.0];
    Compositor::new(gpu.clone(), scene)
}

/// The parameters of a test case, with all effects on.
fn base(case: usize) -> PictureInputs {
    let mut inputs = PictureInputs::new(case);
    for set in [
        "camera.width_px=96",
        "camera.height_px=64",
        "camera.fx_px=110",
        "camera.fy_px=110",
        "camera.cx_px=48",
        "camera.cy_px=32",
        "camera.lens.focus_distance_m=0.3",
        "camera.lens.f_number=2",
    ] {
        inputs.rig.set_text(set, &mut inputs.settings).unwrap();
    }
    inputs
}

/// The settings with which a parameter has an effect.
fn prerequisites(inputs: &PictureInputs, table: &str, spec: &Spec) -> Vec<String> {
    match (table, spec.name) {
        ("camera.lens", "aperture_diameter_mm") => {
            ["f_number=none", "aperture_diameter_mm=20"].map(|set| format!("camera.lens.{set}")).to_vec()
        }
        ("camera.lens", "blade_rotation_deg") => vec!["camera.lens.blades=3".to_owned()],
        ("camera.exposure", "shutter_angle_deg") => vec!["camera.exposure.time_s=none".to_owned()],
        ("camera.exposure", "iso") => vec!["noise.iso=800".to_owned()],
        ("depth_of_field", "largest_radius_px") => {
            let sets =
                ["camera.lens.f_number=0.5", "depth_of_field.method=diffusion", "depth_of_field.largest_radius_px=4"];
            sets.map(str::to_owned).to_vec()
        }
        ("vignetting", "rim_radius_mm") => vec!["vignetting.rim_distance_mm=100".to_owned()],
        _ => {
            let Some(acts_if @ ActsIf { other, is: true, .. }) = spec.acts_if else { return Vec::new() };
            let value = acts_if.values().next().unwrap_or_default();
            let specs = inputs.parameters(0);
            let (_, other_spec) = specs.iter().find(|(of, spec)| *of == table && spec.name == other).unwrap();
            let mut before = prerequisites(inputs, table, other_spec);
            before.push(format!("{table}.{other}={value}"));
            before
        }
    }
}

/// Other values of a parameter, near its own ones first.
fn changes(table: &str, spec: &Spec, value: &Value) -> Vec<Value> {
    let numbers = match (table, spec.name) {
        ("camera.distortion", "k2") => vec![0.01],
        ("camera.distortion", "k3" | "omega") => vec![0.05],
        ("camera.distortion", "k4" | "k5" | "k6") => vec![50.0, 100.0],
        ("camera.lens", "blades") => vec![3.0],
        ("camera.lens", "blade_rotation_deg") => vec![20.0],
        ("camera.exposure", "shutter_angle_deg") => vec![200.0, 250.0],
        ("depth", "tolerance_m") => vec![1.0],
        ("chromatic_aberration", "red" | "blue") => vec![0.002],
        ("depth_of_field", "blend_below") => vec![0.9, 0.5],
        ("depth_of_field", "largest_radius_px") => vec![3.9, 3.5],
        ("edge_blend", "impact") => vec![0.5],
        ("exposure", "reference_s") => vec![0.02],
        ("motion_blur", "frames_per_s") => vec![160.0],
        ("motion_blur", "threshold_px") => vec![2.0, 3.0, 4.0],
        ("noise", "animation_delay") => vec![5.0],
        ("noise", "film_width_mm") => vec![10.0],
        ("noise", "iso") => vec![800.0],
        ("vignetting", "image_circle_px") => vec![20.0, 30.0],
        ("vignetting", "rim_distance_mm") => vec![100.0],
        _ => Vec::new(),
    };
    if !numbers.is_empty() {
        return numbers.into_iter().map(Value::Number).collect();
    }
    let others = match &spec.kind {
        Kind::Bool => vec![Value::Bool(*value != Value::Bool(true))],
        Kind::Choice(names) => names.iter().map(|name| Value::Text((*name).to_owned())).collect(),
        Kind::Points => vec![Value::Text("0 0, 0.5 0.2, 1 1".to_owned())],
        Kind::LensTable => vec![Value::None],
        Kind::Number { min, max } | Kind::Integer { min, max } => {
            let other = |factor: f64| match value {
                Value::Number(number) if *number != 0.0 => number * (1.0 + factor),
                _ => factor,
            };
            let is_whole = matches!(spec.kind, Kind::Integer { .. });
            let rounded = |number: f64| if is_whole { number.ceil() } else { number };
            [0.001, 0.01, 0.05, 0.3, 1.0].map(|factor| Value::Number(rounded(other(factor)).clamp(*min, *max))).to_vec()
        }
    };
    others.into_iter().filter(|other| other != value).collect()
}

/// A compositor that shows the picture before a change, and that picture.
struct Shown {
    prerequisites: Vec<String>,
    compositor: Compositor,
    picture: Vec<[u8; 4]>,
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
    // A frame has the camera's size, and a table comes from files.
    let mut left: BTreeSet<&str> = all.iter().map(String::as_str).collect();
    ["camera.width_px", "camera.height_px", "camera.distortion.map"].iter().for_each(|name| assert!(left.remove(name)));
    for case in 0..4 {
        let mut shown: Option<Shown> = None;
        for (table, spec) in base(case).parameters(case) {
            let name = format!("{table}.{}", spec.name);
            let declared = spec.stage.unwrap_or_else(|| panic!("{name} has no stage"));
            let mut from = base(case);
            let prerequisites = prerequisites(&from, table, &spec);
            for text in &prerequisites {
                from.rig.set_text(text, &mut from.settings).unwrap();
            }
            for value in changes(table, &spec, &from.value(table, spec.name)) {
                if !left.contains(name.as_str()) {
                    break;
                }
                let mut to = from.clone();
                if to.rig.set_text(&format!("{name}={value}"), &mut to.settings).is_err() {
                    continue;
                }
                if shown.as_ref().is_none_or(|shown| shown.prerequisites != prerequisites) {
                    let mut compositor = compositor(&gpu);
                    let Some((first, picture)) = display.show(&mut compositor, &from) else { continue };
                    assert_eq!(first, Stage::ALL, "a new compositor");
                    shown = Some(Shown { prerequisites: prerequisites.clone(), compositor, picture });
                }
                let Some(Shown { compositor: reused, picture: unchanged, .. }) = &mut shown else { unreachable!() };
                let Some((mut stages, changed)) = display.show(reused, &to) else { continue };
                let (_, back) = display.show(reused, &from).unwrap();
                assert!(back == *unchanged, "case {case}, {name} = {value}: another picture after the way back");
                let mut opposite = compositor(&gpu);
                let (_, expected) = display.show(&mut opposite, &to).unwrap();
                assert!(changed == expected, "case {case}, {name} = {value}: another picture than a new compositor's");
                // Another reach of an effect recomputes depth as well.
                assert!(stages[0] >= declared.min(Stage::Depth), "case {case}, {name} = {value}: {stages:?}");
                // A result that is not needed any more is not computed; the opposite change
                // computes it.
                if stages[0] > declared {
                    stages = display.show(&mut opposite, &from).unwrap().0;
                }
                if declared >= Stage::Draw && stages[0] == declared {
                    let after = Stage::ALL.into_iter().filter(|stage| *stage >= declared);
                    assert_eq!(stages, after.collect::<Vec<_>>(), "case {case}, {name} = {value}");
                }
                if changed != *unchanged && stages[0] == declared {
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

#[test]
fn forgotten_results_are_computed_again() {
    let gpu = gpu::gpu();
    let (display, mut compositor, inputs) = (Display::new(&gpu), compositor(&gpu), base(0));
    let (_, first) = display.show(&mut compositor, &inputs).unwrap();
    compositor.forget_results();
    let (stages, again) = display.show(&mut compositor, &inputs).unwrap();
    // Planar shadows and lightmaps are computed on the processor, so they cannot fail with it.
    assert_eq!(stages, Stage::ALL[2..]);
    assert!(again == first);
}

#[test]
fn strength_to_and_from_0_repeats_no_stage_before_the_shadow_mask() {
    let gpu = gpu::gpu();
    let display = Display::new(&gpu);
    let mut reused = compositor(&gpu);
    let of_strength = |strength: f32, cast: bool| {
        let mut inputs = base(0);
        for set in [format!("shadow.strength={strength}"), format!("shadow.cast={cast}")] {
            inputs.rig.set_text(&set, &mut inputs.settings).unwrap();
        }
        inputs
    };
    let mut show = |strength: f32| display.show(&mut reused, &of_strength(strength, true)).unwrap();
    let [none, half, none_again] = [0.0, 0.5, 0.0].map(&mut show);
    assert_eq!(none.0, Stage::ALL);
    let from_mask = Stage::ALL.into_iter().filter(|stage| *stage >= Stage::ShadowMask).collect::<Vec<_>>();
    assert_eq!((half.0, none_again.0), (from_mask.clone(), from_mask));
    let (_, without) = display.show(&mut compositor(&gpu), &of_strength(1.0, false)).unwrap();
    assert!(none.1 == without && none_again.1 == without && half.1 != without);
}
