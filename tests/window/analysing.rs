//! Analysis from the window.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

use crate::fixture;
use crate::footage;
use crate::gpu;
use crate::harness::{codes, has_label, run_until, settle, shown_codes, wait_for_label, window};
use crate::program;
use crate::tier::fast_or_full;
use eframe::egui::vec2;
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use locard::compositor::Target;
use locard::params::Value;
use locard::recording::OpenOptions;
use locard::shot::{AnalysisState, Shot, ShotOptions};
use locard::simulate::{self, Flaws, Options};
use locard::window::{App, DEMO_SCENE, JobState, Project};

/// Number of frames, and the shown frame.
fn frames() -> usize {
    fast_or_full(12, 20)
}

fn frame() -> usize {
    fast_or_full(5, 9)
}

/// The demonstration's site in small pictures, by a tracker with drift and a camera with changing
/// exposure.
fn site() -> (tempfile::TempDir, PathBuf) {
    let (width_px, height_px) = fast_or_full((160, 120), (320, 240));
    let options = Options {
        width_px,
        height_px,
        focal_px: 0.8125 * f64::from(width_px),
        samples: 4,
        frames: frames() as u32,
        fps: 15.0,
        ..Options::default()
    };
    let flaws =
        Flaws { jitter_mm: 2.0, jitter_deg: 0.2, exposure_walk_ev: 0.3, exposure_step_ev: 1.0, ..Flaws::default() };
    let made = fixture::once("window-analysing", &[], (width_px, frames()), |folder| {
        simulate::run(&folder.join("site"), &options, &flaws, false, &mut |_, _| ControlFlow::Continue(())).unwrap();
    });
    let folder = tempfile::tempdir().unwrap();
    let site = folder.path().join("site");
    program::copied(&made.join("site"), &site);
    (folder, site)
}

fn given() -> ShotOptions {
    let no_shadows = ["shadow.cast=false", "shadow.on_evidence=false"].map(str::to_owned).to_vec();
    ShotOptions { scene: Some(DEMO_SCENE.into()), sets: fast_or_full(no_shadows, vec![]), ..ShotOptions::default() }
}

fn open(site: &Path) -> Harness<'static, App> {
    let project = Project::open(site, &OpenOptions::default(), &given()).unwrap();
    window(project, vec2(1400.0, 1200.0))
}

fn all_over(app: &App) -> bool {
    app.documents().jobs().is_some_and(|jobs| !jobs.is_busy() && jobs.entries.iter().all(|entry| entry.state.is_over()))
}

fn press(window: &mut Harness<'_, App>, label: &str) {
    window.get_by_label(label).click();
    window.run_steps(3);
}

/// The frame as composited by the program.
fn composited(site: &Path, noise: f64) -> Vec<[u8; 3]> {
    let mut options = given();
    options.sets.push(format!("noise.scale={noise}"));
    let shot = Shot::open(site, &OpenOptions::default(), &options).unwrap();
    let mut compositor = shot.compositor(gpu::gpu().clone());
    let pending = shot.picture(&mut compositor, frame(), Target::Pixels).unwrap();
    codes(&compositor.collect(pending).unwrap().pixels)
}

#[test]
fn analysis_from_the_window_is_adopted_at_the_current_frame() {
    let (_folder, site) = site();
    let analysis = site.with_file_name("site.analysis");
    // An incomplete analysis is not used, and a new one is offered.
    std::fs::create_dir(&analysis).unwrap();
    std::fs::write(analysis.join("analysis.toml"), "version = 4\n").unwrap();
    let mut window = open(&site);
    assert!(has_label(&window, "The analysis of this footage is not used"));
    window.state_mut().player_mut().seek(frame());
    let project = window.state_mut().project_mut();
    project.set("noise", "scale", &Value::Number(0.5)).unwrap();
    project.close_step();
    settle(&mut window);
    let before = shown_codes(&window);
    assert!(before == composited(&site, 0.5));

    footage::leave_out_light_by_tier(window.state().project().shot(), &analysis);
    press(&mut window, "Analyse");
    wait_for_label(&mut window, "Analysing the footage");
    run_until(&mut window, all_over);
    settle(&mut window);
    let app = window.state();
    let entries = &app.documents().jobs().unwrap().entries;
    assert!(
        matches!(&entries[0].state, JobState::Done(output) if output.contains("camera path residual ")),
        "{entries:?}"
    );
    assert!(!has_label(&window, "Analyse") && !has_label(&window, "The analysis of this footage is not used"));
    let AnalysisState::Used(at, findings) = &app.project().shot().analysis else { panic!("it is not used") };
    assert!(at.canonicalize().unwrap() == analysis.canonicalize().unwrap() && findings.registration.is_refined());
    assert!(app.message().unwrap().starts_with("Analysis finished: camera path residual "), "{:?}", app.message());
    press(&mut window, "Details");
    assert_eq!(window.query_all_by_label_contains("poses: refined").count(), 1);
    press(&mut window, "Close");
    let app = window.state();

    // The frame, the settings and the history are kept; the picture matches the program's.
    assert_eq!((app.player().frame(), app.project().value("noise", "scale")), (frame(), Some(Value::Number(0.5))));
    let after = shown_codes(&window);
    assert!(after != before && after == composited(&site, 0.5));
    let project = window.state_mut().project_mut();
    assert!(!project.is_saved());
    project.undo();
    assert!(project.is_saved() && !project.history().can_undo(), "what was found is no step of the past");
    settle(&mut window);
    assert!(shown_codes(&window) == composited(&site, 1.0));

    // Estimates of the analysis are valid for this recording alone: no profile takes them.
    let project = window.state_mut().project_mut();
    assert!(!project.shot().estimates().is_empty());
    let profile = site.with_file_name("mine.toml");
    project.save_profile(&profile).unwrap();
    let text = std::fs::read_to_string(&profile).unwrap();
    assert!(!text.contains("readout_time_s") && !text.contains("point_spread"), "{text}");

    // Estimated brightness of the frames.
    let seen_ev = window.state().project().shot().relative_ev();
    assert_eq!(seen_ev.len(), frames());
    press(&mut window, "Match");
    press(&mut window, "Brightness over time");
    window.run_steps(20);
    let [r, g, b] = seen_ev[frame()].map(|ev| format!("{ev:.2}"));
    let brightness = format!("this frame: red {r}, green {g}, blue {b} stops over the recording's median");
    assert!(has_label(&window, &brightness), "{brightness}");
}

#[test]
fn cancelled_analysis_changes_nothing() {
    let (_folder, site) = site();
    let mut window = open(&site);
    assert!(has_label(&window, "This footage is not analysed"));
    press(&mut window, "Analyse");
    wait_for_label(&mut window, "Cancel the analysis");
    press(&mut window, "Cancel the analysis");
    run_until(&mut window, all_over);
    let app = window.state();
    assert_eq!(app.documents().jobs().unwrap().entries[0].state, JobState::Cancelled);
    assert_eq!(app.project().shot().analysis, AnalysisState::Absent);
    assert!(!site.with_file_name("site.analysis").exists());
    window.run_steps(3);
    assert!(has_label(&window, "Analyse"), "it is offered again");
}
