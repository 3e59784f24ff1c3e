//! Recordings of every format: real data, and refused ones.

use std::path::Path;
use std::process::Command;

use crate::common;
use crate::files::{describe, frames, open, options, picture, refused, write};
use crate::program::copied;
use glam::{DVec2, DVec3};
use locard::pixels::{Codes, Pixels};
use locard::recording::{OpenOptions, Recording};
use locard::tracking::tum;

/// Three small frames `a0.png` to `a2.png`.
fn three_frames(folder: &Path) {
    let pictures: Vec<Pixels> = (0..3).map(|i| picture(i, 4, 2, 8)).collect();
    write(&folder.join("rgb"), &options(4, 2, 8), &pictures);
}

#[test]
fn tum_fr1_rpy_opens() {
    let Some(folder) = common::data("tum-fr1-rpy") else { return };
    let r = open(&folder);
    assert_eq!((r.kind.name(), r.name.as_str(), r.frame_count()), ("TUM RGB-D", "tum-fr1-rpy", 90));
    assert_eq!((r.width, r.height, r.bits, r.up), (640, 480, 8, Some(DVec3::Z)));
    assert!((r.frame_interval_s - 1.0 / 30.0).abs() < 0.002, "{}", r.frame_interval_s);
    assert!(r.has_depth() && r.geometry.is_none());
    println!("{:#?}", r.warnings);
    assert!((0..90).all(|i| r.pose_at_frame(i).is_ok()), "{:?}", r.warnings);
    // The line of groundtruth.txt at 1305031240.5030.
    let track = tum::read_trajectory(&folder.join("groundtruth.txt"), None).unwrap();
    assert!((track.poses()[0].1.position_in_world_m() - DVec3::new(1.3118, 0.6150, 1.5975)).length() < 1e-12);

    let all = frames(&r, 0..90);
    assert!(all.windows(2).all(|pair| pair[0].index + 1 == pair[1].index));
    let with_depth = all.iter().filter(|f| f.depth.is_some()).count();
    assert_eq!(with_depth, 90, "{:?}", r.warnings);
    for frame in &all {
        assert_eq!((frame.pixels.width, frame.pixels.height), (640, 480));
        let depth = frame.depth.as_ref().unwrap();
        assert!((depth.timestamp_s - frame.timestamp_s).abs() <= 0.65 * r.frame_interval_s);
        assert_eq!(depth.depth_m.len(), 640 * 480);
        assert!(depth.depth_m.iter().all(|z| *z == 0.0 || (0.3..14.0).contains(z)));
    }
    let some = frames(&r, 40..43);
    assert!(some.iter().zip(&all[40..]).all(|(a, b)| a.pixels == b.pixels && a.depth == b.depth && a.index == b.index));
}

#[test]
fn neighbours_are_equal_in_every_range_and_damaged_ones_left_out() {
    let beside = |r: &Recording, range: std::ops::Range<usize>| -> Vec<Option<Vec<usize>>> {
        let frames = r.frames_with_neighbours(range).unwrap();
        frames.map(|frame| Some(frame.ok()?.neighbours.iter().map(|neighbour| neighbour.index).collect())).collect()
    };
    let demo = open(Path::new("recordings/demo"));
    let all = beside(&demo, 0..20);
    assert_eq!((all[0].as_deref(), all[10].as_deref()), (Some(&[1, 2, 3][..]), Some(&[7, 8, 9, 11, 12, 13][..])));
    assert_eq!(beside(&demo, 9..12), all[9..12]);
    let last = demo.frame_count() - 1;
    assert_eq!(beside(&demo, last..last + 1), [Some(vec![last - 3, last - 2, last - 1])]);
    assert!(demo.frames_with_neighbours(last..last + 2).is_err() && beside(&demo, 5..5).is_empty());
    let frame = demo.frames_with_neighbours(4..5).unwrap().next().unwrap().unwrap();
    assert!(frame.neighbours[0].pixels == frames(&demo, 1..2)[0].pixels && frame.depth == frames(&demo, 4..5)[0].depth);

    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path().join("damaged");
    copied(Path::new("recordings/demo"), &folder);
    let file = folder.join("rgb/00003.jpg");
    let bytes = std::fs::read(&file).unwrap();
    std::fs::write(&file, &bytes[..bytes.len() / 2]).unwrap();
    let damaged = open(&folder);
    assert_eq!(beside(&damaged, 0..6), [Some(vec![1, 2]), Some(vec![0, 2, 4]), Some(vec![0, 1, 4, 5]), None]);
    assert_eq!(beside(&damaged, 1..3), [Some(vec![0, 2, 4]), Some(vec![0, 1, 4, 5])]);
    assert_eq!(beside(&damaged, 4..6), [Some(vec![1, 2, 5, 6, 7]), Some(vec![2, 4, 6, 7, 8])]);
}

