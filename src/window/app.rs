//! The window: one frame of it is one call of [`App::ui`](eframe::App::ui).

use std::collections::VecDeque;

use std::time::Instant;

use eframe::egui::{self, Key, KeyboardShortcut, Modifiers, Ui};
use glam::DVec2;

use super::controls::Controls;
use super::evidence::Evidence;
use super::picture::{self, Placed, View};
use super::player::Player;
use super::project::Project;
use super::reader::Reader;
use super::timeline::{self, Told};
use super::viewer::Viewer;
use crate::compositor::FrameStats;
use crate::frame::Frame;

const UNDO: KeyboardShortcut = KeyboardShortcut::new(Modifiers::COMMAND, Key::Z);
const REDO: KeyboardShortcut = KeyboardShortcut::new(Modifiers::COMMAND.plus(Modifiers::SHIFT), Key::Z);
const REDO_TOO: KeyboardShortcut = KeyboardShortcut::new(Modifiers::COMMAND, Key::Y);
const SAVE: KeyboardShortcut = KeyboardShortcut::new(Modifiers::COMMAND, Key::S);

/// Every key with what it does, as the window lists them.
const KEYS: [(&str, &str); 14] = [
    ("Space", "play, pause"),
    ("Left, Right", "one frame back, on (Shift: ten)"),
    ("Home, End", "first, last frame"),
    ("\\ held", "the camera's own picture"),
    ("W", "wipe between camera and composite"),
    ("F", "the whole picture"),
    ("1", "one screen pixel to each of the picture's"),
    ("+ -", "larger, smaller"),
    ("Wheel, drag", "zoom about the pointer, move"),
    ("Ctrl+Z", "undo"),
    ("Ctrl+Shift+Z", "redo"),
    ("Ctrl+S", "save profile and scene"),
    ("T", "light or dark"),
    ("?", "these keys"),
];

/// What the picture that is shown was made of.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Made {
    frame: usize,
    version: u64,
}

/// The tuner.
pub struct App {
    project: Project,
    viewer: Viewer,
    reader: Reader,
    player: Player,
    pub view: View,
    controls: Controls,
    evidence: Evidence,
    /// The frame that was decoded last.
    frame: Option<Frame>,
    /// The frame that the reader was asked for, as long as it has not come.
    asked: Option<usize>,
    /// Nothing more is decoded.
    reader_ended: bool,
    /// The frame that could not be decoded last.
    failed: Option<usize>,
    made: Option<Made>,
    stats: Option<FrameStats>,
    /// When pictures of the last second were begun.
    begun: VecDeque<Instant>,
    /// What went wrong last; stays until something goes right.
    problem: Option<String>,
    /// What was done last.
    said: Option<String>,
    /// A person wants to close the window and has not saved.
    asks_to_close: bool,
    /// And has said that the changes may be lost.
    may_close: bool,
    shows_keys: bool,
    shows_history: bool,
    placed: Option<Placed>,
}

impl App {
    /// Takes the window's device.
    pub fn new(context: &eframe::CreationContext<'_>, project: Project) -> Result<Self, String> {
        let window = context.wgpu_render_state.clone().ok_or("the window has no device that Locard can draw with")?;
        let viewer = Viewer::new(window, &project);
        let wake = context.egui_ctx.clone();
        let reader = Reader::new(project.shot().recording.clone(), move || wake.request_repaint())
            .map_err(|e| format!("no thread can be had that decodes: {e}"))?;
        let player = Player::new(&project.shot().recording.timestamps_s);
        Ok(Self {
            project,
            viewer,
            reader,
            player,
            view: View::default(),
            controls: Controls::default(),
            evidence: Evidence::default(),
            frame: None,
            asked: None,
            reader_ended: false,
            failed: None,
            made: None,
            stats: None,
            begun: VecDeque::new(),
            problem: None,
            said: None,
            asks_to_close: false,
            may_close: false,
            shows_keys: false,
            shows_history: false,
            placed: None,
        })
    }

    pub fn project(&self) -> &Project {
        &self.project
    }

    pub fn project_mut(&mut self) -> &mut Project {
        &mut self.project
    }

    pub fn player_mut(&mut self) -> &mut Player {
        &mut self.player
    }

    pub fn viewer(&self) -> &Viewer {
        &self.viewer
    }

    /// Where a place of the picture, px, is on the screen.
    pub fn on_screen(&self, at_px: egui::Vec2) -> Option<egui::Pos2> {
        self.placed.map(|placed| placed.rect.min + at_px * placed.scale)
    }

