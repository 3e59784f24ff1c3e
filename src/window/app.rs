//! The window: one frame of it is one call of [`App::ui`](eframe::App::ui).

use std::path::Path;

use eframe::egui::{self, Key, Ui};
use eframe::egui_wgpu::RenderState;
use glam::DVec2;

use super::actions::{self, Action};
use super::errand::let_go;
use super::evidence::Evidence;
use super::fit;
use super::hand::Hand;
use super::handles::{Handles, Over};
use super::keeper::{Keeper, Turn};
use super::loupe;
use super::measure::Measure;
use super::painter;
use super::picture::{self, Compared, Seen, Taken, View};
use super::placed::Placed;
use super::player::Player;
use super::project::Project;
use super::session::Session;
use super::side::{Side, fixed};
use super::timeline::{self, Held, Told};
use super::viewer::Viewer;
use crate::frame::Frame;
use crate::scene::Entry;
use crate::words::quoted;

/// The tuner.
pub struct App {
    session: Session,
    pub view: View,
    side: Side,
    evidence: Evidence,
    hand: Hand,
    handles: Handles,
    keeper: Keeper,
    window: RenderState,
    shows_keys: bool,
    shows_history: bool,
    placed: Option<Placed>,
    measure: Option<Measure>,
    held: Held,
}

impl App {
    /// Takes the window's device. What does not change is painted once ([`painter`](super::painter)).
    pub fn new(context: &eframe::CreationContext<'_>, project: Project) -> Result<Self, String> {
        let window = context.wgpu_render_state.as_ref().ok_or("the window has no device that Locard can draw with")?;
        let window = painter::install(&context.egui_ctx, window);
        Ok(Self {
            session: Session::new(window.clone(), &context.egui_ctx, project)?,
            view: View::default(),
            side: Side::default(),
            evidence: Evidence::default(),
            hand: Hand::default(),
            handles: Handles::default(),
            keeper: Keeper::default(),
            window,
            shows_keys: false,
            shows_history: false,
            placed: None,
            measure: None,
            held: Held::default(),
        })
    }

    /// Works the window by itself, prints what it costs, and closes it.
    pub fn measured(self, measure: Measure) -> Self {
        Self { measure: Some(measure), ..self }
    }

    /// Keeps work in a folder of the user's, and offers what a crash has left there.
    pub fn keep_in(&mut self, folder: &Path) {
        self.keeper.keep_in(folder, &mut self.session);
    }

    /// Shows the page that says what can be opened.
    pub fn show_start(&mut self, shows: bool) {
        self.keeper.shows_start = shows;
    }

    /// How the program starts anew where the graphics device is lost; `restart` says why it did not.
    pub fn restarts_by(&mut self, restart: fn() -> String) {
        self.keeper.restarts_by = Some(restart);
    }

    pub fn keeper(&self) -> &Keeper {
        &self.keeper
    }

    pub fn project(&self) -> &Project {
        &self.session.project
    }

    pub fn project_mut(&mut self) -> &mut Project {
        &mut self.session.project
    }

    pub fn player_mut(&mut self) -> &mut Player {
        &mut self.session.player
    }

    pub fn player(&self) -> &Player {
        &self.session.player
    }

    pub fn viewer(&self) -> &Viewer {
        &self.session.viewer
    }

    /// The thing that is selected in the list and in the picture.
    pub fn selected(&self) -> Option<Entry> {
        self.evidence.selected
    }

    /// Where a place of the picture, px, is on the screen.
    pub fn on_screen(&self, at_px: egui::Vec2) -> Option<egui::Pos2> {
        self.placed.map(|placed| placed.screen(at_px))
    }

    /// What is wrong, as the window says it.
    pub fn problem(&self) -> Option<&str> {
        self.session.problem()
    }

    /// Whether the picture that is shown is finished, and is that of all that is set now.
    pub fn is_settled(&self) -> bool {
        self.session.is_settled()
    }