/// COLMAP's points must project to their detections: tests axes, order of the quaternion, direction
/// of the pose, principal point and distortion at once.
#[test]
fn lund_door_points_reproject() {
    let Some(folder) = common::data("lund-door-dslr") else { return };
    let r = open(&folder);
    assert_eq!((r.kind.name(), r.frame_count(), r.width, r.height, r.up), ("COLMAP", 12, 1296, 1936, None));
    let geometry = r.geometry.clone().unwrap();
    assert_eq!(open(&folder.join("colmap")).frame_count(), 12);

    let points = std::fs::read_to_string(folder.join("colmap/points3D.txt")).unwrap();
    let points: std::collections::HashMap<&str, DVec3> = points
        .lines()
        .filter(|line| !line.starts_with('#'))
        .map(|line| {
            let words: Vec<&str> = line.split(' ').collect();
            let [x, y, z] = [1, 2, 3].map(|i: usize| words[i].parse().unwrap());
            (words[0], DVec3::new(x, y, z))
        })
        .collect();
    let images = std::fs::read_to_string(folder.join("colmap/images.txt")).unwrap();
    let lines: Vec<&str> = images.lines().filter(|line| !line.starts_with('#')).collect();
    let mut errors_px = Vec::new();
    for pair in lines.chunks_exact(2) {
        let name = pair[0].rsplit(' ').next().unwrap();
        // DSC_0001.JPG is frame 0.
        let pose = r.pose_at_frame(name[4..8].parse::<usize>().unwrap() - 1).unwrap();
        for observation in pair[1].split(' ').collect::<Vec<_>>().chunks_exact(3) {
            let Some(point) = points.get(observation[2]) else { continue };
            let at = DVec2::new(observation[0].parse().unwrap(), observation[1].parse().unwrap());
            errors_px.push((geometry.project(pose.transform_point(*point)).unwrap() - at).length());
        }
    }
    errors_px.sort_by(f64::total_cmp);
    let share = |p: f64| errors_px[(p * (errors_px.len() - 1) as f64) as usize];
    println!("{} observations: median {:.3} px, 95 % {:.3} px", errors_px.len(), share(0.5), share(0.95));
    assert!(errors_px.len() > 10_000 && share(0.5) < 0.6 && share(0.95) < 2.0);

    let frame = frames(&r, 11..12).remove(0);
    assert_eq!((frame.index, frame.pixels.width, frame.pixels.height), (11, 1296, 1936));
    let doubled = Recording::open(&folder, &OpenOptions { metres_per_unit: 2.0, ..Default::default() }).unwrap();
    let (a, b) = (r.pose_at_frame(3).unwrap(), doubled.pose_at_frame(3).unwrap());
    assert!((a.position_in_world_m() * 2.0 - b.position_in_world_m()).length() < 1e-9);
}

