//! Scans from phones and depth cameras: their folders, depth registered to the frames, and repeated
//! pictures.

use std::fs;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use crate::common;
use crate::files::{describe, frames, open, options, picture, refused, write};
use crate::gpu;
use crate::shot;
use crate::tier;
use glam::DVec3;
use image::{ImageBuffer, Luma};
use locard::depth::unknown_fraction;
use locard::frame::Frame;
use locard::pixels::LayerImage;
use locard::recording::{DepthRegistration, OpenOptions, Recording};
use locard::simulate::{self, Detail, Flaws, FolderLayout, Format, Motion, Options, Simulation};

fn depth_png(file: &Path, width: u32, height: u32, code: impl Fn(u32, u32) -> u16) {
    fs::create_dir_all(file.parent().unwrap()).unwrap();
    ImageBuffer::from_fn(width, height, |x, y| Luma([code(x, y)])).save(file).unwrap();
}

/// A phone's export: a video of 8×6 px with this number of frames, and three poses and depth maps
/// of 4×3 px.
fn export(folder: &Path, frames: usize) {
    let pictures: Vec<_> = (0..frames).map(|i| picture(i, 8, 6, 8)).collect();
    write(&folder.join("rgb.mp4"), &options(8, 6, 8), &pictures);
    let line = |i: usize| format!("{}, {i:06}, 0.{i}, 1.5, 0, 0, 0, 0, 1\n", 100.5 + i as f64 / 30.0);
    let lines: String = (0..3).map(line).collect();
    fs::write(folder.join("odometry.csv"), format!("timestamp, frame, x, y, z, qx, qy, qz, qw\n{lines}")).unwrap();
    fs::write(folder.join("camera_matrix.csv"), "7.5,0.0,4.0\n0.0,7.5,3.0\n0.0,0.0,1.0\n").unwrap();
    for i in 0..3 {
        depth_png(&folder.join(format!("depth/{i:06}.png")), 4, 3, |x, _| if x < 2 { 1000 } else { 2000 });
        let sure = ImageBuffer::from_fn(4, 3, |_, y| Luma([if y == 0 { 0u8 } else { 2 }]));
        fs::create_dir_all(folder.join("confidence")).unwrap();
        sure.save(folder.join(format!("confidence/{i:06}.png"))).unwrap();
    }
}

#[test]
fn phone_export_opens_unmodified() {
    let folder = tempfile::tempdir().unwrap();
    export(folder.path(), 3);
    for path in [folder.path().to_owned(), folder.path().join("odometry.csv")] {
        let r = open(&path);
        assert_eq!((r.kind.name(), r.frame_count(), r.up), ("Stray Scanner", 3, Some(DVec3::Y)));
        assert_eq!((r.timestamps_s[0], r.warnings.clone()), (100.5, vec![]));
        assert_eq!(r.geometry.as_ref().unwrap().intrinsics.fx_px, 7.5);
        assert!((r.pose_at_frame(2).unwrap().position_in_world_m() - DVec3::new(0.2, 1.5, 0.0)).length() < 1e-12);
        assert_eq!(r.registration(), Some(DepthRegistration::Enlarged(4, 3)));
        assert_eq!(r.files().filter(|file| file.ends_with("confidence/000001.png")).count(), 1);
        let depth = frames(&r, 1..2)[0].depth.clone().unwrap();
        assert_eq!((depth.width, depth.height), (8, 6));
        // The upper row of the map has low confidence: the upper two rows of the picture.
        assert!(depth.depth_m[..16].iter().all(|z| *z == 0.0));
        assert_eq!(depth.depth_m[16..24], [1.0, 1.0, 1.0, 1.0, 2.0, 2.0, 2.0, 2.0]);
    }
}

