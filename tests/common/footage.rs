//! Recordings with simulated flaws, their analysis, and its error against the ground truth.

#![allow(dead_code, reason = "each test file uses some of it")]

use std::path::{Path, PathBuf};

use crate::reduced::Reduction;
use crate::tier::is_full;
use glam::DVec2;
use locard::analyse::{Analysis, CaptureInfo, Checkpoints, analyse};
use locard::camera::Geometry;
use locard::frame::Frame;
use locard::recording::write::{Line, trajectory};
use locard::recording::{OpenOptions, Recording};
use locard::shot::{Shot, ShotOptions};
use locard::simulate::Flaws;
use locard::tracking::PoseTrack;
use locard::tracking::tum::read_trajectory;

pub fn demo_path() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("recordings/demo")
}

/// Ground-truth track of the demonstration.
pub fn demo_track() -> PoseTrack {
    Recording::open(&demo_path(), &OpenOptions::default()).unwrap().track
}

/// Writes the demonstration's first frames to `site` in a temporary folder, with the poses that a
/// tracker with these flaws would have recorded.
pub fn demo(frames: usize, flaws: &Flaws) -> tempfile::TempDir {
    demo_from(&demo_path(), frames, flaws)
}

/// [`demo`] with pictures and camera read from another folder.
fn demo_from(from: &Path, frames: usize, flaws: &Flaws) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
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
    Shot::open(&folder.path().join("site"), &OpenOptions::default(), &ShotOptions::default()).unwrap()
}

/// Opens the recording `site` in a folder, with one parameter set.
pub fn opened_with(folder: &tempfile::TempDir, set: &str) -> Shot {
    let options = ShotOptions { sets: vec![set.to_owned()], ..ShotOptions::default() };
    Shot::open(&folder.path().join("site"), &OpenOptions::default(), &options).unwrap()
}

/// The true poses of the recording `site` in a folder.
pub fn true_track(folder: &tempfile::TempDir) -> PoseTrack {
    read_trajectory(&folder.path().join("site/truth/poses.txt"), None).unwrap()
}

pub fn analysed(shot: &Shot, threads: usize) -> Analysis {
    with_capture_info(shot, |camera, capture| {
        analyse(&shot.recording, camera, capture, threads, &mut Checkpoints::none(), &mut |_| Ok(())).unwrap().0
    })
}

