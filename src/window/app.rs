//! The window: one frame of it is one call of [`App::ui`](eframe::App::ui).

mod acts;
mod bar;
mod panels;
mod seen;
mod status;

use std::path::{Path, PathBuf};

use eframe::egui::{self, Ui};
use eframe::egui_wgpu::RenderState;
use glam::DVec2;

use self::panels::PanelTabs;
use super::autosave::Left;
use super::camera;
use super::errand::let_go;
use super::evidence::Evidence;
use super::fit;
use super::hand::Hand;
use super::handles::Handles;
use super::keeper::{Keeper, Turn};
use super::keys;
use super::lamps::Lamps;
use super::measure::Measure;
use super::notice::Refusal;
use super::obstacle::NearestPose;
use super::painter;
use super::picture::View;
use super::placed::Placed;
use super::player::Player;
use super::project::Project;
use super::recent::At;
use super::session::Session;
use super::side::Side;
use super::steered::Steered;
use super::theme;
use super::timeline::{self, Held, Told};
use super::titles;
use super::viewer::Viewer;
use super::warnings::Warnings;
use locard_engine::live;
use locard_engine::scene::Thing;

/// The tuner.
pub struct App {
    session: Session,
    pub view: View,
    side: Side,
    evidence: Evidence,
    lamps: Lamps,
    hand: Hand,
    handles: Handles,
    keeper: Keeper,
    window: RenderState,
    shows_keys: bool,
    shows_history: bool,
    /// The notice that the camera is missing was closed.
    hides_obstacle: bool,
    /// Why the last click in the picture had no effect.
    refusal: Option<Refusal>,
    panel_tabs: PanelTabs,
    nearest_pose: NearestPose,
    warnings: Warnings,
    /// The window's title as it was set last.
    title: String,
    placed: Option<Placed>,
    steered: Steered,
    measure: Option<Measure>,
    held: Held,
    /// Something had the keyboard when the last frame of the window ended.
    was_typing: bool,
}

impl App {
    /// Takes the window's device.
    pub fn new(
        context: &eframe::CreationContext<'_>,
        project: Project,
        camera: Option<live::Opened>,
    ) -> Result<Self, String> {
        theme::install(&context.egui_ctx);
        Self::begin(&context.egui_ctx, painter::of_window(context)?, project, camera)
    }