    /// What is wrong, as the window says it.
    pub fn problem(&self) -> Option<&str> {
        self.problem.as_deref()
    }

    /// Whether the picture that is shown is finished, and is that of all that is set now.
    pub fn is_settled(&self) -> bool {
        let wanted = Made { frame: self.player.frame(), version: self.project.version() };
        self.made == Some(wanted) && !self.viewer.is_busy()
    }

    /// Decodes and composites what is due, as far as that does not wait.
    fn work(&mut self, ctx: &egui::Context) {
        let busy = self.viewer.is_busy();
        let frame = self.player.frame();
        let is_shown = self.made.is_some_and(|made| made.frame == frame) && !busy;
        self.player.advance(f64::from(ctx.input(|i| i.unstable_dt)), is_shown);
        loop {
            match self.reader.take() {
                Ok(Some((index, decoded))) => {
                    self.asked = self.asked.filter(|asked| *asked != index);
                    match decoded {
                        Ok(frame) => {
                            self.frame = Some(frame);
                            self.failed = None;
                        }
                        Err(error) => {
                            self.failed = Some(index);
                            self.problem = Some(error.to_string());
                            self.player.play(false);
                        }
                    }
                }
                Ok(None) => break,
                Err(()) => {
                    self.reader_ended = true;
                    self.problem.get_or_insert_with(|| "decoding has ended".to_owned());
                    break;
                }
            }
        }
        let due = self.player.frame();
        let is_there = self.frame.as_ref().is_some_and(|frame| frame.index == due);
        if self.asked.is_none() && !is_there && self.failed != Some(due) && !self.reader_ended {
            self.reader.ask(due);
            self.asked = Some(due);
        }
        if let Some(frame) = self.frame.as_ref().filter(|_| !busy) {
            let wanted = Made { frame: frame.index, version: self.project.version() };
            if self.made != Some(wanted) {
                if self.made.is_none_or(|made| made.frame != frame.index) {
                    self.viewer.show_plain(frame);
                }
                let wake = ctx.clone();
                match self.viewer.show(&self.project, frame, move || wake.request_repaint()) {
                    Ok(stats) => {
                        self.stats = Some(stats);
                        self.problem = None;
                    }
                    Err(error) => {
                        self.problem = Some(error.to_string());
                        let _ = self.viewer.gpu().take_failure();
                    }
                }
                self.made = Some(wanted);
                let now = Instant::now();
                self.begun.push_back(now);
                self.begun.retain(|begun| now.duration_since(*begun).as_secs_f64() < 1.0);
            }
        }
        if self.player.playing || !self.is_settled() {
            ctx.request_repaint();
        }
    }

