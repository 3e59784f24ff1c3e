//! One compositor that is reused while parameters change: each picture equals that of a new
//! compositor, for every target.

use crate::board::{FOCAL_PX, board, sideways};
use crate::gpu;
use crate::tier::{fast_or_full, is_full};
use locard::camera::{Camera, NoiseBin, NoiseProfile};
use locard::compositor::{Compositor, Job, Settings, Target};
use locard::frame::Frame;
use locard::gpu::Gpu;
use locard::params::{Kind, Spec, Value};
use locard::pixels::{Codes, Pixels};
use locard::profile::Rig;
use locard::scene::Scene;

/// Width and height of the frame, px.
fn size() -> (u32, u32) {
    fast_or_full((48, 32), (96, 64))
}

/// Camera parameters and settings of one picture.
#[derive(Clone)]
pub struct PictureInputs {
    pub rig: Rig,
    pub settings: Settings,
}

impl PictureInputs {
    /// Every effect with its test case of this number, with a camera on which all of them have an
    /// effect.
    pub fn new(case: usize) -> Self {
        let mut settings = Settings::default();
        let cases: Vec<_> = settings.effects().map(|e| (e.table(), e.cases())).collect();
        for (table, cases) in &cases {
            for (name, value) in &cases[case.min(cases.len() - 1)].1 {
                settings.set(table, name, value).unwrap().unwrap();
            }
        }
        let geometry = gpu::pinhole(size().0, size().1, FOCAL_PX);
        let mut rig = Rig::default();
        rig.lay_over(&geometry);
        let bins = vec![NoiseBin { code: 0.0, sigma: 2.0 }, NoiseBin { code: 255.0, sigma: 4.0 }];
        rig.noise = Some(NoiseProfile {
            example: None,
            bins: [bins.clone(), bins.clone(), bins],
            channel_correlation: [0.2, 0.1, 0.2],
            neighbour_correlation: [0.3, 0.2],
        });
        for set in [
            "camera.exposure.time_s=0.02",
            "camera.exposure.iso=200",
            // A smaller frame has a longer lens in mm: the same f-number blurs more.
            fast_or_full("camera.lens.f_number=16", "camera.lens.f_number=2"),
            // Limits the number of lens points of the method that samples the lens.
            if case < 3 { "camera.lens.focus_distance_m=0.7" } else { "camera.lens.focus_distance_m=1.9" },
        ] {
            rig.set_text(set, &mut settings).unwrap();
        }
        Self { rig, settings }
    }

    /// Every parameter with its table. From case 1 on, only those of effects that have as many
    /// cases.
    pub fn parameters(&self, case: usize) -> Vec<(&'static str, Spec)> {
        let tables = self.rig.tables().into_iter().chain(self.settings.tables());
        let cases = |table: &str| self.settings.effects().find(|e| e.table() == table).map_or(1, |e| e.cases().len());
        tables
            .filter(|table| case < cases(table.table()))
            .flat_map(|table| table.specs().into_iter().map(|spec| (table.table(), spec)))
            .collect()
    }

    pub fn value(&self, table: &str, name: &str) -> Value {
        let mut tables = self.rig.tables().into_iter().chain(self.settings.tables());
        tables.find(|of| of.table() == table).unwrap().get(name).unwrap()
    }

    /// The picture, or the error.
    fn picture(&self, compositor: &mut Compositor) -> Result<Pixels, String> {
        let camera = self.rig.camera();
        let geometry = camera.geometry.clone().unwrap();
        self.settings.check(&camera, &geometry).map_err(|e| e.to_string())?;
        let track = sideways([200.0, 0.0]);
        let job = Job::of_frame(frame(), &camera, &self.settings, &geometry, &track, 1.0 / 30.0)
            .map_err(|e| e.to_string())?;
        let pending = compositor.submit(job, &camera, &self.settings, Target::Pixels).map_err(|e| e.to_string())?;
        Ok(compositor.collect(pending).unwrap().pixels)
    }
}

fn frame() -> Frame {
    let (width, height) = size();
    let codes = (0..width * height).flat_map(|i| [60 + (i % 60) as u8, 90, 40 + (i / width) as u8]).collect();
    gpu::frame(7, 0.0, Pixels::from_u8(width, height, codes).unwrap())
}

fn scene() -> Scene {
    board(fast_or_full([10.0, 7.0], [20.0, 14.0]), 0.6)
}

