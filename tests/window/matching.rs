//! Plots and calibration in the window. Buttons are clicked by their accessibility action: results
//! that arrive between the press and the release of a pointer move the buttons below them.

use std::path::PathBuf;

use crate::harness;
use crate::harness::{has_label, wait_for};
use crate::reduced::Reduction;
use crate::tier::is_full;
use eframe::egui::{Key, Pos2, accesskit::Role, vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT, Queryable};
use locard::calibrate::sharpness::{EdgeLight, combine, edge, edge_in};
use locard::calibrate::{PickedRegion, SceneMotion, picked_noise};
use locard::params::Value;
use locard::pixels::{Pixels, Rect};
use locard::recording::OpenOptions;
use locard::shot::ShotOptions;
use locard::window::{App, DEMO, DEMO_SCENE, Project};

/// The lower edge of the front box, and plain wall.
const EDGE: Rect = Rect { x0: 88, y0: 120, x1: 116, y1: 148 };
const WALL: Rect = Rect { x0: 400, y0: 10, x1: 520, y1: 70 };

/// The demonstration's recording; in the fast tier its first frames, whose profile turns shadows
/// off.
fn recording() -> PathBuf {
    const FIRST: Reduction = Reduction { max_frames: 4, has_shadows: false, ..Reduction::by(1) };
    if is_full() { PathBuf::from(DEMO) } else { FIRST.demo() }
}

fn open() -> Harness<'static, App> {
    let options = ShotOptions {
        scene: Some(DEMO_SCENE.into()),
        sets: vec!["shadow.cast=false".to_owned()],
        ..ShotOptions::default()
    };
    let project = Project::open(&recording(), &OpenOptions::default(), &options).unwrap();
    harness::window(project, vec2(1400.0, 1200.0))
}

/// A dark marker in front of the bright wall: a straight rendered edge.
fn marker_in_front_of_the_wall(light: f64) -> (tempfile::TempDir, Harness<'static, App>) {
    let temp = tempfile::tempdir().unwrap();
    let path = temp.path().join("scene.toml");
    let at = |file: &str| std::path::absolute(file).unwrap().display().to_string();
    let (model, sky) = (at("scenes/marker-1.glb"), at("recordings/demo/environment.hdr"));
    let text = format!(
        "version = 1\nup = \"z\"\n[[objects]]\nmodel = {model:?}\nposition_m = [0.0, 0.9, 0.36]\n\
         rotation_deg = [0, 0, 12]\nscale = 5.0\n[light]\nenvironment = {sky:?}\nenvironment_intensity = {light}\n"
    );
    std::fs::write(&path, text).unwrap();
    let options = ShotOptions { scene: Some(path), ..ShotOptions::default() };
    let mut project = Project::open(&recording(), &OpenOptions::default(), &options).unwrap();
    // The marker is in the wall, and other sources of blur are off.
    project.set("depth", "occlusion", &Value::Bool(false)).unwrap();
    project.switch("motion_blur", false);
    (temp, harness::window(project, vec2(1400.0, 1200.0)))
}

/// Numbers in the label that starts with this text.
fn numbers(window: &Harness<'_, App>, begin: &str) -> Option<Vec<f64>> {
    let node = window.query_all_by_label_contains(begin).next()?;
    let text = node.accesskit_node().label().or(node.accesskit_node().value())?;
    let rest = text.strip_prefix(begin)?.to_owned();
    let of_number = |c: char| !(c.is_ascii_digit() || c == '.' || c == '-');
    Some(rest.split(of_number).filter_map(|word| word.parse().ok()).collect())
}

/// Runs the window until the numbers of that label satisfy a condition.
fn await_numbers(window: &mut Harness<'_, App>, begin: &str, is_wanted: impl Fn(&[f64]) -> bool) {
    wait_for(window, begin, |window| numbers(window, begin).as_deref().is_some_and(&is_wanted));
}

/// Four frames of the demonstration have too few flat patches.
#[test]
fn comparison_with_the_cameras_noise_runs_on_request_and_reports_the_reason_without_one() {
    let mut window = open();
    window.get_by_label("Match").click_accesskit();
    wait_for(&mut window, "the tab", |window| has_label(window, "Noise beside the camera's"));
    window.get_by_label("Noise beside the camera's").click_accesskit();
    wait_for(&mut window, "the section", |window| has_label(window, "Compare with the camera"));
    assert!(window.query_by_label_contains("flat patches of 32x32 pixels were found").is_none());
    window.get_by_label("Compare with the camera").click_accesskit();
    wait_for(&mut window, "the reason", |window| {
        window.query_by_label_contains("The noise was not compared: ").is_some()
            && window.query_by_label_contains("flat patches of 32x32 pixels were found").is_some()
    });
}

