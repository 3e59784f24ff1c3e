//! The window without a screen, for tests that operate it as a user would.

#![allow(dead_code, reason = "each test file uses some of it")]

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use eframe::egui::{self, Key, Modifiers, accesskit::Role};
use eframe::egui_wgpu::{RenderState, RendererOptions, WgpuConfiguration, WgpuSetup, WgpuSetupCreateNew};
use egui_kittest::kittest::{NodeT, Queryable};
use egui_kittest::{Harness, TestRenderer};
use locard::gpu::Gpu;
use locard::pixels::Pixels;
use locard::recording::OpenOptions;
use locard::shot::ShotOptions;
use locard::window::{App, DEMO, DEMO_SCENE, Project};

use super::gpu;
use super::reduced::Reduction;
use super::tier::{fast_or_full, is_full};

/// Provides the window's GPU device. The window's own image is not inspected.
pub struct Device(RenderState);

impl Device {
    pub fn new() -> Self {
        let mut setup = WgpuSetupCreateNew::without_display_handle();
        setup.instance_descriptor.backends = wgpu::Backends::PRIMARY;
        setup.device_descriptor = Arc::new(Gpu::device_descriptor);
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

/// The demonstration's recording in the fast tier.
const REDUCTION: Reduction = Reduction { factor: 4, stride: 3, max_frames: usize::MAX, has_shadows: false };

/// The demonstration's recording; in the fast tier a copy of every third frame at a quarter of the
/// size, 160x120 px, whose profile turns shadows off. The folder has the same name.
pub fn demo() -> PathBuf {
    if is_full() { PathBuf::from(DEMO) } else { REDUCTION.demo() }
}

/// Scene of tests that check nothing virtual: none in the fast tier.
pub fn scene_or_none() -> Option<PathBuf> {
    is_full().then(|| DEMO_SCENE.into())
}

/// Index in [`demo`] of a frame of the demonstration, or of the nearest earlier frame that it
/// contains.
pub fn demo_frame(of_demonstration: usize) -> usize {
    of_demonstration / fast_or_full(REDUCTION.stride, 1)
}

/// Converts a position in the demonstration's pictures to one in those of [`demo`], px.
pub fn demo_px(x: f32, y: f32) -> egui::Vec2 {
    egui::vec2(x, y) / fast_or_full(REDUCTION.factor as f32, 1.0)
}

/// Opens the demonstration with these parameters set. In tests in which shadows play no part,
/// `shadow.cast=false` avoids computing them after each change.
pub fn demo_window(sets: &[&str], size: egui::Vec2) -> Harness<'static, App> {
    let sets = sets.iter().map(|set| (*set).to_owned()).collect();
    let options = ShotOptions { scene: Some(DEMO_SCENE.into()), sets, ..ShotOptions::default() };
    window(Project::open(&demo(), &OpenOptions::default(), &options).unwrap(), size)
}

/// Opens a window of this size and waits for its first picture.
pub fn window(project: Project, size: egui::Vec2) -> Harness<'static, App> {
    let builder = Harness::builder().with_size(size).renderer(Device::new());
    let mut window = builder.build_eframe(|context| App::new(context, project, None).unwrap());
    settle(&mut window);
    window
}

/// Runs the window until its picture shows the current settings.
pub fn settle(window: &mut Harness<'_, App>) {
    run_until(window, App::is_settled);
    assert_eq!(window.state().problem(), None);
}

/// Pause between two frames of the window, which leaves the processor to other threads.
const BETWEEN_PICTURES: Duration = Duration::from_millis(30);

/// Pauses for [`BETWEEN_PICTURES`].
pub fn pause() {
    std::thread::park_timeout(BETWEEN_PICTURES);
}

/// Runs the window until `done`; decoding and drawing happen on other threads.
///
/// # Panics
/// After 120 s.
pub fn run_until(window: &mut Harness<'_, App>, done: impl Fn(&App) -> bool) {
    let begun = Instant::now();
    loop {
        window.step();
        if done(window.state()) {
            return;
        }
        assert!(begun.elapsed() < Duration::from_secs(120), "it does not come");
        pause();
    }
}

/// Clicks at a position.
pub fn click_at<S>(window: &mut Harness<'_, S>, at: egui::Pos2) {
    window.hover_at(at);
    window.step();
    window.drag_at(at);
    window.step();
    window.drop_at(at);
    window.run_steps(2);
}

/// Presses a key and runs the window for two steps.
pub fn press_key(window: &mut Harness<'_, App>, key: egui::Key) {
    window.key_press(key);
    window.run_steps(2);
}

