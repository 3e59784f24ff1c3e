//! A new folder in the one that is shown.

use eframe::egui::{Key, Role, TextEdit, Ui, WidgetInfo};

use super::Chooser;
use super::disk;

/// The name that it gets.
#[derive(Debug, Default)]
pub struct Making {
    name: String,
    /// Its field has had the keyboard.
    is_begun: bool,
}

impl Chooser {
    /// Asks for the name, and has it made.
    pub(super) fn makes(&mut self, ui: &mut Ui) {
        let (within, _) = self.looks_in();
        let Some(Making { name, is_begun }) = &mut self.makes else { return };
        let (mut is_made, mut is_left) = (false, false);
        ui.horizontal(|ui| {
            let field = ui.add(TextEdit::singleline(name).desired_width(240.0).hint_text("Name of the new folder"));
            field.widget_info(|| WidgetInfo::labeled(Role::TextInput, true, "Name of the new folder"));
            let entered = field.lost_focus() && ui.input(|i| i.key_pressed(Key::Enter));
            if !std::mem::replace(is_begun, true) {
                field.request_focus();
            }
            is_made = ui.button("Make it").clicked() || entered;
            is_left = ui.button("Leave it").clicked();
        });
        let name = name.trim().to_owned();
        if is_left {
            (self.makes, self.wants_keys) = (None, true);
        } else if is_made && !name.is_empty() && self.entering.is_none() {
            let folder = within.join(name);
            self.ask(ui.ctx(), move || disk::make(folder));
        }
    }
}
