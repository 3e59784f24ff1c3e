//! Recordings in and frames out, on files: real data, ffmpeg, and what must be refused.

#![allow(clippy::unwrap_used, clippy::type_complexity, reason = "tests")]

mod common;

use std::path::{Path, PathBuf};
use std::process::Command;

use glam::{DVec2, DVec3};
use locard::frame::Frame;
use locard::image::{Codes, Pixels};
use locard::recording::{OpenOptions, Recording};
use locard::sink::{self, OutPath, SinkOptions};
use locard::source::still;
use locard::tracking::tum;

fn open(path: &Path) -> Recording {
    Recording::open(path, &OpenOptions::default()).unwrap()
}

fn refused(path: &Path) -> String {
    Recording::open(path, &OpenOptions::default()).unwrap_err().to_string()
}

fn frames(recording: &Recording, range: std::ops::Range<usize>) -> Vec<Frame> {
    recording.frames(range).unwrap().map(Result::unwrap).collect()
}

/// A picture in which every pixel of every frame is different.
fn picture(frame: usize, width: u32, height: u32, bits: u32) -> Pixels {
    let code = |i: usize| (i * 40_503 + frame * 7_919) % 65_521;
    let count = 3 * width as usize * height as usize;
    match bits {
        8 => Pixels::from_u8(width, height, (0..count).map(|i| code(i) as u8).collect()).unwrap(),
        _ => Pixels::from_u16(width, height, (0..count).map(|i| code(i) as u16).collect()).unwrap(),
    }
}

fn options(width: u32, height: u32, bits: u32) -> SinkOptions {
    SinkOptions { force: false, fps: 30.0, lossless: true, width, height, bits }
}

fn write(path: &Path, options: &SinkOptions, pictures: &[Pixels]) {
    let mut sink = sink::open(&OutPath::parse(path).unwrap(), options).unwrap();
    for (i, pixels) in pictures.iter().enumerate() {
        sink.write(i, pixels).unwrap();
    }
    sink.finish().unwrap();
}

fn describe(folder: &Path, rest: &str) -> PathBuf {
    std::fs::write(folder.join("recording.toml"), format!("version = 1\n{rest}")).unwrap();
    folder.to_owned()
}

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

