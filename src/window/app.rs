//! The window: one frame of it is one call of [`App::ui`](eframe::App::ui).

mod acts;
mod bar;
mod seen;

use std::path::Path;

use eframe::egui::{self, Ui};
use eframe::egui_wgpu::RenderState;

use super::actions;
use super::errand::let_go;
use super::evidence::Evidence;
use super::fit;
use super::hand::Hand;
use super::handles::Handles;
use super::keeper::{Keeper, Turn};
use super::measure::Measure;
use super::painter;
use super::picture::View;
use super::placed::Placed;
use super::player::Player;
use super::project::Project;
use super::session::Session;
use super::side::{Side, fixed};
use super::timeline::{self, Held, Told};
use super::viewer::Viewer;
use crate::scene::Entry;

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