/// Four values that span a parameter's range, or lie between those, and all choices. Unbounded
/// ranges are limited to ±10,000. The fast tier takes the two ends of the range, or the one value
/// between them.
fn values(spec: &Spec, between: bool) -> Vec<Value> {
    let numbers = |min: f64, max: f64| -> Vec<f64> {
        let (min, max) = (min.max(-1e4), max.min(1e4));
        let count: u32 = fast_or_full(if between { 1 } else { 2 }, 4);
        let step = |i: u32| {
            if between { (f64::from(i) + 0.5) / f64::from(count) } else { f64::from(i) / f64::from(count - 1) }
        };
        // Logarithmic steps over several decades.
        if min > 0.0 && max / min > 100.0 {
            return (0..count).map(|i| min * (max / min).powf(step(i))).collect();
        }
        (0..count).map(|i| min + (max - min) * step(i)).collect()
    };
    match &spec.kind {
        // Choices have no intermediate values; the full tier repeats all of them.
        Kind::Bool | Kind::Choice(_) if between && !is_full() => Vec::new(),
        Kind::Bool => vec![Value::Bool(true), Value::Bool(false)],
        Kind::Choice(names) => names.iter().map(|name| Value::Text((*name).to_owned())).collect(),
        Kind::Points => vec![Value::Text("0 0, 0.5 0.2, 1 1".to_owned())],
        Kind::LensTable => vec![Value::None],
        Kind::Number { min, max } => numbers(*min, *max).into_iter().map(Value::Number).collect(),
        Kind::Integer { min, max } => numbers(*min, *max).into_iter().map(|n| Value::Number(n.round())).collect(),
    }
}

/// Each value of each parameter in each test case, with a label.
fn sweep(between: bool) -> impl Iterator<Item = (String, PictureInputs)> {
    (0..4).flat_map(move |case| {
        let start = PictureInputs::new(case);
        let one = move |table: &str, name: &str, value: &Value| {
            let mut one = start.clone();
            let set = one.rig.set_text(&format!("{table}.{name}={value}"), &mut one.settings);
            set.is_ok().then(|| (format!("case {case}, {table}.{name} = {value}"), one))
        };
        let parameters = PictureInputs::new(case).parameters(case).into_iter();
        parameters.flat_map(move |(table, spec)| {
            values(&spec, between).iter().filter_map(|value| one(table, spec.name, value)).collect::<Vec<_>>()
        })
    })
}

// Slow: renders a picture for each value of each parameter, with four sets of methods.
#[test]
fn reused_compositor_matches_a_new_one_over_every_parameter_range() {
    // Own device: the test counts its pipelines.
    let gpu = Gpu::open().unwrap();
    let mut reused = Compositor::new(gpu.clone(), scene());
    let pictures: Vec<_> = sweep(false).map(|(label, one)| (label, one.picture(&mut reused))).collect();
    let drawn = pictures.iter().filter(|(_, picture)| picture.is_ok()).count();
    println!("{} values, {drawn} pictures", pictures.len());
    assert!(drawn > fast_or_full(100, 200) && drawn * 2 > pictures.len(), "{drawn} of {}", pictures.len());

    // Each choice has been drawn by now. Other numbers create no pipeline.
    let mut made = gpu.pipeline_count();
    for (label, one) in sweep(true) {
        let _ = one.picture(&mut reused);
        let now = gpu.pipeline_count();
        assert_eq!(now, made, "{label}: {} pipelines more", now - made);
        made = now;
    }
    let (again, anew) = fast_or_full((8, 24), (3, 9));
    for (n, ((label, one), (_, first))) in sweep(false).zip(&pictures).enumerate() {
        if n % again == 0 {
            assert!(one.picture(&mut reused) == *first, "{label}: another picture the second time");
        }
        // A new compositor for every picture would take minutes.
        if n % anew == 0 {
            let anew = one.picture(&mut Compositor::new(gpu.clone(), scene()));
            assert!(anew == *first, "{label}: not what a new compositor gives");
        }
    }
}

/// A device created as a window would create it.
fn adopted_gpu() -> (Gpu, wgpu::Device) {
    let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
    descriptor.backends = wgpu::Backends::PRIMARY;
    let instance = wgpu::Instance::new(descriptor);
    let adapter = pollster::block_on(instance.request_adapter(&wgpu::RequestAdapterOptions::default())).unwrap();
    let (device, queue) = pollster::block_on(adapter.request_device(&Gpu::device_descriptor(&adapter))).unwrap();
    (Gpu::from_device(&adapter, device.clone(), queue), device)
}

#[test]
fn error_on_an_adopted_device_is_reported_and_rendering_continues() {
    let (gpu, device) = adopted_gpu();
    let mut compositor = Compositor::new(gpu.clone(), scene());
    let inputs = PictureInputs::new(0);
    let before = inputs.picture(&mut compositor).unwrap();
    // Exceeds any device's limits.
    let _ = device.create_buffer(&wgpu::BufferDescriptor {
        label: None,
        size: 16,
        usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::MAP_WRITE,
        mapped_at_creation: false,
    });
    let camera = inputs.rig.camera();
    let (geometry, track) = (camera.geometry.clone().unwrap(), sideways([200.0, 0.0]));
    let job = |frame| Job::of_frame(frame, &camera, &inputs.settings, &geometry, &track, 1.0 / 30.0).unwrap();
    let pending = compositor.submit(job(frame()), &camera, &inputs.settings, Target::Pixels).unwrap();
    let error = compositor.collect(pending).unwrap_err().to_string();
    assert!(error.contains("MAP_READ"), "{error}");
    assert_eq!(gpu.take_failure().map(|e| e.to_string()), Some(error));
    assert!(inputs.picture(&mut compositor).unwrap() == before);

    // A view of another size is refused before drawing.
    let (width, height) = size();
    let view = gpu.render_target((width - 1, height), wgpu::TextureFormat::Rgba8Unorm).create_view(&Default::default());
    let target = Target::View(&view, wgpu::TextureFormat::Rgba8Unorm);
    let error = compositor.submit(job(frame()), &camera, &inputs.settings, target).unwrap_err().to_string();
    let (narrow, whole) = (format!("{}x{height}", width - 1), format!("{width}x{height}"));
    assert!(error.contains(&narrow) && error.contains(&whole), "{error}");
    gpu.check().unwrap();
}

