//! Requested flaws of a simulated recording, and the truth beside it.

use std::fs;
use std::ops::ControlFlow;
use std::path::Path;

use crate::columns::columns;
use crate::simulate::{CRUDE, small};
use glam::{DQuat, DVec3};
use locard::camera::Response;
use locard::simulate::{self, DepthSensorModel, Flaws, FolderLayout, Ground, Motion, Options, Simulation};
use locard::tracking::tum::read_trajectory;

/// A site with coarse light and textures, which flaws do not depend on.
fn simulation(options: &Options, flaws: &Flaws) -> Simulation {
    Simulation::with_flaws_and_detail(options, flaws, CRUDE, 2).unwrap()
}

fn write_site(out: &Path, options: &Options, flaws: &Flaws) {
    simulate::write(out, true, || Ok(simulation(options, flaws)), &mut |_, _| ControlFlow::Continue(())).unwrap();
}

/// A recording differs from the one without flaws by the requested amounts, which the truth
/// contains.
#[test]
fn flaws_have_the_requested_size_and_the_truth_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let options = Options { frames: 12, noise_scale: 0.0, ..small() };
    let flaws = Flaws {
        exposure_walk_ev: 0.5,
        exposure_step_ev: 1.5,
        white_balance_share: 0.1,
        jitter_mm: 1.0,
        hand_eye_deg: 1.0,
        poses_later_s: 0.015,
        depth_later_s: 0.02,
        repeat_share: 0.3,
        ..Flaws::default()
    };
    let [plain, flawed] = ["plain", "flawed"].map(|name| folder.path().join(name));
    write_site(&plain, &options, &Flaws::default());
    write_site(&flawed, &options, &flaws);
    assert!(!plain.join("truth").exists());
    assert!(!fs::read_to_string(plain.join("truth.toml")).unwrap().contains("flaws"));

    // Poses: the truth has those of the recording without flaws, and more at its ends.
    let read = |list: &Path| read_trajectory(list, None).unwrap();
    let truth = read(&flawed.join("truth/poses.txt"));
    let (without, recorded) = (read(&plain.join("groundtruth.txt")), read(&flawed.join("groundtruth.txt")));
    assert!(without.poses().iter().all(|pose| truth.poses().contains(pose)));
    let toml: toml::Table = fs::read_to_string(flawed.join("truth.toml")).unwrap().parse().unwrap();
    let is_true = &toml["truth"];
    let number = |key: &str| is_true[key].as_float().unwrap();
    assert_eq!([number("clock_s"), number("depth_later_s"), number("readout_time_s")], [0.015, 0.02, 0.015]);
    let turn_deg: Vec<f64> =
        is_true["hand_eye_turn_deg"].as_array().unwrap().iter().map(|v| v.as_float().unwrap()).collect();
    let turn = DQuat::from_scaled_axis(DVec3::from_slice(&turn_deg) * 1f64.to_radians());
    for ((time_s, is), (true_s, was)) in recorded.poses().iter().zip(truth.poses()) {
        assert!((time_s - true_s - 0.015).abs() < 2e-6);
        assert!((is.position_in_world_m() - was.position_in_world_m()).length() < 5e-3);
        let camera = is.world_from_camera_rotation() * turn;
        assert!(camera.angle_between(was.world_from_camera_rotation()) < 1e-6);
    }

    // Pictures: brightness as stated until they clip; repeated pictures are identical files.
    let light = |path: &Path| {
        let codes = image::open(path).unwrap().into_rgb8().into_raw();
        codes.into_iter().map(|code| Response::default().decode(f64::from(code) / 255.0)).collect::<Vec<_>>()
    };
    let (rows, depth) = (columns(&flawed, "truth/frames.txt"), |of: &Path, n: usize| {
        image::open(of.join(format!("depth/{n:05}.png"))).unwrap().into_luma16().into_raw()
    });
    let mut repeats = 0;
    for (n, row) in rows.iter().enumerate() {
        let value = |column: usize| row[column].parse::<f64>().unwrap();
        let picture = value(5) as usize;
        let file = |n: usize| fs::read(flawed.join(format!("rgb/{n:05}.png"))).unwrap();
        assert!(file(n) == file(picture));
        repeats += usize::from(picture != n);
        let (is, was) =
            (light(&flawed.join(format!("rgb/{n:05}.png"))), light(&plain.join(format!("rgb/{picture:05}.png"))));
        for (i, (is, was)) in is.iter().zip(was).enumerate() {
            let expected = (value(2 + i % 3) * was).min(1.0);
            // Half a code on either side.
            assert!((is - expected).abs() < 0.012 * (1.0 + value(2 + i % 3)), "{n}: {is} is not {expected}");
        }
        assert!(depth(&flawed, n) != depth(&plain, n), "measured later");
    }
    assert!(repeats > 0);
    let first = columns(&flawed, "exposure.txt")[0].len();
    assert_eq!(first, 2, "the camera does not say its gain");

    // A frame does not depend on the other frames.
    let [few, more] = ["few", "more"].map(|name| folder.path().join(name));
    for (out, frames) in [(&few, 3), (&more, 5)] {
        let options = Options { frames, motion: Motion::Static, ..options.clone() };
        write_site(out, &options, &flaws);
    }
    for file in ["rgb/00000.png", "rgb/00001.png", "rgb/00002.png"] {
        assert!(fs::read(few.join(file)).unwrap() == fs::read(more.join(file)).unwrap());
    }
    assert_eq!(columns(&few, "truth/frames.txt")[..], columns(&more, "truth/frames.txt")[..3]);
    // With `--force` the truth is replaced as the simulation's own file.
    write_site(&few, &options, &Flaws::default());
    assert!(!few.join("truth").exists());
}

