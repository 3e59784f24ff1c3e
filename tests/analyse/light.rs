//! The light of a room estimated from its recording, compared with the truth, and its use by
//! scenes.

use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;

use crate::fixture;
use crate::footage::{analysed, demo_by_tier, opened};
use crate::program::{copied, locard, refused, stdout_of};
use crate::tier::{fast_or_full, is_full};
use glam::DVec3;
use locard::analyse::{Analysis, LightFindings};
use locard::recording::OpenOptions;
use locard::scene::{self, Environment, LightingOrigin};
use locard::shot::{AnalysisChoice, AnalysisState, Shot, ShotOptions};
use locard::simulate::{Detail, Flaws, Options, Simulation, run};

fn options(lamps: u32, site: u32) -> Options {
    Options {
        width_px: 320,
        height_px: 240,
        focal_px: 260.0,
        frames: 16,
        fps: 7.0,
        samples: 8,
        lamps: Some(lamps),
        site: Some(site),
        seed: site.into(),
        ..Options::default()
    }
}

fn mean(of: [f64; 3]) -> f64 {
    of.iter().sum::<f64>() / 3.0
}

/// All of 20 sites, with the table of docs/light.md: `scripts/light_of_sites.py`.
#[test]
#[ignore = "full tier: two sites; a_person_corrects_the_light_... checks the demonstration"]
fn light_of_simulated_sites_is_found_with_lamps_out_of_view() {
    // The limits of docs/light.md are of all 20 sites in full size; these are small and noisy, and
    // two lamps may be merged into one.
    for (lamps, site, max_deg, within) in [(1, 10, 6.0, 0.25), (2, 2, 20.0, 0.3)] {
        let options = options(lamps, site);
        let folder = tempfile::tempdir().unwrap();
        let on = &mut |_, _| ControlFlow::Continue(());
        run(&folder.path().join("site"), &options, &Flaws::default(), false, on).unwrap();
        let analysis = analysed(&opened(&folder), 2);
        let light = analysis.findings.light.as_ref().unwrap();
        let simulation = Simulation::new(&options).unwrap();
        println!("site {site}: {}", analysis.findings);
        check_light(light, &simulation, max_deg, within);
    }
}

/// Asserts the light on a surface facing up, and the direction of the lamp that is brightest there,
/// against the truth.
fn check_light(light: &LightFindings, simulation: &Simulation, max_deg: f64, within: f64) {
    let place = DVec3::from(light.place_m.unwrap());
    let (white, truth) = (mean(light.white_level.unwrap()), true_white(simulation, place));
    let lamps = simulation.lamps();
    let irradiance = |lamp: &(DVec3, DVec3)| lamp_contribution(lamp, place);
    let brightest = lamps.iter().max_by(|a, b| irradiance(a).total_cmp(&irradiance(b))).unwrap().0;
    let off = |at: [f64; 3]| (DVec3::from(at) - place).angle_between(brightest - place).to_degrees();
    let off_deg = light.lamps.iter().map(|lamp| off(lamp.at_m)).fold(f64::INFINITY, f64::min);
    println!("white {white:.2} of {truth:.2}, lamp {off_deg:.1}° off");
    assert!((white / truth - 1.0).abs() < within, "{white} of {truth}");
    let [low, high] = light.between.unwrap();
    assert!(low * white < truth && truth < high * white, "{truth} not within {low} to {high} times {white}");
    assert!(off_deg < max_deg, "{off_deg}");
    // The panorama's centre is above most of the observed points.
    assert!(light.coverage.unwrap() > 0.3 && light.coverage_above.unwrap() > 0.0, "{light:?}");
}

/// Contribution of an unoccluded lamp to the light on white facing up.
fn lamp_contribution((at, shown_at_1_m): &(DVec3, DVec3), place: DVec3) -> f64 {
    let to = *at - place;
    mean(shown_at_1_m.to_array()) * to.z.max(0.0) / to.length().powi(3)
}

/// True light on white facing up at a point of a site, outside of shadows: the site's middle is not
/// in a shadow.
fn true_white(simulation: &Simulation, place: DVec3) -> f64 {
    let middle = DVec3::new(0.0, 0.0, 0.1);
    let farther = |lamp: &(DVec3, DVec3)| lamp_contribution(lamp, place) - lamp_contribution(lamp, middle);
    mean(simulation.white_facing_up(middle).to_array()) + simulation.lamps().iter().map(farther).sum::<f64>()
}