    fn keys(&mut self, ctx: &egui::Context) {
        // Keys of the picture are letters where text is typed.
        let typing = ctx.egui_wants_keyboard_input();
        if ctx.input_mut(|i| i.consume_shortcut(&REDO) || i.consume_shortcut(&REDO_TOO)) {
            self.redo();
        }
        if ctx.input_mut(|i| i.consume_shortcut(&UNDO)) {
            self.undo();
        }
        if ctx.input_mut(|i| i.consume_shortcut(&SAVE)) {
            self.save();
        }
        self.view.plain = !typing && ctx.input(|i| i.key_down(Key::Backslash));
        if typing {
            return;
        }
        for file in ctx.input(|i| i.raw.dropped_files.clone()) {
            let path = file.path().to_owned();
            if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("glb") || e.eq_ignore_ascii_case("gltf")) {
                self.evidence.drop(path);
            } else {
                self.said = Some(format!("{}: .glb and .gltf models can be dropped here", path.display()));
            }
        }
        let pressed = |key| ctx.input(|i| i.key_pressed(key) && !i.modifiers.command);
        let far = if ctx.input(|i| i.modifiers.shift) { 10 } else { 1 };
        if pressed(Key::Space) {
            self.player.play(!self.player.playing);
        }
        // Of a key that is held several presses come at once.
        let times = |key| ctx.input(|i| i.num_presses(key)) as isize;
        let steps = times(Key::ArrowRight) - times(Key::ArrowLeft);
        if steps != 0 {
            self.player.step(steps * far);
        }
        if pressed(Key::Home) {
            self.player.step(isize::MIN);
        }
        if pressed(Key::End) {
            self.player.step(isize::MAX);
        }
        if pressed(Key::W) {
            self.view.wipe = if self.view.wipe.is_some() { None } else { Some(0.5) };
        }
        if pressed(Key::F) {
            self.view.zoom = None;
        }
        if pressed(Key::Num1) {
            self.view.zoom = Some(1.0);
        }
        let zoom = self.view.zoom.or(self.placed.map(|placed| placed.scale * ctx.pixels_per_point()));
        if pressed(Key::Plus) || pressed(Key::Equals) {
            self.view.zoom = zoom.map(|zoom| (zoom * 2.0).min(64.0));
        }
        if pressed(Key::Minus) {
            self.view.zoom = zoom.map(|zoom| (zoom * 0.5).max(1.0 / 32.0));
        }
        if pressed(Key::T) {
            let dark = ctx.global_style().visuals.dark_mode;
            ctx.set_theme(if dark { egui::Theme::Light } else { egui::Theme::Dark });
        }
        if pressed(Key::Questionmark) || pressed(Key::F1) {
            self.shows_keys = !self.shows_keys;
        }
        if pressed(Key::Escape) {
            self.evidence.cancel();
            (self.shows_keys, self.shows_history) = (false, false);
        }
    }

    fn undo(&mut self) {
        if let Some(name) = self.project.undo() {
            self.said = Some(format!("Undone: {name}"));
        }
    }

    fn redo(&mut self) {
        if let Some(name) = self.project.redo() {
            self.said = Some(format!("Done again: {name}"));
        }
    }

    fn save(&mut self) {
        let scene = self.project.scene_path();
        if self.project.scene_is_changed()
            && let Err(error) = self.project.save_scene(&scene)
        {
            self.said = Some(format!("Not saved: {error}"));
            return;
        }
        if self.project.is_saved() {
            self.said = Some(format!("Saved {}", scene.display()));
            return;
        }
        let Some(path) = self.project.profile.clone() else {
            self.said =
                Some("There is no profile to save to: open with --profile FILE, which may be a new one".to_owned());
            return;
        };
        self.said = Some(match self.project.save_profile(&path) {
            Ok(()) => format!("Saved {}", path.display()),
            Err(error) => format!("Not saved: {error}"),
        });
    }

    fn bar(&mut self, ui: &mut Ui) {
        ui.horizontal(|ui| {
            let recording = &self.project.shot().recording;
            let star = if self.project.is_saved() { "" } else { " •" };
            ui.strong(format!("{}{star}", recording.name)).on_hover_text(recording.path.display().to_string());
            ui.separator();
            let (undo, redo) = (self.project.history().can_undo(), self.project.history().can_redo());
            if ui.add_enabled(undo, egui::Button::new("Undo")).on_hover_text("Ctrl+Z").clicked() {
                self.undo();
            }
            if ui.add_enabled(redo, egui::Button::new("Redo")).on_hover_text("Ctrl+Shift+Z").clicked() {
                self.redo();
            }
            ui.toggle_value(&mut self.shows_history, "History");
            let unsaved = !self.project.is_saved();
            if ui.add_enabled(unsaved, egui::Button::new("Save")).on_hover_text("Ctrl+S").clicked() {
                self.save();
            }
            ui.separator();
            if ui.selectable_label(self.view.zoom.is_none(), "Fit").on_hover_text("F").clicked() {
                self.view.zoom = None;
            }
            if ui.selectable_label(self.view.zoom == Some(1.0), "100 %").on_hover_text("1").clicked() {
                self.view.zoom = Some(1.0);
            }
            let mut wiped = self.view.wipe.is_some();
            if ui.toggle_value(&mut wiped, "Wipe").on_hover_text("W: drag the line in the picture").changed() {
                self.view.wipe = wiped.then_some(0.5);
            }
            ui.separator();
            ui.toggle_value(&mut self.shows_keys, "Keys").on_hover_text("?");
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                if let Some(problem) = self.project.problem().or(self.problem.as_deref()) {
                    ui.add(
                        egui::Label::new(egui::RichText::new(problem).color(ui.visuals().error_fg_color)).truncate(),
                    );
                } else if let Some(said) = &self.said {
                    ui.add(egui::Label::new(egui::RichText::new(said).weak()).truncate());
                } else if let Some(why) = self.stats.as_ref().and_then(|stats| stats.no_pose.clone()) {
                    let text = format!("Nothing is drawn here: {why}");
                    ui.add(egui::Label::new(egui::RichText::new(text).color(ui.visuals().warn_fg_color)).truncate());
                }
            });
        });
    }

    /// Asks before anything is lost.
    fn closing(&mut self, ctx: &egui::Context) {
        let closes = ctx.input(|i| i.viewport().close_requested());
        if closes && !self.may_close && !self.project.is_saved() {
            ctx.send_viewport_cmd(egui::ViewportCommand::CancelClose);
            self.asks_to_close = true;
        }
        if !self.asks_to_close {
            return;
        }
        let (mut save, mut discard, mut stay) = (false, false, false);
        egui::Modal::new(egui::Id::unique("closing")).show(ctx, |ui| {
            ui.set_max_width(340.0);
            ui.heading("Save what you have changed?");
            ui.label("The changes since the last save are lost otherwise.");
            ui.add_space(8.0);
            ui.horizontal(|ui| {
                save = ui.button("Save and close").clicked();
                discard = ui.button("Close without saving").clicked();
                stay = ui.button("Stay").clicked();
            });
        });
        if save {
            self.save();
            discard = self.project.is_saved();
        }
        self.asks_to_close = !(save || discard || stay);
        if discard {
            self.may_close = true;
            ctx.send_viewport_cmd(egui::ViewportCommand::Close);
        }
    }

    fn windows(&mut self, ctx: &egui::Context) {
        egui::Window::new("Keys")
            .open(&mut self.shows_keys)
            .resizable(false)
            .anchor(egui::Align2::CENTER_CENTER, egui::Vec2::ZERO)
            .show(ctx, |ui| {
                egui::Grid::new("keys").num_columns(2).spacing([16.0, 6.0]).show(ui, |ui| {
                    for (key, does) in KEYS {
                        ui.strong(key);
                        ui.label(does);
                        ui.end_row();
                    }
                });
            });
        let mut chosen = None;
        egui::Window::new("History").open(&mut self.shows_history).default_width(240.0).show(ctx, |ui| {
            egui::ScrollArea::vertical().max_height(360.0).stick_to_bottom(true).show(ui, |ui| {
                let (names, at) = self.project.history().names();
                for (step, name) in names.enumerate() {
                    let text = egui::RichText::new(name);
                    let text = if step > at { text.weak() } else { text };
                    if ui.selectable_label(step == at, text).clicked() {
                        chosen = Some(step);
                    }
                }
            });
        });
        if let Some(step) = chosen {
            self.project.go_to(step);
        }
    }
}

