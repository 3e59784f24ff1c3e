//! Lamps in the picture of the window: selected, moved, added and adopted from an analysis.

use std::path::Path;

use crate::footage;
use crate::harness::{
    click_at, demo, demo_px, demo_window, has_label, press_and_move, press_key, release_at, settle, shown_codes, steps,
    type_text, window,
};
use crate::tier::{fast_or_full, is_full};
use eframe::egui::{self, Key, Modifiers, Pos2, accesskit::Role};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use glam::{DVec2, DVec3};
use locard::analyse::{Analysis, EnvironmentFit, LightFindings};
use locard::recording::OpenOptions;
use locard::scene::{LightingOrigin, SceneFile, SceneItem, Size, load_file};
use locard::shot::{AnalysisState, ShotOptions};
use locard::simulate::Flaws;
use locard::window::{App, HistoryRecord, Project};

const LAMP: SceneItem = SceneItem::Lamp(0);
/// Position in the demonstration's scene: above the picture.
const LAMP_AT: [f64; 3] = [-0.2783, 0.2778, 2.349];
const MARK_INSET: f64 = 18.0;
const HANDLES_INSET: f64 = 104.0;

const NO_SHADOWS: [&str; 2] = ["shadow.cast=false", "shadow.on_evidence=false"];

/// On the floor of the simulated site: an edge of the paper, and an unprinted part of it.
const PAPER_M: [DVec3; 2] = [DVec3::new(-0.1296, 0.6968, 0.0), DVec3::new(-0.1888, 0.7872, 0.0)];

const SIZE: egui::Vec2 = egui::vec2(1400.0, 1000.0);

fn open() -> Harness<'static, App> {
    demo_window(&[], SIZE)
}

fn open_without_shadows() -> Harness<'static, App> {
    demo_window(&["shadow.cast=false"], SIZE)
}

/// Size of the picture, px.
fn picture_px() -> DVec2 {
    let size = demo_px(640.0, 480.0);
    DVec2::new(size.x.into(), size.y.into())
}

fn on_screen(window: &Harness<'_, App>, px: DVec2) -> Pos2 {
    window.state().on_screen(egui::vec2(px.x as f32, px.y as f32)).unwrap()
}

fn projected(window: &Harness<'_, App>, point_m: DVec3) -> Option<DVec2> {
    window.state().project().shot().posed_camera(0).unwrap().project(point_m)
}

fn lamp_position_m(window: &Harness<'_, App>, lamp: SceneItem) -> DVec3 {
    window.state().project().edit().scene.placement(lamp).unwrap().position_m
}

/// The point `inset` points inside the picture's border, in a direction from its middle.
fn at_border(window: &Harness<'_, App>, towards: DVec2, inset: f64) -> Pos2 {
    let size = picture_px();
    let [low, high] = [DVec2::ZERO, size].map(|px| on_screen(window, px));
    let half = DVec2::new((high.x - low.x).into(), (high.y - low.y).into()) * 0.5 - inset;
    let way = towards * (half / towards.abs()).min_element();
    low + (high - low) * 0.5 + egui::vec2(way.x as f32, way.y as f32)
}

/// Direction from the middle of the picture to a point outside it or behind the camera.
fn towards(window: &Harness<'_, App>, point_m: [f64; 3]) -> DVec2 {
    let way = || window.state().project().shot().posed_camera(0).unwrap().vector_to(point_m.into()).truncate();
    let size = picture_px();
    let lamp_px = projected(window, point_m.into());
    assert!(lamp_px.is_none_or(|px| px.min_element() < 0.0 || px.cmpgt(size).any()), "{lamp_px:?}");
    lamp_px.map_or_else(way, |px| px - 0.5 * size).normalize()
}

fn undo(window: &mut Harness<'_, App>) {
    window.key_press_modifiers(Modifiers::COMMAND, Key::Z);
    window.step();
    settle(window);
}