#[test]
fn scene_without_light_uses_the_estimated_one_and_keeps_its_own_otherwise() {
    let (folder, analysis) = analysed_demo();
    let site = folder.path().join("site");
    let analysis_folder = folder.path().join("site.analysis");
    let light = analysis.findings.light.as_ref().unwrap();
    let examples = analysis.findings.example_noise.as_ref().unwrap();
    assert!(examples.sha256.is_some() && examples.frames >= 6, "{examples:?}");
    // The lamp, and a virtual lamp for the indirect light around it.
    assert_eq!(light.lamps.iter().map(|lamp| lamp.is_bounce()).collect::<Vec<_>>(), [false, true], "{light:?}");
    assert_eq!(light.lamps[0].at_m, light.lamps[1].at_m);

    let model = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/marker-1.glb");
    let written = |name: &str, light: &str| {
        let path = folder.path().join(name);
        let text = format!("version = 1\nup = \"z\"\n\n# the tent\n[[objects]]\nmodel = {model:?}\n{light}");
        std::fs::write(&path, text).unwrap();
        path
    };
    let (bare, own) = (written("bare.toml", ""), written("own.toml", "\n[light]\nambient = 0.25\n"));
    let lit = |scene: &Path, analysis: AnalysisChoice| {
        let options = ShotOptions { scene: Some(scene.to_owned()), analysis, ..ShotOptions::default() };
        Shot::open(&site, &OpenOptions::default(), &options).unwrap()
    };
    let taken = lit(&bare, AnalysisChoice::Beside);
    let lighting = &taken.scene.lighting;
    assert!(lighting.suns.is_empty() && lighting.points.len() == 2, "{lighting:?}");
    assert_eq!(lighting.points[0].position_in_world_m, DVec3::from(light.lamps[0].at_m));
    assert!(matches!(&lighting.environment, Environment::Map(map) if (map.width, map.height) == (256, 128)));
    // Without an analysis the scene is lit by a guess; a scene with its own light keeps it.
    let guessed = lit(&bare, AnalysisChoice::No);
    assert_eq!((guessed.scene.lighting_origin, guessed.scene.lighting.points.len()), (LightingOrigin::Default, 0));
    assert_eq!(lit(&own, AnalysisChoice::Beside).scene.lighting, lit(&own, AnalysisChoice::No).scene.lighting);
    // The same during a session, and for the next scene.
    let mut worked = lit(&bare, AnalysisChoice::No);
    worked.apply_analysis(analysis_folder.clone(), analysis).unwrap();
    assert_eq!(worked.scene.lighting, *lighting);
    worked.set_scene(Arc::new(scene::load(&own, None).unwrap()));
    assert_eq!(worked.scene.lighting.points.len(), 0);
    worked.set_scene(Arc::new(scene::load(&bare, None).unwrap()));
    assert_eq!(worked.scene.lighting, *lighting);

    // Written into the scene for editing: the same light.
    let [site, bare, own] = [&site, &bare, &own].map(|path| path.to_str().unwrap());
    assert!(refused(&["light", site, "--scene", own]).contains("--force"));
    let stdout = stdout_of(&["light", site, "--scene", bare]);
    assert!(stdout.contains("lamp ") && stdout.contains("upward-facing"), "{stdout}");
    let text = std::fs::read_to_string(bare).unwrap();
    assert!(text.contains("# the tent") && text.contains("[[light.lamp]]"), "{text}");
    let edited = lit(Path::new(bare), AnalysisChoice::No);
    assert_eq!(edited.scene.lighting_origin, LightingOrigin::Scene);
    let close = edited.scene.lighting.points[0].color - lighting.points[0].color;
    assert!(close.abs().max_element() < 1e-6);
    let (Environment::Map(a), Environment::Map(b)) = (&edited.scene.lighting.environment, &lighting.environment) else {
        panic!("two panoramas")
    };
    assert!(a.rgb == b.rgb && a.map_from_world.abs_diff_eq(b.map_from_world, 1e-6));
    // The panorama exists already.
    assert!(refused(&["light", site, "--scene", bare]).contains("bare-light.hdr"));
    let new = folder.path().join("light.toml");
    stdout_of(&["light", site, "-o", new.to_str().unwrap()]);
    assert!(refused(&["light", site, "-o", new.to_str().unwrap()]).contains("light"));
    std::fs::remove_dir_all(&analysis_folder).unwrap();
    assert!(refused(&["light", site, "-o", "other.toml"]).contains("locard analyse"));
}

