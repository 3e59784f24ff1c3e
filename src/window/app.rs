//! The main window. One call of [`App::ui`](eframe::App::ui) is one frame of the window.

mod bar;
mod document;
mod input;
mod panels;
mod picture;
mod status;

use std::path::{Path, PathBuf};

use eframe::egui::{self, Ui};
use eframe::egui_wgpu::RenderState;
use glam::{DVec2, DVec3};

use self::document::OpenDocument;
use self::panels::PanelTabs;
use super::camera;
use super::documents::{DocumentSwitch, Documents};
use super::keyboard_cursor::KeyboardCursor;
use super::keys;
use super::measure::Measure;
use super::painter;
use super::picture::PictureView;
use super::player::Player;
use super::project::Project;
use super::recent::ViewState;
use super::recovery_search::RecoverableWork;
use super::session::Session;
use super::task::drop_in_background;
use super::theme;
use super::timeline::{self, PlaybackInfo};
use super::titles;
use super::viewer::Viewer;
use super::window_size;
use locard_engine::live;
use locard_engine::scene::SceneItem;

/// The tuner.
pub struct App {
    document: OpenDocument,
    documents: Documents,
    window: RenderState,
    shows_keys: bool,
    shows_history: bool,
    panel_tabs: PanelTabs,
    /// The window's current title.
    title: String,
    keyboard_cursor: KeyboardCursor,
    measure: Option<Measure>,
    /// A field had the keyboard focus at the end of the last frame of the window.
    was_typing: bool,
}

impl App {
    /// Uses the window's graphics device.
    pub fn new(
        context: &eframe::CreationContext<'_>,
        project: Project,
        camera: Option<live::LiveInput>,
    ) -> Result<Self, String> {
        theme::install(&context.egui_ctx);
        Self::begin(&context.egui_ctx, painter::take_over(context)?, project, camera)
    }

    /// Builds the app for a window that already has its painter. The project belongs to a recording
    /// or to a camera, which starts now.
    pub fn begin(
        ctx: &egui::Context,
        window: RenderState,
        project: Project,
        camera: Option<live::LiveInput>,
    ) -> Result<Self, String> {
        Ok(Self {
            document: OpenDocument::new(session(&window, ctx, project, camera)?),
            documents: Documents::default(),
            window,
            shows_keys: false,
            shows_history: false,
            panel_tabs: PanelTabs::default(),
            title: String::new(),
            keyboard_cursor: KeyboardCursor::default(),
            measure: None,
            was_typing: false,
        })
    }

    /// Runs the measurement without a user, prints the costs, and closes the window.
    pub fn measured(self, measure: Measure) -> Self {
        Self { measure: Some(measure), ..self }
    }

    /// Stores state in the user's folder, and offers work to recover from there.
    pub fn set_state_folder(&mut self, folder: &Path) {
        self.documents.set_state_folder(folder, &mut self.document.session);
    }

    /// Restores the view of a document, and adopts recovered work.
    pub fn restore_view(&mut self, at: ViewState, left: Option<RecoverableWork>) {
        if !self.document.session.is_live() {
            self.document.session.player.seek(at.frame);
        }
        self.document.view.look_at(at.zoom, at.centre);
        if let Some(left) = left {
            self.documents.adopt_recovery(left);
        }
    }

    /// Current frame and view.
    fn view_state(&self) -> ViewState {
        ViewState {
            frame: self.document.session.player.frame(),
            zoom: self.document.view.zoom,
            centre: self.document.view.centre.into(),
        }
    }

    /// Opens or closes the welcome page.
    pub fn show_start(&mut self, shows: bool) {
        self.documents.is_start_open = shows;
    }

    /// Records frames of the camera into a new folder.
    pub fn record(&mut self, folder: PathBuf) {
        self.document.session.record(folder);
    }

    /// Sets the function that restarts the program after the graphics device was lost; it returns
    /// an error message.
    pub fn restart_with(&mut self, restart: fn() -> String) {
        self.documents.restart_with(restart);
    }

