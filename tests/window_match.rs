//! Plots and calibration in the window, worked as a person would.

#![cfg(feature = "window")]
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

#[path = "common/gpu.rs"]
mod gpu;
#[path = "common/program.rs"]
mod program;
#[path = "common/window.rs"]
mod window;

use std::path::Path;
use std::time::{Duration, Instant};

use eframe::egui::{Key, Pos2, accesskit::Role, vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT, Queryable};
use locard::calibrate::sharpness::{edge, together};
use locard::calibrate::{Place, SceneMotion, picked_noise};
use locard::params::Value;
use locard::pixels::Rect;
use locard::recording::OpenOptions;
use locard::shot::Given;
use locard::window::{App, Project};

/// The lower edge of the front box, and wall without anything on it.
const EDGE: Rect = Rect { x0: 88, y0: 120, x1: 116, y1: 148 };
const WALL: Rect = Rect { x0: 400, y0: 10, x1: 520, y1: 70 };

fn open() -> Harness<'static, App> {
    let given = Given { scene: Some("scenes/demo.toml".into()), ..Given::default() };
    let project = Project::open(Path::new("recordings/demo"), &OpenOptions::default(), &given).unwrap();
    window::window(project, vec2(1400.0, 1200.0))
}

/// Drags a rectangle in the picture.
fn drag(window: &mut Harness<'_, App>, rect: Rect) {
    let at = |window: &Harness<'_, App>, x: i32, y: i32| window.state().on_screen(vec2(x as f32, y as f32)).unwrap();
    let (from, to): (Pos2, Pos2) = (at(window, rect.x0, rect.y0), at(window, rect.x1, rect.y1));
    window.hover_at(from);
    window.step();
    window.drag_at(from);
    window.step();
    for share in [0.1, 0.5, 1.0, 1.0] {
        window.hover_at(from + (to - from) * share);
        window.step();
    }
    window.drop_at(to);
    window.run_steps(2);
}

/// Until something with these words is shown.
fn await_text(window: &mut Harness<'_, App>, words: &str) {
    let begun = Instant::now();
    while window.query_all_by_label_contains(words).next().is_none() {
        assert!(begun.elapsed() < Duration::from_secs(120), "nothing says {words}");
        window.step();
        std::thread::yield_now();
    }
}

/// Until nothing with these words is shown.
fn await_no_text(window: &mut Harness<'_, App>, words: &str) {
    let begun = Instant::now();
    while window.query_all_by_label(words).next().is_some() {
        assert!(begun.elapsed() < Duration::from_secs(120), "it still says {words}");
        window.step();
        std::thread::yield_now();
    }
}

fn value(window: &Harness<'_, App>, table: &str, name: &str) -> Option<Value> {
    window.state().project().value(table, name)
}

#[test]
fn an_edge_that_is_picked_gives_the_sharpness_which_is_taken_and_undone() {
    let mut window = open();
    window.get_by_label("Calibrate").click();
    window.run_steps(2);
    window.get_by_label("Pick edges").click();
    window.run_steps(2);
    drag(&mut window, EDGE);
    // What the window shows is what the engine gives.
    let shot = window.state().project().shot().clone();
    let frame = shot.read(0).unwrap();
    let at = glam::DVec2::new(f64::from(EDGE.x0 + EDGE.x1), f64::from(EDGE.y0 + EDGE.y1)) / 2.0;
    let moved = shot.moved_px(&frame, at, &shot.surface_at(&frame, at).unwrap()).unwrap();
    let found = edge(&frame.pixels, &shot.camera().response, EDGE, moved.to_array()).unwrap();
    await_text(&mut window, &format!("σ {:.3} ± {:.3} px", found.sigma_px, found.uncertainty_px));
    assert!(window.query_by_role_and_label(Role::Image, "Measured edges").is_some());
    let before = value(&window, "point_spread", "sigma_px");
    window.get_by_label("Take the sharpness").click();
    window.run_steps(3);
    let all = together(&[found]).unwrap();
    let taken = Value::Number((1e3 * all.sigma_px).round() / 1e3);
    assert!(value(&window, "point_spread", "sigma_px") == Some(taken.clone()) && before != Some(taken));
    window::settle(&mut window);
    window.get_by_label("Undo").click();
    window.run_steps(3);
    assert_eq!(value(&window, "point_spread", "sigma_px"), before);
    // What is no edge is told in words, and nothing can be taken.
    window.get_by_label("Leave the sharpness").click();
    window.run_steps(2);
    // It is still asked for edges.
    drag(&mut window, WALL);
    window.get_by_label("edge 1");
    await_no_text(&mut window, "…");
    assert!(window.query_by_label("Take the sharpness").is_none());
}

#[test]
fn a_plain_place_gives_the_noise_which_is_taken_and_undone() {
    let mut window = open();
    window.get_by_label("Calibrate").click();
    window.run_steps(2);
    window.get_by_label("Pick plain places").click();
    window.run_steps(2);
    drag(&mut window, WALL);
    let before = window.state().project().edit().rig.noise.clone();
    let frame = window.state().project().shot().read(0).unwrap();
    let place = Place { frames: &[&frame.pixels], at: WALL };
    let found = picked_noise(&[place], SceneMotion::Moving, before.as_ref()).noise.unwrap();
    await_text(&mut window, "Measured from code");
    assert!(window.query_by_role_and_label(Role::Image, "Measured noise").is_some());
    let green = &found.points[1][0];
    assert!(window.query_all_by_label(&format!("{:.2}", green.sigma)).next().is_some(), "{green:?}");
    window.get_by_label("Take the noise").click();
    window.run_steps(3);
    assert_eq!(window.state().project().edit().rig.noise, Some(found.profile));
    // One step, which a saved profile keeps.
    let temp = tempfile::tempdir().unwrap();
    let path = temp.path().join("camera.toml");
    window.state_mut().project_mut().save_profile(&path).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    assert!(text.contains("[camera.noise]") && text.contains("picked in the window"), "{text}");
    window::settle(&mut window);
    window.get_by_label("Undo").click();
    window.run_steps(3);
    assert_eq!(window.state().project().edit().rig.noise, before);
}