// Slow: analyses the demonstration's frames and searches for lamps.
#[test]
fn light_estimated_with_another_up_is_ignored_and_the_rest_is_used() {
    let (folder, analysis) = analysed_demo();
    let site = folder.path().join("site");
    let open = || Shot::open(&site, &OpenOptions::default(), &ShotOptions::default()).unwrap();
    assert!(open().stale_estimates().is_empty());
    let description = site.join("recording.toml");
    let text = std::fs::read_to_string(&description).unwrap();
    assert!(text.contains("up = [0.0, 0.0, 1.0]"), "{text}");
    std::fs::write(&description, text.replace("up = [0.0, 0.0, 1.0]", "up = [0.0, 0.6, 0.8]")).unwrap();
    let shot = open();
    let AnalysisState::Used(_, used) = &shot.analysis else { panic!("{:?}", shot.analysis) };
    let notes: Vec<String> = shot.stale_estimates().iter().map(ToString::to_string).collect();
    assert!(notes.len() == 1 && notes[0].contains("light left out, found with another up"), "{notes:?}");
    assert!(notes[0].contains("analyse the recording again"), "{notes:?}");
    let findings = analysis.findings;
    assert_eq!((&used.gain, &used.spread, &used.shutter), (&findings.gain, &findings.spread, &findings.shutter));
    assert!(used.light.as_ref().unwrap().panorama.is_none());
    assert_eq!(shot.scene.lighting.points.len(), 0);
    let scene = folder.path().join("light.toml");
    let error = refused(&["light", site.to_str().unwrap(), "-o", scene.to_str().unwrap()]);
    assert!(error.contains("light left out") && !scene.exists(), "{error}");
}

/// Divisor of the width and height of the demonstration's pictures in the fast tier.
const REDUCTION: u32 = 2;

/// Position in the pictures of [`analysed_demo`] of a position in the demonstration's, px.
fn demo_px(x: u32, y: u32) -> String {
    let divisor = fast_or_full(REDUCTION, 1);
    format!("{},{}", x / divisor, y / divisor)
}

/// The demo's first frames with their analysis beside them.
pub fn analysed_demo() -> (tempfile::TempDir, Analysis) {
    let folder = demo_by_tier(13, &Flaws::default(), REDUCTION);
    let made = fixture::once("demo-analysed", &["recordings/demo"], is_full(), |to| {
        let shot = opened(&folder);
        let analysis = analysed(&shot, 2);
        analysis.write(&to.join("site.analysis"), &shot.recording).unwrap();
        assert!(Analysis::read(&to.join("site.analysis")).unwrap() == analysis);
    });
    let analysis = folder.path().join("site.analysis");
    // The one whole analysis of the fast tier: others leave out light and examples.
    copied(&made.join("site.analysis"), &analysis);
    (folder, Analysis::read(&analysis).unwrap())
}

// Slow: the search for lamps takes 10 s, and a correction is a run of the program.
#[test]
fn light_is_corrected_by_white_paper() {
    let (folder, analysis) = analysed_demo();
    assert_white_paper_correction(&folder, &analysis);
}

#[test]
#[ignore = "full tier: ten runs of the program; light_is_corrected_by_white_paper is its small form"]
fn light_is_corrected_by_lamp_or_panorama_and_supports_are_reported() {
    let (folder, analysis) = analysed_demo();
    assert_lamp_and_panorama_corrections(&folder, &analysis);
    assert_supports(&folder);
}