    fn act(&mut self, action: Action, ctx: &egui::Context) {
        let player = &mut self.session.player;
        let zoom = self.view.zoom.or(self.placed.map(|placed| placed.scale * ctx.pixels_per_point()));
        match action {
            Action::Play => player.play(!player.playing),
            Action::Step(by) => player.step(by),
            Action::LoopFrom => player.set_range(player.frame()..player.range().end.max(player.frame() + 1)),
            Action::LoopTo => player.set_range(player.range().start.min(player.frame())..player.frame() + 1),
            Action::LoopAll => player.set_range(0..player.count()),
            Action::Wipe => self.view.wipe = if self.view.wipe.is_some() { None } else { Some(0.5) },
            Action::Compare => self.compare(),
            Action::Exchange => self.session.project.exchange(),
            Action::Loupe => self.view.loupe = !self.view.loupe,
            Action::Alone => self.view.alone = !self.view.alone,
            Action::Fit => self.view.zoom = None,
            Action::OneToOne => self.view.zoom = Some(1.0),
            Action::Larger => self.view.zoom = zoom.map(|zoom| (zoom * 2.0).min(picture::MOST_ZOOM)),
            Action::Smaller => self.view.zoom = zoom.map(|zoom| (zoom * 0.5).max(picture::LEAST_ZOOM)),
            Action::Undo => self.undo(),
            Action::Redo => self.redo(),
            Action::Save => self.keeper.save(),
            Action::Open => self.keeper.open(&self.session.project),
            Action::Export => self.keeper.shows_output = !self.keeper.shows_output,
            Action::Theme => {
                let dark = ctx.global_style().visuals.dark_mode;
                ctx.set_theme(if dark { egui::Theme::Light } else { egui::Theme::Dark });
            }
            Action::Begin(what) => {
                player.play(false);
                self.handles.begin(what);
            }
            Action::Nudge(right, up) => {
                let frame = self.session.frame().map(|frame| frame.index);
                if let (Some(frame), Some(entry)) = (frame, self.evidence.selected)
                    && let Err(wrong) = Handles::nudge(&mut self.session.project, frame, entry, right, up)
                {
                    self.session.say(wrong);
                }
            }
            Action::Hide => {
                if let Some(wrong) = self.evidence.hide(&mut self.session.project) {
                    self.session.say(wrong);
                }
            }
            Action::Delete => {
                if let Some(wrong) = self.evidence.delete(&mut self.session.project) {
                    self.session.say(wrong);
                }
            }
            Action::Keys => self.shows_keys = !self.shows_keys,
            Action::Leave => {
                self.hand.cancel();
                self.evidence.cancel();
                (self.shows_keys, self.shows_history) = (false, false);
            }
        }
    }

