//! Evidence behind real surfaces measured by a depth sensor: the distance between the composited
//! and the true occlusion edge, by exact depth and by a Kinect's.

use std::fs;
use std::path::{Path, PathBuf};

use crate::models::Model;
use crate::tier::fast_or_full;
use crate::{gpu, shot};
use glam::{DVec2, DVec3};
use locard::pixels::LayerImage;
use locard::simulate::{DepthSensorModel, Detail, Flaws, Options, Simulation};

/// Frames of the demonstration in which the stool, the bucket and the ball are in front of the
/// evidence. The evaluated frames' depth is fused with that of their neighbours.
fn range() -> std::ops::Range<usize> {
    fast_or_full(53..56, 46..63)
}

fn evaluated_frames() -> &'static [usize] {
    fast_or_full(&[54], &[50, 54, 58])
}

/// Depth does not depend on the resolution of the site's light.
const CRUDE: Detail = Detail { texture_m: 0.05, light_m: 0.4 };
/// Depth codes per metre, as in a Kinect's recordings.
const CODES_PER_METRE: f64 = 5000.0;

/// The evidence: upright triangles that face the camera, right angle at the lower left, twice as
/// wide as high. Position of the corner and height, m.
const CARDS: [(DVec3, f64); 2] = [(DVec3::new(-0.3, 0.05, 0.0), 0.9), (DVec3::new(-0.1, 0.95, 0.0), 0.8)];

/// Real surfaces nearer to the evidence than this have no edge that a sensor could resolve, m.
const MIN_SEPARATION_M: f64 = 0.05;
/// Step and half length of the profile across an edge, px.
const STEP_PX: f64 = 0.25;
const REACH_PX: f64 = 12.0;

fn simulation() -> Simulation {
    let flaws = Flaws { depth_sensor: Some(DepthSensorModel::Kinect), ..Flaws::default() };
    Simulation::with_flaws_and_detail(&Options::default(), &flaws, CRUDE, 2).unwrap()
}

/// The demonstration's frames with measured depth.
fn recording(folder: &Path, name: &str, simulation: &Simulation, depths: &[Vec<f32>]) -> PathBuf {
    let from = Path::new("recordings/demo");
    let out = folder.join(name);
    for sub in ["rgb", "depth"] {
        fs::create_dir_all(out.join(sub)).unwrap();
    }
    for file in ["camera.toml", "exposure.txt", "groundtruth.txt"] {
        fs::copy(from.join(file), out.join(file)).unwrap();
    }
    let text = fs::read_to_string(from.join("recording.toml")).unwrap();
    fs::write(out.join("recording.toml"), text.replace("scale = 250.0", "scale = 5000.0")).unwrap();
    for list in ["rgb.txt", "depth.txt"] {
        let text = fs::read_to_string(from.join(list)).unwrap();
        let kept: Vec<&str> =
            text.lines().enumerate().filter(|(n, _)| *n == 0 || range().contains(&(n - 1))).map(|l| l.1).collect();
        fs::write(out.join(list), kept.join("\n") + "\n").unwrap();
    }
    let Options { width_px, height_px, .. } = *simulation.options();
    for (frame, measured) in range().zip(depths) {
        let rgb = format!("rgb/{frame:05}.jpg");
        fs::copy(from.join(&rgb), out.join(&rgb)).unwrap();
        let codes = measured.iter().map(|m| (CODES_PER_METRE * f64::from(*m)).round() as u16).collect();
        let map = image::ImageBuffer::<image::Luma<u16>, Vec<u16>>::from_raw(width_px, height_px, codes).unwrap();
        map.save(out.join(format!("depth/{frame:05}.png"))).unwrap();
    }
    out
}

/// Writes the cards and their scene file, and returns the scene's path.
fn scene(folder: &Path) -> PathBuf {
    fs::write(folder.join("card.glb"), Model::triangle().glb()).unwrap();
    let object = |(at, high): &(DVec3, f64)| {
        let [x, y, z] = at.to_array();
        format!("[[objects]]\nmodel = \"card.glb\"\nposition_m = [{x:?}, {y:?}, {z:?}]\nscale = {high:?}\n")
    };
    let text = CARDS.iter().map(object).fold("version = 1\nup = \"z\"\n".to_owned(), |text, object| text + &object);
    let file = folder.join("scene.toml");
    fs::write(&file, text).unwrap();
    file
}

