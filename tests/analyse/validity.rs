//! Estimates are valid as long as the inputs of their analysis are.

use std::fs;
use std::path::Path;

use crate::footage::{demo_by_tier, opened};
use crate::program::{locard, stdout_of};
use locard::recording::OpenOptions;
use locard::shot::{AnalysisState, Shot, ShotOptions};
use locard::simulate::Flaws;

/// Length of the model's unit, m.
const UNIT_M: f64 = 0.419817;

/// Writes the demonstration's frames as a COLMAP model, every third of them with half of the light.
fn model(to: &Path) {
    let folder = demo_by_tier(12, &Flaws::default(), 4);
    let shot = opened(&folder);
    let camera = shot.geometry_at(0).unwrap();
    let response = shot.camera().response;
    fs::create_dir(to).unwrap();
    fs::create_dir(to.join("images")).unwrap();
    let (i, d) = (&camera.intrinsics, &camera.distortion);
    let lens = [i.fx_px, i.fy_px, i.cx_px, i.cy_px, d.k1, d.k2, d.p1, d.p2].map(|number| number.to_string()).join(" ");
    fs::write(to.join("cameras.txt"), format!("1 OPENCV {} {} {lens}\n", i.width_px, i.height_px)).unwrap();
    let mut images = String::new();
    for n in 0..shot.recording.frame_count() {
        let pose = shot.recording.pose_at_frame(n).unwrap();
        let (q, t) = (pose.rotation, pose.translation_m / UNIT_M);
        images += &format!("{} {} {} {} {} {} {} {} 1 {n:02}.png\n\n", n + 1, q.w, q.x, q.y, q.z, t.x, t.y, t.z);
        let pixels = shot.read(n).unwrap().pixels;
        let gain = if n % 3 == 1 { 0.5 } else { 1.0 };
        let code = |code: u8| (255.0 * response.encode(gain * response.decode(f64::from(code) / 255.0))).round() as u8;
        let picture = image::RgbImage::from_fn(pixels.width, pixels.height, |x, y| {
            image::Rgb(pixels.eight_bits_at(x, y).map(code))
        });
        picture.save(to.join(format!("images/{n:02}.png"))).unwrap();
    }
    fs::write(to.join("images.txt"), images).unwrap();
}

fn opened_in_metres(model: &Path) -> Shot {
    let options = OpenOptions { metres_per_unit: UNIT_M, ..OpenOptions::default() };
    Shot::open(model, &options, &ShotOptions::default()).unwrap()
}

// Slow: two analyses and a composite by the program.
#[test]
fn analysis_of_a_model_is_valid_for_any_unit_length() {
    let temp = tempfile::tempdir().unwrap();
    let site = temp.path().join("door");
    model(&site);
    let path = site.to_str().unwrap();
    let unit = UNIT_M.to_string();
    let stdout = stdout_of(&["analyse", path]);
    assert!(stdout.contains("stops from the darkest to the brightest"), "{stdout}");
    // Analysed without the unit's length, and used with it.
    let shot = opened_in_metres(&site);
    assert!(matches!(shot.analysis, AnalysisState::Used(..)), "{:?}", shot.analysis);
    assert!(shot.stale_estimates().is_empty(), "{:?}", shot.stale_estimates());
    assert_eq!(shot.relative_ev().len(), 12);
    let frame = temp.path().join("out");
    let composite = ["composite", path, "--metres-per-unit", &unit, "--scene", "scenes/demo.toml", "--frames", "2..3"];
    let done = locard(&[&composite[..], &["--plain", "-o", frame.to_str().unwrap()]].concat());
    let warned = String::from_utf8_lossy(&done.stderr);
    assert!(done.status.success() && !warned.contains("is not used") && !warned.contains("left out"), "{warned}");
    // Analysed with it.
    let unit_of_analysis = || opened_in_metres(&site).analysis;
    let made_with = |state: AnalysisState| match state {
        AnalysisState::Used(_, findings) => findings.made_with.metres_per_unit,
        state => panic!("{state:?}"),
    };
    stdout_of(&["analyse", path, "--metres-per-unit", &unit]);
    assert_eq!(made_with(unit_of_analysis()), 1.0, "exists and is up to date");
    stdout_of(&["analyse", path, "--metres-per-unit", &unit, "--force"]);
    assert_eq!(made_with(unit_of_analysis()), UNIT_M);
    assert!(opened_in_metres(&site).stale_estimates().is_empty());
    // A scene may set the unit, and the window analyses with it.
    let scene = temp.path().join("scene.toml");
    fs::write(&scene, format!("version = 1\nmetres_per_unit = {UNIT_M}\n")).unwrap();
    let options = ShotOptions { scene: Some(scene), ..ShotOptions::default() };
    let by_scene = Shot::open(&site, &OpenOptions::default(), &options).unwrap();
    assert_eq!([&by_scene, &by_scene.as_recorded()].map(|shot| shot.recording.metres_per_unit), [UNIT_M; 2]);
    assert!(by_scene.stale_estimates().is_empty(), "{:?}", by_scene.stale_estimates());
    // Another pose makes another recording.
    let images = fs::read_to_string(site.join("images.txt")).unwrap();
    let (first, rest) = images.split_once('\n').unwrap();
    let mut words: Vec<String> = first.split(' ').map(str::to_owned).collect();
    words[5] = (words[5].parse::<f64>().unwrap() + 1e-4).to_string();
    fs::write(site.join("images.txt"), format!("{}\n{rest}", words.join(" "))).unwrap();
    let AnalysisState::Unfit(_, why) = opened_in_metres(&site).analysis else { panic!("it is used") };
    assert!(why.contains("the recording has changed since it was made"), "{why}");
}