fn assert_supports(folder: &tempfile::TempDir) {
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let site = at("site");
    // The demo's objects, the first of them 30 mm over the floor.
    let own = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes");
    let demo = std::fs::read_to_string(own.join("demo.toml")).unwrap();
    let models = demo.replace("model = \"", &format!("model = \"{}/", own.display()));
    let light = models.find("# The light that").unwrap();
    let hovering = models[..light].replacen("[0.0, 0.12, 0.0]", "[0.0, 0.12, 0.03]", 1);
    std::fs::write(at("scene.toml"), hovering).unwrap();
    let (scene, written) = (at("scene.toml"), folder.path().join("site.analysis/supports.toml"));
    let output = locard(&["analyse", &site, "--scene", &scene]);
    let (stdout, warned) = (String::from_utf8(output.stdout).unwrap(), String::from_utf8(output.stderr).unwrap());
    // The first object's hover distance is reported once.
    assert!(output.status.success() && !warned.contains("hovers"), "{warned}");
    let stands: Vec<&str> = stdout.lines().filter_map(|line| line.strip_prefix("stands     ")).collect();
    assert_eq!(stands.len(), 7, "{stdout}");
    let text = std::fs::read_to_string(&written).unwrap();
    let table: toml::Table = text.parse().unwrap();
    let number = |of: &toml::Value, key: &str| of[key].as_float().unwrap();
    for (n, object) in table["object"].as_array().unwrap().iter().enumerate() {
        let height_m = if n == 0 { 0.03 } else { 0.0 };
        assert_eq!(object["known_by"].as_str(), Some("depth"), "{text}");
        // An object within 15 mm of a plane is put on it exactly.
        assert!((number(object, "height_m") - height_m).abs() < 1e-3, "{text}");
        assert!(number(object, "tilt_deg") < 0.5, "{text}");
    }
    assert!(stands[0].contains("marker 1: ") && stands[0].contains(" mm over a plane"), "{stdout}");
    assert!(stands[1..].iter().all(|line| line.contains(": on a plane that depth shows")), "{stdout}");
    // Identical when repeated, byte for byte, and on the page.
    let page = at("page.html");
    stdout_of(&["analyse", &site, "--scene", &scene, "--report", &page]);
    assert_eq!(std::fs::read_to_string(&written).unwrap(), text);
    assert!(std::fs::read_to_string(&page).unwrap().contains(stands[0]));
    // A missing scene is refused, and the existing files stay.
    assert!(refused(&["analyse", &site, "--scene", &at("none.toml")]).contains("none.toml"));
    assert_eq!(std::fs::read_to_string(&written).unwrap(), text);
    // The next analysis removes it.
    let shot = opened(folder);
    Analysis::read(&folder.path().join("site.analysis"))
        .unwrap()
        .write(written.parent().unwrap(), &shot.recording)
        .unwrap();
    assert!(!written.exists());
}

fn assert_white_paper_correction(folder: &tempfile::TempDir, analysis: &Analysis) {
    let light = analysis.findings.light.as_ref().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (site, new) = (at("site"), at("light.toml"));
    let written = || scene::document::read(Path::new(&new)).unwrap().value().light.clone();
    let light_command = |more: &[&str]| stdout_of(&[&["light", &site, "-o", &new, "--force"], more].concat());
    let denied = |more: &[&str]| refused(&[&["light", &site, "-o", &new, "--force"], more].concat());

    // The paper on the floor, beside its title.
    let stdout = light_command(&["--white", &format!("6:{}", demo_px(267, 139))]);
    // Lamps, and the light on white in the middle of the site, are the same in any detail.
    let crude = Detail { texture_m: 0.05, light_m: 0.15 };
    let (table, simulation) = (written(), Simulation::with_detail(&Options::default(), crude, 2).unwrap());
    let factor = table.environment_intensity.unwrap();
    assert!(table.lamp.iter().all(|lamp| lamp.intensity == Some(factor)), "{table:?}");
    // With half of the reflectance the light doubles; with almost none the correction is refused.
    if is_full() {
        light_command(&["--white", "6:267,139=0.4"]);
        let doubled = written().environment_intensity.unwrap();
        assert!((doubled / factor - 2.0).abs() < 1e-3, "{doubled} {factor}");
        let black = denied(&["--white", "6:267,139=0.02"]);
        assert!(black.contains("expected 0.125 to 8"), "{black}");
    }
    // The tolerances of a site with one lamp.
    check_light(light, &simulation, 6.0, 0.25);
    let place = DVec3::from(light.place_m.unwrap());
    let (white, truth) = (mean(light.white_level.unwrap()), true_white(&simulation, place));
    println!("white {white} times {factor} of {truth}\n{stdout}");
    // With the paper the error is at most a twentieth, and no larger than before.
    let off = |white: f64| (white / truth).ln().abs();
    let (analysis, corrected) = (off(white), off(factor * white));
    assert!(corrected < 0.05 && corrected <= analysis, "{white} times {factor} of {truth}");
    assert!(stdout.contains("factor ") && stdout.contains("between"), "{stdout}");
    // Invalid points change nothing: an edge, a missing frame, a position outside.
    std::fs::remove_file(&new).unwrap();
    let edge = format!("6:{}", demo_px(281, 150));
    let invalid = [(edge.as_str(), "edge"), ("6:455,240", "black"), ("99:3,4", "frame"), ("6:900,3", "outside")];
    for (place, message) in &invalid[..fast_or_full(1, 4)] {
        let stdout = denied(&["--white", place]);
        assert!(stdout.contains(message) && stdout.contains(place), "{stdout}");
    }
    assert!(!Path::new(&new).exists());
}