/// The measured sharpness matches the set one within three standard deviations of the measurement;
/// the footage has its noise.
#[test]
fn virtual_edge_width_matches_the_set_sharpness() {
    let (_temp, mut window) = marker_in_front_of_the_wall(0.02);
    window.state_mut().project_mut().switch("noise", false);
    window.get_by_label("Match").click_accesskit();
    window.run_steps(3);
    window.get_by_label("Edges").click_accesskit();
    window.run_steps(20);
    window.get_by_label("Pick a virtual edge").click_accesskit();
    window.run_steps(2);
    drag(&mut window, Rect::new(356, 4, 388, 50));
    for sigma_px in [1.0, 2.0, 0.5] {
        let project = window.state_mut().project_mut();
        project.set("point_spread", "sigma_px", &Value::Number(sigma_px)).unwrap();
        harness::settle(&mut window);
        await_numbers(&mut window, "virtual: σ ", |found| {
            let [found_px, uncertainty_px] = [found[0], found[1]];
            uncertainty_px < 0.05 && (found_px - sigma_px).abs() <= 3.0 * uncertainty_px
        });
    }
}

/// The rendered noise is the profile's times the amount. σ of some thousand independent pixels is
/// within 2 %; the rest is rounding to codes, which matters more the less noise there is.
#[test]
fn drawn_noise_is_the_profile_noise_times_the_amount() {
    let (_temp, mut window) = marker_in_front_of_the_wall(1.0);
    window.get_by_label("Match").click_accesskit();
    window.run_steps(3);
    for scale in [1.0, 0.5, 2.0] {
        window.state_mut().project_mut().set("noise", "scale", &Value::Number(scale)).unwrap();
        harness::settle(&mut window);
        // Plain regions of the footage match the profile, which was measured in other frames.
        await_numbers(&mut window, "Noise relative to profile: virtual ", |found| {
            (found[0] / scale - 1.0).abs() < 0.05 && (found[1] - 1.0).abs() < 0.15
        });
    }
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

/// Runs the window until a label contains this text.
fn await_text(window: &mut Harness<'_, App>, words: &str) {
    wait_for(window, words, |window| window.query_all_by_label_contains(words).next().is_some());
}

/// The wall region of a picture.
fn place(pixels: &Pixels) -> PickedRegion {
    let mut place = PickedRegion::new(WALL);
    place.add(pixels).unwrap();
    place
}

/// Runs the window until no label has this text.
fn await_no_text(window: &mut Harness<'_, App>, words: &str) {
    wait_for(window, &format!("the end of {words}"), |window| !has_label(window, words));
}

fn value(window: &Harness<'_, App>, table: &str, name: &str) -> Option<Value> {
    window.state().project().value(table, name)
}

#[test]
fn picked_edge_gives_a_sharpness_that_is_accepted_and_undone() {
    let mut window = open();
    window.get_by_label("Calibrate").click_accesskit();
    window.run_steps(2);
    window.get_by_label("Pick edges").click_accesskit();
    window.run_steps(2);
    drag(&mut window, EDGE);
    // The window shows the engine's result.
    let shot = window.state().project().shot().clone();
    let frame = shot.read(0).unwrap();
    let at = glam::DVec2::new(f64::from(EDGE.x0 + EDGE.x1), f64::from(EDGE.y0 + EDGE.y1)) / 2.0;
    let moved = shot.motion_px(&frame, at, &shot.surface_at(&frame, at).unwrap()).unwrap();
    let measured = edge(&frame.pixels, &shot.camera().response, EDGE, moved.to_array()).unwrap();
    await_text(&mut window, &format!("σ {:.3} ± {:.3} px", measured.sigma_px, measured.uncertainty_px));
    assert!(window.query_by_role_and_label(Role::Image, "Measured edges").is_some());
    let before = value(&window, "point_spread", "sigma_px");
    window.get_by_label("Apply to profile: sharpness").click_accesskit();
    window.run_steps(3);
    let all = combine(&[measured]).unwrap();
    let taken = Value::Number((1e3 * all.sigma_px).round() / 1e3);
    assert!(value(&window, "point_spread", "sigma_px") == Some(taken.clone()) && before != Some(taken));
    harness::settle(&mut window);
    window.get_by_label("Undo").click_accesskit();
    window.run_steps(3);
    assert_eq!(value(&window, "point_spread", "sigma_px"), before);
    // The reason of a rejected edge is shown, and nothing can be accepted.
    window.get_by_label("Discard: sharpness").click_accesskit();
    window.run_steps(2);
    // The picker is still active.
    drag(&mut window, WALL);
    window.get_by_label("edge 1");
    await_no_text(&mut window, "…");
    assert!(window.query_by_label("Apply to profile: sharpness").is_none());
}

#[test]
fn picked_plain_region_gives_noise_that_is_accepted_and_undone() {
    let mut window = open();
    window.get_by_label("Calibrate").click_accesskit();
    window.run_steps(2);
    window.get_by_label("Pick uniform areas").click_accesskit();
    window.run_steps(2);
    drag(&mut window, WALL);
    let before = window.state().project().edit().rig.noise.clone();
    let frame = window.state().project().shot().read(0).unwrap();
    let place = place(&frame.pixels);
    let noise = picked_noise(&[place], SceneMotion::Moving, before.as_ref()).noise.unwrap();
    await_text(&mut window, "Measured from pixel value");
    assert!(window.query_by_role_and_label(Role::Image, "Measured noise").is_some());
    // The true noise of the simulated demonstration is known.
    for (c, points) in noise.points.iter().enumerate() {
        let profile_sigma = before.as_ref().unwrap().sigma(c, points[0].code);
        assert!((points[0].sigma / profile_sigma - 1.0).abs() < 0.15, "{c}: {points:?}, {profile_sigma}");
    }
    let green = &noise.points[1][0];
    assert!(window.query_all_by_label(&format!("{:.2}", green.sigma)).next().is_some(), "{green:?}");
    window.get_by_label("Apply to profile: noise").click_accesskit();
    window.run_steps(3);
    assert_eq!(window.state().project().edit().rig.noise, Some(noise.profile));
    // One step, which a saved profile keeps.
    let temp = tempfile::tempdir().unwrap();
    let path = temp.path().join("camera.toml");
    window.state_mut().project_mut().save_profile(&path).unwrap();
    let text = std::fs::read_to_string(&path).unwrap();
    assert!(text.contains("[camera.noise]") && text.contains("picked in the window"), "{text}");
    harness::settle(&mut window);
    window.get_by_label("Undo").click_accesskit();
    window.run_steps(3);
    assert_eq!(window.state().project().edit().rig.noise, before);
}

#[test]
fn rejected_regions_show_a_reason_and_the_others_are_used() {
    let mut window = open();
    window.get_by_label("Calibrate").click_accesskit();
    window.run_steps(2);
    window.get_by_label("Pick uniform areas").click_accesskit();
    window.run_steps(2);
    // Three in a row, and one in another frame, without pressing the button again: one too small,
    // one over the box's edges.
    drag(&mut window, Rect::new(400, 10, 430, 20));
    drag(&mut window, Rect::new(60, 90, 200, 200));
    drag(&mut window, WALL);
    window.state_mut().player_mut().seek(2);
    harness::settle(&mut window);
    drag(&mut window, WALL);
    await_text(&mut window, "too small: 30 × 10 px; 24 × 24 px and more are needed");
    await_text(&mut window, "not plain: ");
    await_text(&mut window, "Measured from pixel value");
    let shot = window.state().project().shot().clone();
    let (first, third) = (shot.read(0).unwrap(), shot.read(2).unwrap());
    let places = [&first, &third].map(|frame| place(&frame.pixels));
    let present = window.state().project().edit().rig.noise.clone();
    let noise = picked_noise(&places, SceneMotion::Moving, present.as_ref());
    for code in &noise.places {
        await_text(&mut window, &format!("used, pixel value {:.0}", code.as_ref().unwrap()));
    }
    // Each is removed separately; the rest gives the same result.
    for _ in 0..2 {
        window.get_by_label("Drop area 1").click_accesskit();
        window.run_steps(3);
    }
    assert!(window.query_by_label("Drop area 3").is_none() && window.query_by_label("Drop area 2").is_some());
    await_no_text(&mut window, "…");
    assert!(window.query_all_by_label_contains("too small").next().is_none());
    // Esc ends picking: a drag then has no effect.
    window.key_press(Key::Escape);
    window.run_steps(2);
    drag(&mut window, WALL);
    assert!(window.query_by_label("Drop area 3").is_none());
    let take = "Apply to profile: noise";
    until_enabled(&mut window, take);
    window.get_by_label(take).click_accesskit();
    window.run_steps(3);
    assert_eq!(window.state().project().edit().rig.noise, Some(noise.noise.unwrap().profile));
}

#[test]
fn rejected_edge_is_shown_and_a_channel_can_be_chosen() {
    let mut window = open();
    window.get_by_label("Match").click_accesskit();
    window.run_steps(3);
    window.get_by_label("Edges").click_accesskit();
    window.run_steps(20);
    window.get_by_label("Pick a real edge").click_accesskit();
    window.run_steps(2);
    drag(&mut window, WALL);
    await_text(&mut window, "real: ");
    await_text(&mut window, "Only one step between two level parts");
    assert!(window.query_by_role_and_label(Role::Image, "Refused edges").is_some());
    window.get_by_label("real: refused");
    // An edge again, in the red channel alone.
    window.get_by_label("Pick a real edge").click_accesskit();
    window.run_steps(2);
    drag(&mut window, EDGE);
    await_no_text(&mut window, "Only one step between two level parts");
    let shot = window.state().project().shot().clone();
    let red =
        edge_in(&shot.read(0).unwrap().pixels, &shot.camera().response, EDGE, [0.0; 2], EdgeLight::Channel(0)).unwrap();
    window.get_all_by_label("Red").last().unwrap().click_accesskit();
    await_text(&mut window, &format!("real: σ {:.3} ", red.sigma_px));
}

#[test]
fn rejected_edge_is_plotted_beside_accepted_ones_with_names() {
    let mut window = open();
    window.get_by_label("Calibrate").click_accesskit();
    window.run_steps(2);
    window.get_by_label("Pick edges").click_accesskit();
    window.run_steps(2);
    for place in [WALL, EDGE, Rect { x0: EDGE.x0 + 2, ..EDGE }] {
        drag(&mut window, place);
    }
    // The first is rejected, not the one picked last.
    await_text(&mut window, "edge 1: refused");
    for plot in ["Measured edges", "Refused edges"] {
        assert!(window.query_by_role_and_label(Role::Image, plot).is_some(), "{plot}");
    }
    // In the list, and in the legend of the plot.
    for (name, times) in [("edge 1", 1), ("edge 2", 2), ("edge 3", 2)] {
        assert_eq!(window.query_all_by_label(name).count(), times, "{name}");
    }
}

/// Runs the window until a button is enabled.
fn until_enabled(window: &mut Harness<'_, App>, label: &str) {
    let is_enabled = |window: &Harness<'_, App>| {
        window.query_by_label(label).is_some_and(|node| !node.accesskit_node().is_disabled())
    };
    wait_for(window, label, is_enabled);
}

