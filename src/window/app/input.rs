//! Handles keys and dropped files.

use eframe::egui::{self, Key};

use super::super::actions::{self, Action};
use super::super::camera::CameraCommand;
use super::super::fields;
use super::super::handles::Handles;
use super::super::object_actions;
use super::super::theme;
use super::App;

impl App {
    pub(super) fn act(&mut self, action: Action, ctx: &egui::Context) {
        let is_live = self.session.is_live();
        let player = &mut self.session.player;
        let zoom = self.view.zoom.or(self.placed.map(|placed| placed.scale * ctx.pixels_per_point()));
        match action {
            Action::Play | Action::Camera if is_live => {
                self.documents.handle_camera_request(ctx, &mut self.session, CameraCommand::Freeze);
            }
            Action::Camera => self.documents.handle_camera_request(ctx, &mut self.session, CameraCommand::Live),
            // A live camera only has its newest frame.
            Action::Step(_) | Action::LoopFrom | Action::LoopTo | Action::LoopAll if is_live => {}
            Action::Play => player.play(!player.playing),
            Action::Step(by) => player.step(by),
            Action::LoopFrom => player.set_range(player.frame()..player.range().end.max(player.frame() + 1)),
            Action::LoopTo => player.set_range(player.range().start.min(player.frame())..player.frame() + 1),
            Action::LoopAll => player.set_range(0..player.count()),
            Action::Wipe => self.view.wipe = if self.view.wipe.is_some() { None } else { Some(0.5) },
            Action::Compare => self.compare(),
            Action::Exchange => self.session.project.swap_variant(),
            Action::Loupe => self.view.loupe = !self.view.loupe,
            Action::Alone => self.view.alone = !self.view.alone,
            Action::Fit => self.view.zoom = None,
            Action::OneToOne => self.view.zoom_to(1.0),
            Action::Larger => zoom.into_iter().for_each(|zoom| self.view.zoom_to(zoom * 2.0)),
            Action::Smaller => zoom.into_iter().for_each(|zoom| self.view.zoom_to(zoom * 0.5)),
            Action::Undo => self.undo(),
            Action::Redo => self.redo(),
            Action::Save => self.documents.save(),
            Action::Open => self.documents.open(&self.session.project),
            Action::Export => self.documents.exports.is_open = !self.documents.exports.is_open,
            Action::Theme => theme::toggle(ctx),
            Action::Transform(command) => {
                if !is_live {
                    player.play(false);
                }
                self.handles.begin(command);
            }
            Action::Nudge(right, up) => {
                let frame = self.session.frame().map(|frame| frame.index);
                if let (Some(frame), Some(entry)) = (frame, self.evidence.selected)
                    && let Err(error) = Handles::nudge(&mut self.session.project, frame, entry, right, up)
                {
                    self.session.show_message(error);
                }
            }
            Action::Hide => {
                if let Some(error) = object_actions::hide(&mut self.session.project, self.evidence.selected) {
                    self.session.show_message(error);
                }
            }
            Action::Delete => {
                if let Some(error) = object_actions::delete(&mut self.session.project, &mut self.evidence.selected) {
                    self.session.show_message(error);
                }
            }
            Action::Keys => self.shows_keys = !self.shows_keys,
            Action::Leave => self.leave(),
        }
    }

    /// Ends the tools; without any, closes the windows; without any, clears the selection.
    fn leave(&mut self) {
        if self.tools.cancel() | self.evidence.ground.cancel_scale() {
            return;
        }
        let was_open = self.shows_keys | self.shows_history | self.documents.close_windows();
        (self.shows_keys, self.shows_history) = (false, false);
        if !was_open {
            self.evidence.selected = None;
        }
    }

    pub(super) fn input(&mut self, ctx: &egui::Context) {
        if self.was_typing && ctx.input(|i| i.key_pressed(Key::Escape)) {
            fields::revert_typed(ctx);
        }
        // An open dialog receives all keys.
        if self.documents.is_dialog_open() || ctx.memory(|memory| memory.top_modal_layer().is_some()) {
            return;
        }
        let picks_point = self.tools.active().picks_point();
        match self.session.frame().filter(|_| picks_point && !ctx.egui_wants_keyboard_input()) {
            Some(frame) => {
                let size = egui::vec2(frame.pixels.width as f32, frame.pixels.height as f32);
                self.keyboard_cursor.consume_keys(ctx, size);
            }
            None => self.keyboard_cursor = Default::default(),
        }
        let is_transforming = self.tools.transform().is_some();
        self.handles.consume_keys(ctx, is_transforming, self.evidence.selected.is_some());
        for action in actions::pressed(ctx, self.was_typing) {
            self.act(action, ctx);
        }
        self.view.plain = !ctx.egui_wants_keyboard_input() && ctx.input(|i| i.key_down(Key::Backslash));
        for file in ctx.input(|i| i.raw.dropped_files.clone()) {
            self.documents.open_file(ctx, file.path().to_owned(), &mut self.session);
        }
    }

    /// Starts or ends the A/B comparison.
    pub(super) fn compare(&mut self) {
        let begins = self.session.project.edit().other.is_none();
        self.session.project.compare(begins);
        self.view.wipe = begins.then_some(0.5);
    }

    pub(super) fn undo(&mut self) {
        if let Some(name) = self.session.project.undo() {
            self.session.show_message(format!("Undone: {name}"));
        }
    }

    pub(super) fn redo(&mut self) {
        if let Some(name) = self.session.project.redo() {
            self.session.show_message(format!("Redone: {name}"));
        }
    }
}