/// The binary model of the castle: each point's mean reprojection error over its track is the one
/// that COLMAP stored with the point.
#[test]
fn castle_points_reproject_with_the_errors_stored_by_colmap() {
    let Some(folder) = common::data("bring/colmap-binary") else { return };
    let r = open(&folder);
    assert_eq!((r.kind.name(), r.frame_count(), r.width, r.height, r.up), ("COLMAP", 11, 2832, 2128, None));
    assert_eq!(open(&folder.join("sparse/0/cameras.bin")).frame_count(), 11);
    let geometry = r.geometry.clone().unwrap();

    let mut keypoints = std::collections::HashMap::<u64, Vec<(usize, DVec2)>>::new();
    for frame in 0..r.frame_count() {
        for landmark in r.landmarks(frame) {
            keypoints.entry(landmark.number).or_default().push((frame, DVec2::from(landmark.at_px.map(f64::from))));
        }
    }
    let bytes = std::fs::read(folder.join("sparse/0/points3D.bin")).unwrap();
    let u64_at = |at: usize| u64::from_le_bytes(bytes[at..at + 8].try_into().unwrap());
    let f64_at = |at: usize| f64::from_bits(u64_at(at));
    // After the number of points, each has: its number, x, y, z, a colour of three bytes, its error
    // in px, the track's length, and 8 bytes for each observation.
    let (mut at, mut own_px, mut stored_px, mut worst_px) = (8, 0.0, 0.0, 0.0f64);
    let count = u64_at(0);
    for _ in 0..count {
        let (point, error_px, length) =
            (DVec3::from([8, 16, 24].map(|i| f64_at(at + i))), f64_at(at + 35), u64_at(at + 43));
        let track = &keypoints[&u64_at(at)];
        assert_eq!(track.len() as u64, length);
        let off_px = |&(frame, at): &(usize, DVec2)| {
            let pose = r.pose_at_frame(frame).unwrap();
            geometry.project(pose.transform_point(point)).unwrap().distance(at)
        };
        let mean_px = track.iter().map(off_px).sum::<f64>() / length as f64;
        worst_px = worst_px.max((mean_px - error_px).abs());
        own_px += mean_px / count as f64;
        stored_px += error_px / count as f64;
        at += 51 + 8 * length as usize;
    }
    println!("{count} points: mean {own_px:.4} px, stored {stored_px:.4} px, largest difference {worst_px:.5} px");
    assert!(at == bytes.len() && count > 1000 && (own_px - stored_px).abs() < 1e-3 && worst_px < 1e-2);
}

#[test]
fn cycles_recordings_open() {
    for case in ["defocus-behind", "motion-translate", "rolling-shutter"] {
        let Some(folder) = common::data(&format!("cycles/{case}")) else { return };
        let r = open(&folder);
        assert_eq!(r.frame_count(), 5);
        assert!((0..5).all(|i| r.pose_at_frame(i).is_ok()), "{:?}", r.warnings);
    }
}