pub fn type_text(window: &mut Harness<'_, App>, text: &str) {
    window.event(egui::Event::Text(text.to_owned()));
    window.step();
}

/// Drags in small steps, as a user does, without releasing the button.
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

/// Releases the button and runs the window for two steps.
pub fn release_at(window: &mut Harness<'_, App>, at: egui::Pos2) {
    window.drop_at(at);
    window.run_steps(2);
}

/// Names of the steps that can be undone.
pub fn steps(window: &Harness<'_, App>) -> Vec<String> {
    window.state().project().history().names().0.map(str::to_owned).collect()
}

/// Drops a file onto the window in its next frame.
pub fn drop_file<S>(window: &mut Harness<'_, S>, path: PathBuf) {
    window.input_mut().dropped_files.push(Arc::new(Dropped(path)));
}

/// Drops a model and waits until the next click places it.
pub fn drop_model(window: &mut Harness<'_, App>, path: PathBuf) {
    drop_file(window, path);
    wait_for_label(window, "Click in the picture, or press and drag to turn it; Esc ends it.");
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

/// Enters a text into the search field, which filters the parameters of all groups.
pub fn search(window: &mut Harness<'_, App>, words: &str) {
    window.get_by_role_and_label(Role::TextInput, "Search parameters").focus();
    window.step();
    window.key_press_modifiers(Modifiers::COMMAND, Key::A);
    window.step();
    window.get_by_role_and_label(Role::TextInput, "Search parameters").type_text(words);
    window.run_steps(3);
}

pub fn has_label<S>(window: &Harness<'_, S>, label: &str) -> bool {
    window.query_all_by_label(label).count() > 0
}

/// Presses a button or an item of a menu.
pub fn press(window: &mut Harness<'_, App>, label: &str) {
    window.get_by_label(label).click();
    window.run_steps(3);
}

/// Chooses a path in a file dialog by the button with this label.
pub fn answer(window: &mut Harness<'_, App>, path: &Path, button: &str) {
    window.run_steps(3);
    let field = window.get_by_role_and_label(Role::TextInput, "File name");
    field.focus();
    window.step();
    window.key_press_modifiers(Modifiers::COMMAND, Key::A);
    window.step();
    window.get_by_role_and_label(Role::TextInput, "File name").type_text(path.to_str().unwrap());
    // The dialog needs several frames for its new size.
    window.run_steps(6);
    // The button appears once the folder is listed.
    wait_for_label(window, button);
    window.get_by_label(button).click();
    // The dialog closes after a check of the disk.
    let is_closed = |window: &Harness<'_, App>| window.query_by_role_and_label(Role::TextInput, "File name").is_none();
    wait_for(window, "the end of the dialog", is_closed);
    window.run_steps(2);
}

/// Runs the window until a widget has this label; files are read on other threads.
pub fn wait_for_label<S>(window: &mut Harness<'_, S>, label: &str) {
    wait_for(window, label, |window| has_label(window, label));
}

/// Runs the window until `done`.
///
/// # Panics
/// After 120 s, with `awaited` and the labels of the window in the message.
pub fn wait_for<S>(window: &mut Harness<'_, S>, awaited: &str, done: impl Fn(&Harness<'_, S>) -> bool) {
    let begun = Instant::now();
    while !done(window) {
        assert!(begun.elapsed() < Duration::from_secs(120), "{awaited} does not come; labels: {:?}", labels(window));
        window.step();
        pause();
    }
}

/// All labels of the window.
fn labels<S>(window: &Harness<'_, S>) -> Vec<String> {
    let nodes = window.root().children_recursive();
    nodes.filter_map(|node| node.accesskit_node().label().or(node.accesskit_node().value())).collect()
}

/// Label of a parameter's control.
pub fn control_label(window: &Harness<'_, App>, table: &str, name: &str) -> String {
    let edit = window.state().project().edit();
    let mut tables = edit.rig.tables().into_iter().chain(edit.settings.tables());
    locard::params::called(tables.find(|params| params.table() == table).unwrap(), name)
}

/// Code values of the picture in the window.
pub fn shown_codes(window: &Harness<'_, App>) -> Vec<[u8; 3]> {
    let viewer = window.state().viewer();
    let texels = gpu::read_back(viewer.gpu(), &viewer.composite().unwrap().texture);
    texels.into_iter().map(|[r, g, b, _]| [r, g, b]).collect()
}

pub fn codes(pixels: &Pixels) -> Vec<[u8; 3]> {
    pixels.codes.eight_bit().unwrap().chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect()
}