#[test]
fn white_desk_clips_and_its_black_screen_has_sparse_depth() {
    let options = Options {
        width_px: 160,
        height_px: 120,
        focal_px: 130.0,
        samples: 4,
        gain: 1.6,
        frames: 1,
        motion: Motion::Static,
        ground: Some(Ground::Desk),
        ..small()
    };
    let flaws = Flaws { depth_sensor: Some(DepthSensorModel::Kinect), ..Flaws::default() };
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("desk");
    write_site(&out, &options, &flaws);
    let picture = image::open(out.join("rgb/00000.png")).unwrap().into_rgb8();
    let depth = image::open(out.join("depth/00000.png")).unwrap().into_luma16();
    let is_black = |codes: &[u8; 3]| codes.iter().all(|code| *code < 60);
    let clipped = picture.pixels().filter(|pixel| pixel.0.contains(&255)).count();
    let screen = picture.pixels().filter(|pixel| is_black(&pixel.0)).count();
    let both = picture.pixels().zip(depth.pixels());
    let measured = both.filter(|(pixel, z)| is_black(&pixel.0) && z.0[0] > 0).count();
    println!("{clipped} of {} px clip, {screen} are black, {measured} of these have depth", 160 * 120);
    assert!(clipped > 160 * 120 / 8 && screen > 500 && 10 * measured < 3 * screen, "{clipped} {screen} {measured}");
}

/// The walking person covers about a fifth of the picture, and nothing else changes.
#[test]
fn walking_person_covers_a_fifth_and_blank_site_has_no_texture() {
    let options =
        Options { width_px: 160, height_px: 120, focal_px: 130.0, samples: 1, motion: Motion::Static, ..small() };
    let of = |flaws: Flaws| simulation(&options, &flaws);
    let (empty, walked) = (of(Flaws::default()), of(Flaws { person_m_per_s: 6.0, ..Flaws::default() }));
    let mut before = None;
    for frame in 0..3 {
        let (without, with) = (empty.picture(frame), walked.picture(frame));
        let nearer: Vec<bool> = with.depth_m.iter().zip(&without.depth_m).map(|(a, b)| a < b).collect();
        let share = nearer.iter().filter(|n| **n).count() as f64 / nearer.len() as f64;
        println!("{share}");
        assert!((0.15..0.3).contains(&share), "{share}");
        assert!(before != Some(nearer.clone()), "they move");
        before = Some(nearer);
    }
    let blank = of(Flaws { blank: true, ..Flaws::default() }).picture(1);
    assert!(blank.light.iter().all(|light| *light == blank.light[0]) && blank.depth_m == empty.picture(1).depth_m);
}

fn depth_of(out: &Path, name: &str) -> Vec<u16> {
    image::open(out.join(name)).unwrap().into_luma16().into_raw()
}