impl eframe::App for App {
    fn ui(&mut self, ui: &mut Ui, _: &mut eframe::Frame) {
        let ctx = ui.ctx().clone();
        self.keys(&ctx);
        self.work(&ctx);
        egui::Panel::top("bar").show(ui, |ui| self.bar(ui));
        egui::Panel::bottom("time").show(ui, |ui| {
            ui.add_space(3.0);
            let time_s = self.project.shot().recording.timestamps_s.get(self.player.frame()).copied().unwrap_or(0.0);
            let told = Told { time_s, shown_per_s: self.begun.len() as f64 };
            timeline::show(ui, &mut self.player, &told);
            ui.add_space(2.0);
        });
        egui::Panel::right("controls").default_size(390.0).size_range(320.0..=700.0).show(ui, |ui| {
            ui.add_space(4.0);
            if let Some(refused) = self.controls.show(ui, &mut self.project) {
                self.said = Some(refused);
            }
        });
        egui::Panel::left("evidence").default_size(170.0).size_range(140.0..=400.0).show(ui, |ui| {
            ui.add_space(4.0);
            if let Some(wrong) = self.evidence.show(ui, &mut self.project) {
                self.said = Some(wrong);
            }
        });
        egui::CentralPanel::default().frame(egui::Frame::NONE).show(ui, |ui| {
            let seen = picture::show(ui, &mut self.view, &self.viewer, self.evidence.is_placing());
            self.placed = seen.map(|seen| seen.placed);
            if self.evidence.is_placing() && seen.is_some_and(|seen| seen.pointed.is_some()) {
                ctx.set_cursor_icon(egui::CursorIcon::Crosshair);
            }
            let clicked = seen.and_then(|seen| seen.clicked).filter(|_| self.evidence.is_placing());
            if let (Some(at), Some(frame)) = (clicked, &self.frame) {
                let at = DVec2::new(at.x.into(), at.y.into());
                self.said = self.evidence.place(&mut self.project, frame, at).err();
            }
        });
        self.windows(&ctx);
        self.closing(&ctx);
    }
}
