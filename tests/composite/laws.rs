//! The laws of ARCHITECTURE.md, on real frames if required. One file, because the laws share the
//! frames and cases.

use std::path::Path;
use std::sync::Arc;

use crate::board::{FOCAL_PX, board, merge_scenes, panel, sideways};
use crate::gpu;
use crate::random::Random;
use crate::reduced::Reduction;
use crate::site::{NOISE, NamedShot, demo_like, desk, sites};
use crate::tier::{fast_or_full, is_full};
use locard::camera::{Curve, NoiseBin, NoiseProfile, Response};
use locard::compositor::{Composited, Compositor, IN_FLIGHT, Settings};
use locard::effects;
use locard::gpu::Gpu;
use locard::params::Value;
use locard::pixels::Pixels;
use locard::scene::{Alpha, Scene, SceneTexture, TextureUse, Wrap};

/// The demonstration at 1/`smaller` of its resolution, with its two markers as the only objects.
/// In the full tier: the demonstration itself and a real recording.
fn sites_of_tier(smaller: u32) -> Vec<NamedShot> {
    if is_full() {
        return sites();
    }
    let mut site = demo_like(&Reduction::by(smaller).demo());
    Arc::make_mut(&mut site.shot.scene).objects.retain(|object| object.name.starts_with("marker"));
    vec![site]
}

/// All effects on, each with its first test case.
fn settings() -> Settings {
    cases_of_all_effects().pop().unwrap()
}

/// All effects on, once per test case; effects with fewer cases repeat their first.
fn cases_of_all_effects() -> Vec<Settings> {
    let cases: Vec<_> = effects::all().iter().map(|e| (e.table(), e.cases())).collect();
    let max_cases = cases.iter().map(|(_, cases)| cases.len()).max().unwrap();
    let way = |n: usize| {
        let mut settings = Settings::default();
        for (table, cases) in &cases {
            let first = cases.first().unwrap_or_else(|| panic!("{table} has no case to be tested in"));
            for (name, value) in &cases.get(n).unwrap_or(first).1 {
                settings.set(table, name, value).unwrap().unwrap();
            }
        }
        settings
    };
    // The first case, the users' default, comes last.
    (0..max_cases).rev().map(way).collect()
}

/// Composites a range by a new compositor with two frames in flight, as the program does.
fn composite(
    gpu: &Gpu,
    site: &mut NamedShot,
    settings: Settings,
    range: std::ops::Range<usize>,
    layers: bool,
) -> Vec<Composited> {
    composite_with(&mut site.shot.compositor(gpu.clone()), site, &settings, (range, IN_FLIGHT), layers)
}

/// Composites a range by a given compositor with this number of frames in flight.
fn composite_with(
    compositor: &mut Compositor,
    site: &mut NamedShot,
    settings: &Settings,
    (range, in_flight): (std::ops::Range<usize>, usize),
    layers: bool,
) -> Vec<Composited> {
    site.shot.settings = settings.clone();
    site.shot.frames(compositor, range, layers, in_flight).unwrap().map(Result::unwrap).collect()
}

/// Asserts that pixels without objects and shadows equal the footage, and that the layer is empty
/// there.
fn assert_footage_unchanged(site: &NamedShot, done: &[Composited], range: std::ops::Range<usize>) {
    let (mut touched, mut visible) = (0usize, 0usize);
    for (done, frame) in done.iter().zip(site.shot.recording.frames(range).unwrap()) {
        let frame = frame.unwrap();
        let layer = done.layer.as_ref().unwrap();
        let pairs = done
            .pixels
            .codes
            .eight_bit()
            .unwrap()
            .chunks_exact(3)
            .zip(frame.pixels.codes.eight_bit().unwrap().chunks_exact(3));
        for (i, (out, camera)) in pairs.enumerate() {
            if layer.rgba[i] == [0.0; 4] && layer.left[i] == [1.0; 3] {
                assert_eq!(out, camera, "{} frame {} pixel {i}", site.name, done.frame);
            } else if layer.rgba[i][3] > 0.0 {
                visible += 1;
                touched += usize::from(out != camera);
            }
        }
        for ((p, depth), velocity) in layer.rgba.iter().zip(&layer.depth_m).zip(&layer.velocity) {
            assert_eq!(p[3] > 0.0, *depth > 0.0, "{}: depth is 0 exactly where A is 0", site.name);
            // Light may lie outside of coverage: a glow, or a highlight whose coverage is below
            // 6e-8, the smallest 16-bit float.
            let nothing = *velocity == [0.0; 2] && (layer.light_alone || p[..3].iter().all(|light| *light == 0.0));
            assert!(p[3] > 0.0 || nothing, "{}: {p:?} {velocity:?}", site.name);
        }
    }
    // The law needs visible objects: 500 px of a 640x480 frame.
    let min_pixels = 500 * site.shot.recording.width as usize * site.shot.recording.height as usize / (640 * 480);
    assert!(
        visible > done.len() * min_pixels && touched > visible / 2,
        "{}: {visible} mixed pixels, {touched} changed",
        site.name
    );
}

