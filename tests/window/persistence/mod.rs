//! Saving and recovery of the user's work, and the files that the window writes.

mod crash;
mod exports;
mod missing_files;
mod questions;
mod saving;
mod shot_settings;

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use crate::gpu;
use crate::harness;
use crate::harness::{
    Device, answer, codes, demo_frame, drop_file, has_label, press, run_until, settle, shown_codes, wait_for,
    wait_for_label, window,
};
use eframe::egui::{self, Key, Modifiers, accesskit::Role};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use locard::compositor::Target;
use locard::params::Value;
use locard::pixels::Pixels;
use locard::recording::OpenOptions;
use locard::scene::document::PlacedModel;
use locard::shot::{Shot, ShotOptions};
use locard::window::{
    App, Autosave, DEMO, DEMO_SCENE, HistoryRecord, JobState, ProfileScope, Project, RecoverableWork, UnsavedWork,
    command_line,
};

fn project(profile: Option<&Path>, scene: Option<&Path>) -> Project {
    let options =
        ShotOptions { profile: profile.map(Into::into), scene: scene.map(Into::into), ..ShotOptions::default() };
    Project::open(&harness::demo(), &OpenOptions::default(), &options).unwrap()
}

fn open(profile: Option<&Path>, scene: &Path) -> Harness<'static, App> {
    window(project(profile, Some(scene)), egui::vec2(1400.0, 1000.0))
}

/// The first frames of the demonstration, shared by these tests.
fn demo() -> Harness<'static, App> {
    open(None, Path::new(DEMO_SCENE))
}

/// Window of tests that check nothing virtual.
fn plain() -> Harness<'static, App> {
    window(project(None, harness::scene_or_none().as_deref()), egui::vec2(1400.0, 1000.0))
}

/// The picture that `locard composite` writes with these settings.
fn written(sets: &[&str], frame: usize) -> Vec<[u8; 3]> {
    let sets = sets.iter().map(ToString::to_string).collect();
    let options = ShotOptions { sets, scene: Some(DEMO_SCENE.into()), ..ShotOptions::default() };
    let shot = Shot::open(&harness::demo(), &OpenOptions::default(), &options).unwrap();
    let mut compositor = shot.compositor(gpu::gpu().clone());
    let pending = shot.picture(&mut compositor, frame, Target::Pixels).unwrap();
    codes(&compositor.collect(pending).unwrap().pixels)
}

fn picture(path: &Path) -> Vec<[u8; 3]> {
    let read = image::open(path).unwrap().to_rgb8();
    codes(&Pixels::from_u8(read.width(), read.height(), read.into_raw()).unwrap())
}

fn set(window: &mut Harness<'_, App>, table: &str, name: &str, number: f64) {
    let project = window.state_mut().project_mut();
    project.set(table, name, &Value::Number(number)).unwrap();
    project.close_step();
}

/// Chooses a file in a save dialog.
fn choose(window: &mut Harness<'_, App>, path: &Path) {
    answer(window, path, "Save here");
}

fn all_over(app: &App) -> bool {
    app.documents().jobs().is_some_and(|jobs| !jobs.is_busy() && jobs.entries.iter().all(|entry| entry.state.is_over()))
}