#[test]
fn only_open_plots_are_computed() {
    let mut window = open();
    window.get_by_label("Match").click_accesskit();
    window.run_steps(3);
    assert!(window.query_by_role_and_label(Role::Image, "Noise by intensity").is_some());
    assert!(window.query_by_role_and_label(Role::Image, "Edges").is_none());
    window.get_by_label("Edges").click_accesskit();
    window.run_steps(20);
    window.get_by_label("Pick a real edge").click_accesskit();
    window.run_steps(2);
    drag(&mut window, EDGE);
    let shot = window.state().project().shot().clone();
    let frame = shot.read(0).unwrap();
    let measured = edge(&frame.pixels, &shot.camera().response, EDGE, [0.0; 2]).unwrap();
    await_text(&mut window, &format!("real: σ {:.3} ± {:.3} px", measured.sigma_px, measured.uncertainty_px));
    // The virtual marker's upper edge, in the composite.
    window.get_by_label("Pick a virtual edge").click_accesskit();
    window.run_steps(2);
    drag(&mut window, Rect::new(300, 238, 318, 260));
    await_text(&mut window, "virtual: ");
    // Brightness of objects and of their surroundings, by luma or by channel.
    window.get_by_label("Brightness").click_accesskit();
    window.run_steps(20);
    // The first ones are those of the brightness; the edges have some, too.
    window.get_all_by_label("Luma").next().unwrap().click_accesskit();
    window.run_steps(2);
    assert!(window.query_by_role_and_label(Role::Image, "Brightness of object and surroundings").is_some());
    window.get_by_label("Brightness").click_accesskit();
    window.run_steps(20);
    // A patch is tracked through all frames.
    window.get_by_label("Patch over time").click_accesskit();
    window.run_steps(20);
    window.get_by_label("Pick a patch").click_accesskit();
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
    // Values at the point under the pointer: the distance of a floor point follows from the
    // camera's pose alone.
    let floor_m = glam::DVec3::new(-0.2, -0.1, 0.0);
    let px = shot.posed_camera(0).unwrap().project(floor_m).unwrap();
    let depth_m = shot.recording.pose_at_frame(0).unwrap().transform_point(floor_m).z;
    let at = window.state().on_screen(vec2(px.x as f32, px.y as f32)).unwrap();
    window.hover_at(at);
    window.run_steps(3);
    await_text(&mut window, "m away, pixel values (8 bit)");
    let label = window.query_all_by_label_contains("m away, pixel values (8 bit)").next().unwrap();
    let label = label.accesskit_node().label().or(label.accesskit_node().value()).unwrap();
    let told_m: f64 = label.split(' ').next().unwrap().parse().unwrap();
    // The sensor's depth has a noise of 1.5 mm, and the row's pose differs slightly from the
    // frame's.
    assert!((told_m - depth_m).abs() < 5e-3, "{label}: {depth_m}");
}