#[test]
fn own_format_with_all_parts_opens() {
    let folder = tempfile::tempdir().unwrap();
    three_frames(folder.path());
    let at = |name: &str| folder.path().join(name);
    std::fs::write(
        at("rgb.txt"),
        "# c\n10.0 rgb/frame_000000.png\n10.1 rgb/frame_000001.png\n10.2 rgb/frame_000002.png\n",
    )
    .unwrap();
    std::fs::write(at("poses.txt"), "0.1 0 0 0 0 0 0 1\n0.2 1 0 0 0 0 0 1.005\n0.25 2 0 0 0 0 0 1\n").unwrap();
    let words: Vec<u16> = (0..8).map(|i| 1000 * i).collect();
    image::ImageBuffer::<image::Luma<u16>, _>::from_raw(4, 2, words).unwrap().save(at("d.png")).unwrap();
    std::fs::write(at("depth.txt"), "10.05 d.png\n10.26 d.png\n").unwrap();
    std::fs::write(at("exposure.txt"), "10.0 0.02 1.5\n10.21 0.01\n").unwrap();
    describe(
        folder.path(),
        "name = \"site\"\nup = [0, 2, 0]\n[frames]\nlist = \"rgb.txt\"\n[poses]\ntrajectory = \"poses.txt\"\n\
         time_offset_s = -9.9\nmax_gap_s = 0.2\n[depth]\nlist = \"depth.txt\"\nscale = 1000.0\n[exposure]\n\
         list = \"exposure.txt\"\n[camera]\nprofile = \"camera.toml\"\n",
    );
    let r = open(&folder.path().join("recording.toml"));
    assert_eq!((r.name.as_str(), r.up, r.kind.name()), ("site", Some(DVec3::Y), "recording.toml"));
    assert_eq!(r.camera_profile, Some(at("camera.toml")));
    assert!((r.pose_at_frame(1).unwrap().position_in_world_m().x - 1.0).abs() < 1e-6);
    let all = frames(&r, 0..3);
    // Depth is assigned within 0.65 of 0.1 s. Frames 0 and 1 are 0.05 s from the first depth, frame
    // 2 0.06 s from the second.
    assert!(all.iter().zip([10.05, 10.05, 10.26]).all(|(f, t)| f.depth.as_ref().unwrap().timestamp_s == t));
    let depth = all[0].depth.as_ref().unwrap();
    assert_eq!((depth.timestamp_s, depth.depth_m[7]), (10.05, 7.0));
    assert_eq!((all[0].exposure.time_s, all[0].exposure.gain), (Some(0.02), Some(1.5)));
    assert_eq!((all[1].exposure.time_s, all[2].exposure.time_s, all[2].exposure.gain), (None, Some(0.01), None));
    let warnings = r.warnings.join("\n");
    let missing = r.missing_poses(0..3).unwrap();
    assert!(missing.contains("no pose for 1 of 3 frames (frame 2"), "{missing}");
    for message in ["1 of 3 quaternions", "no exposure within 0"] {
        assert!(warnings.contains(message), "{warnings}");
    }
    let later = Recording::open(folder.path(), &OpenOptions { time_offset_s: 0.05, ..Default::default() }).unwrap();
    assert!((later.track.clock_offset_s() + 9.85).abs() < 1e-12);
}