/// The scene file as it would be saved into the scene's folder.
fn text(window: &mut Harness<'_, App>) -> String {
    let temp = tempfile::tempdir().unwrap();
    let file = temp.path().join("scene.toml");
    let mut project = Project::open(
        &demo(),
        &OpenOptions::default(),
        &ShotOptions { scene: Some("scenes/demo.toml".into()), ..ShotOptions::default() },
    )
    .unwrap();
    project.restore(window.state().project().edit().clone(), HistoryRecord::default()).unwrap();
    project.save_scene(&file).unwrap();
    std::fs::read_to_string(&file).unwrap()
}

#[test]
fn lamp_outside_the_picture_is_selected_and_dragged_at_the_border() {
    let mut window = open();
    let (first, text_before, before) =
        (shown_codes(&window), text(&mut window), window.state().project().edit().clone());
    assert!(text_before.contains("at_m = [-0.2783, 0.2778, 2.349]\n"), "{text_before}");
    let towards = towards(&window, LAMP_AT);
    let mark = at_border(&window, towards, MARK_INSET);
    click_at(&mut window, mark);
    assert_eq!(window.state().selected(), Some(LAMP));
    assert_eq!(steps(&window).len(), 1, "looking changes nothing");

    // The dot of its handles, dragged: the picture follows during the drag.
    let from = at_border(&window, towards, HANDLES_INSET);
    let to = from + egui::vec2(-160.0, 30.0);
    press_and_move(&mut window, from, to);
    settle(&mut window);
    assert!(shown_codes(&window) != first && steps(&window).len() == 1, "it is no step yet");
    release_at(&mut window, to);
    settle(&mut window);
    let (moved, by) = (shown_codes(&window), lamp_position_m(&window, LAMP) - DVec3::from(LAMP_AT));
    assert!(moved != first && by.length() > 0.3, "{by}");
    // A hanging lamp keeps its depth: it moves perpendicularly to the viewing ray of its dot.
    let eye = window.state().project().shot().posed_camera(0).unwrap();
    let size = window.state().on_screen(egui::vec2(1.0, 0.0)).unwrap() - on_screen(&window, DVec2::ZERO);
    let px = (from - on_screen(&window, DVec2::ZERO)) / size.x;
    let sight = eye.ray(DVec2::new(px.x.into(), px.y.into())).unwrap().direction;
    assert!(by.dot(sight).abs() < 5e-3 * by.length(), "{by} {sight}");
    let names = steps(&window);
    assert!(names.len() == 2 && names[1].starts_with("lamp 1: moved "), "{names:?}");

    // The scene file has the new position, and every comment.
    let scene = window.state().project().edit().scene.clone();
    let [x, y, z] = scene.light.lamp[0].at_m;
    let expected = text_before.replace("[-0.2783, 0.2778, 2.349]", &format!("[{x:?}, {y:?}, {z:?}]"));
    assert_eq!(text(&mut window), expected);
    assert!(expected.contains("# The light that `locard light` found"));

    undo(&mut window);
    assert!(shown_codes(&window) == first && window.state().project().edit() == &before);
    assert_eq!(text(&mut window), text_before);
    window.key_press_modifiers(Modifiers::COMMAND | Modifiers::SHIFT, Key::Z);
    window.step();
    settle(&mut window);
    assert!(shown_codes(&window) == moved && window.state().project().edit().scene == scene);
}

