//! The simulated camera compared with projection, arithmetic and its own tables.

use std::collections::BTreeMap;
use std::fs;
use std::ops::ControlFlow;
use std::path::Path;

use crate::columns::columns;
use crate::tier::fast_or_full;
use glam::{DVec2, DVec3};
use locard::params::{Kind, Params, Value};
use locard::simulate::{
    self, Detail, Flaws, Format, Motion, Options, SimulateError, SimulatedPicture, Simulation, Snapshot, board,
};

/// Detail of a site in tests that do not depend on its light and textures: the board is emissive.
pub const CRUDE: Detail = Detail { texture_m: 0.05, light_m: 0.4 };

fn pan() -> Options {
    Options {
        frames: 31,
        motion: Motion::Pan,
        board: true,
        exposure_time_s: 0.0,
        readout_time_s: 0.0,
        ..Options::default()
    }
}

fn crude(options: &Options) -> Simulation {
    Simulation::with_detail(options, CRUDE, 2).unwrap()
}

/// A snapshot 0.5 s into the pan plus `later_s`, when the camera is `later_s` rad right of rest.
fn snapshot(simulation: &Simulation, later_s: f64, samples: u32) -> Snapshot {
    Snapshot { timestamp_s: 1.5 + later_s, samples, ..simulation.snapshot(0) }
}

fn project(simulation: &Simulation, time_s: f64, point: DVec3) -> DVec2 {
    simulation.geometry().project(simulation.track().at(time_s).unwrap().transform_point(point)).unwrap()
}

fn green(picture: &SimulatedPicture, x: usize, y: usize) -> f64 {
    f64::from(picture.light[y * picture.width as usize + x][1])
}

/// The saddle point near `start`: the point whose direction to every surrounding pixel is
/// perpendicular to the gradient there (Förstner and Gülch 1987).
fn corner_near(picture: &SimulatedPicture, start: DVec2) -> DVec2 {
    let mut at = start;
    for _ in 0..20 {
        let (mut xx, mut xy, mut yy, mut bx, mut by) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for y in (at.y as usize - 5)..(at.y as usize + 6) {
            for x in (at.x as usize - 5)..(at.x as usize + 6) {
                let gx = green(picture, x + 1, y) - green(picture, x - 1, y);
                let gy = green(picture, x, y + 1) - green(picture, x, y - 1);
                let (px, py) = (x as f64 + 0.5, y as f64 + 0.5);
                let w = (-(px - at.x).powi(2) / 8.0 - (py - at.y).powi(2) / 8.0).exp();
                xx += w * gx * gx;
                xy += w * gx * gy;
                yy += w * gy * gy;
                bx += w * (gx * gx * px + gx * gy * py);
                by += w * (gx * gy * px + gy * gy * py);
            }
        }
        let d = xx * yy - xy * xy;
        at = DVec2::new((yy * bx - xy * by) / d, (xx * by - xy * bx) / d);
    }
    at
}

/// Corners far from the picture's middle, where this lens distorts by several pixels. A sample
/// pattern of 36 locates an edge of 12 px contrast within some 0.02 px.
// Slow: many light samples of a large picture, for a twentieth of a pixel.
#[test]
fn corner_is_rendered_where_it_projects() {
    let simulation = crude(&Options { k1: -0.3, k2: 0.08, width_px: 720, ..pan() });
    for &later_s in fast_or_full(&[-0.42, 0.42][..], &[-0.42, 0.0, 0.42]) {
        let snapshot = snapshot(&simulation, later_s, 36);
        let picture = simulation.shoot(&snapshot);
        for texel in [(24.0, 24.0), (40.0, 32.0), (32.0, 48.0)] {
            let point = board().point_at_texel(texel.into());
            let expected = project(&simulation, snapshot.timestamp_s, point);
            let corner = corner_near(&picture, expected);
            assert!((corner - expected).length() < 0.05, "{later_s} {texel:?}: {corner} is not {expected}");
            // The pixel's centre is not the corner: the board is slanted, 1 px of it is 3 mm.
            let depth_m = picture.depth_m[expected.y as usize * 720 + expected.x as usize];
            let pose = simulation.track().at(snapshot.timestamp_s).unwrap();
            assert!((f64::from(depth_m) - pose.transform_point(point).z).abs() < 0.004, "{depth_m}");
        }
    }
    let bent = simulation.geometry().project(DVec3::new(0.5, 0.0, 1.0)).unwrap();
    assert!((bent.x - (361.75 + 520.0 * 0.5)).abs() > 10.0, "the lens does bend: {bent}");
}