#[test]
fn bad_places_say_why_and_the_good_ones_are_used() {
    let mut window = open();
    window.get_by_label("Calibrate").click();
    window.run_steps(2);
    window.get_by_label("Pick plain places").click();
    window.run_steps(2);
    // Three in a row, and one in another frame, without pressing the button again: one too small, one over the box's edges.
    drag(&mut window, Rect::new(400, 10, 430, 20));
    drag(&mut window, Rect::new(60, 90, 200, 200));
    drag(&mut window, WALL);
    window.state_mut().player_mut().seek(2);
    window::settle(&mut window);
    drag(&mut window, WALL);
    await_text(&mut window, "too small: 30 × 10 px; 24 × 24 px and more are needed");
    await_text(&mut window, "not plain: ");
    await_text(&mut window, "Measured from code");
    let shot = window.state().project().shot().clone();
    let (first, third) = (shot.read(0).unwrap(), shot.read(2).unwrap());
    let places = [[&first.pixels], [&third.pixels]];
    let places = places.each_ref().map(|frames| Place { frames, at: WALL });
    let present = window.state().project().edit().rig.noise.clone();
    let found = picked_noise(&places, SceneMotion::Moving, present.as_ref());
    for code in &found.places {
        await_text(&mut window, &format!("used, code {:.0}", code.as_ref().unwrap()));
    }
    // Each is dropped by itself; what is left says the same.
    for _ in 0..2 {
        window.get_by_label("Drop plain 1").click();
        window.run_steps(3);
    }
    assert!(window.query_by_label("Drop plain 3").is_none() && window.query_by_label("Drop plain 2").is_some());
    await_no_text(&mut window, "…");
    assert!(window.query_all_by_label_contains("too small").next().is_none());
    // Esc ends the picking: a drag moves nothing and picks nothing.
    window.key_press(Key::Escape);
    window.run_steps(2);
    drag(&mut window, WALL);
    assert!(window.query_by_label("Drop plain 3").is_none());
    let take = "Take the noise";
    until_enabled(&mut window, take);
    window.get_by_label(take).click();
    window.run_steps(3);
    assert_eq!(window.state().project().edit().rig.noise, Some(found.noise.unwrap().profile));
}

/// Until a button can be pressed.
fn until_enabled(window: &mut Harness<'_, App>, label: &str) {
    let begun = Instant::now();
    while window.query_by_label(label).is_none_or(|node| node.accesskit_node().is_disabled()) {
        assert!(begun.elapsed() < Duration::from_secs(120), "{label} cannot be pressed");
        window.step();
        std::thread::yield_now();
    }
}

#[test]
fn plots_appear_and_only_those_that_are_open_are_computed() {
    let mut window = open();
    window.get_by_label("Match").click();
    window.run_steps(3);
    assert!(window.query_by_role_and_label(Role::Image, "Noise by intensity").is_some());
    assert!(window.query_by_role_and_label(Role::Image, "Edges").is_none());
    window.get_by_label("Edges").click();
    window.run_steps(20);
    window.get_by_label("Pick a real edge").click();
    window.run_steps(2);
    drag(&mut window, EDGE);
    let shot = window.state().project().shot().clone();
    let frame = shot.read(0).unwrap();
    let found = edge(&frame.pixels, &shot.camera().response, EDGE, [0.0; 2]).unwrap();
    await_text(&mut window, &format!("real: σ {:.3} ± {:.3} px", found.sigma_px, found.uncertainty_px));
    // The virtual marker's upper edge, in the composite.
    window.get_by_label("Pick a virtual edge").click();
    window.run_steps(2);
    drag(&mut window, Rect::new(300, 238, 318, 260));
    await_text(&mut window, "virtual: ");
    // A patch is followed through all frames.
    window.get_by_label("A patch over the frames").click();
    window.run_steps(20);
    window.get_by_label("Pick a patch").click();
    window.run_steps(2);
    drag(&mut window, WALL);
    let mean = |frame: usize| {
        let pixels = shot.read(frame).unwrap().pixels;
        let places = (WALL.y0..WALL.y1).flat_map(|y| (WALL.x0..WALL.x1).map(move |x| (x as u32, y as u32)));
        let codes: Vec<f64> = places.map(|(x, y)| f64::from(pixels.at(x, y)[1])).collect();
        codes.iter().sum::<f64>() / codes.len() as f64
    };
    await_text(&mut window, &format!("now {:.1}, ", mean(0)));
    assert!(window.query_by_role_and_label(Role::Image, "Mean of a patch").is_some());
    // What happens to the point under the pointer.
    let at = window.state().on_screen(vec2(100.0, 120.0)).unwrap();
    window.hover_at(at);
    window.run_steps(3);
    await_text(&mut window, "m away, code values");
}