    fn input(&mut self, ctx: &egui::Context) {
        // Esc and Enter are the dialog's that is open.
        if self.keeper.is_asking() {
            return;
        }
        self.handles.keys(ctx);
        for action in actions::pressed(ctx) {
            self.act(action, ctx);
        }
        self.view.plain = !ctx.egui_wants_keyboard_input() && ctx.input(|i| i.key_down(Key::Backslash));
        for file in ctx.input(|i| i.raw.dropped_files.clone()) {
            let path = file.path().to_owned();
            if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("glb") || e.eq_ignore_ascii_case("gltf")) {
                self.evidence.drop(path);
            } else {
                self.keeper.dropped(ctx, path, &mut self.session);
            }
        }
    }

    /// Begins or ends to compare two settings.
    fn compare(&mut self) {
        let begins = self.session.project.edit().other.is_none();
        self.session.project.compare(begins);
        self.view.wipe = begins.then_some(0.5);
    }

    fn undo(&mut self) {
        if let Some(name) = self.session.project.undo() {
            self.session.say(format!("Undone: {name}"));
        }
    }

    fn redo(&mut self) {
        if let Some(name) = self.session.project.redo() {
            self.session.say(format!("Done again: {name}"));
        }
    }

    fn bar(&mut self, ui: &mut Ui) {
        ui.horizontal(|ui| {
            let recording = &self.session.project.shot().recording;
            let star = if self.session.project.is_saved() { "" } else { " •" };
            ui.strong(format!("{}{star}", quoted(&recording.name))).on_hover_text(recording.path.display().to_string());
            self.keeper.menu(ui, &mut self.session);
            ui.separator();
            let (undo, redo) = (self.session.project.history().can_undo(), self.session.project.history().can_redo());
            if ui.add_enabled(undo, egui::Button::new("Undo")).on_hover_text("Ctrl+Z").clicked() {
                self.undo();
            }
            if ui.add_enabled(redo, egui::Button::new("Redo")).on_hover_text("Ctrl+Shift+Z").clicked() {
                self.redo();
            }
            ui.toggle_value(&mut self.shows_history, "History");
            let unsaved = !self.session.project.is_saved();
            if ui.add_enabled(unsaved, egui::Button::new("Save")).on_hover_text("Ctrl+S").clicked() {
                self.keeper.save();
            }
            ui.toggle_value(&mut self.keeper.shows_output, "Export").on_hover_text("Ctrl+E");
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
            let edits_b = self.session.project.edit().other.as_ref().map(|other| other.is_a);
            let hint = "B: two settings beside each other";
            if ui.selectable_label(edits_b.is_some(), "A|B").on_hover_text(hint).clicked() {
                self.compare();
            }
            if let Some(edits_b) = edits_b {
                for (name, is_edited) in [("A", !edits_b), ("B", edits_b)] {
                    let label = ui.selectable_label(is_edited, name).on_hover_text("Shift+B: edit the other one");
                    if label.clicked() && !is_edited {
                        self.session.project.exchange();
                    }
                }
                let text = if edits_b { "B to A" } else { "A to B" };
                if ui.button(text).on_hover_text("Copy the settings that are edited to the other one").clicked() {
                    self.session.project.copy_to_other();
                }
            }
            ui.toggle_value(&mut self.view.loupe, "Loupe").on_hover_text("L: code values at the pointer");
            ui.separator();
            ui.toggle_value(&mut self.shows_keys, "Keys").on_hover_text("?");
            ui.with_layout(egui::Layout::right_to_left(egui::Align::Center), |ui| {
                if self.session.lacks_camera() && ui.button("Open a profile…").clicked() {
                    self.keeper.choose_profile(&self.session.project);
                }
                let visuals = ui.visuals();
                let (wrong, odd, weak) = (visuals.error_fg_color, visuals.warn_fg_color, visuals.weak_text_color());
                let no_pose = || self.session.stats().and_then(|stats| stats.no_pose.clone());
                let told = match (self.session.problem(), self.session.said()) {
                    (Some(problem), _) => Some((problem.to_owned(), wrong)),
                    (None, Some(said)) => Some((said.to_owned(), weak)),
                    (None, None) => no_pose().map(|why| (format!("Nothing is drawn here: {why}"), odd)),
                };
                let Some((text, color)) = told else { return };
                let label = egui::Label::new(egui::RichText::new(&text).color(color)).truncate();
                let response = ui.add(label.sense(egui::Sense::click()));
                if response.on_hover_text("Click: all of it").clicked() {
                    self.keeper.message = Some(text);
                }
            });
        });
    }

    /// The picture, and what is done in it.
    fn picture(&mut self, ui: &mut Ui) {
        let frame = self.session.frame().cloned();
        let asked = self.hand.asks_for();
        let is_picking = self.evidence.ground.is_picking() && asked.is_none();
        let is_placing = self.evidence.is_placing() && asked.is_none() && !is_picking;
        let taken = Taken {
            clicks: is_placing || is_picking || asked.is_some(),
            drags: asked.is_some() || self.handles.takes_drags(),
        };
        let other = self.session.project.edit().other.as_ref();
        let compared = other.map(|other| Compared { edits_a: !other.is_a });
        if compared.is_some() && self.view.wipe.is_some() {
            self.session.want_other();
        }
        let viewer = &mut self.session.viewer;
        let seen = picture::show(ui, &mut self.view, viewer, frame.as_deref(), compared, taken);
        self.placed = seen.as_ref().map(|seen| seen.placed);
        let (Some(seen), Some(frame)) = (seen, frame) else { return };
        self.codes(&seen, &frame);
        self.side.over_picture(&seen, frame.index, self.session.player.playing);
        self.hand.work(&seen);
        let over = Over {
            seen: &seen,
            view: &self.view,
            frame: &frame,
            is_free: !is_placing && !is_picking && asked.is_none(),
            is_hidden: self.view.plain || self.session.player.playing,
        };
        match self.handles.show(&over, &mut self.session.project, &mut self.evidence.selected) {
            Some(Ok(done)) => self.session.say(done),
            Some(Err(wrong)) => self.session.say(wrong),
            None => {}
        }
        self.evidence.ground.paint(&seen, &self.session.project, frame.index);
        if is_picking {
            let at = seen.clicked.map(|at| DVec2::new(at.x.into(), at.y.into()));
            match at.map_or(Ok(None), |at| self.evidence.ground.click(&self.session.project, &frame, at)) {
                Ok(said) => said.into_iter().for_each(|said| self.session.say(said)),
                Err(wrong) => self.session.say(wrong),
            }
        }
        if is_placing {
            if seen.pointed.is_some() {
                ui.ctx().set_cursor_icon(egui::CursorIcon::Crosshair);
            }
            if let Some(at) = seen.clicked {
                let at = DVec2::new(at.x.into(), at.y.into());
                match self.evidence.place(&mut self.session.project, &frame, at) {
                    Ok(()) => {
                        self.evidence.ground.finder.told.take().into_iter().for_each(|told| self.session.say(told))
                    }
                    Err(wrong) => self.session.say(wrong),
                }
            }
        }
    }

    /// Code values at the pointer and in pixels that are large enough.
    fn codes(&mut self, seen: &Seen, frame: &Frame) {
        let ppp = seen.response.ctx.pixels_per_point();
        let numbers = seen.placed.scale * ppp >= loupe::NUMBERS_FROM;
        if !numbers && !self.view.loupe {
            return;
        }
        self.session.want_codes();
        let codes = self.session.codes().filter(|codes| codes.frame.index == frame.index);
        if numbers {
            loupe::numbers(seen, seen.camera, &frame.pixels, ppp);
            if let Some(codes) = &codes {
                loupe::numbers(seen, seen.composite, &codes.pixels, ppp);
            }
        }
        if self.view.loupe && seen.pointed.is_some() {
            self.session.viewer.plain(frame);
            let viewer = &self.session.viewer;
            let camera = viewer.camera().map(|shown| loupe::Side { name: "camera", shown, codes: Some(&frame.pixels) });
            let pixels = codes.as_ref().map(|codes| &*codes.pixels);
            let with = viewer.composite().map(|shown| loupe::Side { name: "with evidence", shown, codes: pixels });
            loupe::show(seen, &camera.into_iter().chain(with).collect::<Vec<_>>());
        }
    }

    /// What stands beside the picture.
    fn panels(&mut self, ui: &mut Ui, panel: egui::Frame) {
        egui::Panel::right("controls").frame(panel).default_size(390.0).size_range(350.0..=700.0).show(ui, |ui| {
            if let Some(refused) = self.side.show(ui, &mut self.session, &mut self.hand) {
                self.session.say(refused);
            }
        });
        egui::Panel::left("evidence").frame(panel).default_size(200.0).size_range(140.0..=400.0).show(ui, |ui| {
            let session = &mut self.session;
            let frame = session.frame().cloned();
            let gpu = session.viewer.gpu();
            let evidence = &mut self.evidence;
            let wrong = fixed(ui, |ui| evidence.show(ui, &mut session.project, gpu, frame.as_ref()));
            if let Some(wrong) = wrong {
                self.session.say(wrong);
            }
        });
    }

    /// Files, dialogs, exports. What was opened meanwhile takes the place of what is open.
    fn keep(&mut self, ctx: &egui::Context) {
        let Some(Turn { project, frame }) = self.keeper.work(ctx, &mut self.session) else { return };
        match Session::new(self.window.clone(), ctx, project) {
            Ok(session) => {
                // Its threads end when what they decode and draw is done.
                let_go(std::mem::replace(&mut self.session, session));
                self.session.player.seek(frame);
                (self.view, self.evidence, self.hand) = Default::default();
                (self.handles, self.side) = Default::default();
                self.keeper.turned(&self.session);
            }
            Err(why) => self.session.wrong(why),
        }
    }

    fn windows(&mut self, ctx: &egui::Context) {
        egui::Window::new("Keys")
            .open(&mut self.shows_keys)
            .resizable(false)
            .anchor(egui::Align2::CENTER_CENTER, egui::Vec2::ZERO)
            .show(ctx, |ui| {
                let height = ctx.content_rect().height() - 120.0;
                egui::ScrollArea::vertical().max_height(height.max(100.0)).show(ui, |ui| {
                    egui::Grid::new("keys").num_columns(2).spacing([16.0, 6.0]).show(ui, |ui| {
                        for (key, does) in actions::page() {
                            ui.strong(key);
                            ui.label(does);
                            ui.end_row();
                        }
                    });
                });
            });
        let mut chosen = None;
        egui::Window::new("History").open(&mut self.shows_history).default_width(240.0).show(ctx, |ui| {
            egui::ScrollArea::vertical().max_height(360.0).stick_to_bottom(true).show(ui, |ui| {
                let (names, at) = self.session.project.history().names();
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
            self.session.project.go_to(step);
        }
    }
}

impl eframe::App for App {
    fn clear_color(&self, visuals: &egui::Visuals) -> [f32; 4] {
        visuals.panel_fill.to_normalized_gamma_f32()
    }

    fn ui(&mut self, ui: &mut Ui, _: &mut eframe::Frame) {
        let ctx = ui.ctx().clone();
        fit::to_screen(&ctx);
        self.input(&ctx);
        self.session.take(&ctx);
        if self.measure.as_mut().is_some_and(|measure| measure.step(&mut self.session, &mut self.view, &ctx)) {
            self.keeper.close_without_asking();
            self.measure = None;
            ctx.send_viewport_cmd(egui::ViewportCommand::Close);
        }
        // The window is cleared to the panels' colour: to fill them again would cost more than all else in them.
        let panel = egui::Frame::side_top_panel(ui.style()).fill(egui::Color32::TRANSPARENT);
        egui::Panel::top("bar").frame(panel).show(ui, |ui| self.bar(ui));
        egui::Panel::bottom("time").frame(panel).show(ui, |ui| {
            ui.add_space(3.0);
            let session = &mut self.session;
            let times_s = &session.project.shot().recording.timestamps_s;
            // From the first frame on: a recording's own clock may count from 1970.
            let of = |frame: usize| times_s.get(frame).copied().unwrap_or(0.0);
            let time_s = of(session.player.frame()) - of(0);
            let told = Told { time_s, shown_per_s: session.pictures_per_s(), reduced_by: session.reduced_by() };
            timeline::strip(ui, &mut session.player, session.thumbnails.as_ref(), &mut self.held);
            ui.add_space(3.0);
            timeline::show(ui, &mut session.player, &told);
            ui.add_space(2.0);
        });
        if !self.view.alone {
            self.panels(ui, panel);
        }
        egui::CentralPanel::default().frame(egui::Frame::NONE).show(ui, |ui| self.picture(ui));
        self.windows(&ctx);
        self.keep(&ctx);
        self.session.make(&ctx);
    }
}