/// x of the board's line along texel column 32 at the centre of a row, at a time.
fn line_in_row(simulation: &Simulation, time_s: f64, row: usize) -> f64 {
    let y = row as f64 + 0.5;
    let at = |v: f64| project(simulation, time_s, board().point_at_texel(DVec2::new(32.0, v)));
    let (mut top, mut bottom) = (0.0, 64.0);
    for _ in 0..60 {
        let middle = 0.5 * (top + bottom);
        if at(middle).y < y { top = middle } else { bottom = middle }
    }
    at(top).x
}

/// Rows in which the line passes through the middles of squares, away from other edges.
fn clear_rows(simulation: &Simulation, time_s: f64) -> Vec<usize> {
    (0..8)
        .flat_map(|square| {
            let at = |v: f64| project(simulation, time_s, board().point_at_texel(DVec2::new(32.0, v))).y as usize;
            let middle = at(8.0 * f64::from(square) + 4.0);
            middle - 1..middle + 2
        })
        .collect()
}

/// Mean and variance of an edge's derivative in a row, px.
fn edge(picture: &SimulatedPicture, row: usize, near: f64, reach: usize) -> (f64, f64) {
    let (mut sum, mut first, mut second) = (0.0, 0.0, 0.0);
    for x in near as usize - reach..near as usize + reach {
        let step = green(picture, x + 1, row) - green(picture, x, row);
        let at = x as f64 + 1.0;
        sum += step;
        first += step * at;
        second += step * at * at;
    }
    (first / sum, second / sum - (first / sum).powi(2))
}

/// An edge under uniform motion is blurred by a box of the displacement's length. Its variance is
/// the sum of those of boxes: displacement²/12, the pixel's 1/12, 1/12 of the difference of
/// neighbours, and that of one texel, across which the texture is linear between squares.
// Slow: 48 samples a pixel of a full picture.
#[test]
fn blur_is_velocity_times_exposure() {
    let options = Options { focal_px: 1000.0, exposure_time_s: 0.01, readout_time_s: 0.012, speed: 1.6, ..pan() };
    let simulation = crude(&options);
    let snapshot = snapshot(&simulation, 0.0, fast_or_full(48, 96));
    let picture = simulation.shoot(&snapshot);
    for row in clear_rows(&simulation, snapshot.timestamp_s) {
        let middle_s = snapshot.timestamp_s + simulation.geometry().row_time_s(row as f64 + 0.5);
        let line = |time_s| line_in_row(&simulation, time_s, row);
        let way = (line(middle_s + 0.005) - line(middle_s - 0.005)).abs();
        let near = line(middle_s);
        let scale = project(&simulation, middle_s, board().point_at_texel(DVec2::new(40.0, 32.0))).distance(project(
            &simulation,
            middle_s,
            board().point_at_texel(DVec2::new(32.0, 32.0)),
        )) / 8.0;
        let (_, variance) = edge(&picture, row, near, 10);
        let blur_px = (12.0 * variance - 2.0 - scale * scale).sqrt();
        assert!(way > 8.0 && (blur_px - way).abs() < 0.3, "row {row}: {blur_px} px is not {way} px");
    }
}

/// Lower rows are exposed later. At the principal point a rotation ω around the world's vertical
/// moves the image by f·ω·cos(pitch), with pitch the downward tilt of the camera.
#[test]
fn rolling_shutter_skew_matches_the_readout_time() {
    let options = Options { readout_time_s: 0.03, k1: 0.0, k2: 0.0, p1: 0.0, p2: 0.0, ..pan() };
    let (rolling, global) = (crude(&options), crude(&Options { readout_time_s: 0.0, ..options.clone() }));
    let snapshot = snapshot(&global, 0.0, fast_or_full(24, 48));
    let (leaning, upright) = (rolling.shoot(&snapshot), global.shoot(&snapshot));
    let mut shifts = Vec::new();
    for row in clear_rows(&global, snapshot.timestamp_s) {
        let row_s = snapshot.timestamp_s + (row as f64 + 0.5 - 240.0) / 480.0 * 0.03;
        let expected = line_in_row(&global, row_s, row);
        let (edge_px, _) = edge(&leaning, row, expected, 4);
        assert!((edge_px - expected).abs() < 0.06, "row {row}: {edge_px} is not {expected}");
        let (still, _) = edge(&upright, row, line_in_row(&global, snapshot.timestamp_s, row), 4);
        shifts.push((row as f64, edge_px - still));
    }
    let (first, last) = (shifts[0], shifts[shifts.len() - 1]);
    let lean = (last.1 - first.1) / (last.0 - first.0);
    let ahead = global.track().at(1.5).unwrap().world_from_camera_rotation() * DVec3::Z;
    let by_hand = -520.0 * ahead.truncate().length() * 0.03 / 480.0;
    assert!((lean / by_hand - 1.0).abs() < 0.1, "{lean} px a row is not {by_hand}");
}