#[test]
fn lamp_in_the_picture_follows_the_pointer() {
    let mut window = open();
    let here = DVec3::new(-0.1, 0.25, 0.15);
    let project = window.state_mut().project_mut();
    let hung_low = |scene: &mut SceneFile| {
        let lamp = &mut scene.light.lamp[0];
        (lamp.at_m, lamp.diameter_m) = (here.to_array(), Some(0.04));
    };
    project.change_scene("hung low", hung_low).unwrap();
    project.close_step();
    settle(&mut window);
    let mark = on_screen(&window, projected(&window, here).unwrap());
    click_at(&mut window, mark);
    assert_eq!(window.state().selected(), Some(LAMP));
    let to = mark + egui::vec2(70.0, -40.0);
    press_and_move(&mut window, mark, to);
    release_at(&mut window, to);
    let now = lamp_position_m(&window, LAMP);
    let there = on_screen(&window, projected(&window, now).unwrap());
    // Within a tenth of a millimetre in the world; the picture's rows have different times.
    assert!(there.distance(to) < 0.5, "{there:?} {to:?}");
    let eye = window.state().project().shot().posed_camera(0).unwrap();
    let across = (now - here).dot((here - eye.position_m()).normalize());
    assert!(across.abs() < 1e-3, "{across}");

    // The arrow of z is dragged beside the lamp's ball and moves along z alone.
    let up = there - egui::vec2(0.0, 50.0);
    press_and_move(&mut window, up, up - egui::vec2(0.0, 40.0));
    release_at(&mut window, up - egui::vec2(0.0, 40.0));
    let by = lamp_position_m(&window, LAMP) - now;
    assert!(by.x == 0.0 && by.y == 0.0 && by.z > 0.02, "{by}");
    // Its size is its diameter, and it has no orientation.
    press_key(&mut window, Key::S);
    type_text(&mut window, "200%");
    press_key(&mut window, Key::Enter);
    assert_eq!(window.state().project().edit().scene.placement(LAMP).unwrap().size, Size::LargestM(0.08));
    let before = window.state().project().edit().clone();
    press_key(&mut window, Key::R);
    assert!(window.state().message().is_some_and(|text| text.contains("cannot be turned")));
    type_text(&mut window, "45");
    press_key(&mut window, Key::Enter);
    press_key(&mut window, Key::H);
    assert!(window.state().project().edit() == &before);
}

#[test]
fn keys_move_duplicate_and_delete_a_lamp_and_escape_cancels() {
    let mut window = open_without_shadows();
    window.get_by_role_and_label(Role::Button, "lamp 1").click();
    window.run_steps(2);
    assert_eq!(window.state().selected(), Some(LAMP));
    let (first, before) = (shown_codes(&window), window.state().project().edit().clone());
    press_key(&mut window, Key::G);
    press_key(&mut window, Key::Z);
    type_text(&mut window, "-1");
    window.run_steps(2);
    assert!(lamp_position_m(&window, LAMP).abs_diff_eq(DVec3::from(LAMP_AT) - DVec3::Z, 1e-9));
    press_key(&mut window, Key::Escape);
    assert!(window.state().project().edit() == &before);
    window.key_press_modifiers(Modifiers::SHIFT, Key::D);
    window.run_steps(2);
    press_key(&mut window, Key::X);
    type_text(&mut window, "1,5");
    press_key(&mut window, Key::Enter);
    settle(&mut window);
    let copy = SceneItem::Lamp(1);
    assert_eq!(window.state().selected(), Some(copy));
    assert!(lamp_position_m(&window, copy).abs_diff_eq(DVec3::from(LAMP_AT) + 1.5 * DVec3::X, 1e-9));
    assert_eq!(lamp_position_m(&window, LAMP), DVec3::from(LAMP_AT));
    assert!(shown_codes(&window) != first, "two shine more than one");
    window.key_press_modifiers(Modifiers::ALT, Key::ArrowRight);
    window.run_steps(2);
    let by = lamp_position_m(&window, copy) - DVec3::from(LAMP_AT) - 1.5 * DVec3::X;
    assert!((by.length() - 1e-3).abs() < 1e-9, "{by}");
    press_key(&mut window, Key::Delete);
    settle(&mut window);
    assert!(
        shown_codes(&window) == first
            && window.state().project().edit() == &before
            && window.state().selected().is_none()
    );
    let expected =
        ["opened", "lamp 2: duplicated, moved 1.5 m", "lamp 2: moved by keys", "lamp 2: deleted"].map(str::to_owned);
    assert_eq!(steps(&window), expected);
}

