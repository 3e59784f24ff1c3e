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

use eframe::egui::{Pos2, accesskit::Role, vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use locard::calibrate::sharpness::{edge, together};
use locard::calibrate::{SceneMotion, picked_noise};
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

fn value(window: &Harness<'_, App>, table: &str, name: &str) -> Option<Value> {
    window.state().project().value(table, name)
}

#[test]
fn an_edge_that_is_picked_gives_the_sharpness_which_is_taken_and_undone() {
    let mut window = open();
    window.get_by_label("Calibrate").click();
    window.run_steps(2);
    window.get_by_label("Pick an edge").click();
    window.run_steps(2);
    drag(&mut window, EDGE);
    // What the window shows is what the engine gives.
    let shot = window.state().project().shot().clone();
    let frame = shot.read(0).unwrap();
    let at = glam::DVec2::new(f64::from(EDGE.x0 + EDGE.x1), f64::from(EDGE.y0 + EDGE.y1)) / 2.0;
    let moved = shot.moved_px(&frame, at, &shot.surface_at(&frame, at).unwrap()).unwrap();
    let found = edge(&frame.pixels, &shot.camera().response, EDGE, moved.to_array()).unwrap();
    await_text(&mut window, &format!("edge 1: σ {:.3} ± {:.3} px", found.sigma_px, found.uncertainty_px));
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
    window.get_by_label("Pick an edge").click();
    window.run_steps(2);
    drag(&mut window, WALL);
    await_text(&mut window, "edge 1: ");
    assert!(window.query_by_label("Take the sharpness").is_none());
}

#[test]
fn a_plain_place_gives_the_noise_which_is_taken_and_undone() {
    let mut window = open();
    window.get_by_label("Calibrate").click();
    window.run_steps(2);
    window.get_by_label("Pick a plain place").click();
    window.run_steps(2);
    drag(&mut window, WALL);
    let before = window.state().project().edit().rig.noise.clone();
    let frame = window.state().project().shot().read(0).unwrap();
    let found = picked_noise(&[&frame.pixels], &[WALL], SceneMotion::Moving, before.as_ref()).unwrap();
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