// Slow: renders every method of every effect, on the demonstration and on a real recording.
#[test]
fn law_1_footage_without_objects_is_unchanged() {
    let gpu = gpu::gpu();
    let range = fast_or_full(31..32, 30..33);
    let all: Vec<_> = effects::all().iter().map(|e| e.table()).collect();
    // Lighting and shadows are computed once for each site's objects, whatever the settings.
    let mut on: Vec<_> = sites_of_tier(2).into_iter().map(|site| (site.shot.compositor(gpu.clone()), site)).collect();
    for (compositor, site) in &mut on {
        for (n, settings) in cases_of_all_effects().into_iter().enumerate() {
            let done = composite_with(compositor, site, &settings, (range.clone(), IN_FLIGHT), true);
            assert_footage_unchanged(site, &done, range.clone());
            // Frames of unknown format have none to follow.
            let is_coded = done[0].pixels.coding.is_some();
            let all: Vec<_> = all.iter().copied().filter(|effect| is_coded || *effect != "format").collect();
            assert!(
                done.iter().any(|done| done.stats.effects == all),
                "{} {n}: {:?}",
                site.name,
                done[0].stats.effects
            );
        }
    }
    // And without the effects that put light outside of coverage.
    let mut glowing = Vec::new();
    let (compositor, site) = &mut on[0];
    for effect in all.iter().map(|name| (*name).to_owned()) {
        let mut alone = settings();
        alone.only(std::slice::from_ref(&effect)).unwrap();
        alone.shadow.cast = false;
        let done = composite_with(compositor, site, &alone, (31..32, IN_FLIGHT), true);
        if done[0].layer.as_ref().unwrap().light_alone {
            glowing.push(effect);
        }
    }
    assert!(!glowing.is_empty());
    for (compositor, site) in &mut on {
        let mut without = settings();
        without.without(&glowing).unwrap();
        let done = composite_with(compositor, site, &without, (range.clone(), IN_FLIGHT), true);
        assert!(done.iter().all(|done| !done.layer.as_ref().unwrap().light_alone), "{glowing:?}");
        assert_footage_unchanged(site, &done, range.clone());
    }
    let Some(mut desk) = desk() else { return };
    let range = fast_or_full(30..32, 0..90);
    let done = composite(&gpu, &mut desk, settings(), range.clone(), true);
    assert_footage_unchanged(&desk, &done, range);
}

// Slow: four compositors light the whole demonstration scene.
#[test]
fn law_2_range_alone_matches_the_same_range_of_the_whole() {
    let gpu = gpu::gpu();
    let (range, part) = (fast_or_full(37..44, 30..55), fast_or_full(40..43, 40..50));
    let among = part.start - range.start..part.end - range.start;
    for mut site in sites_of_tier(4) {
        let whole = composite(&gpu, &mut site, settings(), range.clone(), false);
        let alone = composite(&gpu, &mut site, settings(), part.clone(), false);
        for (a, b) in alone.iter().zip(&whole[among.clone()]) {
            assert_eq!(a.frame, b.frame);
            assert!(a.pixels == b.pixels, "{} frame {}", site.name, a.frame);
        }
        for &in_flight in fast_or_full(&[3][..], &[1, 3]) {
            let mut anew = site.shot.compositor(gpu.clone());
            let again = composite_with(&mut anew, &mut site, &settings(), (part.clone(), in_flight), false);
            for (a, b) in again.iter().zip(&whole[among.clone()]) {
                assert!(a.pixels == b.pixels, "{} frame {}, {in_flight} in flight", site.name, a.frame);
            }
        }
        let mut other_seed = settings();
        other_seed.seed = 1;
        let other = composite(&gpu, &mut site, other_seed, 40..41, false);
        assert!(other[0].pixels != alone[0].pixels, "another seed is another pattern");
    }
}