/// The real log has two poses to a frame, with the frames' times. Its video is made here.
#[test]
fn arkit_log_has_a_camera_and_a_pose_for_each_frame() {
    let Some(log) = common::data("bring/arkit") else { return };
    let folder = tempfile::tempdir().unwrap();
    let first = |name: &str, lines: usize| {
        let text = fs::read_to_string(log.join(name)).unwrap();
        fs::write(folder.path().join(name), text.lines().take(lines).collect::<Vec<_>>().join("\n")).unwrap();
    };
    first("ARposes.txt", 9);
    first("Frames.txt", 5);
    let pictures: Vec<_> = (0..4).map(|i| picture(i, 8, 6, 8)).collect();
    let video = folder.path().join("Frames.mp4");
    write(&video, &options(8, 6, 8), &pictures);
    fs::rename(&video, folder.path().join("Frames.m4v")).unwrap();
    for path in [folder.path().to_owned(), folder.path().join("ARposes.txt")] {
        let r = open(&path);
        assert_eq!((r.kind.name(), r.frame_count(), r.up), ("ARKit log", 4, Some(DVec3::Y)));
        assert!(r.warnings.iter().any(|w| w.contains("has 5 lines, the video 4 frames")), "{:?}", r.warnings);
        assert_eq!(r.timestamps_s[1], 1_627_530_745.073_46);
        assert_eq!(r.geometry_at_frame(1).unwrap().intrinsics.fx_px, 1_467.578_613);
        assert_eq!(r.geometry_at_frame(2).unwrap().intrinsics.cy_px, 693.571_716);
        let pose = r.pose_at_frame(1).unwrap();
        let position_m = DVec3::new(-0.307_841, 0.000_384, -0.024_564);
        assert!((pose.position_in_world_m() - position_m).length() < 1e-9);
        // The phone is held upright enough: the world's up is upwards in the picture, or to a side.
        let up_in_camera = pose.rotation * DVec3::Y;
        assert!((up_in_camera.length() - 1.0).abs() < 1e-9 && up_in_camera.y < 0.0, "{up_in_camera}");
    }
    fs::remove_file(folder.path().join("Frames.m4v")).unwrap();
    assert!(refused(folder.path()).contains("Frames.m4v"), "{}", refused(folder.path()));
}

#[test]
fn missing_parts_of_an_export_are_reported() {
    let folder = tempfile::tempdir().unwrap();
    export(folder.path(), 5);
    fs::remove_file(folder.path().join("depth/000001.png")).unwrap();
    let r = open(folder.path());
    assert_eq!(r.frame_count(), 3);
    for message in
        ["has 3 lines, the video 5 frames: the first 3 of both", "1 of 3 lines have no depth picture (first: line 3,"]
    {
        assert!(r.warnings.iter().any(|w| w.contains(message)), "{message}: {:?}", r.warnings);
    }
    let has: Vec<bool> = frames(&r, 0..3).iter().map(|frame| frame.depth.is_some()).collect();
    assert_eq!(has, [true, false, true]);
    // More poses than frames.
    let folder = tempfile::tempdir().unwrap();
    export(folder.path(), 2);
    let r = open(folder.path());
    assert_eq!((r.frame_count(), frames(&r, 0..2).len()), (2, 2));
    // Two poses at one time: the first is used.
    let odometry = folder.path().join("odometry.csv");
    let text = fs::read_to_string(&odometry).unwrap();
    let third = text.lines().nth(2).unwrap().split(',').next().unwrap().to_owned();
    fs::write(&odometry, text.replacen(&third, "100.5", 1)).unwrap();
    let r = open(folder.path());
    assert!(r.warnings.iter().any(|w| w.contains("1 pose is left out")), "{:?}", r.warnings);
    assert_eq!(r.repeats(|| ()).unwrap().times, [1]);
    // Intrinsics are required.
    fs::remove_file(folder.path().join("camera_matrix.csv")).unwrap();
    assert!(refused(folder.path()).contains("camera_matrix.csv: cannot be read"), "{}", refused(folder.path()));
    fs::write(folder.path().join("odometry.csv"), "timestamp, frame\n").unwrap();
    assert!(refused(folder.path()).contains("odometry.csv, line 1: column x is missing"));
}