/// Grey pictures, a camera on a body, nanoseconds: from the folder, from `mav0`, from the list.
#[test]
fn euroc_opens() {
    let folder = tempfile::tempdir().unwrap();
    let cam = folder.path().join("mav0/cam0");
    let truth = folder.path().join("mav0/state_groundtruth_estimate0");
    std::fs::create_dir_all(cam.join("data")).unwrap();
    std::fs::create_dir_all(&truth).unwrap();
    let start_ns = 1_403_636_579_763_555_584u64;
    let (mut list, mut poses) = ("#timestamp [ns],filename\r\n".to_owned(), "#timestamp, p, q, v, b\n".to_owned());
    for i in 0..3u64 {
        let time = start_ns + i * 50_000_000;
        let grey = image::GrayImage::from_fn(8, 6, |x, y| image::Luma([(x * 20 + y) as u8 + i as u8]));
        grey.save(cam.join(format!("data/{time}.png"))).unwrap();
        list += &format!("{time},{time}.png\r\n");
        poses += &format!("{time},{i},2,3,0.70710678,0,0,0.70710678,0,0,0,0,0,0,0,0,0\n");
    }
    std::fs::write(cam.join("data.csv"), &list).unwrap();
    std::fs::write(truth.join("data.csv"), poses).unwrap();
    let sensor = |shift: f64| {
        format!(
            "T_BS:\n  cols: 4\n  rows: 4\n  data: [0.0, 0.0, 1.0, {shift},\n         -1.0, 0.0, 0.0, 0.0,\n         0.0, -1.0, \
             0.0, 0.0,\n         0.0, 0.0, 0.0, 1.0]\nresolution: [8, 6]\ncamera_model: pinhole\nintrinsics: [9.0, 9.0, 3.5, \
             2.5]\ndistortion_model: radial-tangential\ndistortion_coefficients: [0, 0, 0, 0]\n"
        )
    };
    std::fs::write(cam.join("sensor.yaml"), sensor(0.1)).unwrap();
    for path in [folder.path(), &folder.path().join("mav0"), &cam.join("data.csv")] {
        let r = open(path);
        assert_eq!((r.kind.name(), r.frame_count(), r.bits, r.up), ("EuRoC MAV", 3, 8, Some(DVec3::Z)));
        assert_eq!(r.name, folder.path().file_name().unwrap().to_string_lossy());
        assert!((r.frame_interval_s - 0.05).abs() < 1e-6 && r.warnings.is_empty(), "{:?}", r.warnings);
        assert!(r.kind.has_times() && r.kind.is_metric());
        // The body at (2, 2, 3) faces the world's y; a point 2 m in front of its camera is in
        // the middle of the picture.
        let pose = r.pose_at_frame(2).unwrap();
        let at = r.geometry.as_ref().unwrap().project(pose.transform_point(DVec3::new(2.0, 4.1, 3.0))).unwrap();
        assert!((at - DVec2::new(4.0, 3.0)).length() < 1e-5, "{at}");
        let all = frames(&r, 0..3);
        assert_eq!(all[1].pixels.at(2, 1), [42, 42, 42]);
        assert_eq!(r.files().count(), 6);
    }
    // If the ground truth is that of the camera, its position is the camera's.
    std::fs::write(truth.join("sensor.yaml"), sensor(0.1)).unwrap();
    let pose = open(folder.path()).pose_at_frame(1).unwrap();
    assert!((pose.position_in_world_m() - DVec3::new(1.0, 2.0, 3.0)).length() < 1e-9);
    std::fs::remove_file(cam.join(format!("data/{start_ns}.png"))).unwrap();
    let error = refused(folder.path());
    assert!(error.contains("data.csv, line 2: ") && error.contains("there is no such file"), "{error}");
    assert!(error.ends_with("(1 of 3 pictures is missing; --skip-missing leaves it out)"), "{error}");
}

