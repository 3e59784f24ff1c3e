//! Properties of every effect with every one of its methods. A new effect is tested without further
//! code.

use crate::board::{FOCAL_PX, board, sideways};
use crate::gpu;
use crate::tier::fast_or_full;
use locard::camera::{Camera, Capture, FilmOverride, Geometry, NoiseBin, NoiseProfile, Opening};
use locard::compositor::{Compositor, Job, RealDepth, Settings, Target};
use locard::depth::{DepthGrid, Surfaces};
use locard::effects::{self, Effect, FrameContext, LayerRun};
use locard::gpu::{PassRecorder, Texture};
use locard::params::Value;
use locard::pixels::{Codes, Pixels, Rect};
use locard::render::{COLOR, GEOMETRY, Layer, RealLayer};

const TIME_S: f64 = 0.02;
const OPENING: Opening = Opening { diameter_m: 0.02, focus_distance_m: 0.7, blades: 5, rotation_rad: 0.3 };

/// Width and height of the pictures, px.
fn size() -> (u32, u32) {
    fast_or_full((160, 120), (320, 240))
}

/// Each effect with each of its test cases, and a label.
fn effect_cases() -> Vec<(String, Box<dyn Effect>)> {
    let way = |effect: &dyn Effect, (label, sets): (&str, Vec<(&str, Value)>)| {
        let mut effect = effect.boxed();
        sets.iter().for_each(|(name, value)| effect.set(name, value).unwrap());
        (format!("{} {label}", effect.table()).trim_end().to_owned(), effect)
    };
    let all = effects::all();
    all.iter()
        .flat_map(|effect| effect.cases().into_iter().map(|case| way(effect.as_ref(), case)).collect::<Vec<_>>())
        .collect()
}

/// Settings of one effect alone.
fn settings_of_one_effect(effect: &dyn Effect) -> Settings {
    let mut settings = Settings::default();
    settings.only(&[effect.table().to_owned()]).unwrap();
    for spec in effect.specs() {
        settings.set(effect.table(), spec.name, &effect.get(spec.name).unwrap()).unwrap().unwrap();
    }
    settings
}

fn camera(geometry: &Geometry) -> Camera {
    let mut camera = gpu::camera(geometry, TIME_S);
    let bins = vec![NoiseBin { code: 0.0, sigma: 1.5 }, NoiseBin { code: 255.0, sigma: 4.0 }];
    camera.noise = Some(NoiseProfile {
        example: None,
        bins: [bins.clone(), bins.clone(), bins],
        channel_correlation: [0.0; 3],
        neighbour_correlation: [0.3, 0.2],
    });
    camera.exposure.iso = Some(200.0);
    camera
}

fn stripes(size: (u32, u32)) -> Pixels {
    let codes = (0..size.0 * size.1).flat_map(|i| [60 + (i % size.0 / 4) as u8, 90, 60 + (i / size.0 / 4) as u8]);
    Pixels::from_u8(size.0, size.1, codes.collect()).unwrap()
}

/// A receding floor whose depth is known in every pixel.
fn surfaces(size: (u32, u32)) -> Surfaces {
    let count = (size.0 * size.1) as usize;
    let depth_m: Vec<f32> = (0..count).map(|i| 2.0 - (i as u32 / size.0) as f32 / size.1 as f32).collect();
    let light = vec![[0.1, 0.2, 0.3]; count];
    Surfaces {
        background_m: depth_m.clone(),
        background_light: light.clone(),
        nearest: DepthGrid { width: size.0, height: size.1, enlargement: 1.0, depth_m, light, is_dilated: true },
    }
}

#[test]
fn effects_pass_unchanged_textures_on() {
    let gpu = gpu::gpu();
    let geometry = gpu::pinhole(size().0, size().1, FOCAL_PX);
    let camera = camera(&geometry);
    let capture = Capture { whole: true, over_ev: 1.0, ..Capture::frame(&geometry, TIME_S, Some(OPENING)) };
    let context = FrameContext {
        camera: &camera,
        picture: &geometry,
        capture: &capture,
        frame: 1,
        seed: 0,
        coding: None,
        max_code: 255,
        recorded: Default::default(),
        interval_s: 1.0 / 30.0,
        resting_frames: 0,
        fastest_px_per_s: 400.0,
        depths_m: [0.9, 1.1],
        real_depths_m: Some([1.0, 2.0]),
        objects: &[],
    };
    let mut recorder = PassRecorder::new(gpu.clone());
    let texture = |format| Texture::new(&gpu, "test", size().0 + 16, size().1, format, 1);
    for (name, effect) in effect_cases() {
        let real = RealLayer {
            light: texture(COLOR),
            behind: texture(COLOR),
            depths: texture(GEOMETRY),
            tolerance_m: Some(0.02),
            ranges_m: vec![[1.0, 2.0]; 20],
        };
        let layer = Layer {
            coverage: Some(texture(COLOR)),
            light_alone: true,
            real: Some(real),
            ..Layer::new(texture(COLOR), texture(GEOMETRY), size())
        };
        let mut run = LayerRun {
            recorder: &mut recorder,
            context: &context,
            coding: None,
            drawn: Rect::full(size().0, size().1),
            objects_px: Rect::full(size().0, size().1),
            geometry_is_read: true,
        };
        let out = effect.run(&mut run, layer);
        recorder.submit();
        assert!(out.real.is_some(), "{name}: the real part (`..layer`)");
        assert!(out.coverage.is_some(), "{name}: what of each colour is covered (`..layer`)");
        assert!(out.light_alone, "{name}: that there is light alone (`..layer`)");
        assert_eq!(out.size, size(), "{name}");
    }
}

