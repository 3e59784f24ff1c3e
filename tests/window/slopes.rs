//! Upright objects on surfaces that are not level.

use crate::harness::{demo, steps, wait_for, window};
use eframe::egui;
use egui_kittest::kittest::Queryable;
use glam::DVec3;
use locard::recording::OpenOptions;
use locard::shot::ShotOptions;
use locard::window::Project;

#[test]
fn hovering_object_on_a_slope_is_put_on_the_surface() {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("case.toml");
    let marker = std::fs::canonicalize("scenes/marker-1.glb").unwrap();
    // The floor is level in z; by this up it is tilted by 3°.
    let (sin, cos) = 3f64.to_radians().sin_cos();
    let text = format!(
        "version = 1\nup = [{sin}, 0.0, {cos}]\n\n[[objects]]\nmodel = {marker:?}\nposition_m = [0.1046, -0.0958, 0.0]\n\
         ground = true\nheading_deg = 40\n"
    );
    std::fs::write(&scene, text).unwrap();
    let options = ShotOptions { scene: Some(scene), ..ShotOptions::default() };
    let project = Project::open(&demo(), &OpenOptions::default(), &options).unwrap();
    let mut window = window(project, egui::vec2(1400.0, 1000.0));
    window.get_by_role_and_label(egui::accesskit::Role::Button, "marker-1").click();
    let message = "The surface is tilted by ";
    wait_for(&mut window, message, |window| window.query_all_by_label_contains(message).count() > 0);
    window.get_by_label("On the surface").click();
    window.run_steps(3);
    assert_eq!(steps(&window), ["opened", "marker-1: on the surface"]);
    assert_eq!(window.query_all_by_label_contains(message).count(), 0);
    let scene = &window.state().project().shot().scene;
    let object = &scene.objects[0];
    let stands = object.world_from_model.transform_vector3(DVec3::Y).normalize();
    assert!(stands.dot(DVec3::Z) > 0.9999, "{stands}");
    let low = object.points_m(scene).map(|point| point.z).fold(f64::MAX, f64::min);
    assert!(low.abs() < 0.005, "{low}");
}
