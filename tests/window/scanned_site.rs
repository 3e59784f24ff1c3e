//! Alignment of a scan of the place in the window, by clicks in the picture and in the scan.

use std::path::{Path, PathBuf};

use crate::harness::{
    answer, click_at, demo, demo_frame, has_label, press, run_until, settle, shown_codes, steps, wait_for,
    wait_for_label, window,
};
use crate::scan::{copy_without_depth, hidden_markers, world_from_scan, write_scan};
use eframe::egui::{self, Key, Modifiers, accesskit::Role};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use glam::{DVec2, DVec3};
use locard::recording::OpenOptions;
use locard::scene::SiteTable;
use locard::shot::{Shot, ShotOptions};
use locard::window::{App, Project};

/// Frames with pairs.
fn frames() -> [usize; 2] {
    [demo_frame(12), demo_frame(48)]
}

/// The demonstration with its depth, which is the truth.
fn measured() -> Shot {
    Shot::open(&demo(), &OpenOptions::default(), &ShotOptions::default()).unwrap()
}

/// The demonstration without its depth in a folder that also has a scan.
fn open(folder: &Path) -> Harness<'static, App> {
    write_scan(&measured(), &folder.join("room.ply"), 8);
    copy_without_depth(&demo(), &folder.join("recording"));
    let scene = hidden_markers(folder);
    // Shadows take most of the time.
    let text = std::fs::read_to_string(&scene).unwrap() + "[settings.shadow]\ncast = false\n";
    std::fs::write(&scene, text).unwrap();
    let options = ShotOptions { scene: Some(scene), ..ShotOptions::default() };
    let project = Project::open(&folder.join("recording"), &OpenOptions::default(), &options).unwrap();
    window(project, egui::vec2(1400.0, 900.0))
}

/// Opens the panel with the scan of a folder.
fn open_scan(window: &mut Harness<'_, App>, scan: PathBuf) {
    press(window, "File");
    press(window, "Scan of the place…");
    answer(window, &scan, "Open");
    wait_for_label(window, "Align");
    show_scan(window);
}

/// Waits until the scan is shown at rest.
fn show_scan(window: &mut Harness<'_, App>) {
    wait_for(window, "the view of the scan", |window| window.state().is_scan_settled(window.ctx.input(|i| i.time)));
}

/// Points that a frame and the view of the scan show, spread over the frame: px, and coordinates in
/// the scan.
fn visible_points(window: &Harness<'_, App>, truth: &Shot, frame: usize) -> Vec<(DVec2, DVec3)> {
    let decoded = truth.read(frame).unwrap();
    let grid = [24.0, 56.0, 96.0, 136.0].into_iter().flat_map(|x| [30.0, 60.0, 84.0, 104.0].map(|y| DVec2::new(x, y)));
    let scale = f64::from(truth.recording.width) / 160.0;
    grid.filter_map(|at| {
        let at_px = scale * at;
        let world = truth.surface_at(&decoded, at_px).ok()?.plane.point_m;
        let point_m = world_from_scan().inverse_transform_point(world);
        window.state().scan_on_screen(point_m)?;
        Some((at_px, point_m))
    })
    .collect()
}

/// Clicks a point in the picture and a point of the scan.
fn pick(window: &mut Harness<'_, App>, at_px: DVec2, point_m: DVec3) {
    let at = window.state().on_screen(egui::vec2(at_px.x as f32, at_px.y as f32)).unwrap();
    click_at(window, at);
    let at = window.state().scan_on_screen(point_m).unwrap();
    click_at(window, at);
}

/// Picks pairs in two frames. Returns the points of the scan.
fn pick_pairs(window: &mut Harness<'_, App>) -> Vec<DVec3> {
    let truth = measured();
    let mut picked = Vec::new();
    for frame in frames() {
        window.state_mut().player_mut().seek(frame);
        settle(window);
        let points = visible_points(window, &truth, frame);
        assert!(points.len() > 5, "frame {frame} and the view share {}", points.len());
        let stride = points.len().div_ceil(4);
        for (at_px, point_m) in points.into_iter().step_by(stride) {
            pick(window, at_px, point_m);
            picked.push(point_m);
        }
    }
    picked
}

fn site(window: &Harness<'_, App>) -> Option<SiteTable> {
    window.state().project().edit().scene.site.clone()
}

fn align(window: &mut Harness<'_, App>) {
    press(window, "Align");
    wait_for(window, "the end of the alignment", |window| !has_label(window, "Cancel"));
    window.run_steps(2);
}