/// Calls `of` with the geometry, response, noise and exposure of a shot's camera.
fn with_capture_info<T>(shot: &Shot, of: impl FnOnce(&Geometry, &CaptureInfo<'_>) -> T) -> T {
    let camera = shot.geometry_at(0).unwrap();
    let rig = shot.camera();
    let exposure_s = |frame: &Frame| shot.exposure_time(frame).s;
    of(&camera, &CaptureInfo { response: &rig.response, noise: rig.noise.as_ref(), exposure_s: &exposure_s })
}

/// Reprojects a point of one frame into another frame by a track, with a pose per row (rolling
/// shutter). Returns `None` outside of the picture.
fn reproject(camera: &Geometry, track: &PoseTrack, from: (f64, DVec2, f64), to_s: f64) -> Option<DVec2> {
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

/// Reprojection errors of a track against the ground truth, px, from each frame to the one `gap`
/// later: for each pair with at least 100 common points, all errors in ascending order. Depth is
/// the first frame's own, at its time.
pub fn pair_errors_px(shot: &Shot, truth: &PoseTrack, track: &PoseTrack, gap: usize) -> Vec<Vec<f64>> {
    let (camera, times_s) = (shot.geometry_at(0).unwrap(), &shot.recording.timestamps_s);
    let width = camera.intrinsics.width_px as usize;
    let step = width as f64 / 32.0;
    let of_pair = |n: usize| {
        let depth = shot.read(n).unwrap().depth.unwrap();
        let place = |i: u32| DVec2::new(f64::from(i % 32), f64::from(i / 32)) * step + 0.5 * step + 0.5;
        let off = |at: DVec2| {
            let z = f64::from(depth.depth_m[at.y as usize * width + at.x as usize]);
            let by = |track: &PoseTrack| reproject(&camera, track, (times_s[n], at, z), times_s[n + gap]);
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

/// Median and 90th percentile of the errors of all pairs.
pub fn median_and_p90(pairs: &[Vec<f64>]) -> (f64, f64) {
    let mut all: Vec<f64> = pairs.iter().flatten().copied().collect();
    all.sort_by(f64::total_cmp);
    (all[all.len() / 2], all[all.len() * 9 / 10])
}

/// Compares the pairs' medians. Returns the share of pairs that got worse by more than 0.1 px, and
/// the largest increase, px.
pub fn regressions(recorded: &[Vec<f64>], refined: &[Vec<f64>]) -> (f64, f64) {
    assert_eq!(recorded.len(), refined.len());
    let by = |(was, is): (&Vec<f64>, &Vec<f64>)| is[is.len() / 2] - was[was.len() / 2];
    let worse_px: Vec<f64> = recorded.iter().zip(refined).map(by).collect();
    let count = worse_px.iter().filter(|by| **by > 0.1).count();
    (count as f64 / worse_px.len() as f64, worse_px.into_iter().fold(f64::NEG_INFINITY, f64::max))
}

/// Number of frames of the reduced copy of the demonstration.
const REDUCED_FRAMES: usize = 40;

/// [`demo_reduced`] in the fast tier, [`demo`] in the full tier or if `reduction` is 1.
pub fn demo_by_tier(frames: usize, flaws: &Flaws, reduction: u32) -> tempfile::TempDir {
    if is_full() || reduction == 1 { demo(frames, flaws) } else { demo_reduced(frames, flaws, reduction) }
}

/// [`demo`] with the pictures' width and height divided by `reduction`.
pub fn demo_reduced(frames: usize, flaws: &Flaws, reduction: u32) -> tempfile::TempDir {
    demo_from(&Reduction { max_frames: REDUCED_FRAMES, ..Reduction::by(reduction) }.demo(), frames, flaws)
}

/// Refusal that a test's checkpoint stores in place of the room's light and of examples of noise.
const NOT_NEEDED: &str = "the test does not need it";
/// Upper bound of the number of stages of an analysis.
const STAGES: usize = 32;

/// [`analysed`]; in the fast tier without the search for the room's light, which takes 10 s at any
/// picture size, and without examples of noise, which take some seconds.
pub fn analysed_by_tier(shot: &Shot, threads: usize) -> Analysis {
    if is_full() {
        return analysed(shot, threads);
    }
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("site.analysis");
    let analysis = with_capture_info(shot, |camera, capture| {
        let mut checkpoints = checkpoints_of_refusals(&path, shot, camera, capture);
        analyse(&shot.recording, camera, capture, threads, &mut checkpoints, &mut |_| Ok(())).unwrap().0
    });
    let light = analysis.findings.light.as_ref().and_then(|light| light.why.as_deref());
    let refusals = [NOT_NEEDED, "the camera's poses are unknown", "no depth was measured"];
    assert!(light.is_some_and(|why| refusals.contains(&why)), "{light:?}");
    analysis
}

/// Makes the next analysis of a shot, written to `folder`, leave out the room's light and examples
/// of noise.
pub fn leave_out_light(shot: &Shot, folder: &Path) {
    with_capture_info(shot, |camera, capture| drop(checkpoints_of_refusals(folder, shot, camera, capture)));
}

/// [`leave_out_light`] in the fast tier.
pub fn leave_out_light_by_tier(shot: &Shot, folder: &Path) {
    if !is_full() {
        leave_out_light(shot, folder);
    }
}

/// A checkpoint in which stages that may be refused are. A stage reads only values of its own type,
/// so all others ignore the stored refusal.
fn checkpoints_of_refusals(folder: &Path, shot: &Shot, camera: &Geometry, capture: &CaptureInfo<'_>) -> Checkpoints {
    let mut checkpoints = Checkpoints::of(folder, &shot.recording, camera, capture);
    for _ in 0..STAGES {
        let refused: Result<Result<(), String>, ()> = checkpoints.stage(|| Ok(Err(NOT_NEEDED.to_owned())));
        refused.unwrap().unwrap_err();
    }
    Checkpoints::of(folder, &shot.recording, camera, capture)
}