#[test]
fn composite_into_a_texture_view_matches_the_written_pixels() {
    let (gpu, _) = adopted_gpu();
    let mut compositor = Compositor::new(gpu.clone(), scene());
    let inputs = PictureInputs::new(0);
    let camera = inputs.rig.camera();
    let geometry = camera.geometry.clone().unwrap();
    let written = inputs.picture(&mut compositor).unwrap();
    // Sixteen bits round to eight; a frame without a pose is the footage itself.
    let wide = |pixels: &Pixels| {
        let Codes::U8(codes) = &pixels.codes else { panic!("8 bits go in") };
        Pixels::from_u16(size().0, size().1, codes.iter().map(|c| u16::from(*c) * 257).collect()).unwrap()
    };
    let away = sideways([200.0, 0.0]);
    for format in
        [wgpu::TextureFormat::Rgba8Unorm, wgpu::TextureFormat::Rgba8UnormSrgb, wgpu::TextureFormat::Bgra8Unorm]
    {
        for (what, frame) in [
            ("8 bits", frame()),
            ("no pose", Frame { timestamp_s: 60.0, ..frame() }),
            ("16 bits", {
                let frame = frame();
                Frame { pixels: wide(&frame.pixels).into(), ..frame }
            }),
        ] {
            let texture = gpu.render_target(size(), format);
            let view = texture.create_view(&Default::default());
            let job = Job::of_frame(frame.clone(), &camera, &inputs.settings, &geometry, &away, 1.0 / 30.0).unwrap();
            let target = Target::View(&view, format);
            let pending = compositor.submit(job, &camera, &inputs.settings, target).unwrap();
            let done = compositor.collect(pending).unwrap();
            assert!(done.pixels == *frame.pixels, "the frame itself stays as it came");
            let job = Job::of_frame(frame.clone(), &camera, &inputs.settings, &geometry, &away, 1.0 / 30.0).unwrap();
            let pending = compositor.submit(job, &camera, &inputs.settings, Target::Pixels).unwrap();
            let expected = compositor.collect(pending).unwrap().pixels;
            assert_eq!(expected != *frame.pixels, what != "no pose");
            if what == "8 bits" {
                assert!(expected == written);
            }
            let max_code = expected.max_code();
            for (i, texel) in gpu::read_back(&gpu, &texture).into_iter().enumerate() {
                let [a, b, c, alpha] = texel.map(u32::from);
                let shown = if format == wgpu::TextureFormat::Bgra8Unorm { [c, b, a] } else { [a, b, c] };
                let codes = expected.at(i as u32 % size().0, i as u32 / size().0);
                let eight = codes.map(|code| (code * 255 + max_code / 2) / max_code);
                // Drivers may round a value halfway between two codes to either one, and so for
                // light halfway between two 16-bit codes.
                let max_difference = if max_code == 255 { 0 } else { 1 };
                let off = shown.iter().zip(eight).map(|(a, b)| a.abs_diff(b)).max().unwrap();
                assert!(
                    off <= max_difference && alpha == 255,
                    "{format:?}, {what}, pixel {i}: {shown:?}, not {eight:?}"
                );
            }
        }
    }
}

#[test]
fn settings_compare_by_value_and_survive_serialization() {
    let one = PictureInputs::new(0).settings;
    let mut other = PictureInputs::new(0).settings;
    assert!(one == other);
    other.set("noise", "scale", &Value::Number(0.5)).unwrap().unwrap();
    assert!(one != other && one.clone() == one);
    let mut off = one.clone();
    off.without(&["noise".to_owned()]).unwrap();
    assert!(off != one);
    let text = toml::to_string(&other).unwrap();
    assert!(text.contains("[tables.noise]") && text.contains("scale = 0.5"), "{text}");
    assert!(toml::from_str::<Settings>(&text).unwrap() == other);
    assert!(toml::from_str::<Settings>(&toml::to_string(&off).unwrap()).unwrap() == off);
    let camera = PictureInputs::new(0).rig.camera();
    let written = toml::to_string(&camera).unwrap();
    assert!(toml::from_str::<Camera>(&written).unwrap() == camera, "{written}");
    let wrong = text.replace("scale = 0.5", "scale = 900.0");
    assert!(toml::from_str::<Settings>(&wrong).unwrap_err().to_string().contains("0 to 8"));
}
