//! Creates a new folder in the displayed one.

use eframe::egui::{Key, Role, TextEdit, Ui, WidgetInfo};

use super::Chooser;
use super::disk;

/// The form for its name.
#[derive(Debug, Default)]
pub struct NewFolderForm {
    name: String,
    /// The field has received the keyboard focus.
    has_had_focus: bool,
}

impl Chooser {
    /// Shows the form, and creates the folder.
    pub(super) fn show_new_folder_form(&mut self, ui: &mut Ui) {
        let (within, _) = self.displayed_folder();
        let Some(NewFolderForm { name, has_had_focus }) = &mut self.new_folder else { return };
        let (mut is_confirmed, mut is_cancelled) = (false, false);
        ui.horizontal(|ui| {
            let field = ui.add(TextEdit::singleline(name).desired_width(240.0).hint_text("Name of the new folder"));
            field.widget_info(|| WidgetInfo::labeled(Role::TextInput, true, "Name of the new folder"));
            let entered = field.lost_focus() && ui.input(|i| i.key_pressed(Key::Enter));
            if !std::mem::replace(has_had_focus, true) {
                field.request_focus();
            }
            is_confirmed = ui.button("Create").clicked() || entered;
            let cancel = ui.button("Cancel");
            // The dialog has a button of that name, too.
            cancel.widget_info(|| WidgetInfo::labeled(Role::Button, true, "Cancel the new folder"));
            is_cancelled = cancel.clicked();
        });
        let name = name.trim().to_owned();
        if is_cancelled {
            (self.new_folder, self.wants_focus) = (None, true);
        } else if is_confirmed && !name.is_empty() && self.pending_entry.is_none() {
            let folder = within.join(name);
            self.start_entry(ui.ctx(), move || disk::make(folder));
        }
    }
}