#[test]
fn typed_lamp_values_are_one_undo_step_each() {
    let mut window = open_without_shadows();
    window.get_by_role_and_label(Role::Button, "lamp 1").click();
    window.run_steps(2);
    let first = shown_codes(&window);
    for (label, value) in [("lamp intensity", 2.0), ("lamp green", 0.0), ("lamp diameter", 1.0), ("lamp z", 1.5)] {
        window.get_by_role_and_label(Role::Slider, label).set_value_accesskit(value);
        window.run_steps(3);
    }
    let lamp = window.state().project().edit().scene.light.lamp[0].clone();
    assert_eq!(
        (lamp.intensity, lamp.rgb(), lamp.diameter_or_default_m(), lamp.at_m[2]),
        (Some(2.0), [5.4049, 0.0, 4.6338], 1.0, 1.5)
    );
    // A negative intensity means no light, and is accepted.
    window.get_by_role_and_label(Role::Slider, "lamp intensity").set_value_accesskit(-3.0);
    window.run_steps(3);
    assert_eq!(window.state().project().edit().scene.light.lamp[0].intensity, Some(0.0));
    settle(&mut window);
    assert!(shown_codes(&window) != first);
    for _ in 0..5 {
        undo(&mut window);
    }
    assert!(shown_codes(&window) == first && !window.state().project().history().can_undo());
}

#[test]
fn lamp_is_added_at_the_clicked_point() {
    let mut window = open_without_shadows();
    window.get_by_label("Add lamp").click();
    window.run_steps(2);
    press_key(&mut window, Key::Escape);
    let place = on_screen(&window, projected(&window, DVec3::new(-0.2, 0.2, 0.0)).unwrap());
    click_at(&mut window, place);
    assert_eq!(window.state().project().edit().scene.light.lamp.len(), 1, "Esc has ended it");
    window.get_by_label("Add lamp").click();
    window.run_steps(2);
    click_at(&mut window, place);
    let added = SceneItem::Lamp(1);
    assert_eq!((window.state().selected(), steps(&window).last().unwrap().as_str()), (Some(added), "lamp 2: added"));
    // A bulb of 6 cm that touches the floor, z = 0, whose depth has a noise of 1.5 mm.
    assert!(
        lamp_position_m(&window, added).abs_diff_eq(DVec3::new(-0.2, 0.2, 0.03), 4e-3),
        "{}",
        lamp_position_m(&window, added)
    );
    // The next click selects again.
    let beside = on_screen(&window, projected(&window, DVec3::new(-0.4, 0.4, 0.0)).unwrap());
    click_at(&mut window, beside);
    assert_eq!(window.state().selected(), None);
    undo(&mut window);
    assert_eq!(window.state().project().edit().scene.light.lamp.len(), 1);
}

/// Adds the light of the demonstration's scene to an analysis. The search for a light takes 10 s.
fn with_light(analysis: &mut Analysis) {
    let panorama = image::open("scenes/demo-light.hdr").unwrap().into_rgb32f();
    let rgb: Vec<[f32; 3]> = panorama.pixels().map(|pixel| pixel.0).collect();
    let environment = EnvironmentFit::of(&rgb).unwrap();
    let mut light: LightFindings = toml::from_str(FOUND_LIGHT).unwrap();
    light.panorama = LightFindings::of(&Err(String::new()), Some(&environment)).panorama;
    (analysis.environment, analysis.findings.light) = (Some(environment), Some(light));
}

const FOUND_LIGHT: &str = "middle_m = [0.1, 0.0, 0.1]\nup = [0.0, 0.0, 1.0]\nwhite_level = [0.6, 0.6, 0.6]\n\
    [[lamps]]\nat_m = [-0.2783, 0.2778, 2.349]\nshown_at_1_m = [5.4049, 5.1358, 4.6338]\n";