#[test]
fn nerfstudio_opens() {
    let folder = tempfile::tempdir().unwrap();
    three_frames(folder.path());
    let entry = |i: usize, x: f64, more: &str| {
        format!(
            r#"{{"file_path": "./rgb/frame_00000{i}.png", {more}
            "transform_matrix": [[1,0,0,{x}],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}}"#
        )
    };
    let common = r#""camera_model": "OPENCV", "fl_x": 5, "fl_y": 6, "cx": 2, "cy": 1, "w": 4, "h": 2, "p1": 0.001"#;
    let all = [entry(2, 2.0, ""), entry(0, 0.0, ""), entry(1, 1.0, "")].join(",");
    std::fs::write(folder.path().join("transforms.json"), format!("{{{common}, \"frames\": [{all}]}}")).unwrap();
    let r = Recording::open(folder.path(), &OpenOptions { metres_per_unit: 3.0, ..Default::default() }).unwrap();
    assert_eq!((r.kind.name(), r.frame_count(), r.up), ("nerfstudio", 3, Some(DVec3::Z)));
    assert_eq!(r.pose_at_frame(2).unwrap().position_in_world_m(), DVec3::new(6.0, 0.0, 0.0));
    let g = r.geometry.as_ref().unwrap();
    assert_eq!((g.intrinsics.fy_px, g.distortion.p1), (6.0, 0.001));
    assert!(r.warnings.iter().any(|w| w.contains("30 a second")), "{:?}", r.warnings);
    assert!(*frames(&r, 2..3)[0].pixels == picture(2, 4, 2, 8));

    let all = [entry(0, 0.0, ""), entry(1, 1.0, r#""fl_x": 9,"#)].join(",");
    std::fs::write(folder.path().join("transforms.json"), format!("{{{common}, \"frames\": [{all}]}}")).unwrap();
    let r = open(&folder.path().join("transforms.json"));
    assert!(r.geometry.is_none());
    assert_eq!(r.geometry_at_frame(1).unwrap().intrinsics.fx_px, 9.0);
    let wrong = common.replace("\"w\": 4", "\"w\": 8");
    std::fs::write(folder.path().join("transforms.json"), format!("{{{wrong}, \"frames\": [{all}]}}")).unwrap();
    assert!(refused(folder.path()).contains("frame 0 is 4x2, its camera is for 8x2"), "{}", refused(folder.path()));
}

#[test]
fn unregistered_colmap_image_is_a_frame_without_a_pose() {
    let folder = tempfile::tempdir().unwrap();
    three_frames(folder.path());
    std::fs::rename(folder.path().join("rgb"), folder.path().join("images")).unwrap();
    let model = folder.path().join("sparse/0");
    std::fs::create_dir_all(&model).unwrap();
    std::fs::write(model.join("cameras.txt"), "1 PINHOLE 4 2 5 5 2 1\n").unwrap();
    let line = |i: usize| format!("{i} 1 0 0 0 {i} 0 0 1 frame_00000{i}.png\n\n");
    std::fs::write(model.join("images.txt"), line(2) + &line(0)).unwrap();
    for path in [folder.path(), &model, &model.join("cameras.txt"), &model.join("images.txt")] {
        let r = open(path);
        assert_eq!((r.frame_count(), r.kind.name()), (3, "COLMAP"));
        assert!(r.pose_at_frame(0).is_ok() && r.pose_at_frame(1).is_err());
        assert_eq!(r.pose_at_frame(2).unwrap().position_in_world_m(), DVec3::new(-2.0, 0.0, 0.0));
        let missing = r.missing_poses(0..3).unwrap();
        assert!(missing.contains("no pose for 1 of 3 frames (frame 1"), "{missing}");
        assert!(
            r.missing_poses(1..2).unwrap().contains("no pose for 1 of 1 frames") && r.missing_poses(2..3).is_none()
        );
    }
}

/// The binary form of the model in a folder with both. Its only image is the second picture.
#[test]
fn binary_colmap_model_takes_precedence_over_the_text_beside_it() {
    let folder = tempfile::tempdir().unwrap();
    three_frames(folder.path());
    std::fs::rename(folder.path().join("rgb"), folder.path().join("images")).unwrap();
    let write = |name: &str, bytes: &[u8]| std::fs::write(folder.path().join(name), bytes).unwrap();
    write("cameras.txt", b"1 PINHOLE 4 2 5 5 2 1\n");
    write("images.txt", b"1 1 0 0 0 1 0 0 1 frame_000000.png\n\n");
    let numbers = |values: &[f64]| values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>();
    let counts = |values: &[u64]| values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>();
    let words = |values: &[u32]| values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>();
    write("cameras.bin", &[counts(&[1]), words(&[1, 0]), counts(&[4, 2]), numbers(&[7.0, 2.0, 1.0])].concat());
    let posed = |i: usize| {
        assert_eq!((open(folder.path()).frame_count(), open(folder.path()).pose_at_frame(i).is_ok()), (3, true));
    };
    // Incomplete, it is not taken.
    posed(0);
    let image =
        [words(&[1]), numbers(&[1.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0]), words(&[1]), b"frame_000001.png\0".to_vec()];
    write("images.bin", &[counts(&[1]), image.concat(), counts(&[0])].concat());
    posed(1);
    let r = open(folder.path());
    assert_eq!(r.geometry.as_ref().unwrap().intrinsics.fx_px, 7.0);
    assert_eq!(r.pose_at_frame(1).unwrap().position_in_world_m(), DVec3::new(-2.0, 0.0, 0.0));
    assert!(r.pose_at_frame(0).is_err());
    // A named file decides.
    for (name, fx_px) in [("cameras.bin", 7.0), ("images.bin", 7.0), ("cameras.txt", 5.0), ("images.txt", 5.0)] {
        let r = open(&folder.path().join(name));
        assert_eq!(r.geometry.unwrap().intrinsics.fx_px, fx_px, "{name}");
    }
    write("cameras.bin", &[counts(&[1]), words(&[3, 0]), counts(&[4, 2]), numbers(&[7.0, 2.0, 1.0])].concat());
    let error = refused(folder.path());
    assert!(
        error.contains("images.bin, byte 8: frame_000001.png names camera 1, which cameras.bin does not have"),
        "{error}"
    );
}

#[test]
fn pictures_missing_from_a_folder_are_reported() {
    let folder = tempfile::tempdir().unwrap();
    three_frames(folder.path());
    let described = describe(folder.path(), "[frames]\nimages = \"rgb\"\nfps = 30.0\n");
    assert_eq!(open(&described).warnings, Vec::<String>::new());
    let rgb = folder.path().join("rgb");
    std::fs::rename(rgb.join("frame_000002.png"), rgb.join("frame_000004.png")).unwrap();
    std::fs::copy(rgb.join("frame_000004.png"), rgb.join("frame_000005.png")).unwrap();
    let warnings = open(&described).warnings.join("\n");
    assert!(warnings.contains("frame_000001.png is followed by frame_000004.png"), "{warnings}");
}

#[test]
fn invalid_recordings_are_refused_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    assert!(refused(&at("nowhere")).contains("not a recording: no such file or folder"));
    assert!(refused(folder.path()).contains("Supported: a folder with recording.toml"));
    std::fs::write(at("empty.dat"), "").unwrap();
    assert!(refused(&at("empty.dat")).contains("not a recording: the file is empty"));
    three_frames(folder.path());
    let list = |lines: &str| std::fs::write(at("rgb.txt"), lines).unwrap();
    list("1 rgb/frame_000000.png\n2 rgb/frame_000001.png\n");
    assert!(refused(folder.path()).contains("groundtruth.txt: cannot be read"), "{}", refused(folder.path()));
    std::fs::write(at("groundtruth.txt"), "1 0 0 0 0 0 0 1\n").unwrap();
    assert!(open(folder.path()).missing_poses(0..2).unwrap().contains("no pose for 1 of 2 frames"));
    assert_eq!((open(&at("rgb.txt")).frame_count(), open(&at("rgb.txt")).kind.name()), (2, "TUM RGB-D"));

    list("1 rgb/frame_000000.png\n2 rgb/not_there.png\n");
    let error = refused(folder.path());
    assert!(
        error.contains("rgb.txt, line 2: ") && error.contains("not_there.png: cannot be read: there is no"),
        "{error}"
    );
    assert!(error.ends_with("(1 of 2 pictures is missing; --skip-missing leaves it out)"), "{error}");
    list("1 rgb/frame_000000.png\n2 rgb/not_there.png\n3 rgb/nor_this.png\n");
    assert!(
        refused(folder.path()).ends_with("(2 of 3 pictures are missing; --skip-missing leaves them out)"),
        "{}",
        refused(folder.path())
    );
    list("");
    assert!(refused(folder.path()).contains("no frames"));
    write(&at("other"), &options(5, 2, 8), &[picture(0, 5, 2, 8)]);
    list("1 rgb/frame_000000.png\n2 rgb/frame_000001.png\n3 other/frame_000000.png\n");
    let r = open(folder.path());
    let is_size_warning =
        |w: &String| w.contains("most pictures are 4x2") && w.contains("other/frame_000000.png is 5x2");
    assert!(r.frame_count() == 2 && r.warnings.iter().any(is_size_warning), "{:?}", r.warnings);

    list("1 rgb/frame_000000.png\n2 rgb/frame_000001.png\n3 rgb/frame_000002.png\n");
    let whole = std::fs::read(at("rgb/frame_000001.png")).unwrap();
    std::fs::write(at("rgb/frame_000001.png"), &whole[..50]).unwrap();
    let r = open(folder.path());
    let got: Vec<_> = r.frames(0..3).unwrap().collect();
    assert!(got.len() == 2 && got[0].is_ok(), "after an error there is nothing more");
    let error = got[1].as_ref().unwrap_err().to_string();
    assert!(error.contains("frame_000001.png") && error.contains("truncated"), "{error}");
    assert!(r.frames(1..4).err().unwrap().to_string().contains("1..4 were requested; the recording has 0..3"));
    let bad = OpenOptions { metres_per_unit: 0.0, ..Default::default() };
    assert!(Recording::open(folder.path(), &bad).unwrap_err().to_string().contains("metres_per_unit = 0"));
}