#[test]
fn law_3_neutral_settings_are_the_identity() {
    let gpu = gpu::gpu();
    let range = fast_or_full(20..22, 20..24);
    // Effects that are not neutral by themselves: motion blur is set by the exposure, depth of
    // field by the lens, and these.
    let neutral = || {
        gpu::settings(&[
            ("noise", "scale", Value::Number(0.0)),
            ("depth", "occlusion", Value::Bool(false)),
            ("shadow", "cast", Value::Bool(false)),
        ])
    };
    for mut site in sites_of_tier(4) {
        let with_lens = site.shot.rig.clone();
        site.shot.rig.exposure.time_s = Some(0.0);
        site.shot.rig.lens = Default::default();
        let mut plain = Settings::default();
        plain.overrule_recorded_exposure = true;
        plain.plain();
        let plain = composite(&gpu, &mut site, plain, range.clone(), false);
        let mut overruled = neutral();
        overruled.overrule_recorded_exposure = true;
        for (a, b) in composite(&gpu, &mut site, overruled, range.clone(), false).iter().zip(&plain) {
            assert_eq!(a.stats.effects, [""; 0], "{}: every effect has a neutral setting, to be given here", site.name);
            assert!(a.pixels == b.pixels, "{} frame {}", site.name, a.frame);
        }
        // A scene without objects yields the recording itself.
        site.shot.rig = with_lens;
        std::sync::Arc::make_mut(&mut site.shot.scene).objects.clear();
        let frames = site.shot.recording.frames(range.clone()).unwrap();
        for (a, b) in composite(&gpu, &mut site, settings(), range.clone(), false).iter().zip(frames) {
            assert!(a.pixels == *b.unwrap().pixels);
        }
    }
}

/// Response curves with which a camera may encode light.
fn curves() -> [Response; 5] {
    [Curve::Srgb, Curve::Linear, Curve::Gamma, Curve::Hlg, Curve::SLog3].map(|curve| Response {
        curve,
        gamma: 2.2,
        ..Response::default()
    })
}

/// Composites under one response curve; everything else stays the same.
fn under_curve(
    response: &Response,
    settings: Settings,
    blur_px: f64,
    scene: Scene,
    camera_pixels: Pixels,
) -> Composited {
    const EXPOSURE_S: f64 = 0.02;
    let geometry = gpu::pinhole(320, 240, FOCAL_PX);
    let mut camera = gpu::camera(&geometry, EXPOSURE_S);
    camera.response = response.clone();
    let bins = vec![NoiseBin { code: 0.0, sigma: 6.1 }, NoiseBin { code: 255.0, sigma: 1.0 }];
    camera.noise = Some(NoiseProfile {
        example: None,
        bins: [bins.clone(), bins.clone(), bins],
        channel_correlation: [0.0; 3],
        neighbour_correlation: [0.0; 2],
    });
    let frame = gpu::frame(0, 0.0, camera_pixels);
    gpu::composite(&gpu::gpu(), &camera, settings, scene, &sideways([blur_px / EXPOSURE_S, 0.0]), frame)
}

/// Silhouettes and the seam between a dark and a bright board pass through pixel centres.
fn dark_and_bright() -> Scene {
    merge_scenes(panel([-59.5, -50.5], [0.5, 50.5], 0.05), panel([0.5, -50.5], [60.5, 50.5], 0.8))
}