/// A simulated site whose analysis includes a light, and a scene of one marker without light.
fn analysed_site() -> (tempfile::TempDir, Project) {
    let folder = footage::demo_by_tier(4, &Flaws::default(), 4);
    let shot = footage::opened(&folder);
    let mut analysis = footage::analysed_by_tier(&shot, 2);
    with_light(&mut analysis);
    analysis.write(&folder.path().join("site.analysis"), &shot.recording).unwrap();
    let file = folder.path().join("case.toml");
    let model = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/marker-1.glb");
    let scene = format!("version = 1\nup = \"z\"\n[[objects]]\nmodel = {model:?}\nposition_m = [0.0, 0.12, 0.0]\n");
    std::fs::write(&file, scene).unwrap();
    let options =
        ShotOptions { scene: Some(file), sets: NO_SHADOWS.map(str::to_owned).to_vec(), ..ShotOptions::default() };
    let project = Project::open(&folder.path().join("site"), &OpenOptions::default(), &options).unwrap();
    (folder, project)
}

#[test]
fn light_is_matched_to_white_paper_as_by_the_command_and_undone() {
    let (_folder, project) = analysed_site();
    let mut window = window(project, SIZE);
    let first = shown_codes(&window);
    window.get_by_label("Match white").click();
    window.run_steps(2);
    // The edge of the paper is rejected; the next click is used.
    let [edge, paper] = PAPER_M.map(|at_m| on_screen(&window, projected(&window, at_m).unwrap()));
    click_at(&mut window, edge);
    assert!(window.state().project().edit().scene.light.is_unspecified());
    click_at(&mut window, paper);
    settle(&mut window);
    assert_eq!(steps(&window), ["opened", "light: matched to white"]);
    let light = window.state().project().edit().scene.light.clone();
    let factor = light.environment_intensity.unwrap();
    assert!((0.3..3.0).contains(&factor) && factor != 1.0, "{light:?}");
    assert_eq!(light.lamp[0].intensity, Some(factor), "all of it alike");
    assert!(shown_codes(&window) != first);
    undo(&mut window);
    assert!(window.state().project().edit().scene.light.is_unspecified() && shown_codes(&window) == first);
}

#[test]
fn panorama_ambient_light_and_suns_are_edited_step_by_step() {
    let (_folder, project) = analysed_site();
    let mut window = window(project, SIZE);
    window.get_by_label("Copy to scene and edit").click();
    window.run_steps(2);
    settle(&mut window);
    let light = |window: &Harness<'_, App>| window.state().project().edit().scene.light.clone();
    let before = shown_codes(&window);
    for (label, value) in [("panorama brightness", 0.5), ("panorama turn", 90.0)] {
        window.get_by_role_and_label(Role::Slider, label).set_value_accesskit(value);
        window.run_steps(2);
    }
    settle(&mut window);
    let edited = light(&window);
    assert_eq!((edited.environment_intensity, edited.environment_rotation_deg), (Some(0.5), Some(90.0)));
    assert!(shown_codes(&window) != before);
    window.get_by_label("Even light").click();
    window.run_steps(2);
    settle(&mut window);
    let even = light(&window);
    assert!(even.environment.is_none() && even.ambient.is_some() && even.lamp == edited.lamp, "{even:?}");
    window.get_by_label("Add sun").click();
    window.run_steps(2);
    // Its height over the horizon is z.
    window.get_by_role_and_label(Role::Slider, "sun 1 height").set_value_accesskit(30.0);
    window.run_steps(2);
    settle(&mut window);
    assert!((light(&window).sun[0].towards[2] - 0.5).abs() < 1e-3, "{:?}", light(&window).sun);
    window.get_by_label("Delete sun").click();
    window.run_steps(2);
    assert_eq!(light(&window), even);
}