/// Photographs the picture region by region.
fn photographed(
    settings: &Settings,
    regions: &[Rect],
    made: &dyn Fn() -> (Geometry, Geometry, f64),
    real_too: bool,
) -> Pixels {
    let gpu = gpu::gpu();
    let (picture, recorded, enlargement) = made();
    let size = (picture.intrinsics.width_px, picture.intrinsics.height_px);
    let camera = camera(&recorded);
    let surfaces = surfaces(size);
    let mut compositor = Compositor::new(gpu.clone(), board(fast_or_full([30.0, 25.0], [60.0, 50.0]), 0.9));
    let mut all = stripes(size);
    for region in regions {
        let capture = Capture {
            region: *region,
            whole: true,
            over_ev: 0.5,
            film: Some(FilmOverride { speed: 4.0, width_mm: recorded.intrinsics.film_width_mm }),
            enlargement,
            recorded: recorded.clone(),
            ..Capture::frame(&picture, TIME_S, Some(OPENING))
        };
        let job = Job {
            frame: gpu::frame(3, 0.0, stripes(size)),
            picture: &picture,
            capture,
            real: RealDepth::Known { grid: None, surfaces: real_too.then_some(&surfaces), moments: &[] },
            track: &sideways([200.0, 60.0]),
            interval_s: 1.0 / 30.0,
            want_layer: false,
        };
        let pending = compositor.submit(job, &camera, settings, Target::Pixels).unwrap();
        let done = compositor.collect(pending).unwrap();
        let (Codes::U8(to), Codes::U8(from)) = (&mut all.codes, &done.pixels.codes) else { panic!("8 bits went in") };
        for y in region.y0..region.y1 {
            let at = |x: i32| 3 * (y as usize * size.0 as usize + x as usize);
            to[at(region.x0)..at(region.x1)].copy_from_slice(&from[at(region.x0)..at(region.x1)]);
        }
    }
    all
}

/// Asserts equality within one code value: texture sizes differ, and with them the rounding of
/// positions and of light.
fn assert_within_one_code(a: &Pixels, b: &Pixels, label: &str) {
    let apart = |i: u32| {
        let [a, b] = [a, b].map(|picture| picture.at(i % size().0, i / size().0));
        a.iter().zip(b).map(|(a, b)| a.abs_diff(b)).max().unwrap()
    };
    let (largest, at) = (0..size().0 * size().1).map(|i| (apart(i), i)).max().unwrap();
    let differ = (0..size().0 * size().1).filter(|i| apart(*i) > 0).count();
    println!("{label} {differ} pixels differ, by {largest} at most");
    assert!(largest <= 1, "{label} {differ} pixels differ, by {largest} at ({}, {})", at % size().0, at / size().0);
}

// Slow: every method of every effect, in whole and in five parts.
#[test]
fn effects_in_regions_match_the_whole_picture() {
    let geometry = || {
        let geometry = gpu::pinhole(size().0, size().1, FOCAL_PX);
        (geometry.clone(), geometry, 1.0)
    };
    let whole = [Rect::full(size().0, size().1)];
    // The regions' corners lie on the object and beside it.
    let smaller = fast_or_full(2, 1);
    let part = |edges: [i32; 4]| {
        let [x0, y0, x1, y1] = edges.map(|px| px / smaller);
        Rect::new(x0, y0, x1, y1)
    };
    let parts =
        [[0, 0, 130, 110], [130, 0, 320, 110], [0, 110, 97, 240], [97, 110, 230, 240], [230, 110, 320, 240]].map(part);
    for (name, effect) in effect_cases() {
        for real_too in [false, true] {
            let settings = settings_of_one_effect(effect.as_ref());
            let [whole, parts] =
                [&whole[..], &parts].map(|regions| photographed(&settings, regions, &geometry, real_too));
            assert!(whole != stripes(size()), "{name}: something is in the picture");
            assert_within_one_code(&whole, &parts, &format!("{name}: does it look farther than `reach` says?"));
        }
    }
}

// Slow: every effect at two resolutions.
#[test]
fn enlargement_matches_a_camera_of_higher_resolution() {
    let large = gpu::pinhole(size().0, size().1, FOCAL_PX);
    let small = gpu::pinhole(size().0 / 2, size().1 / 2, FOCAL_PX / 2.0);
    let whole = [Rect::full(size().0, size().1)];
    for (name, effect) in effect_cases() {
        // A parameter in camera pixels is twice as large for the camera of twice the resolution.
        let (mut coarser, mut finer) = (effect.clone(), effect.clone());
        for spec in effect.specs() {
            let Some(Value::Number(number)) = effect.get(spec.name) else { continue };
            let times = match spec.unit {
                "px" => 2.0,
                "1/px" => 0.5,
                _ => continue,
            };
            // If the doubled value is out of range, the coarser camera takes half of it.
            if finer.set(spec.name, &Value::Number(times * number)).is_err() {
                coarser.set(spec.name, &Value::Number(number / times)).unwrap();
            }
        }
        let enlarged = photographed(
            &settings_of_one_effect(coarser.as_ref()),
            &whole,
            &|| (large.clone(), small.clone(), 2.0),
            false,
        );
        let of_finer = photographed(
            &settings_of_one_effect(finer.as_ref()),
            &whole,
            &|| (large.clone(), large.clone(), 1.0),
            false,
        );
        assert_within_one_code(
            &enlarged,
            &of_finer,
            &format!("{name}: are its parameters in px times `capture.enlargement`?"),
        );
    }
}