// Slow: eight pairs are clicked in two frames, and six views of the picture are composited.
#[test]
fn clicked_pairs_place_the_scan_in_one_undo_step() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = open(folder.path());
    open_scan(&mut window, folder.path().join("room.ply"));
    let points = pick_pairs(&mut window);
    // The frame shows the markers behind real things.
    window.state_mut().player_mut().seek(demo_frame(20));
    settle(&mut window);
    let codes_before = shown_codes(&window);
    let before = steps(&window);
    press(&mut window, "Refine by the pictures");
    align(&mut window);
    assert_eq!(steps(&window), [before.clone(), vec!["scan: aligned".to_owned()]].concat());
    let table = site(&window).unwrap();
    let placed = table.world_from_scan().unwrap();
    for point_m in &points {
        let error_m = placed.transform_point(*point_m).distance(world_from_scan().transform_point(*point_m));
        assert!(error_m < 0.03, "{point_m} is off by {error_m} m");
    }
    let message = window.state().message().unwrap_or_default().to_owned();
    assert!(message.starts_with("Scan aligned within "), "{message}");
    // Evidence behind real things is hidden now.
    settle(&mut window);
    assert!(window.state().project().shot().recording.site().is_some());
    let aligned = shown_codes(&window);
    assert_ne!(aligned, codes_before);
    window.key_press_modifiers(Modifiers::COMMAND, Key::Z);
    window.run_steps(2);
    settle(&mut window);
    assert_eq!((site(&window), shown_codes(&window) == codes_before), (None, true));
    window.key_press_modifiers(Modifiers::COMMAND | Modifiers::SHIFT, Key::Z);
    window.run_steps(2);
    settle(&mut window);
    assert_eq!((site(&window), shown_codes(&window) == aligned), (Some(table.clone()), true));
    // It can be removed, which is a step, too.
    press(&mut window, "Remove the scan");
    assert_eq!((site(&window), steps(&window).last().unwrap().as_str()), (None, "scan: removed"));
    window.state_mut().project_mut().undo();
    // A scene in another folder names the same scan.
    let other = folder.path().join("other");
    std::fs::create_dir(&other).unwrap();
    window.state_mut().project_mut().save_scene(&other.join("case.toml")).unwrap();
    assert_eq!(site(&window).unwrap().scan, "../room.ply");
    let saved = Shot::open(
        &folder.path().join("recording"),
        &OpenOptions::default(),
        &ShotOptions { scene: Some(other.join("case.toml")), ..ShotOptions::default() },
    );
    assert!(saved.unwrap().recording.site().is_some());
}

// Slow: nine pairs are clicked in two frames.
#[test]
fn contradictory_pair_is_named_and_can_be_removed() {
    let folder = tempfile::tempdir().unwrap();
    let mut window = open(folder.path());
    open_scan(&mut window, folder.path().join("room.ply"));
    let pair = |n: usize| format!("Remove pair {n}");
    let points = pick_pairs(&mut window);
    // The first point of the scan at the last position of the frame.
    let frame = frames()[1];
    let truth = measured();
    let (at_px, _) = *visible_points(&window, &truth, frame).last().unwrap();
    pick(&mut window, at_px, points[0]);
    let wrong = points.len() + 1;
    assert!(has_label(&window, &pair(wrong)) && !has_label(&window, &pair(wrong + 1)));
    press(&mut window, "Refine by the pictures");
    align(&mut window);
    let problem = window.state().problem().unwrap_or_default().to_owned();
    assert!(problem.contains("the pairs contradict each other"), "{problem}");
    assert!(problem.ends_with(&format!("without pair {wrong} the others agree: check it")), "{problem}");
    assert!(has_label(&window, &problem) && site(&window).is_none());
    window.get_by_label(&pair(wrong)).scroll_to_me();
    window.run_steps(3);
    press(&mut window, &pair(wrong));
    assert!(!has_label(&window, &pair(wrong)));
    align(&mut window);
    assert!(site(&window).is_some());
}

#[test]
fn scan_of_a_scene_is_opened_with_the_panel_and_few_pairs_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    write_scan(&measured(), &folder.path().join("room.ply"), 40);
    let scene = folder.path().join("case.toml");
    std::fs::write(&scene, "version = 1\n[site]\nscan = \"room.ply\"\nposition_m = [1.0, 2.0, 3.0]\n").unwrap();
    let options = ShotOptions { scene: Some(scene), ..ShotOptions::default() };
    let mut window =
        window(Project::open(&demo(), &OpenOptions::default(), &options).unwrap(), egui::vec2(1400.0, 900.0));
    press(&mut window, "File");
    press(&mut window, "Scan of the place…");
    show_scan(&mut window);
    // The middle of the view shows the scan. The order of the clicks does not matter.
    let view = window.get_by_role_and_label(Role::Image, "scan").rect();
    let picture = window.state().on_screen(egui::vec2(40.0, 40.0)).unwrap();
    click_at(&mut window, view.center());
    assert!(has_label(&window, "Now click the same point in the picture, in any frame."));
    click_at(&mut window, picture);
    assert!(has_label(&window, "Remove pair 1"));
    align(&mut window);
    let problem = window.state().problem().unwrap_or_default().to_owned();
    assert_eq!(problem, "1 pairs are too few: 3 are needed, not on a line");
    // Without pairs the scan keeps its place.
    press(&mut window, "Remove pair 1");
    window.get_by_label("Refine by the pictures").click();
    align(&mut window);
    assert_eq!(site(&window).unwrap().position_m, Some([1.0, 2.0, 3.0]));
    // Esc ends picking, Close the panel.
    window.key_press(Key::Escape);
    window.run_steps(2);
    click_at(&mut window, picture);
    click_at(&mut window, view.center());
    assert!(!has_label(&window, "Remove pair 1"));
    press(&mut window, "Close");
    assert!(!has_label(&window, "Align") && has_label(&window, "Search parameters"));
}

#[test]
fn unreadable_scan_is_refused_with_the_reason() {
    let folder = tempfile::tempdir().unwrap();
    let scan = folder.path().join("room.ply");
    std::fs::write(&scan, "ply\nformat ascii 1.0\nelement vertex 9\n").unwrap();
    let mut window = window(
        Project::open(&demo(), &OpenOptions::default(), &ShotOptions::default()).unwrap(),
        egui::vec2(1400.0, 900.0),
    );
    press(&mut window, "File");
    press(&mut window, "Scan of the place…");
    answer(&mut window, &scan, "Open");
    run_until(&mut window, |app| app.problem().is_some());
    let problem = window.state().problem().unwrap().to_owned();
    assert!(problem.contains("room.ply") && has_label(&window, &problem), "{problem}");
    press(&mut window, "Close");
    assert!(has_label(&window, "Search parameters"));
}