#[test]
fn invalid_intrinsics_are_named_with_their_file() {
    let folder = tempfile::tempdir().unwrap();
    export(folder.path(), 3);
    let (matrix, odometry) = (folder.path().join("camera_matrix.csv"), folder.path().join("odometry.csv"));
    let text = fs::read_to_string(&matrix).unwrap();
    fs::write(&matrix, text.replacen("7.5", "9e18", 1)).unwrap();
    let error = refused(folder.path());
    assert!(error.contains("camera_matrix.csv: camera.fx_px = 9") && !error.contains("odometry"), "{error}");
    // Intrinsics of a single frame, in the columns of newer files.
    let lines = fs::read_to_string(&odometry).unwrap();
    let with = |(i, line): (usize, &str)| {
        let own = ["fx, fy, cx, cy", "7, 7, 4, 3", "7, 9e18, 4, 3", "7, 7, 4, 3"][i];
        format!("{line}, {own}\n")
    };
    fs::write(&odometry, lines.lines().enumerate().map(with).collect::<String>()).unwrap();
    let error = refused(folder.path());
    assert!(error.contains("odometry.csv, line 3: camera.fy_px = 9"), "{error}");
}

#[test]
fn truncated_line_is_left_out_and_reported() {
    let folder = tempfile::tempdir().unwrap();
    export(folder.path(), 3);
    let odometry = folder.path().join("odometry.csv");
    let text = fs::read_to_string(&odometry).unwrap();
    // In the middle of a number, and after it.
    for cut in [text.len() - 20, text.len() - 1] {
        fs::write(&odometry, &text[..cut]).unwrap();
        let r = open(folder.path());
        assert_eq!((r.frame_count(), r.track.poses().len()), (2, 2));
        let message = "odometry.csv: the last line, 4, is incomplete and left out";
        assert!(r.warnings.iter().any(|w| w.contains(message)), "{:?}", r.warnings);
    }
}

/// Depth by a camera 0.1 m to the left of the frames' camera: a wall at 2 m, f = 40 px.
fn unregistered(folder: &Path) -> PathBuf {
    write(&folder.join("rgb"), &options(32, 24, 8), &[picture(0, 32, 24, 8)]);
    depth_png(&folder.join("d.png"), 32, 24, |x, _| if x < 16 { 1000 } else { 2000 });
    fs::write(folder.join("depth.txt"), "0 d.png\n").unwrap();
    fs::write(folder.join("t.txt"), "0 0 0 0 0 0 0 1\n").unwrap();
    let camera = "[camera]\nwidth_px = 32\nheight_px = 24\nfx_px = 40\nfy_px = 40\ncx_px = 16\ncy_px = 12\n";
    fs::write(folder.join("depth.toml"), camera).unwrap();
    fs::write(folder.join("camera.toml"), format!("version = 1\n{camera}")).unwrap();
    describe(
        folder,
        "[frames]\nimages = \"rgb\"\nfps = 30.0\n[poses]\ntrajectory = \"t.txt\"\n[depth]\nlist = \"depth.txt\"\nscale = \
         1000.0\ncamera = \"depth.toml\"\n[depth.colour_from_depth]\nposition_m = [-0.1, 0, 0]\nquaternion = [0, 0, 0, \
         1]\n[camera]\nprofile = \"camera.toml\"\n",
    )
}

