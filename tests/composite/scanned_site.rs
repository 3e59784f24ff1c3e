//! A scan of the site in place of a depth sensor.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::DVec3;

use crate::flip::{PIXELS_PER_DEGREE, mean_flip};
use crate::reduced::Reduction;
use crate::scan::{copy_without_depth, hidden_markers, world_from_scan, write_scan};
use crate::tier::{fast_or_full, is_full};
use crate::{gpu, program, shot};
use locard::compositor::Composited;
use locard::params::Value;
use locard::pose::Pose;
use locard::shot::Shot;
use locard::site::{ScannedSite, SiteScan};

/// The demonstration, at half the size in the fast tier.
fn demo_recording() -> PathBuf {
    if is_full() { "recordings/demo".into() } else { Reduction::by(2).demo() }
}

/// The demonstration with markers.
fn demo(folder: &Path) -> Shot {
    let mut shot = shot::open(&demo_recording(), None, &hidden_markers(folder));
    // Shadows take most of the time.
    let cast = Value::Bool(is_full());
    shot.settings = gpu::settings(&[("noise", "scale", Value::Number(0.0)), ("shadow", "cast", cast)]);
    shot
}

#[test]
fn scan_hides_and_is_shadowed_as_measured_depth_is() {
    let folder = tempfile::tempdir().unwrap();
    let measured = demo(folder.path());
    let file = folder.path().join("site.ply");
    write_scan(&measured, &file, 3);
    let mut without = demo(folder.path());
    without.recording = Arc::new(without.recording.without_depth());
    let mut scanned = demo(folder.path());
    let scan = Arc::new(SiteScan::read(&file, None).unwrap());
    let mut recording = scanned.recording.without_depth();
    recording.set_site(Some(ScannedSite::new(scan, world_from_scan())));
    recording.set_cameras(|own| scanned.rig.geometry_over(own));
    scanned.recording = Arc::new(recording);
    let frame = 20;
    let composites =
        [&measured, &scanned, &without].map(|shot| shot::composited(&gpu::gpu(), shot, frame..frame + 1).remove(0));
    let [a, b, none] = &composites;
    // Evidence and shadows without occlusion, and therefore with it.
    let layer = none.layer.as_ref().unwrap();
    let mask: Vec<bool> = layer.rgba.iter().zip(&layer.left).map(|(p, left)| p[3] > 0.0 || left[0] < 0.995).collect();
    assert!(mask.iter().filter(|is_virtual| **is_virtual).count() > fast_or_full(3000, 12_000));
    let flip = |other: &Composited, mask| mean_flip(&a.pixels, &other.pixels, mask, PIXELS_PER_DEGREE);
    let [whole, evidence] = [None, Some(&mask[..])].map(|mask| flip(b, mask));
    let [whole_without, evidence_without] = [None, Some(&mask[..])].map(|mask| flip(none, mask));
    println!("mean FLIP {whole:.4}, of evidence and shadows {evidence:.4}");
    println!("without depth {whole_without:.4}, of evidence and shadows {evidence_without:.4}");
    assert!(whole < 0.01, "{whole}");
    // Edges differ by a pixel or less; without depth all hidden evidence differs.
    assert!(evidence < 0.15 * evidence_without, "{evidence}, {evidence_without} without depth");
    assert!(whole_without > 0.03, "{whole_without}");
}

/// The numbers after the first word of the line with this beginning.
fn numbers(text: &str, beginning: &str) -> Vec<f64> {
    let line = text.lines().find(|line| line.starts_with(beginning)).unwrap_or_else(|| panic!("{text}"));
    line.split_whitespace().skip(1).map_while(|word| word.parse().ok()).collect()
}

/// The demonstration without its depth in `folder`, and a scene with a scan of its site.
fn scanned_demo(folder: &Path) -> (String, String) {
    let path = |name: &str| folder.join(name).to_str().unwrap().to_owned();
    let with_depth = demo_recording();
    write_scan(&shot::open(&with_depth, None, &hidden_markers(folder)), Path::new(&path("site.ply")), 3);
    let recording = path("recording");
    copy_without_depth(&with_depth, Path::new(&recording));
    let Pose { rotation: q, translation_m: at } = world_from_scan();
    let site = format!(
        "version = 1\nup = \"z\"\n[site]\nscan = \"site.ply\"\nposition_m = [{}, {}, {}]\nquaternion = [{}, {}, {}, {}]\n",
        at.x, at.y, at.z, q.x, q.y, q.z, q.w
    );
    let scene = path("site.toml");
    std::fs::write(&scene, site).unwrap();
    (recording, scene)
}

#[test]
fn picked_points_on_a_scan_match_those_of_measured_depth() {
    let folder = tempfile::tempdir().unwrap();
    let (recording, scene) = scanned_demo(folder.path());
    let points = fast_or_full(["160,200", "100,150"], ["320,400", "200,300"]);
    let picks = ["--frame", "20", "--pick", points[0], "--pick", points[1], "--no-analysis"];
    let picked =
        |recording: &str, more: &[&str]| program::stdout_of(&[&["inspect", recording], &picks[..], more].concat());
    let measured = picked(demo_recording().to_str().unwrap(), &[]);
    let scanned = picked(&recording, &["--scene", &scene]);
    for point in ["world 1", "world 2"] {
        let [a, b] = [&measured, &scanned].map(|text| DVec3::from_slice(&numbers(text, point)[1..]));
        assert!(a.distance(b) < 0.01, "{point}: {a} by depth, {b} by the scan");
    }
    let error = program::refused(&[&["inspect", recording.as_str()], &picks[..]].concat());
    assert!(error.contains("has no depth"), "{error}");
    let error = program::refused(&["verify", &recording, "--no-analysis", "-q"]);
    assert!(error.contains("a scan of the place serves as well: --scene"), "{error}");
}

#[test]
#[ignore = "full tier: two verifications of the demonstration; picks on a scan are compared in the fast tier"]
fn registration_by_a_scan_is_that_of_measured_depth() {
    let folder = tempfile::tempdir().unwrap();
    let (recording, scene) = scanned_demo(folder.path());
    let registration_px = |recording: &str, more: &[&str]| {
        let quick = ["--every", "30", "--gap", "8", "--no-analysis", "-q"];
        let output = program::locard(&[&["verify", recording], &quick[..], more].concat());
        let text = String::from_utf8(output.stdout).unwrap();
        let line = text.lines().find(|line| line.starts_with("registration")).unwrap_or_else(|| panic!("{text}"));
        line.split_whitespace().find_map(|word| word.parse::<f64>().ok()).unwrap()
    };
    let measured_px = registration_px(demo_recording().to_str().unwrap(), &[]);
    let scanned_px = registration_px(&recording, &["--scene", &scene]);
    assert!((measured_px - scanned_px).abs() < 0.1, "{measured_px} px by depth, {scanned_px} px by the scan");
}