/// A Kinect's maps have its holes, quantisation and widened edges; the exact maps are beside them;
/// the pictures are unchanged.
#[test]
fn kinect_depth_has_the_sensor_errors_and_the_truth_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let options = Options { frames: 3, depth_scale: 10_000.0, motion: Motion::Static, ..small() };
    let kinect = Flaws { depth_sensor: Some(DepthSensorModel::Kinect), ..Flaws::default() };
    let [plain, flawed, again] = ["plain", "flawed", "again"].map(|name| folder.path().join(name));
    write_site(&plain, &options, &Flaws::default());
    write_site(&flawed, &options, &kinect);
    write_site(&again, &Options { frames: 2, ..options.clone() }, &kinect);
    let listed = columns(&flawed, "truth/depth.txt");
    assert_eq!(listed.len(), 3);
    for (n, line) in listed.iter().enumerate() {
        let name = format!("depth/{n:05}.png");
        let exact = depth_of(&plain, &name);
        let apart =
            depth_of(&flawed, &format!("truth/{}", line[1])).iter().zip(&exact).map(|(a, b)| a.abs_diff(*b)).max();
        assert!(apart <= Some(1), "the truth is that of a recording without flaws");
        let rgb = format!("rgb/{n:05}.png");
        assert!(fs::read(flawed.join(&rgb)).unwrap() == fs::read(plain.join(&rgb)).unwrap());
        let depth = depth_of(&flawed, &name);
        assert!(n == 0 || depth != depth_of(&flawed, "depth/00000.png"), "each frame has its own");
        assert!(n == 2 || depth == depth_of(&again, &name), "whichever others are made");
        let (mut holes, mut off) = (0, Vec::new());
        for (depth, exact) in depth.iter().zip(exact) {
            let [depth, exact] = [*depth, exact].map(|code| f64::from(code) / 10_000.0);
            if depth == 0.0 {
                holes += 1;
            } else {
                let steps = depth.recip() / 2.87e-3;
                // Half a code.
                assert!(
                    (steps - steps.round()).abs() < 0.6e-4 / (depth * depth * 2.87e-3) + 1e-3,
                    "{depth} m: {steps}"
                );
                off.push((depth.recip() - exact.recip()).abs());
            }
        }
        off.sort_by(f64::total_cmp);
        let share = f64::from(holes) / (off.len() + holes as usize) as f64;
        // Half of normal values with σ = 1.43e-3 are within 0.67 σ, two thirds within one.
        let [median, two_thirds] = [off[off.len() / 2], off[off.len() * 2 / 3]];
        println!("{share} {median} {two_thirds}");
        assert!((0.01..0.3).contains(&share), "{share}");
        assert!(
            (median / 0.96e-3 - 1.0).abs() < 0.2 && (two_thirds / 1.43e-3 - 1.0).abs() < 0.25,
            "{median} {two_thirds}"
        );
    }
    // With `--force` the truth is replaced as the simulation's own file.
    write_site(&flawed, &options, &Flaws::default());
    assert!(!flawed.join("truth").exists());
}

/// Depth maps of a phone and of a separate depth camera have errors as well.
#[test]
fn other_depth_cameras_have_errors() {
    let folder = tempfile::tempdir().unwrap();
    let kinect = Flaws { depth_sensor: Some(DepthSensorModel::Kinect), ..Flaws::default() };
    let options = Options { frames: 1, depth_scale: 1000.0, ..small() };
    let phone =
        Options { layout: Some(FolderLayout::Stray), depth_width_px: Some(options.width_px), ..options.clone() };
    let beside = Options { depth_beside_mm: Some(25.0), ..options };
    for (name, options, file) in [("phone", phone, "depth/000000.png"), ("beside", beside, "depth/00000.png")] {
        let out = folder.path().join(name);
        write_site(&out, &options, &kinect);
        let (measured, exact) = (depth_of(&out, file), depth_of(&out, "truth/depth-00000.png"));
        let share = |is: &dyn Fn(u16, u16) -> bool| {
            measured.iter().zip(&exact).filter(|(measured, exact)| is(**measured, **exact)).count() as f64
                / measured.len() as f64
        };
        let (missing, near) =
            (share(&|measured, _| measured == 0), share(&|measured, exact| measured.abs_diff(exact) < 60));
        println!("{name}: {missing} missing, {near} near");
        assert!((0.003..0.3).contains(&missing) && near > 0.65, "{name}: {missing} {near}");
    }
}