#[test]
fn depth_of_a_separate_camera_is_reprojected_to_the_colour_camera() {
    let folder = tempfile::tempdir().unwrap();
    let path = unregistered(folder.path());
    // The recording alone has no camera for the frames.
    let r = open(&path);
    assert_eq!(r.registration(), Some(DepthRegistration::OtherCamera(32, 24)));
    assert!(frames(&r, 0..1)[0].depth.is_none());
    let row = |frame: &Frame| frame.depth.as_ref().unwrap().depth_m[12 * 32..13 * 32].to_vec();
    let shot = shot::open(&path, None, Path::new("scenes/marker-1.glb"));
    // f·b/z: 4 px at 1 m, 2 px at 2 m. The near half ends at 16 − 4, the far one begins at 16 − 2.
    let wide_row = row(&shot.read(0).unwrap());
    assert!(wide_row[..12].iter().all(|z| (z - 1.0).abs() < 1e-6), "{wide_row:?}");
    assert!(
        wide_row[12..14].iter().all(|z| *z == 0.0) && wide_row[14..29].iter().all(|z| (z - 2.0).abs() < 1e-6),
        "{wide_row:?}"
    );
    // Depth is registered to the camera of a given profile.
    let narrow = locard::shot::ShotOptions { sets: vec!["camera.fx_px=80".into()], ..Default::default() };
    let narrow = locard::shot::Shot::open(&path, &OpenOptions::default(), &narrow).unwrap();
    // Twice as large about 16: the near half ends at 16 − 2·4.
    let narrow_row = row(&narrow.read(0).unwrap());
    assert!(
        (narrow_row[7] - 1.0).abs() < 1e-6 && narrow_row[8..12] == [0.0; 4] && (narrow_row[12] - 2.0).abs() < 1e-6,
        "{narrow_row:?}"
    );
}

#[test]
fn invalid_depth_camera_description_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = unregistered(folder.path());
    let toml = fs::read_to_string(path.join("recording.toml")).unwrap();
    for (from, to, message) in [
        ("camera = \"depth.toml\"\n", "", "depth.colour_from_depth goes with depth.camera only"),
        ("[0, 0, 0, 1]", "[0, 0, 0, 2]", "colour_from_depth.quaternion: the quaternion has length 2"),
        ("depth.toml", "none.toml", "none.toml: cannot be read"),
    ] {
        fs::write(path.join("recording.toml"), toml.replacen(from, to, 1)).unwrap();
        assert!(refused(&path).contains(message), "{}", refused(&path));
    }
    fs::write(path.join("recording.toml"), &toml).unwrap();
    depth_png(&path.join("d.png"), 16, 12, |_, _| 1000);
    assert!(refused(&path).contains("d.png: is 16x12, the depth camera's pictures are 32x24"), "{}", refused(&path));
}

/// Pictures a, a, b, b, c; `poses` changes in each frame except the fourth.
fn repeating(folder: &Path) -> PathBuf {
    let pictures: Vec<_> = [0, 0, 1, 1, 2].map(|i| picture(i, 8, 6, 8)).into();
    write(&folder.join("rgb"), &options(8, 6, 8), &pictures);
    let pose = |i: usize| format!("{} {} 0 0 0 0 0 1\n", i as f64 / 30.0, [0, 1, 2, 2, 2][i]);
    fs::write(folder.join("t.txt"), (0..5).map(pose).collect::<String>()).unwrap();
    let list: String = (0..5).map(|i| format!("{} rgb/frame_{i:06}.png\n", i as f64 / 30.0)).collect();
    fs::write(folder.join("rgb.txt"), list).unwrap();
    describe(folder, "[frames]\nlist = \"rgb.txt\"\n[poses]\ntrajectory = \"t.txt\"\n")
}

#[test]
fn repeated_pictures_are_found_and_can_be_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let path = repeating(folder.path());
    let mut each = 0;
    let repeats = open(&path).repeats(|| each += 1).unwrap();
    assert_eq!((repeats.pictures, repeats.moved, repeats.poses, repeats.times), (vec![1, 3], vec![1], vec![4], vec![]));
    assert_eq!(each, 5);
    let skipping = OpenOptions { skip_duplicates: true, ..OpenOptions::default() };
    let r = Recording::open(&path, &skipping).unwrap();
    assert!(
        r.warnings.iter().any(|w| w.contains("2 of 5 frames repeat the one before and are left out")),
        "{:?}",
        r.warnings
    );
    let kept = frames(&r, 0..3);
    for (frame, number) in kept.iter().zip([0, 2, 4]) {
        assert!((frame.timestamp_s - number as f64 / 30.0).abs() < 1e-12);
        assert_eq!(*frame.pixels, picture(number / 2, 8, 6, 8));
    }
    assert!((r.pose_at_frame(1).unwrap().position_in_world_m().x - 2.0).abs() < 1e-9);
    assert_eq!(r.repeats(|| ()).unwrap().pictures, [0usize; 0]);
}