    pub fn documents(&self) -> &Documents {
        &self.documents
    }

    pub fn project(&self) -> &Project {
        &self.document.session.project
    }

    pub fn project_mut(&mut self) -> &mut Project {
        &mut self.document.session.project
    }

    pub fn player_mut(&mut self) -> &mut Player {
        &mut self.document.session.player
    }

    pub fn player(&self) -> &Player {
        &self.document.session.player
    }

    pub fn viewer(&self) -> &Viewer {
        &self.document.session.viewer
    }

    /// Zoom and display of the picture.
    pub fn view(&self) -> &PictureView {
        &self.document.view
    }

    pub fn view_mut(&mut self) -> &mut PictureView {
        &mut self.document.view
    }

    /// The selected object or lamp.
    pub fn selected(&self) -> Option<SceneItem> {
        self.document.evidence.selected
    }

    /// Outline of the placement preview, px of the picture.
    pub fn preview_outline(&self) -> Option<&[Vec<DVec2>]> {
        self.document.tools.placement()?.preview_outline()
    }

    /// Position of a pixel of the picture on the screen.
    pub fn on_screen(&self, at_px: egui::Vec2) -> Option<egui::Pos2> {
        self.document.placed.map(|placed| placed.screen(at_px))
    }

    /// Position of a visible point of the scan, m in its axes, in the view of the scan.
    pub fn scan_on_screen(&self, point_m: DVec3) -> Option<egui::Pos2> {
        self.document.scan_alignment.on_screen(point_m)
    }

    /// True if the view of the scan is at rest at a time of the window's clock.
    pub fn is_scan_settled(&self, now_s: f64) -> bool {
        self.document.scan_alignment.is_settled(now_s)
    }

    /// The displayed error.
    pub fn problem(&self) -> Option<&str> {
        self.document.session.problem()
    }

    /// The displayed message.
    pub fn message(&self) -> Option<&str> {
        self.document.session.message()
    }

    /// The window's title.
    pub fn title(&self) -> &str {
        &self.title
    }

    /// True if the displayed picture is finished and has the current content at full quality.
    pub fn is_settled(&self) -> bool {
        self.document.session.is_settled()
    }

    /// Index of the displayed frame.
    pub fn shown_frame(&self) -> Option<usize> {
        self.document.session.frame().map(|frame| frame.index)
    }

    /// Runs files, dialogs and exports. Switches to another document once it is open.
    fn update_documents(&mut self, ctx: &egui::Context) {
        if let Some(missing) = self.document.evidence.locates.take() {
            self.documents.choose_missing(&self.document.session.project, missing);
        }
        let turn = self.documents.update(ctx, &mut self.document.session);
        if let Some(model) = self.documents.take_model() {
            self.document.evidence.drop(model, &mut self.document.tools);
        }
        let scan_alignment = &mut self.document.scan_alignment;
        if self.documents.take_scan_panel_request() {
            scan_alignment.open(&self.document.session.project, &mut self.document.tools);
        }
        if let Some(path) = self.documents.take_scan() {
            scan_alignment.read(ctx, path);
        }
        if scan_alignment.take_file_request() {
            self.documents.choose_scan(&self.document.session.project);
        }
        let Some(DocumentSwitch { project, camera, at }) = turn else { return };
        self.documents.remember_document(&self.document.session.project, self.view_state());
        match session(&self.window, ctx, project, camera) {
            Ok(session) => {
                let closed = std::mem::replace(&mut self.document, OpenDocument::new(session));
                // Its threads end after their current decoding and drawing.
                drop_in_background(closed.session);
                self.panel_tabs = self.panel_tabs.reopened();
                self.restore_view(at, None);
                self.documents.document_opened(&self.document.session);
            }
            Err(why) => self.document.session.show_error(why),
        }
    }