/// Distance along the depth ray of a picture position to the nearest card, m.
fn card_m(simulation: &Simulation, frame: usize, at: DVec2) -> Option<f64> {
    let time_s = simulation.timestamp_s(frame) + simulation.geometry().row_time_s(at.y.floor() + 0.5);
    let pose = simulation.track().at(time_s).unwrap();
    let (from, way) =
        (pose.position_in_world_m(), pose.world_from_camera_rotation() * simulation.geometry().depth_ray(at)?);
    let meets = |(corner, high): &(DVec3, f64)| {
        let t = (corner.y - from.y) / way.y;
        let on = (from + way * t - corner) / *high;
        (t > 0.0 && on.x >= 0.0 && on.z >= 0.0 && on.x / 2.0 + on.z <= 1.0).then_some(t)
    };
    CARDS.iter().filter_map(meets).min_by(f64::total_cmp)
}

/// The true visible share of evidence in each pixel, supersampled within two pixels of an edge.
struct Truth {
    width: usize,
    visible_share: Vec<f64>,
    /// True if the pixel has evidence, and the real surface is clearly in front of it or behind it.
    is_clear: Vec<bool>,
}

impl Truth {
    fn new(simulation: &Simulation, frame: usize) -> Self {
        let Options { width_px, height_px, .. } = *simulation.options();
        let (width, height) = (width_px as usize, height_px as usize);
        // Distance from the evidence to the real surface behind it.
        let behind_m = |at: DVec2| Some(simulation.depth_at(frame, at)? - card_m(simulation, frame, at)?);
        let middle = |i: usize| DVec2::new((i % width) as f64 + 0.5, (i / width) as f64 + 0.5);
        let apart: Vec<Option<f64>> = (0..width * height).map(|i| behind_m(middle(i))).collect();
        let is_clear: Vec<bool> = apart.iter().map(|m| m.is_some_and(|m| m.abs() > MIN_SEPARATION_M)).collect();
        let is_seen = |m: Option<f64>| f64::from(u8::from(m.is_some_and(|m| m > 0.0)));
        let share = |i: usize| {
            let (x, y) = (i % width, i / width);
            let around = (y.saturating_sub(2)..(y + 3).min(height))
                .flat_map(|y| (x.saturating_sub(2)..(x + 3).min(width)).map(move |x| y * width + x));
            let here = is_seen(apart[i]);
            if around.into_iter().all(|other| is_seen(apart[other]) == here) {
                return here;
            }
            let part = |n: i32| middle(i) + DVec2::new(f64::from(n % 4) - 1.5, f64::from(n / 4) - 1.5) / 4.0;
            (0..16).map(|n| is_seen(behind_m(part(n)))).sum::<f64>() / 16.0
        };
        Self { width, visible_share: (0..width * height).map(share).collect(), is_clear }
    }

    /// Positions of the evidence's edge between two pixels, each with the edge's normal.
    fn edges(&self) -> Vec<(DVec2, DVec2)> {
        let (width, height) = (self.width, self.visible_share.len() / self.width);
        let reach = REACH_PX as usize + 2;
        let mut edges = Vec::new();
        for y in reach..height - reach {
            for x in reach..width - reach {
                let i = y * width + x;
                let around = (0..25).map(|n| i + (n / 5) * width + n % 5 - 2 * width - 2);
                if !around.clone().all(|i| self.is_clear[i]) {
                    continue;
                }
                for next in [1, width] {
                    let (a, b) = (self.visible_share[i] - 0.5, self.visible_share[i + next] - 0.5);
                    if a * b >= 0.0 {
                        continue;
                    }
                    let along = if next == 1 { DVec2::X } else { DVec2::Y };
                    let at = DVec2::new(x as f64 + 0.5, y as f64 + 0.5) + along * (a / (a - b));
                    let steep: DVec2 = around
                        .clone()
                        .enumerate()
                        .map(|(n, i)| DVec2::new((n % 5) as f64 - 2.0, (n / 5) as f64 - 2.0) * self.visible_share[i])
                        .sum();
                    // Counts each edge once: along the axis closer to its normal.
                    let across = steep.normalize_or_zero();
                    if across.dot(along).abs() > 0.72 {
                        edges.push((at, across));
                    }
                }
            }
        }
        edges
    }
}