#[test]
fn repeated_video_frames_are_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let order = [0, 1, 1, 1, 2, 3, 3, 4];
    let pictures: Vec<_> = order.map(|i| picture(i, 16, 12, 8)).into();
    write(&folder.path().join("v.mkv"), &options(16, 12, 8), &pictures);
    let path = describe(folder.path(), "[frames]\nvideo = \"v.mkv\"\n");
    assert_eq!(open(&path).repeats(|| ()).unwrap().pictures, [2, 3, 6]);
    let skipping = OpenOptions { skip_duplicates: true, ..OpenOptions::default() };
    let r = Recording::open(&path, &skipping).unwrap();
    assert_eq!(r.frame_count(), 5);
    for range in [0..5, 1..3, 2..4, 4..5, 3..3] {
        let got = frames(&r, range.clone());
        assert_eq!(got.len(), range.len());
        for (frame, i) in got.iter().zip(range) {
            assert_eq!((frame.index, &*frame.pixels), (i, &picture(i, 16, 12, 8)));
            let first = order.iter().position(|n| *n == i).unwrap();
            assert!((frame.timestamp_s - first as f64 / 30.0).abs() < 1e-9);
        }
    }
}

#[test]
fn missing_pictures_are_counted_and_can_be_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let path = repeating(folder.path());
    for i in [1, 4] {
        fs::remove_file(path.join(format!("rgb/frame_{i:06}.png"))).unwrap();
    }
    let error = refused(&path);
    assert!(error.contains("rgb.txt, line 2: ") && error.contains("frame_000001.png"), "{error}");
    assert!(error.ends_with("(2 of 5 pictures are missing; --skip-missing leaves them out)"), "{error}");
    let r = Recording::open(&path, &OpenOptions { skip_missing: true, ..OpenOptions::default() }).unwrap();
    assert!(
        r.warnings.iter().any(|w| w.contains("2 of 5 pictures are missing and left out (first: ")),
        "{:?}",
        r.warnings
    );
    let times: Vec<f64> = frames(&r, 0..3).iter().map(|frame| (frame.timestamp_s * 30.0).round()).collect();
    assert_eq!(times, [0.0, 2.0, 3.0]);
}

#[test]
fn redkitchen_opens_with_depth_registered_to_colour() {
    let Some(folder) = common::data("redkitchen") else { return };
    let r = open(&folder);
    assert_eq!((r.kind.name(), r.frame_count(), r.up), ("7-Scenes", 90, None));
    assert_eq!(r.registration(), Some(DepthRegistration::OtherCamera(640, 480)));
    assert!(r.warnings.iter().any(|w| w.contains("25 mm to the right of depth")), "{:?}", r.warnings);
    assert!((0..90).all(|i| r.pose_at_frame(i).is_ok()));
    let frame = &frames(&r, 30..31)[0];
    let depth = frame.depth.as_ref().unwrap();
    // 585 px against 525: the colour camera has a larger field of view than the depth camera, by 5
    // % at each side.
    println!("holes: {:.3}", unknown_fraction(depth));
    assert!((0.1..0.5).contains(&unknown_fraction(depth)), "{}", unknown_fraction(depth));
    assert!(depth.depth_m.iter().all(|z| *z == 0.0 || (0.3..10.0).contains(z)));
    // Registered depth edges match those of the picture better than the stored ones.
    let moved = edges_apart(frame, |x, y| depth.depth_m[y * 640 + x]);
    let raw = image::open(folder.join("frame-000030.depth.png")).unwrap().into_luma16().into_raw();
    let stored =
        edges_apart(frame, |x, y| if raw[y * 640 + x] == u16::MAX { 0.0 } else { f32::from(raw[y * 640 + x]) });
    println!("contrast at depth's edges: registered {moved:.2}, as stored {stored:.2}");
    assert!(moved > 1.15 * stored, "{moved} {stored}");
}