/// Points that COLMAP found must land where COLMAP saw them: axes, order of the quaternion,
/// direction of the pose, principal point and distortion at once.
#[test]
fn lund_door_reprojects() {
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
        for seen in pair[1].split(' ').collect::<Vec<_>>().chunks_exact(3) {
            let Some(point) = points.get(seen[2]) else { continue };
            let at = DVec2::new(seen[0].parse().unwrap(), seen[1].parse().unwrap());
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

#[test]
fn the_other_renderers_recordings_open() {
    for case in ["defocus-behind", "motion-translate", "rolling-shutter"] {
        let Some(folder) = common::data(&format!("cycles/{case}")) else { return };
        let r = open(&folder);
        assert_eq!(r.frame_count(), 5);
        assert!((0..5).all(|i| r.pose_at_frame(i).is_ok()), "{:?}", r.warnings);
    }
}

/// Y'CbCr of a colour by the definitions: BT.601-7 2.5.1, BT.709-6 3.2 to 3.5, 8 or 10 bits.
fn ycbcr(rgb: [f64; 3], (kr, kb): (f64, f64), full: bool, bits: u32) -> [u16; 3] {
    let [r, g, b] = rgb.map(|c| c / 255.0);
    let y = kr * r + (1.0 - kr - kb) * g + kb * b;
    let (cb, cr) = ((b - y) / (2.0 * (1.0 - kb)), (r - y) / (2.0 * (1.0 - kr)));
    let unit = f64::from(1u32 << (bits - 8));
    let largest = 256.0 * unit - 1.0;
    let (luma, chroma) = if full { ((0.0, largest), largest) } else { ((16.0 * unit, 219.0 * unit), 224.0 * unit) };
    [luma.0 + luma.1 * y, 128.0 * unit + chroma * cb, 128.0 * unit + chroma * cr]
        .map(|v| v.round().clamp(0.0, largest) as u16)
}

/// The colours are turned into Y'CbCr here, by formula, and stored without loss.
#[test]
fn saturated_colours_come_back_within_2_codes() {
    let (bt601, bt709) = ((0.299, 0.114), (0.2126, 0.0722));
    // Height, pixel format, tags, what they mean.
    let cases: [(u32, &str, &[&str], (f64, f64), bool); 8] = [
        (64, "yuv420p", &["-color_range", "tv", "-colorspace", "smpte170m"], bt601, false),
        (64, "yuv420p", &["-color_range", "tv", "-colorspace", "bt709"], bt709, false),
        (64, "yuv420p", &["-color_range", "pc", "-colorspace", "bt709"], bt709, true),
        (64, "yuv420p", &["-color_range", "pc", "-colorspace", "bt470bg"], bt601, true),
        (64, "yuv420p", &[], bt601, false),
        (720, "yuv420p", &[], bt709, false),
        (64, "yuv444p", &["-color_range", "tv", "-colorspace", "bt709"], bt709, false),
        (64, "yuv420p10le", &["-color_range", "tv", "-colorspace", "bt709"], bt709, false),
    ];
    for (height, format, tags, matrix, full) in cases {
        let folder = tempfile::tempdir().unwrap();
        let (bits, chroma) =
            (if format.ends_with("10le") { 10 } else { 8 }, if format.contains("444") { 1 } else { 4 });
        let colors = [[255.0, 0.0, 0.0], [0.0, 200.0, 10.0], [20.0, 30.0, 250.0], [250.0, 240.0, 5.0]];
        let mut raw = Vec::new();
        for color in colors {
            for (plane, value) in ycbcr(color, matrix, full, bits).into_iter().enumerate() {
                let count = 64 * height as usize / if plane == 0 { 1 } else { chroma };
                let bytes = value.to_le_bytes();
                raw.extend((0..count).flat_map(|_| bytes[..if bits == 8 { 1 } else { 2 }].to_vec()));
            }
        }
        std::fs::write(folder.path().join("raw"), raw).unwrap();
        let size = format!("64x{height}");
        let done = Command::new("ffmpeg")
            .args(["-v", "error", "-f", "rawvideo", "-pix_fmt", format, "-s", &size, "-framerate", "30", "-i"])
            .arg(folder.path().join("raw"))
            .args(["-c:v", "ffv1"])
            .args(tags)
            .arg(folder.path().join("v.mkv"))
            .status();
        assert!(done.expect("this test needs ffmpeg").success());
        let r = open(&describe(folder.path(), "[frames]\nvideo = \"v.mkv\"\n"));
        assert_eq!((r.frame_count(), r.width, r.height, r.bits), (4, 64, height, if bits == 8 { 8 } else { 16 }));
        for (frame, color) in frames(&r, 0..4).iter().zip(colors) {
            let scale = f64::from(frame.pixels.max_code()) / 255.0;
            for (found, expected) in frame.pixels.at(31, 33).into_iter().zip(color) {
                let off = (f64::from(found) / scale - expected).abs();
                assert!(off <= 2.0, "{format} {height} {tags:?} {color:?}: {:?}", frame.pixels.at(31, 33));
            }
        }
    }
}

/// What our own encoder writes, by lossy x264 with tags, reads back as the same colour.
#[test]
fn lossy_video_keeps_colours_within_2_codes() {
    for (width, height, name) in [(64, 48, "a.mp4"), (64, 720, "a.mkv"), (33, 47, "odd.mp4")] {
        let folder = tempfile::tempdir().unwrap();
        let colors = [[255u8, 0, 0], [0, 200, 10], [20, 30, 250]];
        let pictures = colors.map(|c| Pixels::from_u8(width, height, c.repeat((width * height) as usize)).unwrap());
        write(&folder.path().join(name), &SinkOptions { lossless: false, ..options(width, height, 8) }, &pictures);
        let r = open(&describe(folder.path(), &format!("[frames]\nvideo = \"{name}\"\n")));
        assert_eq!((r.width, r.height), (width, height));
        for (frame, color) in frames(&r, 0..3).iter().zip(colors) {
            for (found, expected) in frame.pixels.at(width / 2, height / 2).into_iter().zip(color) {
                assert!(found.abs_diff(expected.into()) <= 2, "{name} {color:?}: {:?}", frame.pixels.at(9, 9));
            }
        }
    }
}

#[test]
fn lossless_video_keeps_every_code_and_ranges_are_exact() {
    for (name, bits) in [("a.mp4", 8), ("a.mkv", 8), ("a.mkv", 16)] {
        let folder = tempfile::tempdir().unwrap();
        let pictures: Vec<Pixels> = (0..20).map(|i| picture(i, 34, 22, bits)).collect();
        write(&folder.path().join(name), &options(34, 22, bits), &pictures);
        let r = open(&describe(folder.path(), &format!("[frames]\nvideo = \"{name}\"\n")));
        assert_eq!((r.frame_count(), r.bits), (20, bits), "{name}");
        assert!(r.timestamps_s.iter().enumerate().all(|(i, t)| (t - i as f64 / 30.0).abs() < 1e-12), "{name}");
        for range in [0..20, 7..13, 19..20, 5..5] {
            let got = frames(&r, range.clone());
            assert_eq!(got.len(), range.len());
            for (frame, i) in got.iter().zip(range) {
                assert!(frame.index == i && frame.pixels == pictures[i], "{name}, {bits} bits, frame {i}");
            }
        }
        // Dropped in the middle: the child is killed, and another one starts.
        let mut half = r.frames(0..20).unwrap();
        half.next().unwrap().unwrap();
        drop(half);
    }
}

/// What is lost in the middle is painted over by ffmpeg, which says so; a Matroska file's length tells a lost end.
#[test]
fn a_damaged_video_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.mkv");
    // 16 bits go out as ffv1, whose slices carry checksums.
    let pictures: Vec<Pixels> = (0..30).map(|i| picture(i, 64, 48, 16)).collect();
    write(&file, &options(64, 48, 16), &pictures);
    let whole = std::fs::read(&file).unwrap();
    let folder = describe(folder.path(), "[frames]\nvideo = \"a.mkv\"\n");
    assert_eq!(frames(&open(&folder), 0..30).len(), 30);
    assert!(!open(&folder).warnings.iter().any(|w| w.contains("a.mkv")), "{:?}", open(&folder).warnings);

    std::fs::write(&file, &whole[..whole.len() / 2]).unwrap();
    let error = refused(&folder);
    assert!(error.contains("a.mkv: ends after 0.") && error.contains("it lasts 1.000 s: is it truncated?"), "{error}");

    let mut damaged = whole.clone();
    let middle = whole.len() / 2;
    damaged[middle..middle + 3000].fill(0);
    std::fs::write(&file, damaged).unwrap();
    let error = refused(&folder);
    assert!(error.contains("a.mkv: is damaged: ffprobe says: "), "{error}");

    // A small hole, inside of a picture.
    let mut damaged = whole.clone();
    let inside = whole.len() / 2;
    damaged[inside..inside + 40].fill(0);
    std::fs::write(&file, damaged).unwrap();
    let read: Result<Vec<_>, _> = open(&folder).frames(0..30).unwrap().collect();
    let error = read.map(|frames| frames.len()).unwrap_err().to_string();
    assert!(error.contains("a.mkv: is damaged at frame ") && error.contains("ffmpeg says: "), "{error}");
}

#[test]
fn a_truncated_video_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let pictures: Vec<Pixels> = (0..20).map(|i| picture(i, 34, 22, 8)).collect();
    let file = folder.path().join("a.mp4");
    write(&file, &options(34, 22, 8), &pictures);
    let whole = std::fs::read(&file).unwrap();
    std::fs::write(&file, &whole[..whole.len() / 2]).unwrap();
    let folder = describe(folder.path(), "[frames]\nvideo = \"a.mp4\"\n");
    let error = match Recording::open(&folder, &OpenOptions::default()) {
        Err(e) => e.to_string(),
        Ok(r) => r.frames(0..r.frame_count()).unwrap().find_map(Result::err).expect("an error").to_string(),
    };
    assert!(error.contains("a.mp4"), "{error}");
    std::fs::write(&file, b"this is no video").unwrap();
    assert!(refused(&folder).contains("a.mp4"), "{}", refused(&folder));
}