#[test]
fn law_4_optics_work_on_linear_light() {
    for (method, blur_px) in [("velocity", 0.0), ("velocity", 12.0), ("copies", 12.0), ("reference", 12.0)] {
        let settings = || {
            gpu::settings(&[
                ("motion_blur", "method", Value::Text(method.to_owned())),
                ("motion_blur", "copies", Value::Number(48.0)),
                ("noise", "scale", Value::Number(0.0)),
            ])
        };
        let layers = curves().map(|response| {
            let done = under_curve(&response, settings(), blur_px, dark_and_bright(), gpu::grey(320, 240, 60));
            let mut layer = done.layer.unwrap();
            // The codes of mixed pixels are rounded under each curve.
            layer.noise.clear();
            let behind = response.decode(60.0 / 255.0);
            let mut mixed = 0;
            for (i, (out, rgba)) in done.pixels.codes.eight_bit().unwrap().chunks_exact(3).zip(&layer.rgba).enumerate()
            {
                let [r, _, _, a] = rgba.map(f64::from);
                let code = 255.0 * response.encode(r + (1.0 - a) * behind);
                // Rounding, and the shader's 32-bit error.
                assert!((f64::from(out[0]) - code).abs() < 0.52, "{method} {response:?} pixel {i}: {} {code}", out[0]);
                mixed += usize::from(a > 0.1 && a < 0.9);
            }
            assert!(mixed > 200, "{mixed} pixels are part camera, part layer");
            layer
        });
        // The optics do not depend on the curve.
        assert!(layers.iter().all(|layer| *layer == layers[0]), "{method}");
        // Both radiances meet in the middle of column 160: coverage and blur take their mean. The
        // mean of their sRGB codes would be a radiance of 0.29.
        let row = &layers[0].rgba[120 * 320..][..320];
        let middle = f64::from(row[160][0]);
        // A tap or a sample may fall on either side: a twelfth of the blur's ramp.
        let tolerance = if blur_px > 0.0 { 0.75 / 12.0 } else { 1e-3 };
        assert!((middle - 0.425).abs() < tolerance, "{method} {blur_px}: {middle}");
        let flat = if blur_px > 0.0 { 12 } else { 1 };
        assert!((row[160 - flat][0] - 0.05).abs() < 1e-3 && (row[160 + flat][0] - 0.8).abs() < 1e-3);
        // The silhouette at column 100: half of the pixel is board.
        assert!((row[100][3] - 0.5).abs() < 1.0 / 12.0 && (row[100][0] - 0.5 * 0.05).abs() < 0.1, "{:?}", row[100]);
    }
}

#[test]
fn law_4_textures_are_filtered_in_linear_light() {
    // Black and white texels, nearly four a pixel in each direction: the pixel has their mean
    // light, not their mean code (0.21).
    let side = 450;
    let texel = |i: u32| if (i % side + i / side).is_multiple_of(2) { [255, 255, 255, 255] } else { [0, 0, 0, 255] };
    let mut scene = board([60.0, 60.0], 1.0);
    scene.textures.push(SceneTexture {
        width: side,
        height: side,
        rgba: Arc::new((0..side * side).flat_map(texel).collect()),
        srgb: true,
        wrap: [Wrap::Clamp; 2],
        smooth: true,
        mipmaps: true,
    });
    let whole = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    scene.materials[0].base_color_texture = Some(TextureUse { texture: 0, uv_set: 0, transform: whole });
    let done = under_curve(&Response::default(), Settings::default(), 0.0, scene, gpu::grey(320, 240, 60));
    let layer = done.layer.unwrap();
    let inside: Vec<f64> = (80..160)
        .flat_map(|y| (120..200).map(move |x| (y, x)))
        .map(|(y, x): (usize, usize)| f64::from(layer.rgba[y * 320 + x][0]))
        .collect();
    let mean = inside.iter().sum::<f64>() / inside.len() as f64;
    assert!((mean - 0.5).abs() < 0.03, "{mean}");
}

