//! The question where changed values of the camera are saved: in its profile, which other
//! recordings use, or with the scene.

use std::path::Path;

use eframe::egui::Context;

use super::project::Project;
use super::question::{self, Answer, Choices};

/// Where the values of the camera are saved.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SavedIn {
    Profile,
    Scene,
}

/// More names than this are counted.
const MAX_NAMES: usize = 6;

/// Asks; `Some(None)` cancels saving.
pub fn ask(ctx: &Context, project: &Project) -> Option<Option<SavedIn>> {
    // The file that nobody shares is the default.
    let (with_scene, default) =
        if project.can_place() { ("Save with the scene", Answer::No) } else { ("", Answer::Yes) };
    let choices = Choices { labels: ["Save to the profile", with_scene, "Cancel"], default };
    let answer = question::ask(ctx, "Save camera values to the profile?", choices, |ui| {
        ui.label(listed(&project.camera_changes()));
        ui.label(match project.profile.as_deref().and_then(Path::file_name) {
            Some(name) => format!("Other recordings that use {} change, too.", name.to_string_lossy()),
            None => "No profile is open. A new one is named next.".to_owned(),
        });
        if project.can_place() {
            ui.label("With the scene, they hold for this shot alone.");
        }
    })?;
    Some(match answer {
        Answer::Yes => Some(SavedIn::Profile),
        Answer::No => Some(SavedIn::Scene),
        Answer::Cancel => None,
    })
}

fn listed(names: &[String]) -> String {
    let (shown, more) = names.split_at(names.len().min(MAX_NAMES));
    let more = if more.is_empty() { String::new() } else { format!(" and {} more", more.len()) };
    match shown {
        [] => "Settings are changed, and a model that is opened alone cannot keep them.".to_owned(),
        shown => format!("Changed: {}{more}.", shown.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::listed;

    #[test]
    fn many_names_are_counted() {
        let names: Vec<String> = (1..=8).map(|n| format!("k{n}")).collect();
        assert_eq!(listed(&names), "Changed: k1, k2, k3, k4, k5, k6 and 2 more.");
        assert_eq!(listed(&names[..2]), "Changed: k1, k2.");
    }
}