#[test]
fn a_folder_of_png_keeps_every_code_and_is_not_overwritten() {
    for bits in [8, 16] {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("out");
        let pictures: Vec<Pixels> = (0..3).map(|i| picture(i, 5, 3, bits)).collect();
        write(&out, &options(5, 3, bits), &pictures);
        let mut names: Vec<_> = std::fs::read_dir(&out).unwrap().map(|e| e.unwrap().file_name()).collect();
        names.sort();
        assert_eq!(names, ["frame_000000.png", "frame_000001.png", "frame_000002.png"]);
        let r = open(&describe(folder.path(), "[frames]\nimages = \"out\"\nfps = 25.0\n"));
        assert_eq!((r.bits, r.frame_interval_s), (bits, 0.04));
        assert!(frames(&r, 0..3).iter().zip(&pictures).all(|(frame, p)| frame.pixels == *p));
        let error = sink::open(&OutPath::parse(&out).unwrap(), &options(5, 3, bits)).err().unwrap().to_string();
        assert!(error.contains("exists already") && error.contains("--force"), "{error}");
        let forced = SinkOptions { force: true, ..options(5, 3, bits) };
        write(&out, &forced, &pictures[1..2]);
        assert!(open(folder.path()).frames(0..1).unwrap().next().unwrap().unwrap().pixels == pictures[1]);
    }
}

