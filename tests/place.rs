//! `locard place`: evidence where a pixel shows a surface.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod common;
#[path = "common/program.rs"]
mod program;

use std::path::Path;

use locard::scene::document;
use program::{refused, said};

const DEMO: [&str; 4] = ["place", "recordings/demo", "--frame", "30"];

fn place<'a>(scene: &'a str, rest: &[&'a str]) -> Vec<&'a str> {
    [&DEMO[..], rest, &["--scene", scene]].concat()
}

#[test]
fn things_come_to_rest_on_the_floor_and_the_file_keeps_its_comments() {
    let temp = tempfile::tempdir().unwrap();
    let file = temp.path().join("scene.toml");
    let scene = file.to_str().unwrap();
    let text = "# the site\nversion = 1 # so far\nup = \"z\"\n";
    std::fs::write(&file, text).unwrap();
    let told = said(&place(scene, &["--at", "320,300", "--model", "scenes/marker-1.glb", "--heading", "30"]));
    assert!(told.contains("tilted by 0.") && told.contains("placed"), "{told}");
    said(&place(scene, &["--at", "300,330", "--model", "scenes/cartridge-case-9mm.glb", "--flat", "--name", "case"]));
    let written = std::fs::read_to_string(&file).unwrap();
    assert!(written.starts_with(text), "{written}");
    let objects = document::read(&file).unwrap().value().objects.clone();
    assert_eq!((objects[0].heading_deg, objects[1].name.as_deref()), (Some(30.0), Some("case")));
    // The simulated floor is z = 0, and its depth is noisy by 1.5 mm.
    for object in &objects {
        assert!(object.position_m.unwrap()[2].abs() < 1e-3, "{object:?}");
    }
    // What it wrote is composited.
    let report = temp.path().join("report.json");
    let out = temp.path().join("out");
    let frames = ["--frames", "30..31", "-o", out.to_str().unwrap(), "--report", report.to_str().unwrap()];
    said(&[&["composite", "recordings/demo", "--scene", scene], &frames[..]].concat());
    assert!(std::fs::read_to_string(&report).unwrap().contains("\"objects_in_sight\": true"));
}

#[test]
fn on_a_real_desk_the_surface_is_the_desks() {
    let Some(folder) = common::data("tum-fr1-rpy") else { return };
    let temp = tempfile::tempdir().unwrap();
    let scene = temp.path().join("scene.toml");
    let arguments = ["--frame", "20", "--at", "320,300", "--model", "scenes/l-scale.glb", "--flat", "--profile"];
    let folder = [folder.to_str().unwrap(), "profiles/tum-fr1.toml", scene.to_str().unwrap()];
    let told = said(&[&["place", folder[0]], &arguments[..], &[folder[1], "--scene", folder[2]]].concat());
    assert!(told.contains("of what is around") && scene.exists(), "{told}");
}

#[test]
fn what_cannot_be_placed_changes_nothing() {
    let temp = tempfile::tempdir().unwrap();
    let file = temp.path().join("scene.toml");
    let scene = file.to_str().unwrap();
    let marker = ["--model", "scenes/marker-1.glb"];
    let outside = refused(&place(scene, &[&["--at", "9000,3"], &marker[..]].concat()));
    assert!(outside.contains("9000,3 lies outside of the picture, 640x480 px"), "{outside}");
    let missing = refused(&place(scene, &["--at", "320,300", "--model", "scenes/none.glb"]));
    assert!(missing.contains("none.glb"), "{missing}");
    let both = refused(&place(scene, &[&["--at", "320,300", "--flat", "--upright"], &marker[..]].concat()));
    assert!(both.contains("--flat") && both.contains("--upright"), "{both}");
    assert!(!file.exists());
    std::fs::write(&file, "version = 2\n").unwrap();
    refused(&place(scene, &[&["--at", "320,300"], &marker[..]].concat()));
    assert_eq!(std::fs::read_to_string(Path::new(scene)).unwrap(), "version = 2\n");
}