/// Position of the 50 % crossing nearest to the edge, along its normal, px.
fn half_crossing_px(values: &[f64], width: usize, at: DVec2, across: DVec2) -> Option<f64> {
    let count = (2.0 * REACH_PX / STEP_PX) as usize + 1;
    let place = |n: usize| n as f64 * STEP_PX - REACH_PX;
    let value = |n: usize| {
        let p = at + place(n) * across - 0.5;
        let (corner, f) = (p.floor(), p - p.floor());
        let of = |dx: usize, dy: usize| values[(corner.y as usize + dy) * width + corner.x as usize + dx];
        let row = |dy: usize| (1.0 - f.x) * of(0, dy) + f.x * of(1, dy);
        (1.0 - f.y) * row(0) + f.y * row(1) - 0.5
    };
    let profile: Vec<f64> = (0..count).map(value).collect();
    let crossing = |n: usize| {
        let (a, b) = (profile[n], profile[n + 1]);
        // As for the truth: evidence is on the positive side of the normal.
        (a <= 0.0 && b > 0.0).then(|| place(n) + STEP_PX * a / (a - b))
    };
    (0..count - 1).filter_map(crossing).min_by(|a, b| a.abs().total_cmp(&b.abs()))
}

/// The visible share of each pixel's evidence: occluded over unoccluded coverage.
fn visible_share(hidden: &LayerImage, whole: &LayerImage) -> Vec<f64> {
    let share = |(on, off): (&[f32; 4], &[f32; 4])| if off[3] > 0.5 { f64::from(on[3] / off[3]) } else { 0.0 };
    hidden.rgba.iter().zip(&whole.rgba).map(share).collect()
}

/// Writes the composited share in red and the true one in green into the folder LOCARD_PICTURES, if
/// set.
fn show(name: &str, coverage: &[f64], truth: &[f64], width: usize) {
    let Ok(folder) = std::env::var("LOCARD_PICTURES") else { return };
    let bytes = coverage
        .iter()
        .zip(truth)
        .flat_map(|(coverage, truth)| [*coverage, *truth, 0.0].map(|v| (255.0 * v) as u8))
        .collect();
    let height = (coverage.len() / width) as u32;
    image::RgbImage::from_raw(width as u32, height, bytes).unwrap().save(format!("{folder}/{name}.png")).unwrap();
}

/// Errors of all edge positions in the evaluated frames, px, ascending. An edge without a crossing
/// counts as the reach.
fn edge_errors_px(recording: &Path, scene: &Path, truths: &[Truth]) -> Vec<f64> {
    let name = recording.file_name().unwrap().to_str().unwrap();
    let layers = |occlusion: bool, frame: usize| {
        let mut shot = shot::open(recording, None, scene);
        shot.settings.plain();
        shot.settings.depth.occlusion = occlusion;
        let at = frame - range().start;
        shot::composited(&gpu::gpu(), &shot, at..at + 1).pop().unwrap().layer.unwrap()
    };
    let mut off = Vec::new();
    for (frame, truth) in evaluated_frames().iter().copied().zip(truths) {
        let share = visible_share(&layers(true, frame), &layers(false, frame));
        show(&format!("{name}-{frame}"), &share, &truth.visible_share, truth.width);
        for (at, across) in truth.edges() {
            let Some(is) = half_crossing_px(&truth.visible_share, truth.width, at, across) else { continue };
            off.push(half_crossing_px(&share, truth.width, at, across).map_or(REACH_PX, |share| (share - is).abs()));
        }
    }
    off.sort_by(f64::total_cmp);
    off
}

// Slow: traces rays for each frame of a simulated depth sensor, and for the exact coverage.
#[test]
fn occlusion_edges_of_sensed_depth_match_the_true_ones() {
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(folder.path());
    let simulation = simulation();
    let truths: Vec<_> = evaluated_frames().iter().map(|frame| Truth::new(&simulation, *frame)).collect();
    let (kinect, exact): (Vec<_>, Vec<_>) =
        range().map(|frame| simulation.depths(frame).unwrap()).map(|[measured, exact]| (measured, exact)).unzip();
    let mut figures = Vec::new();
    for (name, depths) in [("exact", exact), ("kinect", kinect)] {
        let off = edge_errors_px(&recording(folder.path(), name, &simulation, &depths), &scene, &truths);
        let of = |share: f64| off[(share * (off.len() - 1) as f64) as usize];
        println!(
            "{name}: {} places, median {:.2} px, 90 % within {:.2} px, 95 % within {:.2} px",
            off.len(),
            of(0.5),
            of(0.9),
            of(0.95)
        );
        assert!(off.len() > 500 * truths.len() / 3);
        figures.push([of(0.5), of(0.9)]);
    }
    let [[exact, exact_max], [kinect, kinect_max]] = figures[..] else { panic!() };
    assert!(exact < 0.5 && exact_max < 1.5, "exact depth: {exact} {exact_max}");
    assert!(kinect < 1.0 && kinect_max < 2.5, "a Kinect's: {kinect} {kinect_max}");
}