#[test]
fn estimated_light_is_adopted_by_the_scene_and_saved_with_its_panorama() {
    let folder = footage::demo_by_tier(fast_or_full(4, 13), &Flaws::default(), 4);
    let shot = footage::opened(&folder);
    let analysis = folder.path().join("site.analysis");
    let mut estimates = footage::analysed_by_tier(&shot, 2);
    if !is_full() {
        with_light(&mut estimates);
    }
    estimates.write(&analysis, &shot.recording).unwrap();
    let file = folder.path().join("case.toml");
    let model = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/marker-1.glb");
    let bare = format!(
        "version = 1\nup = \"z\"\n\n# the tent\n[[objects]]\nmodel = {model:?}\nposition_m = [0.0, 0.12, 0.0]\n"
    );
    std::fs::write(&file, &bare).unwrap();
    // Another case's panorama has the same name, and stays.
    std::fs::write(folder.path().join("case-light.hdr"), "another").unwrap();
    let sets = if is_full() { Vec::new() } else { NO_SHADOWS.map(str::to_owned).to_vec() };
    let options = ShotOptions { scene: Some(file.clone()), sets, ..ShotOptions::default() };
    let open = || Project::open(&folder.path().join("site"), &OpenOptions::default(), &options).unwrap();
    assert!(matches!(open().shot().analysis, AnalysisState::Used(..)));
    let mut window = window(open(), egui::vec2(1400.0, 1000.0));
    let first = shown_codes(&window);
    assert!(!has_label(&window, "lamp 1"));
    window.get_by_label("Copy to scene and edit").click();
    window.run_steps(2);
    settle(&mut window);
    assert!(shown_codes(&window) == first, "it is the light that it was in");
    assert!(!has_label(&window, "Copy to scene and edit") && has_label(&window, "lamp 1"));
    assert_eq!(steps(&window), ["opened", "light: copied from the analysis"]);
    window.get_by_role_and_label(Role::Button, "lamp 1").click();
    window.run_steps(2);
    press_key(&mut window, Key::G);
    press_key(&mut window, Key::X);
    type_text(&mut window, "0.5");
    press_key(&mut window, Key::Enter);
    settle(&mut window);
    let moved = shown_codes(&window);
    assert!(moved != first);

    window.state_mut().project_mut().save_scene(&file).unwrap();
    assert!(window.state().project().is_saved());
    let written = std::fs::read_to_string(&file).unwrap();
    assert!(written.starts_with(&bare) && written.contains("environment = \"case-light-2.hdr\"\n"), "{written}");
    let read = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    assert_eq!(read("case-light.hdr"), b"another");
    assert!(read("case-light-2.hdr") == std::fs::read(analysis.join("environment.hdr")).unwrap());
    // After undo and redo the scene names it too; and the file has the same lighting when it is
    // opened.
    undo(&mut window);
    assert!(shown_codes(&window) == first);
    let environment = window.state().project().edit().scene.light.environment.clone();
    assert_eq!(environment.as_deref(), Some("case-light-2.hdr"));
    undo(&mut window);
    assert!(shown_codes(&window) == first && has_label(&window, "Copy to scene and edit"));
    let again = open();
    assert!(again.shot().scene.lighting_origin == LightingOrigin::Scene && again.found_light().is_none());
    let again = crate::harness::window(again, egui::vec2(1400.0, 1000.0));
    assert!(shown_codes(&again) == moved);
}

#[test]
fn lamp_added_to_a_guessed_light_keeps_the_rest() {
    let project = Project::open(&demo(), &OpenOptions::default(), &ShotOptions::default()).unwrap();
    let mut window = window(project, egui::vec2(1400.0, 1000.0));
    let project = window.state_mut().project_mut();
    let guessed = load_file(&SceneFile::default(), Path::new("scene.toml"), Some(DVec3::Z)).unwrap().lighting;
    assert_eq!(project.add_lamp(DVec3::new(0.0, 0.0, 1.0)), Ok(LAMP));
    let lighting = &project.shot().scene.lighting;
    assert!(lighting.environment == guessed.environment && lighting.suns.len() == 1 && lighting.points.len() == 1);
    // Another lamp is added to that light, and nothing else changes.
    let light = project.edit().scene.light.clone();
    project.add_lamp(DVec3::new(0.5, 0.0, 1.0)).unwrap();
    let mut with_another = project.edit().scene.light.clone();
    with_another.lamp.pop();
    assert_eq!(with_another, light);
    project.undo();
    project.undo();
    assert!(project.edit().scene.light.is_unspecified());
}
