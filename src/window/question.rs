//! Questions: a title, a few sentences, and a button for each answer. Enter takes the default
//! answer, Esc cancels.

use eframe::egui::accesskit::Role;
use eframe::egui::{self, Context, Event, Id, InnerResponse, Key, Modal, ModalResponse, Ui};

/// An answer to a question.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Answer {
    Yes,
    No,
    Cancel,
}

/// The buttons of a question.
#[derive(Clone, Copy, Debug)]
pub struct Choices {
    /// Labels of [`Answer::Yes`], [`Answer::No`] and [`Answer::Cancel`]; an empty one has no
    /// button.
    pub labels: [&'static str; 3],
    /// The answer of the Enter key.
    pub default: Answer,
}

/// Shows a modal dialog. Screen readers get its name.
pub fn modal<T>(ctx: &Context, id: &str, name: &str, body: impl FnOnce(&mut Ui) -> T) -> ModalResponse<T> {
    let id = Id::unique(id);
    let area = Modal::default_area(id).accessible_name(name);
    Modal::new(id).area(area).show(ctx, body)
}

/// Gives a window the role of a dialog for screen readers; its title is the dialog's name.
pub fn as_dialog<T>(ctx: &Context, window: Option<&InnerResponse<T>>) {
    if let Some(window) = window {
        ctx.accesskit_node_builder(window.response.id, |node| node.set_role(Role::Dialog));
    }
}

/// Shows a question until it is answered.
pub fn ask(ctx: &Context, title: &str, choices: Choices, body: impl FnOnce(&mut Ui)) -> Option<Answer> {
    let keys = DialogKeys::of(ctx, title);
    let mut clicked = None;
    let modal = modal(ctx, "question", title, |ui| {
        ui.set_width(420.0_f32.min(ctx.content_rect().width() - 48.0));
        ui.heading(title);
        ui.add_space(4.0);
        body(ui);
        ui.add_space(10.0);
        clicked = buttons(ui, choices);
    });
    // Consumes Esc. A click beside the dialog is no answer.
    let _ = modal.should_close();
    clicked.or(keys.answer(choices.default))
}

/// Shows the buttons in a row, the default one filled.
pub fn buttons(ui: &mut Ui, choices: Choices) -> Option<Answer> {
    let mut clicked = None;
    ui.horizontal_wrapped(|ui| {
        for (label, answer) in choices.labels.into_iter().zip([Answer::Yes, Answer::No, Answer::Cancel]) {
            if !label.is_empty() && default_button(ui, label, answer == choices.default).clicked() {
                clicked = Some(answer);
            }
        }
    });
    clicked
}

/// A button that is filled if Enter presses it.
pub fn default_button(ui: &mut Ui, label: &str, is_default: bool) -> egui::Response {
    if !is_default {
        return ui.button(label);
    }
    let selection = ui.visuals().selection;
    let text = egui::RichText::new(label).color(selection.stroke.color);
    ui.add(egui::Button::new(text).fill(selection.bg_fill))
}

/// Presses of Enter and Esc that belong to a dialog.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DialogKeys {
    pub enter: bool,
    pub escape: bool,
}

impl DialogKeys {
    /// Reads the keys of this frame; call it before the dialog's body, which consumes them. The key
    /// that opened the dialog, and one that is held down since, are ignored.
    pub fn of(ctx: &Context, dialog: &str) -> Self {
        let frame = ctx.cumulative_frame_nr();
        let shown = Id::unique(("dialog", dialog));
        let last_frame = ctx.data_mut(|data| std::mem::replace(data.get_temp_mut_or(shown, frame), frame));
        if last_frame + 1 != frame {
            return Self::default();
        }
        let is_pressed = |target: Key| {
            let is_press =
                |event: &Event| matches!(event, Event::Key { key, pressed: true, repeat: false, .. } if *key == target);
            ctx.input(|i| i.events.iter().any(is_press))
        };
        Self { enter: is_pressed(Key::Enter), escape: is_pressed(Key::Escape) }
    }

    fn answer(self, default: Answer) -> Option<Answer> {
        if self.escape { Some(Answer::Cancel) } else { self.enter.then_some(default) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CHOICES: Choices = Choices { labels: ["Save", "Discard", "Cancel"], default: Answer::Yes };

    /// Runs a frame in which a key is pressed, and released unless it is held.
    fn frame(ctx: &Context, key: Option<Key>, is_key_down: bool, shows: bool) -> Option<Answer> {
        let event = |pressed: bool| {
            key.map(|key| Event::Key { key, physical_key: None, pressed, repeat: false, modifiers: Default::default() })
        };
        // A key that is held down is not released.
        let events = [event(true), event(false).filter(|_| !is_key_down)].into_iter().flatten().collect();
        let input = egui::RawInput { events, ..Default::default() };
        let mut answer = None;
        let mut output = ctx.run_ui(input, |ui| {
            if shows {
                answer = ask(ui.ctx(), "Save changes?", CHOICES, |_| ());
            }
        });
        output.textures_delta.clear();
        answer
    }

    #[test]
    fn enter_takes_the_default_and_esc_cancels() {
        for (key, answer) in [(Key::Enter, Answer::Yes), (Key::Escape, Answer::Cancel)] {
            let ctx = Context::default();
            assert_eq!(frame(&ctx, None, false, true), None);
            assert_eq!(frame(&ctx, Some(key), false, true), Some(answer));
        }
    }

    #[test]
    fn the_key_that_opened_a_question_does_not_answer_it() {
        let ctx = Context::default();
        assert_eq!(frame(&ctx, Some(Key::Enter), true, true), None, "opened in this frame");
        assert_eq!(frame(&ctx, Some(Key::Enter), false, true), None, "still held down");
        frame(&ctx, None, false, false);
        assert_eq!(frame(&ctx, Some(Key::Enter), false, true), None, "opened again");
        assert_eq!(frame(&ctx, Some(Key::Enter), false, true), Some(Answer::Yes));
    }
}