    /// In a window that has its painter already. The project is a recording's, or that of a camera, which starts now.
    pub fn begin(
        ctx: &egui::Context,
        window: RenderState,
        project: Project,
        camera: Option<live::Opened>,
    ) -> Result<Self, String> {
        Ok(Self {
            session: session(&window, ctx, project, camera)?,
            view: View::default(),
            side: Side::default(),
            evidence: Evidence::default(),
            lamps: Lamps::default(),
            hand: Hand::default(),
            handles: Handles::default(),
            keeper: Keeper::default(),
            window,
            shows_keys: false,
            shows_history: false,
            hides_obstacle: false,
            refusal: None,
            panel_tabs: PanelTabs::default(),
            nearest_pose: NearestPose::default(),
            warnings: Warnings::default(),
            title: String::new(),
            placed: None,
            steered: Steered::default(),
            measure: None,
            held: Held::default(),
            was_typing: false,
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

    /// Goes on where one was, with the work that was left there.
    pub fn go_on(&mut self, at: At, left: Option<Left>) {
        if !self.session.is_live() {
            self.session.player.seek(at.frame);
        }
        self.view.look_at(at.zoom, at.centre);
        if let Some(left) = left {
            self.keeper.take_up(left);
        }
    }

    /// Where one is.
    fn at(&self) -> At {
        At { frame: self.session.player.frame(), zoom: self.view.zoom, centre: self.view.centre.into() }
    }

    /// Shows the page that says what can be opened.
    pub fn show_start(&mut self, shows: bool) {
        self.keeper.shows_start = shows;
    }

    /// Records what comes from the camera into a new folder.
    pub fn record(&mut self, folder: PathBuf) {
        self.session.record(folder);
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
    pub fn selected(&self) -> Option<Thing> {
        self.evidence.selected
    }

    /// The outline of what the next click would place, px of the picture, while something is placed.
    pub fn previewed(&self) -> Option<&[Vec<DVec2>]> {
        self.evidence.previewed()
    }

    /// Where a place of the picture, px, is on the screen.
    pub fn on_screen(&self, at_px: egui::Vec2) -> Option<egui::Pos2> {
        self.placed.map(|placed| placed.screen(at_px))
    }

    /// What is wrong, as the window says it.
    pub fn problem(&self) -> Option<&str> {
        self.session.problem()
    }

    /// What was done, as the window says it.
    pub fn said(&self) -> Option<&str> {
        self.session.said()
    }

    /// The window's title.
    pub fn title(&self) -> &str {
        &self.title
    }

    /// Whether the picture that is shown is finished, and is that of all that is set now.
    pub fn is_settled(&self) -> bool {
        self.session.is_settled()
    }

    /// The number of the frame whose picture is shown.
    pub fn shown_frame(&self) -> Option<usize> {
        self.session.frame().map(|frame| frame.index)
    }

    /// Files, dialogs, exports. What was opened meanwhile takes the place of what is open.
    fn keep(&mut self, ctx: &egui::Context) {
        if let Some(missing) = self.evidence.locates.take() {
            self.keeper.choose_missing(&self.session.project, missing);
        }
        let turn = self.keeper.work(ctx, &mut self.session);
        if let Some(model) = self.keeper.take_model() {
            self.evidence.drop(model);
        }
        let Some(Turn { project, camera, at }) = turn else { return };
        self.keeper.leaves(&self.session.project, self.at());
        match session(&self.window, ctx, project, camera) {
            Ok(session) => {
                // Its threads end when what they decode and draw is done.
                let_go(std::mem::replace(&mut self.session, session));
                (self.view, self.evidence, self.hand) = Default::default();
                (self.handles, self.side, self.lamps) = Default::default();
                (self.hides_obstacle, self.refusal) = Default::default();
                self.panel_tabs = self.panel_tabs.reopened();
                self.go_on(at, None);
                self.keeper.turned(&self.session);
            }
            Err(why) => self.session.wrong(why),
        }
    }

    /// Names in the window's title what is open.
    fn set_title(&mut self, ctx: &egui::Context) {
        let title = titles::of_window(&self.session.project);
        if title != self.title {
            ctx.send_viewport_cmd(egui::ViewportCommand::Title(title.clone()));
            self.title = title;
        }
    }

    fn windows(&mut self, ctx: &egui::Context) {
        keys::show(ctx, &mut self.shows_keys);
        let mut chosen = None;
        // Below the bar, beside the evidence.
        let history = egui::Window::new("History").default_pos([212.0, 48.0]).default_width(240.0);
        history.open(&mut self.shows_history).show(ctx, |ui| {
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

fn session(
    window: &RenderState,
    ctx: &egui::Context,
    project: Project,
    camera: Option<live::Opened>,
) -> Result<Session, String> {
    match camera {
        Some(camera) => Session::live(window.clone(), ctx, project, camera),
        None => Session::new(window.clone(), ctx, project),
    }
}

impl eframe::App for App {
    fn on_exit(&mut self) {
        self.keeper.leaves(&self.session.project, self.at());
    }

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
        egui::Panel::bottom("status").frame(panel).show(ui, |ui| self.status(ui));
        egui::Panel::bottom("time").frame(panel).show(ui, |ui| {
            ui.add_space(3.0);
            let session = &mut self.session;
            let times_s = &session.project.shot().recording.timestamps_s;
            // From the first frame on: a recording's own clock may count from 1970.
            let of = |frame: usize| times_s.get(frame).copied().unwrap_or(0.0);
            let time_s = of(session.player.frame()) - of(0);
            if session.is_live() {
                camera::show(ui, session);
            } else {
                let told = Told { time_s, shown_per_s: session.pictures_per_s(), reduced_by: session.reduced_by() };
                timeline::strip(ui, &mut session.player, session.thumbnails.as_ref(), &mut self.held);
                ui.add_space(3.0);
                timeline::show(ui, &mut session.player, &told);
            }
            if let Some(asked) = camera::buttons(ui, session) {
                self.keeper.of_camera(ui.ctx(), session, asked);
            }
            ui.add_space(2.0);
        });
        self.update_evidence();
        if !self.view.alone {
            self.panels(ui, panel);
        }
        egui::CentralPanel::default().frame(egui::Frame::NONE).show(ui, |ui| self.picture(ui));
        self.windows(&ctx);
        self.keep(&ctx);
        self.set_title(&ctx);
        if !self.keeper.holds_picture() {
            self.session.make(&ctx);
        }
        self.was_typing = ctx.egui_wants_keyboard_input();
    }
}