#[test]
fn an_unfinished_video_leaves_nothing_and_a_finished_one_is_kept() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mp4");
    let count = || std::fs::read_dir(folder.path()).unwrap().count();
    let open_sink = |force| sink::open(&OutPath::Video(path.clone()), &SinkOptions { force, ..options(16, 16, 8) });
    let mut unfinished = open_sink(false).unwrap();
    unfinished.write(0, &picture(0, 16, 16, 8)).unwrap();
    assert!(!path.exists(), "looks finished but is not");
    drop(unfinished);
    assert_eq!(count(), 0);
    write(&path, &options(16, 16, 8), &[picture(0, 16, 16, 8)]);
    let kept = std::fs::read(&path).unwrap();
    assert!(open_sink(false).err().unwrap().to_string().contains("exists already"));
    let mut forced = open_sink(true).unwrap();
    forced.write(0, &picture(5, 16, 16, 8)).unwrap();
    assert!(forced.write(1, &picture(5, 16, 8, 8)).unwrap_err().to_string().contains("16x8 with 8 bits; 16x16"));
    drop(forced);
    assert_eq!(std::fs::read(&path).unwrap(), kept);
    assert_eq!(count(), 1);
}

#[test]
fn our_own_folder_with_everything() {
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
    // Reach: 0.65 of 0.1 s. Frames 0 and 1 are 0.05 s from the first depth, frame 2 0.06 s from the second.
    assert!(all.iter().zip([10.05, 10.05, 10.26]).all(|(f, t)| f.depth.as_ref().unwrap().timestamp_s == t));
    let depth = all[0].depth.as_ref().unwrap();
    assert_eq!((depth.timestamp_s, depth.depth_m[7]), (10.05, 7.0));
    assert_eq!((all[0].exposure.time_s, all[0].exposure.gain), (Some(0.02), Some(1.5)));
    assert_eq!((all[1].exposure.time_s, all[2].exposure.time_s, all[2].exposure.gain), (None, Some(0.01), None));
    let warnings = r.warnings.join("\n");
    let missing = r.missing_poses(0..3).unwrap();
    assert!(missing.contains("no pose for 1 of 3 frames (frame 2"), "{missing}");
    for said in ["1 of 3 quaternions", "no exposure within 0"] {
        assert!(warnings.contains(said), "{warnings}");
    }
    let later = Recording::open(folder.path(), &OpenOptions { time_offset_s: 0.05, ..Default::default() }).unwrap();
    assert!((later.time_offset_s + 9.85).abs() < 1e-12);
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
        // The body at (2, 2, 3) looks along the world's y; 2 m before its camera, in the middle of the picture.
        let pose = r.pose_at_frame(2).unwrap();
        let at = r.geometry.as_ref().unwrap().project(pose.transform_point(DVec3::new(2.0, 4.1, 3.0))).unwrap();
        assert!((at - DVec2::new(4.0, 3.0)).length() < 1e-5, "{at}");
        let all = frames(&r, 0..3);
        assert_eq!(all[1].pixels.at(2, 1), [42, 42, 42]);
        assert_eq!(r.files().count(), 6);
    }
    // What the truth was estimated of is the camera itself: its place is then the camera's.
    std::fs::write(truth.join("sensor.yaml"), sensor(0.1)).unwrap();
    let pose = open(folder.path()).pose_at_frame(1).unwrap();
    assert!((pose.position_in_world_m() - DVec3::new(1.0, 2.0, 3.0)).length() < 1e-9);
    std::fs::remove_file(cam.join(format!("data/{start_ns}.png"))).unwrap();
    let error = refused(folder.path());
    assert!(error.contains("data.csv, line 2: ") && error.contains("there is no such file"), "{error}");
    assert!(error.ends_with("(1 of 3 pictures is missing)"), "{error}");
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
    assert!(frames(&r, 2..3)[0].pixels == picture(2, 4, 2, 8));

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
fn an_unregistered_colmap_image_is_a_frame_without_a_pose() {
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

/// By every cut of pictures that other programs made; progressive ones may end between two scans.
#[test]
fn a_jpeg_is_whole_or_refused() {
    let folder = tempfile::tempdir().unwrap();
    let cut = folder.path().join("cut.jpg");
    for name in ["baseline-420", "grey-optimised", "restarts-422", "progressive-420"] {
        let file = PathBuf::from(format!("tests/jpeg/{name}.jpg"));
        let bytes = std::fs::read(&file).unwrap();
        let pixels = still::read_pixels(&file).unwrap();
        assert_eq!((pixels.width, pixels.height), (45, 37));
        let data = bytes.windows(2).position(|pair| pair == b"\xff\xda").unwrap() + 14;
        let passes = |length: &usize| {
            std::fs::write(&cut, [&bytes[..*length], b"\xff\xd9"].concat()).unwrap();
            let ends = still::check_end(&cut);
            assert_eq!(ends.is_ok(), still::read_pixels(&cut).is_ok());
            ends.is_ok()
        };
        let passed: Vec<usize> = (data..bytes.len() - 2).filter(passes).collect();
        let between = |at: &usize| bytes[*at] == 0xff && bytes[at + 1] != 0;
        let fits = |length: &usize| name.starts_with("progressive") && (between(length) || between(&(length - 1)));
        assert!(passed.iter().all(fits), "{name}: cut off after {passed:?} of {} bytes", bytes.len());
    }
}

/// Pictures of real cameras pass, and do not when their second half is gone.
#[test]
fn jpegs_of_real_cameras_are_whole() {
    let Some(folder) = common::data("chessboard/camera_cal") else { return };
    let temp = tempfile::tempdir().unwrap();
    let cut = temp.path().join("cut.jpg");
    let mut count = 0;
    let more = ["chessboard/test_images", "lund-door-dslr/images"].into_iter().filter_map(common::data);
    for folder in std::iter::once(folder).chain(more) {
        for file in std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
            if !file.extension().is_some_and(|e| e.eq_ignore_ascii_case("jpg")) {
                continue;
            }
            still::check_end(&file).unwrap();
            let bytes = std::fs::read(&file).unwrap();
            std::fs::write(&cut, [&bytes[..bytes.len() / 2], b"\xff\xd9"].concat()).unwrap();
            let error = still::check_end(&cut).unwrap_err().to_string();
            assert!(error.contains("cut.jpg: the JPEG is truncated after"), "{}: {error}", file.display());
            count += 1;
        }
    }
    assert!(count >= 40, "{count}");
}