fn assert_lamp_and_panorama_corrections(folder: &tempfile::TempDir, analysis: &Analysis) {
    let light = analysis.findings.light.as_ref().unwrap();
    let at = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (site, new) = (at("site"), at("light.toml"));
    let written = || scene::document::read(Path::new(&new)).unwrap().value().light.clone();
    let with = |more: &[&str]| [&["light", &site, "-o", &new, "--force"], more].concat().join("\n");
    let light_command = |more: &[&str]| stdout_of(&with(more).split('\n').collect::<Vec<_>>());
    let denied = |more: &[&str]| refused(&with(more).split('\n').collect::<Vec<_>>());

    // By its distance along the ray. The real lamp stays; this one is not real, and dim beside it.
    let stdout = light_command(&["--lamp", "6:320,10,1.5"]);
    let lamps = written().lamp;
    let place = opened(folder).posed_camera(6).unwrap().ray(glam::DVec2::new(320.0, 10.0)).unwrap().at(1.5);
    assert!(DVec3::from(lamps[0].at_m).distance(place) < 1e-3, "{lamps:?} {place}\n{stdout}");
    let color = |lamp: &scene::document::LampTable| glam::Vec3::from(lamp.color.unwrap()).element_sum();
    let real = DVec3::from(light.lamps[0].at_m);
    let [bulbs, bounced]: [Vec<&scene::document::LampTable>; 2] = [false, true]
        .map(|is_wide| lamps.iter().filter(|lamp| (lamp.diameter_or_default_m() > 1.0) == is_wide).collect());
    assert!(bulbs.len() == 2 && DVec3::from(bulbs[1].at_m).distance(real) < 1e-3, "{lamps:?}");
    assert!(bounced.len() == 1 && DVec3::from(bounced[0].at_m).distance(real) < 1e-3, "{lamps:?}");
    assert!(color(bulbs[1]) > 3.0 * color(bulbs[0]), "{lamps:?}");
    // By depth, and by two frames; nonsense is refused.
    light_command(&["--lamp", "6:240,58"]);
    let by_depth = DVec3::from(written().lamp[0].at_m);
    assert!((by_depth.y - 0.99).abs() < 0.03 && (by_depth.z - 0.3).abs() < 0.1, "the socket: {by_depth}");
    let four = ["--lamp", "6:1,1,1", "--lamp", "6:1,1,1", "--lamp", "6:1,1,1", "--lamp", "6:1,1,1"];
    assert!(denied(&four).contains("up to 3"));
    assert!(denied(&["--lamp", "6:1,1+6:2,2"]).contains("different frames"));

    // A user's panorama replaces the estimated one and its lamps, at the same brightness.
    let sky = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/demo-light.hdr");
    let stdout = light_command(&["--environment", sky.to_str().unwrap(), "--turn", "30"]);
    let table = written();
    assert!(stdout.contains("panorama") && stdout.contains("as bright as") && !stdout.contains("lamp "), "{stdout}");
    assert!(table.environment.as_ref().is_some_and(|name| name.ends_with("demo-light.hdr")), "{table:?}");
    assert_eq!((table.environment_rotation_deg, table.lamp.len()), (Some(30.0), 0));
    // White paper sets the intensity by the same key.
    let intensity = table.environment_intensity.unwrap();
    let stdout = light_command(&["--environment", sky.to_str().unwrap(), "--turn", "30", "--white", "6:267,139"]);
    let tint = glam::Vec3::from(written().environment_color.unwrap());
    assert!(
        (tint.to_array().into_iter().product::<f32>() - 1.0).abs() < 1e-3 && tint != glam::Vec3::ONE,
        "{tint} {stdout}"
    );
    let factor = written().environment_intensity.unwrap() / intensity;
    assert!((0.4..2.5).contains(&factor) && factor != 1.0, "{factor}");
    assert!(denied(&["--environment", &at("none.hdr")]).contains("none.hdr"));
}
