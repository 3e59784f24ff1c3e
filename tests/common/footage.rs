//! Recordings with flaws, what is found of them, and how far that is from what is true.

#![allow(dead_code, reason = "each test file uses some of it")]

use std::path::{Path, PathBuf};

use glam::DVec2;
use locard::analyse::{Analysis, Part, Taken, analyse};
use locard::camera::Geometry;
use locard::compositor::exposure_time_s;
use locard::frame::Frame;
use locard::recording::write::{Line, trajectory};
use locard::recording::{OpenOptions, Recording};
use locard::shot::{Given, Shot};
use locard::simulate::Flaws;
use locard::tracking::PoseTrack;

pub fn demo_path() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("recordings/demo")
}

/// The demo's true way.
pub fn demo_track() -> PoseTrack {
    Recording::open(&demo_path(), &OpenOptions::default()).unwrap().track
}

/// The demo's first frames as `site` in a folder of their own, with the poses that a tracker with flaws would have written.
pub fn demo(frames: usize, flaws: &Flaws) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let from = demo_path();
    let site = folder.path().join("site");
    for sub in ["rgb", "depth"] {
        std::fs::create_dir_all(site.join(sub)).unwrap();
    }
    for file in ["recording.toml", "camera.toml", "exposure.txt"] {
        std::fs::copy(from.join(file), site.join(file)).unwrap();
    }
    for list in ["rgb.txt", "depth.txt"] {
        let text = std::fs::read_to_string(from.join(list)).unwrap();
        let lines: Vec<&str> = text.lines().take(1 + frames).collect();
        for line in &lines[1..] {
            let picture = line.split(' ').nth(1).unwrap();
            std::fs::copy(from.join(picture), site.join(picture)).unwrap();
        }
        std::fs::write(site.join(list), lines.join("\n") + "\n").unwrap();
    }
    let recorded = flaws.recorded(&demo_track()).unwrap();
    let lines: Vec<Line> = recorded.poses().iter().map(|(time_s, pose)| Line::new(*time_s, pose)).collect();
    std::fs::write(site.join("groundtruth.txt"), trajectory(&lines)).unwrap();
    folder
}

pub fn opened(folder: &tempfile::TempDir) -> Shot {
    Shot::open(&folder.path().join("site"), &OpenOptions::default(), &Given::default()).unwrap()
}

/// The recording `site` in a folder, with one parameter set.
pub fn opened_with(folder: &tempfile::TempDir, set: &str) -> Shot {
    let given = Given { sets: vec![set.to_owned()], ..Given::default() };
    Shot::open(&folder.path().join("site"), &OpenOptions::default(), &given).unwrap()
}

pub fn analysed(shot: &Shot, threads: usize) -> Analysis {
    let camera = shot.geometry_at(0).unwrap();
    let rig = shot.camera();
    let exposure_s = |frame: &Frame| exposure_time_s(&rig, &shot.settings, frame, shot.interval_s(frame.index));
    let taken = Taken { response: &rig.response, noise: rig.noise.as_ref(), exposure_s: &exposure_s };
    analyse(&shot.recording, &camera, &taken, threads, &mut Part::none(), &mut |_, _| Ok(())).unwrap().0
}

/// Where a point of one frame lands in another, by a track: each row by its own pose.
fn carried(camera: &Geometry, track: &PoseTrack, from: (f64, DVec2, f64), to_s: f64) -> Option<DVec2> {
    let (from_s, at, depth_m) = from;
    let here = track.at(from_s + camera.row_time_s(at.y)).ok()?;
    let world = here.inverse_transform_point(camera.unproject(at)? * depth_m);
    let [width, height] = [camera.intrinsics.width_px, camera.intrinsics.height_px].map(f64::from);
    let mut there = DVec2::new(0.0, 0.5 * height);
    for _ in 0..6 {
        there = camera.project(track.at(to_s + camera.row_time_s(there.y)).ok()?.transform_point(world))?;
    }
    let inside = there.x > 0.0 && there.y > 0.0 && there.x < width && there.y < height;
    inside.then_some(there)
}

/// How far a track moves things from one frame to the one `gap` later than they do in truth, px: for each pair of frames that
/// shows some of the same, all of them, ascending. Depth is the frame's own, at the frame's time.
pub fn pairs_off_px(shot: &Shot, truth: &PoseTrack, track: &PoseTrack, gap: usize) -> Vec<Vec<f64>> {
    let (camera, times_s) = (shot.geometry_at(0).unwrap(), &shot.recording.timestamps_s);
    let width = camera.intrinsics.width_px as usize;
    let step = width as f64 / 32.0;
    let of_pair = |n: usize| {
        let depth = shot.read(n).unwrap().depth.unwrap();
        let place = |i: u32| DVec2::new(f64::from(i % 32), f64::from(i / 32)) * step + 0.5 * step + 0.5;
        let off = |at: DVec2| {
            let z = f64::from(depth.depth_m[at.y as usize * width + at.x as usize]);
            let by = |track: &PoseTrack| carried(&camera, track, (times_s[n], at, z), times_s[n + gap]);
            if z > 0.2 { Some((by(track)? - by(truth)?).length()) } else { None }
        };
        let mut off: Vec<f64> = (0..24 * 32).map(place).filter_map(off).collect();
        off.sort_by(f64::total_cmp);
        off
    };
    let pairs: Vec<Vec<f64>> = (0..times_s.len() - gap).map(of_pair).filter(|off| off.len() >= 100).collect();
    assert!(pairs.len() * 2 > times_s.len() - gap, "{} pairs", pairs.len());
    pairs
}

/// Median and 90 % of all pairs together.
pub fn whole(pairs: &[Vec<f64>]) -> (f64, f64) {
    let mut all: Vec<f64> = pairs.iter().flatten().copied().collect();
    all.sort_by(f64::total_cmp);
    (all[all.len() / 2], all[all.len() * 9 / 10])
}

/// Of pairs by their medians: the share that got worse by more than 0.1 px, and by how much the one that lost most did.
pub fn worse(recorded: &[Vec<f64>], refined: &[Vec<f64>]) -> (f64, f64) {
    assert_eq!(recorded.len(), refined.len());
    let by = |(was, is): (&Vec<f64>, &Vec<f64>)| is[is.len() / 2] - was[was.len() / 2];
    let lost: Vec<f64> = recorded.iter().zip(refined).map(by).collect();
    let count = lost.iter().filter(|by| **by > 0.1).count();
    (count as f64 / lost.len() as f64, lost.into_iter().fold(f64::NEG_INFINITY, f64::max))
}
