//! A window with the full text of a message, to be read, selected and copied.

use eframe::egui::{self, Context, InnerResponse};

use super::question::as_dialog;

/// The window of a message. A press beside it closes it, and also acts on the widget there.
#[derive(Clone, Debug)]
pub struct MessageWindow {
    text: String,
    /// The frame in which it was opened: the press that opens it does not close it.
    opened_in: Option<u64>,
}

impl MessageWindow {
    pub fn new(text: String) -> Self {
        Self { text, opened_in: None }
    }

    /// Shows it. Returns true when it is closed.
    pub fn show(&mut self, ctx: &Context) -> bool {
        let (mut is_closed, mut is_open) = (false, true);
        let window = egui::Window::new("Message")
            .open(&mut is_open)
            .collapsible(false)
            .resizable(false)
            .anchor(egui::Align2::CENTER_CENTER, egui::Vec2::ZERO)
            .show(ctx, |ui| {
                ui.set_width(520.0_f32.min(ctx.content_rect().width() - 48.0));
                egui::ScrollArea::vertical().max_height(300.0).show(ui, |ui| {
                    ui.add(egui::Label::new(&self.text).wrap().selectable(true));
                });
                ui.add_space(8.0);
                ui.horizontal(|ui| {
                    if ui.button("Copy").clicked() {
                        ui.ctx().copy_text(self.text.clone());
                    }
                    is_closed = ui.button("Close").clicked();
                });
            });
        as_dialog(ctx, window.as_ref());
        is_closed || !is_open || self.is_pressed_beside(ctx, window.as_ref())
    }

    fn is_pressed_beside<T>(&mut self, ctx: &Context, window: Option<&InnerResponse<T>>) -> bool {
        let frame = ctx.cumulative_frame_nr();
        let rect = window.map(|window| window.response.rect);
        let is_beside = |at: egui::Pos2| rect.is_some_and(|rect| !rect.contains(at));
        let is_pressed = ctx.input(|i| i.pointer.any_pressed() && i.pointer.interact_pos().is_some_and(is_beside));
        *self.opened_in.get_or_insert(frame) != frame && is_pressed
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use eframe::egui::{Event, Modifiers, PointerButton, Pos2, RawInput, Rect, pos2, vec2};

    /// A press and release within one frame, as a quick click in a slow window.
    fn click(at: Pos2) -> RawInput {
        let button = |pressed| Event::PointerButton {
            pos: at,
            button: PointerButton::Primary,
            pressed,
            modifiers: Modifiers::NONE,
        };
        let screen_rect = Some(Rect::from_min_size(Pos2::ZERO, vec2(800.0, 600.0)));
        RawInput {
            screen_rect,
            events: vec![Event::PointerMoved(at), button(true), button(false)],
            ..Default::default()
        }
    }

    fn show(ctx: &Context, message: &mut MessageWindow, input: RawInput) -> bool {
        let mut is_closed = false;
        let mut output = ctx.run_ui(input, |ui| is_closed = message.show(ui.ctx()));
        output.textures_delta.clear();
        is_closed
    }

    #[test]
    fn a_quick_click_opens_a_message_and_a_later_one_beside_it_closes_it() {
        let ctx = Context::default();
        let mut message = MessageWindow::new("The disk is full".to_owned());
        assert!(!show(&ctx, &mut message, click(pos2(5.0, 5.0))), "closed by the click that opened it");
        assert!(!show(&ctx, &mut message, RawInput { events: Vec::new(), ..click(Pos2::ZERO) }));
        assert!(!show(&ctx, &mut message, click(pos2(400.0, 300.0))), "a click into it");
        assert!(show(&ctx, &mut message, click(pos2(5.0, 5.0))));
    }
}