#[test]
fn law_4_the_sensor_works_on_code_values() {
    // Noise: σ of one code value, whatever the light at that code under the camera's curve.
    let noisy = curves().map(|response| {
        let light = response.decode(123.5 / 255.0) as f32;
        let scene = board([200.0, 150.0], light);
        under_curve(&response, Settings::default(), 0.0, scene, gpu::grey(320, 240, 90)).pixels
    });
    for other in &noisy[1..] {
        let pairs = || noisy[0].codes.eight_bit().unwrap().iter().zip(other.codes.eight_bit().unwrap());
        // The layer has 16-bit floats, half a unit of which is up to 0.04 codes at this brightness.
        assert!(pairs().all(|(a, b)| a.abs_diff(*b) <= 1));
        let differ = pairs().filter(|(a, b)| a != b).count();
        assert!(differ < 230_400 / 20, "{differ} of 230,400 codes differ");
    }
    let [mean, sigma] = mean_and_sigma(&noisy[0]);
    let expected = (6.1 - 5.1 * 123.5 / 255.0f64).hypot((1.0f64 / 12.0).sqrt());
    assert!((mean - 123.5).abs() < 0.1 && (sigma / expected - 1.0).abs() < 0.02, "{mean} {sigma} {expected}");

    // Edge blend: the paper's mean of code values.
    for response in curves() {
        let settings =
            gpu::settings(&[("edge_blend", "impact", Value::Number(1.0)), ("noise", "scale", Value::Number(0.0))]);
        let scene = board([60.0, 50.0], response.decode(200.0 / 255.0) as f32);
        let done = under_curve(&response, settings, 0.0, scene, gpu::grey(320, 240, 40)).pixels;
        // On a straight edge three of eight neighbours are footage, at a corner five; inside none.
        for (x, y, code) in [(100, 120, 80), (160, 70, 80), (219, 120, 80), (100, 70, 67), (130, 120, 200)] {
            assert_eq!(done.at(x, y), [code; 3], "{response:?} ({x}, {y})");
        }
    }

    // The footage's share of a mixed pixel brings noise through the optics: its σ times the ratio
    // of the curve's slopes at its own and at the mixed code. With the added noise, the pixel has
    // the σ of its own code.
    let (behind, code) = (30.0, 150.0);
    let sigma_at = |code: f64| 6.1 - 5.1 * code / 255.0;
    let mut random = Random::new(1);
    // The sum of twelve uniform numbers has variance 1.
    let mut normal = || (0..12).map(|_| random.uniform()).sum::<f64>() - 6.0;
    let camera: Vec<u8> = (0..3 * 320 * 240).map(|_| (behind + sigma_at(behind) * normal()).round() as u8).collect();
    for response in curves() {
        let light = 2.0 * response.decode(code / 255.0) - response.decode(behind / 255.0);
        let mut scene = board([200.0, 150.0], light as f32);
        scene.materials[0].base_color[3] = 0.5;
        scene.materials[0].alpha = Alpha::Blend;
        let pixels = Pixels::from_u8(320, 240, camera.clone()).unwrap();
        let done = under_curve(&response, Settings::default(), 0.0, scene, pixels).pixels;
        let [_, sigma] = mean_and_sigma(&done);
        let expected = sigma_at(code).hypot((1.0f64 / 12.0).sqrt());
        assert!((sigma / expected - 1.0).abs() < 0.03, "{response:?}: {sigma} {expected}");
    }
}