/// Opening a pipe waits for a writer indefinitely; a device has no end.
#[cfg(unix)]
#[test]
fn pipe_or_device_in_place_of_a_file_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    three_frames(folder.path());
    let depth = image::ImageBuffer::<image::Luma<u16>, _>::from_raw(4, 2, vec![7u16; 8]).unwrap();
    depth.save(folder.path().join("d.png")).unwrap();
    let files = [
        ("rgb.txt", "1 rgb/frame_000000.png\n"),
        ("depth.txt", "1 d.png\n"),
        ("groundtruth.txt", "1 0 0 0 0 0 0 1\n"),
        ("exposure.txt", "1 0.01\n"),
        (
            "recording.toml",
            "version = 1\n[frames]\nlist = \"rgb.txt\"\n[poses]\ntrajectory = \"groundtruth.txt\"\n[depth]\nlist = \
             \"depth.txt\"\nscale = 1.0\n[exposure]\nlist = \"exposure.txt\"\n",
        ),
    ];
    for (name, text) in files {
        std::fs::write(folder.path().join(name), text).unwrap();
    }
    assert_eq!(open(folder.path()).frame_count(), 1);
    for name in
        ["rgb.txt", "depth.txt", "groundtruth.txt", "exposure.txt", "recording.toml", "d.png", "rgb/frame_000000.png"]
    {
        let (file, kept) = (folder.path().join(name), folder.path().join("kept"));
        std::fs::rename(&file, &kept).unwrap();
        assert!(Command::new("mkfifo").arg(&file).status().unwrap().success());
        assert!(refused(folder.path()).contains("a pipe or a device"), "{name}: {}", refused(folder.path()));
        std::fs::remove_file(&file).unwrap();
        std::os::unix::fs::symlink("/dev/zero", &file).unwrap();
        assert!(refused(folder.path()).contains("a pipe or a device"), "{name}: {}", refused(folder.path()));
        std::fs::remove_file(&file).unwrap();
        std::fs::rename(&kept, &file).unwrap();
    }
    let list = folder.path().join("groundtruth.txt");
    std::fs::write(&list, format!("1 0 0 {} 0 0 0 1\n", "\x1b[2J".repeat(1_000_000))).unwrap();
    let error = refused(folder.path());
    assert!(error.len() < 500 && error.contains("tz is `\\u{1b}[2J\\u{1b}"), "{} bytes: {error:.300}", error.len());
}

/// The iterator is `Send + 'static`: it owns its data and may move to another thread.
#[test]
fn frame_iterator_outlives_the_recording() {
    fn needs(_: impl Iterator + Send + 'static) {}
    let folder = tempfile::tempdir().unwrap();
    three_frames(folder.path());
    let r = open(&describe(folder.path(), "[frames]\nimages = \"rgb\"\nfps = 30.0\n"));
    needs(r.frames(0..3).unwrap());
    let stream = r.frames(0..3).unwrap();
    drop(r);
    assert!(matches!(stream.last().unwrap().unwrap().pixels.codes, Codes::U8(_)));
}