/// Mean contrast of the picture, 8-bit codes across 6 px, at the edges of a depth map along rows;
/// high if the edges coincide.
fn edges_apart(frame: &Frame, depth: impl Fn(usize, usize) -> f32) -> f64 {
    let green = |x: usize, y: usize| f64::from(frame.pixels.eight_bits_at(x as u32, y as u32)[1]);
    let (mut sum, mut count) = (0.0, 0);
    for y in 40..440 {
        for x in 60..580 {
            let (a, b) = (depth(x, y), depth(x + 1, y));
            if a > 0.0 && b > 0.0 && a.max(b) > 1.1 * a.min(b) {
                sum += (green(x + 4, y) - green(x - 3, y)).abs();
                count += 1;
            }
        }
    }
    assert!(count > 100, "{count} edges");
    sum / f64::from(count)
}

/// Number of frames of [`site`].
fn site_frames() -> usize {
    tier::fast_or_full(4, 6)
}

/// A small site without distortion, with a global shutter.
fn site() -> Options {
    Options {
        width_px: tier::fast_or_full(200, 320),
        height_px: tier::fast_or_full(150, 240),
        focal_px: tier::fast_or_full(162.5, 260.0),
        frames: site_frames() as _,
        motion: Motion::Dolly,
        exposure_time_s: 0.0,
        readout_time_s: 0.0,
        noise_scale: 0.0,
        samples: 1,
        k1: 0.0,
        k2: 0.0,
        p1: 0.0,
        p2: 0.0,
        format: Format::Png,
        depth_scale: 1000.0,
        ..Options::default()
    }
}

/// Simulates a site whose light is crude: edges and depth do not depend on it.
fn simulated(folder: &Path, name: &str, options: &Options) -> PathBuf {
    let out = folder.join(name);
    let detail = Detail { light_m: 0.2, ..Detail::for_focal_px(options.focal_px) };
    let simulation = || Simulation::with_detail(options, detail, 2);
    simulate::write(&out, false, simulation, &mut |_, _| ControlFlow::Continue(())).unwrap();
    out
}

/// A large marker behind the stool, in given axes.
fn scene(folder: &Path, up: &str, [x, y, z]: [f64; 3]) -> PathBuf {
    let file = folder.join(format!("scene-{up}.toml"));
    let model = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/marker-1.glb");
    let text = format!(
        "version = 1\nup = \"{up}\"\n[[objects]]\nmodel = {:?}\nposition_m = [{x:?}, {y:?}, {z:?}]\nscale = 4.0\n",
        model.display().to_string()
    );
    fs::write(&file, text).unwrap();
    file
}

/// Centroid of the coverage, px, and the number of covered pixels.
fn coverage_centroid(layer: &LayerImage) -> (glam::DVec2, f64) {
    let (mut sum, mut all) = (glam::DVec2::ZERO, 0.0);
    for (i, pixel) in layer.rgba.iter().enumerate() {
        let (x, y) = (i % layer.width as usize, i / layer.width as usize);
        sum += f64::from(pixel[3]) * glam::DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
        all += f64::from(pixel[3]);
    }
    (sum / all, all)
}

/// Layers of all frames except the first and the last, with all effects off, with or without
/// occlusion.
fn layers(recording: &Path, scene: &Path, occlusion: bool) -> Vec<LayerImage> {
    let mut shot = shot::open(recording, None, scene);
    shot.settings.plain();
    shot.settings.depth.occlusion = occlusion;
    shot::composited(&gpu::gpu(), &shot, 1..site_frames() - 1).into_iter().map(|done| done.layer.unwrap()).collect()
}