    /// Shows the open document in the window's title.
    fn set_title(&mut self, ctx: &egui::Context) {
        let title = titles::of_window(&self.document.session.project);
        if title != self.title {
            ctx.send_viewport_cmd(egui::ViewportCommand::Title(title.clone()));
            self.title = title;
        }
    }

    fn windows(&mut self, ctx: &egui::Context) {
        keys::show(ctx, &mut self.shows_keys);
        let mut chosen = None;
        // Below the bar, beside the evidence panel.
        let history = egui::Window::new("History").default_pos([212.0, 48.0]).default_width(240.0);
        history.open(&mut self.shows_history).show(ctx, |ui| {
            egui::ScrollArea::vertical().max_height(360.0).stick_to_bottom(true).show(ui, |ui| {
                let (names, at) = self.document.session.project.history().names();
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
            self.document.session.project.go_to(step);
        }
    }
}

fn session(
    window: &RenderState,
    ctx: &egui::Context,
    project: Project,
    camera: Option<live::LiveInput>,
) -> Result<Session, String> {
    match camera {
        Some(camera) => Session::live(window.clone(), ctx, project, camera),
        None => Session::new(window.clone(), ctx, project),
    }
}

impl eframe::App for App {
    fn on_exit(&mut self) {
        self.documents.remember_document(&self.document.session.project, self.view_state());
    }

    fn clear_color(&self, visuals: &egui::Visuals) -> [f32; 4] {
        visuals.panel_fill.to_normalized_gamma_f32()
    }

    fn ui(&mut self, ui: &mut Ui, _: &mut eframe::Frame) {
        let ctx = ui.ctx().clone();
        window_size::fit_to_screen(&ctx);
        self.input(&ctx);
        self.document.session.poll(&ctx);
        if self
            .measure
            .as_mut()
            .is_some_and(|measure| measure.step(&mut self.document.session, &mut self.document.view, &ctx))
        {
            self.documents.close_without_asking();
            self.measure = None;
            ctx.send_viewport_cmd(egui::ViewportCommand::Close);
        }
        // The window is cleared to the panels' colour: filling them again would cost more than all
        // of their content.
        let panel = egui::Frame::side_top_panel(ui.style()).fill(egui::Color32::TRANSPARENT);
        egui::Panel::top("bar").frame(panel).show(ui, |ui| self.bar(ui));
        egui::Panel::bottom("status").frame(panel).show(ui, |ui| self.status(ui));
        egui::Panel::bottom("time").frame(panel).show(ui, |ui| {
            ui.add_space(3.0);
            let session = &mut self.document.session;
            let times_s = &session.project.shot().recording.timestamps_s;
            // Relative to the first frame, because a recording's clock may count from 1970.
            let frame_time_s = |frame: usize| times_s.get(frame).copied().unwrap_or(0.0);
            let time_s = frame_time_s(session.player.frame()) - frame_time_s(0);
            if session.is_live() {
                camera::show(ui, session);
            } else {
                let info =
                    PlaybackInfo { time_s, shown_per_s: session.pictures_per_s(), reduced_by: session.reduced_by() };
                timeline::strip(ui, &mut session.player, session.thumbnails.as_ref(), &mut self.document.strip_drag);
                ui.add_space(3.0);
                timeline::show(ui, &mut session.player, &info);
            }
            if let Some(request) = camera::buttons(ui, session) {
                self.documents.handle_camera_request(ui.ctx(), session, request);
            }
            ui.add_space(2.0);
        });
        self.update_evidence();
        self.document.scan_alignment.poll(&mut self.document.session, &mut self.document.tools);
        if !self.document.view.alone {
            self.panels(ui, panel);
        }
        egui::CentralPanel::default().frame(egui::Frame::NONE).show(ui, |ui| self.picture(ui));
        self.windows(&ctx);
        self.update_documents(&ctx);
        self.set_title(&ctx);
        if !self.documents.defers_rendering() {
            self.document.session.request_pictures(&ctx);
        }
        self.was_typing = ctx.egui_wants_keyboard_input();
    }
}
