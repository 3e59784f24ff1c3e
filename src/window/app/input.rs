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
        let document = &mut self.document;
        let is_live = document.session.is_live();
        let player = &mut document.session.player;
        let zoom = document.view.zoom.or(document.placed.map(|placed| placed.scale * ctx.pixels_per_point()));
        match action {
            Action::Play | Action::Camera if is_live => {
                self.documents.handle_camera_request(ctx, &mut document.session, CameraCommand::Freeze);
            }
            Action::Camera => self.documents.handle_camera_request(ctx, &mut document.session, CameraCommand::Live),
            // A live camera only has its newest frame.
            Action::Step(_) | Action::LoopFrom | Action::LoopTo | Action::LoopAll if is_live => {}
            Action::Play => player.play(!player.playing),
            Action::Step(by) => player.step(by),
            Action::LoopFrom => player.set_range(player.frame()..player.range().end.max(player.frame() + 1)),
            Action::LoopTo => player.set_range(player.range().start.min(player.frame())..player.frame() + 1),
            Action::LoopAll => player.set_range(0..player.count()),
            Action::Wipe => document.view.wipe = if document.view.wipe.is_some() { None } else { Some(0.5) },
            Action::Compare => self.compare(),
            Action::Exchange => document.session.project.swap_variant(),
            Action::Loupe => document.view.loupe = !document.view.loupe,
            Action::Alone => document.view.alone = !document.view.alone,
            Action::Fit => document.view.zoom = None,
            Action::OneToOne => document.view.zoom_to(1.0),
            Action::Larger => zoom.into_iter().for_each(|zoom| document.view.zoom_to(zoom * 2.0)),
            Action::Smaller => zoom.into_iter().for_each(|zoom| document.view.zoom_to(zoom * 0.5)),
            Action::Undo => self.undo(),
            Action::Redo => self.redo(),
            Action::Save => self.documents.save(),
            Action::Open => self.documents.open(&document.session.project),
            Action::Export => self.documents.output_jobs.is_open = !self.documents.output_jobs.is_open,
            Action::Theme => theme::toggle(ctx),
            Action::Transform(command) => {
                if !is_live {
                    player.play(false);
                }
                document.handles.begin(command);
            }
            Action::Nudge(right, up) => {
                let frame = document.session.frame().map(|frame| frame.index);
                if let (Some(frame), Some(entry)) = (frame, document.evidence.selected)
                    && let Err(error) = Handles::nudge(&mut document.session.project, frame, entry, right, up)
                {
                    document.session.show_message(error);
                }
            }
            Action::Hide => {
                if let Some(error) = object_actions::hide(&mut document.session.project, document.evidence.selected) {
                    document.session.show_message(error);
                }
            }
            Action::Delete => {
                if let Some(error) =
                    object_actions::delete(&mut document.session.project, &mut document.evidence.selected)
                {
                    document.session.show_message(error);
                }
            }
            Action::Keys => self.shows_keys = !self.shows_keys,
            Action::Leave => self.leave(),
        }
    }

    /// Ends the tools; without any, closes the windows; without any, clears the selection.
    fn leave(&mut self) {
        if self.document.tools.cancel() | self.document.evidence.ground.picked.cancel_scale() {
            return;
        }
        let was_open = self.shows_keys | self.shows_history | self.documents.close_windows();
        (self.shows_keys, self.shows_history) = (false, false);
        if !was_open {
            self.document.evidence.selected = None;
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
        let picks_point = self.document.tools.active().picks_point();
        match self.document.session.frame().filter(|_| picks_point && !ctx.egui_wants_keyboard_input()) {
            Some(frame) => {
                let size = egui::vec2(frame.pixels.width as f32, frame.pixels.height as f32);
                self.keyboard_cursor.consume_keys(ctx, size);
            }
            None => self.keyboard_cursor = Default::default(),
        }
        let is_transforming = self.document.tools.transform().is_some();
        self.document.handles.consume_keys(ctx, is_transforming, self.document.evidence.selected.is_some());
        for action in actions::pressed(ctx, self.was_typing) {
            self.act(action, ctx);
        }
        self.document.view.plain = !ctx.egui_wants_keyboard_input() && ctx.input(|i| i.key_down(Key::Backslash));
        for file in ctx.input(|i| i.raw.dropped_files.clone()) {
            self.documents.open_file(ctx, file.path().to_owned(), &mut self.document.session);
        }
    }

    /// Starts or ends the A/B comparison.
    pub(super) fn compare(&mut self) {
        let begins = self.document.session.project.edit().other.is_none();
        self.document.session.project.compare(begins);
        self.document.view.wipe = begins.then_some(0.5);
    }

    pub(super) fn undo(&mut self) {
        if let Some(name) = self.document.session.project.undo() {
            self.document.session.show_message(format!("Undone: {name}"));
        }
    }

    pub(super) fn redo(&mut self) {
        if let Some(name) = self.document.session.project.redo() {
            self.document.session.show_message(format!("Redone: {name}"));
        }
    }
}