// Slow: lights three simulated sites.
#[test]
fn phone_export_and_unregistered_depth_composite_like_the_own_format() {
    let folder = tempfile::tempdir().unwrap();
    let own = simulated(folder.path(), "own", &site());
    // The phone's depth has four fifths of the frames' width, that of the separate camera half of
    // it.
    let stray_size = tier::fast_or_full((160, 120), (256, 192));
    let beside_size = tier::fast_or_full((100, 75), (160, 120));
    let stray_depth = tier::fast_or_full(Some(stray_size.0), None);
    let stray = Options { layout: Some(FolderLayout::Stray), depth_width_px: stray_depth, ..site() };
    let stray = simulated(folder.path(), "stray", &stray);
    let beside = Options { depth_width_px: Some(beside_size.0), depth_beside_mm: Some(50.0), ..site() };
    let beside = simulated(folder.path(), "beside", &beside);
    let opened = open(&stray);
    assert_eq!(
        (opened.kind.name(), opened.registration()),
        ("Stray Scanner", Some(DepthRegistration::Enlarged(stray_size.0, stray_size.1)))
    );
    assert!(opened.warnings.is_empty(), "{:?}", opened.warnings);
    assert_eq!(open(&beside).registration(), Some(DepthRegistration::OtherCamera(beside_size.0, beside_size.1)));
    // The video is lossless in this test: the same pixels.
    assert!(
        frames(&opened, 0..site_frames())
            .iter()
            .zip(frames(&open(&own), 0..site_frames()))
            .all(|(a, b)| a.pixels == b.pixels)
    );

    let at = [0.62, 0.1, 0.0];
    let scenes = [scene(folder.path(), "z", at), scene(folder.path(), "y", [at[0], at[2], -at[1]])];
    let (z_up, y_up) = (&scenes[0], &scenes[1]);
    let mut rows = Vec::new();
    for occlusion in [false, true] {
        let truth = layers(&own, z_up, occlusion);
        rows.push(coverage_centroid(&truth[0]).1);
        for (name, actual) in [("stray", layers(&stray, y_up, occlusion)), ("beside", layers(&beside, z_up, occlusion))]
        {
            for (truth, actual) in truth.iter().zip(&actual) {
                let ((a, of_a), (b, of_b)) = (coverage_centroid(truth), coverage_centroid(actual));
                println!("{name}, occlusion {occlusion}: {:.3} px apart, {of_a:.0} and {of_b:.0} px", a.distance(b));
                assert!(of_a > 500.0 && a.distance(b) < 0.5, "{name}: {a} {b}");
                assert!((of_b / of_a - 1.0).abs() < 0.05, "{name}: {of_a} {of_b}");
            }
        }
    }
    assert!(rows[1] < 0.8 * rows[0], "the stool hides a part: {rows:?}");
    // The registered depth agrees with the own format's in the frames' pixels.
    let depths = |path: &Path| {
        let shot = shot::open(path, None, z_up);
        shot.read(3).unwrap().depth.unwrap()
    };
    let truth = depths(&own);
    for (name, actual) in [("stray", depths(&stray)), ("beside", depths(&beside))] {
        let both_measured = |(a, b): &(&f32, &f32)| **a > 0.0 && **b > 0.0;
        let pairs: Vec<_> = truth.depth_m.iter().zip(&actual.depth_m).filter(both_measured).collect();
        let close = pairs.iter().filter(|(a, b)| (*a / *b - 1.0).abs() < 0.01).count() as f64 / pairs.len() as f64;
        println!(
            "{name}: {:.1} % of the pixels within 1 %, {:.1} % holes",
            100.0 * close,
            100.0 * unknown_fraction(&actual)
        );
        assert!(close > 0.97 && unknown_fraction(&actual) < 0.12, "{name}: {close}");
    }
}

#[test]
fn unregistered_depth_in_a_phone_export_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let options = Options { layout: Some(FolderLayout::Stray), depth_beside_mm: Some(20.0), ..site() };
    let error = simulate::run(&folder.path().join("s"), &options, &Flaws::default(), false, &mut |_, _| {
        ControlFlow::Continue(())
    });
    assert!(error.unwrap_err().to_string().contains("simulate.layout = stray: a phone has no such lens"));
}