#[test]
fn a_video_without_its_index_is_said_to_be_cut_off() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mp4");
    let source = ["-v", "error", "-f", "lavfi", "-i", "testsrc=duration=1:size=64x48"];
    assert!(Command::new("ffmpeg").args(source).arg(&path).status().unwrap().success());
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() / 3]).unwrap();
    let error = refused(&describe(folder.path(), "[frames]\nvideo = \"a.mp4\"\n"));
    assert!(error.contains("a.mp4: cannot be opened; is it cut off before its index"), "{error}");
}

#[test]
fn pictures_missing_from_a_folder_are_told_of() {
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
fn bad_recordings_are_one_clear_line() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    assert!(refused(&at("nowhere")).contains("there is nothing at this path"));
    assert!(refused(folder.path()).contains("accepted are a folder with recording.toml"));
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
    assert!(error.ends_with("(1 of 2 pictures is missing)"), "{error}");
    list("1 rgb/frame_000000.png\n2 rgb/not_there.png\n3 rgb/nor_this.png\n");
    assert!(refused(folder.path()).ends_with("(2 of 3 pictures are missing)"), "{}", refused(folder.path()));
    list("");
    assert!(refused(folder.path()).contains("no frames"));
    write(&at("other"), &options(5, 2, 8), &[picture(0, 5, 2, 8)]);
    list("1 rgb/frame_000000.png\n2 rgb/frame_000001.png\n3 other/frame_000000.png\n");
    let error = refused(folder.path());
    assert!(
        error.contains("rgb/frame_000000.png is 4x2") && error.contains("other/frame_000000.png is 5x2"),
        "{error}"
    );

    list("1 rgb/frame_000000.png\n2 rgb/frame_000001.png\n3 rgb/frame_000002.png\n");
    let whole = std::fs::read(at("rgb/frame_000001.png")).unwrap();
    std::fs::write(at("rgb/frame_000001.png"), &whole[..50]).unwrap();
    let r = open(folder.path());
    let got: Vec<_> = r.frames(0..3).unwrap().collect();
    assert!(got.len() == 2 && got[0].is_ok(), "after an error there is nothing more");
    let error = got[1].as_ref().unwrap_err().to_string();
    assert!(error.contains("frame_000001.png") && error.contains("truncated"), "{error}");
    assert!(r.frames(1..4).err().unwrap().to_string().contains("1..4 are asked for; the recording has 0..3"));
    let bad = OpenOptions { metres_per_unit: 0.0, ..Default::default() };
    assert!(Recording::open(folder.path(), &bad).unwrap_err().to_string().contains("metres_per_unit = 0"));
}

/// Opening a pipe waits for a writer, for ever; a device has no end.
#[cfg(unix)]
#[test]
fn a_pipe_or_a_device_in_place_of_any_file_is_refused() {
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

/// The iterator owns all it needs and may go to another thread.
#[test]
fn frames_outlive_the_recording() {
    fn needs(_: impl Iterator + Send + 'static) {}
    let folder = tempfile::tempdir().unwrap();
    three_frames(folder.path());
    let r = open(&describe(folder.path(), "[frames]\nimages = \"rgb\"\nfps = 30.0\n"));
    needs(r.frames(0..3).unwrap());
    let stream = r.frames(0..3).unwrap();
    drop(r);
    assert!(matches!(stream.last().unwrap().unwrap().pixels.codes, Codes::U8(_)));
}
