//! The window without a screen, for tests that work it as a person would.

#![allow(dead_code, reason = "each test file uses some of it")]

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use eframe::egui::{self, Key, Modifiers, accesskit::Role};
use eframe::egui_wgpu::{RenderState, RendererOptions, WgpuConfiguration, WgpuSetup, WgpuSetupCreateNew};
use egui_kittest::kittest::Queryable;
use egui_kittest::{Harness, TestRenderer};
use locard::gpu::Gpu;
use locard::pixels::Pixels;
use locard::recording::OpenOptions;
use locard::shot::Given;
use locard::window::{App, Project};

use super::gpu;

/// Gives the window a device, as a screen would. What it would show of itself is not looked at.
pub struct Device(RenderState);

impl Device {
    pub fn new() -> Self {
        let mut setup = WgpuSetupCreateNew::without_display_handle();
        setup.instance_descriptor.backends = wgpu::Backends::PRIMARY;
        setup.device_descriptor = Arc::new(Gpu::wanted);
        let configuration = WgpuConfiguration { wgpu_setup: WgpuSetup::CreateNew(setup), ..Default::default() };
        let state = pollster::block_on(async {
            let instance = configuration.wgpu_setup.new_instance().await;
            RenderState::create(&configuration, &instance, None, RendererOptions::PREDICTABLE).await
        });
        Self(state.unwrap())
    }
}

impl TestRenderer for Device {
    fn setup_eframe(&self, context: &mut eframe::CreationContext<'_>, frame: &mut eframe::Frame) {
        context.wgpu_render_state = Some(self.0.clone());
        frame.wgpu_render_state = Some(self.0.clone());
    }

    fn handle_delta(&mut self, delta: &mut egui::TexturesDelta) {
        delta.set.clear();
        delta.free.clear();
    }
}

/// The demonstration in its window, with these parameters set. Where shadows have no part, `shadow.cast=false` saves that they are
/// worked out anew for whatever changes.
pub fn demo_window(sets: &[&str], size: egui::Vec2) -> Harness<'static, App> {
    let sets = sets.iter().map(|set| (*set).to_owned()).collect();
    let given = Given { scene: Some("scenes/demo.toml".into()), sets, ..Given::default() };
    window(Project::open(Path::new("recordings/demo"), &OpenOptions::default(), &given).unwrap(), size)
}

/// Opens a window of that size, with its first picture.
pub fn window(project: Project, size: egui::Vec2) -> Harness<'static, App> {
    let builder = Harness::builder().with_size(size).renderer(Device::new());
    let mut window = builder.build_eframe(|context| App::new(context, project, None).unwrap());
    settle(&mut window);
    window
}

/// Until the picture is that of all that is set.
pub fn settle(window: &mut Harness<'_, App>) {
    until(window, App::is_settled);
    assert_eq!(window.state().problem(), None);
}

/// A screen asks for its next picture after so long, and leaves the processor to the other threads until then.
const BETWEEN_PICTURES: Duration = Duration::from_millis(16);

/// Decoding and drawing have threads of their own: goes on until they are as far.
pub fn until(window: &mut Harness<'_, App>, done: impl Fn(&App) -> bool) {
    let begun = Instant::now();
    loop {
        window.step();
        if done(window.state()) {
            return;
        }
        assert!(begun.elapsed() < Duration::from_secs(120), "it does not come");
        std::thread::park_timeout(BETWEEN_PICTURES);
    }
}

/// Presses and lets go in a place.
pub fn click_at<S>(window: &mut Harness<'_, S>, at: egui::Pos2) {
    window.hover_at(at);
    window.step();
    window.drag_at(at);
    window.step();
    window.drop_at(at);
    window.run_steps(2);
}

/// Presses a key and sees what follows.
pub fn press_key(window: &mut Harness<'_, App>, key: egui::Key) {
    window.key_press(key);
    window.run_steps(2);
}

pub fn types(window: &mut Harness<'_, App>, text: &str) {
    window.event(egui::Event::Text(text.to_owned()));
    window.step();
}

/// Presses and moves in small steps, as a hand does, without letting go.
pub fn press_and_move(window: &mut Harness<'_, App>, from: egui::Pos2, to: egui::Pos2) {
    window.hover_at(from);
    window.step();
    window.drag_at(from);
    window.step();
    for share in [0.1, 0.4, 0.7, 1.0, 1.0] {
        window.hover_at(from + (to - from) * share);
        window.step();
    }
}

/// Lets go, and sees what follows.
pub fn let_go(window: &mut Harness<'_, App>, at: egui::Pos2) {
    window.drop_at(at);
    window.run_steps(2);
}

/// What was done to the project, as it can be undone.
pub fn steps(window: &Harness<'_, App>) -> Vec<String> {
    window.state().project().history().names().0.map(str::to_owned).collect()
}

/// A file is dropped into the window in its next frame.
pub fn drop_file<S>(window: &mut Harness<'_, S>, path: PathBuf) {
    window.input_mut().dropped_files.push(Arc::new(Dropped(path)));
}

#[derive(Debug)]
struct Dropped(PathBuf);

impl egui::DroppedFile for Dropped {
    fn path(&self) -> &Path {
        &self.0
    }

    fn bytes(&self) -> Result<Vec<u8>, String> {
        std::fs::read(&self.0).map_err(|error| error.to_string())
    }
}

/// Opens every group of parameters, and leaves those whose text has the words.
pub fn search(window: &mut Harness<'_, App>, words: &str) {
    window.get_by_role_and_label(Role::TextInput, "Search parameters").focus();
    window.step();
    window.key_press_modifiers(Modifiers::COMMAND, Key::A);
    window.step();
    window.get_by_role_and_label(Role::TextInput, "Search parameters").type_text(words);
    window.run_steps(3);
}

pub fn has<S>(window: &Harness<'_, S>, label: &str) -> bool {
    window.query_all_by_label(label).count() > 0
}

/// Files are read on threads of their own: goes on until there is something that is called so.
pub fn shows<S>(window: &mut Harness<'_, S>, label: &str) {
    let begun = Instant::now();
    while !has(window, label) {
        assert!(begun.elapsed() < Duration::from_secs(60), "{label} does not come");
        window.step();
        std::thread::park_timeout(BETWEEN_PICTURES);
    }
}

/// What the control of a parameter is called.
pub fn called(window: &Harness<'_, App>, table: &str, name: &str) -> String {
    let edit = window.state().project().edit();
    let mut tables = edit.rig.tables().into_iter().chain(edit.settings.tables());
    locard::params::called(tables.find(|params| params.table() == table).unwrap(), name)
}

/// The codes that the window shows.
pub fn shown(window: &Harness<'_, App>) -> Vec<[u8; 3]> {
    let viewer = window.state().viewer();
    let texels = gpu::read_back(viewer.gpu(), &viewer.composite().unwrap().texture);
    texels.into_iter().map(|[r, g, b, _]| [r, g, b]).collect()
}

pub fn codes(pixels: &Pixels) -> Vec<[u8; 3]> {
    pixels.codes.eight_bit().unwrap().chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect()
}