/// Bins of 16 codes with 60,000 values or more: a correlation of 0.6 between neighbours leaves a
/// fifth of them independent, so the standard error of σ is 0.65 %; 3 % is more than four times
/// that.
#[test]
fn noise_of_static_frames_matches_the_profile() {
    let options =
        Options { width_px: 320, height_px: 240, focal_px: 260.0, motion: Motion::Static, ..Options::default() };
    let scenes = crude(&options).static_scenes(&[0.1, 0.35, 1.0, 2.2], 12);
    let mut bins: BTreeMap<(usize, u32), (f64, f64, f64)> = BTreeMap::new();
    for scene in &scenes.scenes {
        assert_eq!(scene.frames.len(), 12);
        for frame in &scene.frames {
            for (i, clean) in scene.clean.iter().enumerate() {
                let (c, clean) = (i % 3, f64::from(*clean));
                let sigma = scenes.noise.sigma(c, clean);
                if clean < 4.0 * sigma || clean > 255.0 - 4.0 * sigma {
                    continue;
                }
                let pixel = (i / 3) as u32;
                let code = f64::from(frame.at(pixel % 320, pixel / 320)[c]);
                let bin = bins.entry((c, clean as u32 / 16)).or_default();
                // Rounding to whole codes adds 1/12.
                *bin = (bin.0 + 1.0, bin.1 + (code - clean).powi(2), bin.2 + sigma * sigma + 1.0 / 12.0);
            }
        }
    }
    let full: Vec<_> = bins.iter().filter(|(_, bin)| bin.0 >= 60_000.0).collect();
    assert!(full.len() >= 36, "only {} bins are full", full.len());
    for (at, bin) in full {
        let relative = (bin.1 / bin.2).sqrt();
        assert!((relative - 1.0).abs() < 0.03, "{at:?}: {relative} of the table");
    }
}

#[test]
fn simulation_is_independent_of_the_thread_count() {
    let options = Options { width_px: 96, height_px: 72, focal_px: 80.0, samples: 4, ..Options::default() };
    let of = |threads: usize| {
        let simulation = Simulation::with_detail(&options, Detail::for_focal_px(80.0), threads).unwrap();
        let picture = simulation.picture(31);
        let clean = simulation.sensor.clean(&picture, 1.0);
        (simulation.sensor.sense(&clean, 96, 31, threads), picture)
    };
    let one = of(1);
    assert!(one.1.max_blur_px > 1.0, "the frame moves");
    for threads in [2, 5] {
        assert!(of(threads) == one, "{threads} threads");
    }
    let other =
        Simulation::with_detail(&Options { seed: 2, ..options.clone() }, Detail::for_focal_px(80.0), 2).unwrap();
    assert!(other.picture(31) != one.1, "the seed counts");
}

pub fn small() -> Options {
    Options {
        width_px: 64,
        height_px: 48,
        focal_px: 52.0,
        frames: 3,
        samples: 4,
        format: Format::Png,
        ..Options::default()
    }
}

fn run(
    out: &Path,
    options: &Options,
    force: bool,
    progress: &mut dyn FnMut(usize, usize) -> ControlFlow<()>,
) -> Result<(), SimulateError> {
    simulate::run(out, options, &Flaws::default(), force, progress)
}