fn mean_and_sigma(pixels: &Pixels) -> [f64; 2] {
    let values = || pixels.codes.eight_bit().unwrap().iter().map(|&c| f64::from(c));
    let n = values().count() as f64;
    let mean = values().sum::<f64>() / n;
    [mean, (values().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt()]
}

/// A recording with this many frames: ten pictures and a depth map repeated, with a swaying marker
/// in front of them.
fn long_recording(folder: &Path, frames: usize) {
    let write = |name: &str, text: &str| std::fs::write(folder.join(name), text).unwrap();
    let mut random = Random::new(1);
    let (width, height) = long_px();
    for i in 0..10 {
        let pixels =
            image::RgbImage::from_fn(width, height, |_, _| image::Rgb([(60.0 + 120.0 * random.uniform()) as u8; 3]));
        pixels.save(folder.join(format!("{i}.png"))).unwrap();
    }
    image::ImageBuffer::from_pixel(width, height, image::Luma([1000u16])).save(folder.join("depth.png")).unwrap();
    let list = |name: &dyn Fn(usize) -> String| -> String {
        (0..frames).map(|i| format!("{:.6} {}\n", i as f64 / 30.0, name(i))).collect()
    };
    write("rgb.txt", &list(&|i| format!("{}.png", i % 10)));
    write("depth.txt", &list(&|_| "depth.png".to_owned()));
    let sway = |i: usize| 0.05 * (i as f64 / 7.0).sin();
    let poses = (0..2 * frames + 9).map(|i| format!("{:.6} {:.6} 0 0 0 0 0 1\n", (i as f64 - 4.0) / 60.0, sway(i)));
    write("poses.txt", &poses.collect::<String>());
    write(
        "recording.toml",
        "version = 1\nup = [0, -1, 0]\n[frames]\nlist = \"rgb.txt\"\n[poses]\ntrajectory = \"poses.txt\"\n\
         [depth]\nlist = \"depth.txt\"\nscale = 1000\n[camera]\nprofile = \"camera.toml\"\n",
    );
    let (cx_px, cy_px) = (width / 2, height / 2);
    write(
        "camera.toml",
        &format!(
            "{NOISE}[camera]\nwidth_px = {width}\nheight_px = {height}\nfx_px = 150\nfy_px = 150\n\
             cx_px = {cx_px}\ncy_px = {cy_px}\n"
        ),
    );
    let marker = std::fs::canonicalize("scenes/marker-1.glb").unwrap();
    write(
        "scene.toml",
        &format!(
            "version = 1\n[[objects]]\nmodel = {:?}\nposition_m = [0, 0.05, 0.5]\n[light]\nambient = 1\n",
            marker.to_str().unwrap()
        ),
    );
}

/// A frame must be larger than a pipe's buffer (64 KiB). With fewer frames each is larger: the
/// pixels of the additional 60 frames are 16 MB, and 5 % of the program's peak of 184 MB are 9 MB.
fn long_px() -> (u32, u32) {
    fast_or_full((320, 280), (160, 140))
}

#[cfg(target_os = "linux")]
#[test]
fn law_5_memory_does_not_grow_with_the_recording() {
    use std::io::Read;
    let peak_kib = |frames: usize| -> u64 {
        let temp = tempfile::tempdir().unwrap();
        long_recording(temp.path(), frames);
        let mut child = std::process::Command::new(env!("CARGO_BIN_EXE_locard"))
            .arg("composite")
            .arg(temp.path())
            .arg("--scene")
            .arg(temp.path().join("scene.toml"))
            .args(["--output", "-"])
            .stdout(std::process::Stdio::piped())
            .spawn()
            .unwrap();
        // Until the last frame is read, the program blocks with all its work done.
        let mut out = child.stdout.take().unwrap();
        let (width, height) = long_px();
        let (row, rows) = (3 * width as usize, height as usize);
        let mut frame = vec![0; row * rows];
        let mut distinct = std::collections::HashSet::new();
        for _ in 1..frames {
            out.read_exact(&mut frame).unwrap();
            distinct.insert(frame[row * (rows / 2)..][..row].to_vec());
        }
        assert_eq!(distinct.len(), frames - 1, "every frame has its own object and noise");
        let status = std::fs::read_to_string(format!("/proc/{}/status", child.id())).unwrap();
        let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:")).unwrap();
        let peak = line.trim().trim_end_matches(" kB").parse().unwrap();
        out.read_exact(&mut frame).unwrap();
        assert_eq!(out.read(&mut [0]).unwrap(), 0);
        assert!(child.wait().unwrap().success());
        peak
    };
    let (few, many) = fast_or_full((20, 80), (90, 900));
    let (short, long) = (peak_kib(few), peak_kib(many));
    println!("peak memory: {short} KiB of {few} frames, {long} KiB of {many}");
    assert!(long as f64 <= 1.05 * short as f64, "{short} KiB of {few} frames, {long} KiB of {many}");
}

#[test]
fn law_7_missing_requirements_are_named_in_one_line() {
    let temp = tempfile::tempdir().unwrap();
    let run = |arguments: &[&str], variables: &[(&str, &str)]| {
        let output = std::process::Command::new(env!("CARGO_BIN_EXE_locard"))
            .args(arguments)
            .envs(variables.iter().copied())
            .output()
            .unwrap();
        let text = String::from_utf8(output.stderr).unwrap();
        let lines: Vec<_> = text.lines().filter(|l| l.starts_with("locard: ")).map(str::to_owned).collect();
        assert_eq!(output.status.code(), Some(2), "{text}");
        assert_eq!(lines.len(), 1, "{text}");
        lines[0].clone()
    };
    let out = temp.path().join("out");
    let video = temp.path().join("out.mp4");
    let demo = |out: &Path| {
        let out = out.to_str().unwrap().to_owned();
        ["composite", "recordings/demo", "--scene", "scenes/demo.toml", "--frames", "0..1", "-o"]
            .map(str::to_owned)
            .into_iter()
            .chain([out])
            .collect::<Vec<_>>()
    };
    let arguments = demo(&out);
    let arguments: Vec<_> = arguments.iter().map(String::as_str).collect();
    let no_driver = [("VK_ICD_FILENAMES", "/nowhere"), ("VK_DRIVER_FILES", "/nowhere"), ("WGPU_BACKEND", "vulkan")];
    let line = run(&arguments, &no_driver);
    assert!(line.contains("no graphics adapter") && line.contains("apt-get install"), "{line}");
    assert!(!out.exists());

    let arguments = demo(&video);
    let arguments: Vec<_> = arguments.iter().map(String::as_str).collect();
    let line = run(&arguments, &[("PATH", "/nowhere")]);
    assert!(line.contains("ffmpeg"), "{line}");
    assert!(!video.exists());
}