#[test]
fn recording_contains_the_simulated_data() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("some/site");
    let options = Options { board: true, ..small() };
    let mut progress = Vec::new();
    let mut tell = |done, of| {
        progress.push((done, of));
        ControlFlow::Continue(())
    };
    run(&out, &options, false, &mut tell).unwrap();
    assert_eq!(progress, [(0, 3), (1, 3), (2, 3), (3, 3)]);
    assert_eq!(fs::read_dir(out.parent().unwrap()).unwrap().count(), 1, "nothing else is left behind");

    let simulation = Simulation::new(&options).unwrap();
    let picture = simulation.picture(1);
    let codes = simulation.sensor.sense(&simulation.sensor.clean(&picture, 1.0), 64, 1, 1);
    let rgb = columns(&out, "rgb.txt");
    assert_eq!(rgb[1][0], "1.033333");
    assert_eq!(image::open(out.join(&rgb[1][1])).unwrap().into_rgb8().into_raw(), codes);
    let depth = image::open(out.join(&columns(&out, "depth.txt")[1][1])).unwrap().into_luma16().into_raw();
    let expected: Vec<u16> = picture.depth_m.iter().map(|d| (f64::from(*d) * 250.0).round() as u16).collect();
    assert_eq!(depth, expected);

    let truth = columns(&out, "groundtruth.txt");
    let times: Vec<f64> = truth.iter().map(|line| line[0].parse().unwrap()).collect();
    assert!(times.windows(2).all(|t| (t[1] - t[0] - 0.005).abs() < 1e-9));
    assert!(times[0] < 1.0 - 0.016 && times[times.len() - 1] > 1.066_667 + 0.016, "all shutters are covered");
    let eye = simulation.track().poses()[0].1.position_in_world_m();
    assert!((truth[0][3].parse::<f64>().unwrap() - eye.z).abs() < 1e-8);

    // From (0, 0, 0.1) the lamp at (-0.3, 0.4, 2.49) is atan2(-0.3, 0.4) = -36.9° right of +y and
    // atan(0.5 / 2.39) = 11.8° off the zenith: at (0.398 · 256, 0.0656 · 128).
    let panorama = image::open(out.join("environment.hdr")).unwrap().into_rgb32f();
    let lit = |x, y| panorama.get_pixel(x, y)[1] > 40.0;
    assert!(lit(101, 8) && lit(102, 8), "the lamp is where it should be");
    assert!(!lit(154, 8) && !lit(26, 8) && !lit(102, 119), "and neither mirrored nor upside down");

    let camera: toml::Table = fs::read_to_string(out.join("camera.toml")).unwrap().parse().unwrap();
    assert_eq!(camera["camera"]["fx_px"].as_float(), Some(52.0));
    assert_eq!(camera["camera"]["width_px"].as_integer(), Some(64));
    let bins = &camera["camera"]["noise"];
    assert_eq!(bins["code"].as_array().unwrap().len(), 16);
    assert_eq!(bins["sigma_b"][7].as_float(), Some(4.365), "√(4.375² − 1/12): before rounding");
    let recording: toml::Table = fs::read_to_string(out.join("recording.toml")).unwrap().parse().unwrap();
    assert_eq!(recording["name"].as_str(), Some("site"));
    for name in ["truth.toml", "environment.hdr", "board.glb"] {
        assert!(out.join(name).is_file(), "{name}");
    }
}

#[test]
fn stopped_simulation_leaves_no_files() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("site");
    for last in [0, 2] {
        let mut stop = |done, _| if done < last { ControlFlow::Continue(()) } else { ControlFlow::Break(()) };
        assert!(matches!(run(&out, &small(), false, &mut stop), Err(SimulateError::Stopped)));
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0, "after {last}");
    }
}

#[test]
fn foreign_and_edited_files_are_kept() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("site");
    let mut quiet = |_, _| ControlFlow::Continue(());
    run(&out, &small(), false, &mut quiet).unwrap();
    assert!(matches!(run(&out, &small(), false, &mut quiet), Err(SimulateError::Exists(_))));
    run(&out, &Options { frames: 1, ..small() }, true, &mut quiet).unwrap();
    assert_eq!(columns(&out, "rgb.txt").len(), 1);

    let other = folder.path().join("letters");
    fs::create_dir(&other).unwrap();
    fs::write(other.join("letter.txt"), "dear").unwrap();
    assert!(matches!(run(&other, &small(), true, &mut quiet), Err(SimulateError::NotSimulated(_))));
    assert_eq!(fs::read_to_string(other.join("letter.txt")).unwrap(), "dear");
    let below_a_file = other.join("letter.txt/site");
    assert!(matches!(run(&below_a_file, &small(), false, &mut quiet), Err(SimulateError::Write { .. })));
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);

    // A recording made by hand, with the same names.
    let names = ["truth.toml", "recording.toml", "camera.toml", "rgb.txt", "groundtruth.txt"];
    let by_hand = folder.path().join("by hand");
    fs::create_dir(&by_hand).unwrap();
    for name in names {
        fs::write(by_hand.join(name), "mine").unwrap();
    }
    assert!(matches!(run(&by_hand, &small(), true, &mut quiet), Err(SimulateError::NotSimulated(_))));
    for name in names {
        assert_eq!(fs::read_to_string(by_hand.join(name)).unwrap(), "mine", "{name}");
    }
    fs::remove_dir_all(&by_hand).unwrap();

    // A simulated recording edited by the user.
    for name in ["camera.toml", "rgb/00000.png", "truth.toml"] {
        let path = out.join(name);
        let before = fs::read(&path).unwrap();
        let edited = [b"# mine\n", &before[..]].concat();
        fs::write(&path, &edited).unwrap();
        let error = run(&out, &small(), true, &mut quiet).unwrap_err();
        match name {
            "truth.toml" => assert!(matches!(error, SimulateError::NotSimulated(_)), "{error}"),
            _ => assert!(error.to_string().contains(&format!("{name} in it has changed since")), "{error}"),
        }
        assert_eq!(fs::read(&path).unwrap(), edited);
        fs::write(&path, before).unwrap();
    }

    // Foreign files beside the frames, and a recording made by hand.
    for foreign in ["notes.txt", "rgb/00000.jpg", "rgb/00007.png", "depth/mine/00000.png"] {
        let path = out.join(foreign);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(&path, "mine").unwrap();
        let error = run(&out, &small(), true, &mut quiet).unwrap_err().to_string();
        let named = if foreign.starts_with("depth") { "depth/mine" } else { foreign };
        assert!(error.contains(&format!("is not replaced: {named} in it")), "{error}");
        assert_eq!(fs::read_to_string(&path).unwrap(), "mine");
        fs::remove_file(&path).unwrap();
        let _ = fs::remove_dir(out.join("depth/mine"));
    }
    fs::remove_file(out.join("truth.toml")).unwrap();
    assert!(matches!(run(&out, &small(), true, &mut quiet), Err(SimulateError::NotSimulated(_))));
    assert_eq!(columns(&out, "rgb.txt").len(), 1);
}

#[test]
fn impossible_output_path_is_refused_before_the_simulation() {
    let mut work = |_, _| panic!("work was begun");
    for place in [".", "..", "/"] {
        assert!(matches!(run(Path::new(place), &small(), true, &mut work), Err(SimulateError::Within(_))), "{place}");
    }
}

#[test]
fn exported_board_matches_the_simulated_one() {
    let glb = board().glb().unwrap();
    let (document, buffers, images) = gltf::import_slice(&glb).unwrap();
    let primitive = document.meshes().next().unwrap().primitives().next().unwrap();
    assert!(primitive.material().unlit() && primitive.material().double_sided());
    let reader = primitive.reader(|buffer| Some(&buffers[buffer.index()]));
    let positions: Vec<_> = reader.read_positions().unwrap().map(|p| DVec3::from(p.map(f64::from))).collect();
    for (actual, expected) in positions.iter().zip(board().corners_in_world_m) {
        assert!((*actual - expected).length() < 1e-7);
    }
    // The front faces the camera: counter-clockwise from there.
    let indices: Vec<_> = reader.read_indices().unwrap().into_u32().map(|i| positions[i as usize]).collect();
    let camera = DVec3::new(0.16, -1.1, 1.3);
    for corners in indices.chunks(3) {
        assert!((corners[1] - corners[0]).cross(corners[2] - corners[0]).dot(camera - corners[0]) > 0.0);
    }
    assert_eq!(images[0].pixels, *board().texture.rgba);
}

/// The demonstration in the repository was made with the default options, and is small.
#[test]
fn demonstration_matches_the_default_options() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("recordings/demo");
    let truth: toml::Table = fs::read_to_string(folder.join("truth.toml")).unwrap().parse().unwrap();
    let written = truth["simulate"].as_table().unwrap();
    let options = Options::default();
    for spec in options.specs() {
        let same = match (options.get(spec.name).unwrap(), &spec.kind) {
            (Value::Number(n), Kind::Number { .. }) => written[spec.name].as_float() == Some(n),
            (Value::Number(n), _) => written[spec.name].as_integer() == Some(n as i64),
            (Value::Bool(b), _) => written[spec.name].as_bool() == Some(b),
            (Value::Text(t), _) => written[spec.name].as_str() == Some(&t),
            (Value::None, _) => !written.contains_key(spec.name),
        };
        assert!(same, "simulate.{} of the demonstration is {}", spec.name, written[spec.name]);
    }
    let size = |sub: &str| -> u64 {
        fs::read_dir(folder.join(sub)).unwrap().map(|entry| entry.unwrap().metadata().unwrap().len()).sum()
    };
    assert_eq!(columns(&folder, "rgb.txt").len(), 72);
    let total = size(".") + size("rgb") + size("depth");
    assert!(total < 9_000_000, "{total} bytes");
}
