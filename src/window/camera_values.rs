//! The question about the destination of changed camera values: the profile, which other
//! recordings use, or with the scene.

use std::path::Path;

use eframe::egui::Context;

use super::project::Project;
use super::question::{self, Answer, Choices};

/// Destination of changed camera values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CameraValueTarget {
    Profile,
    Scene,
}

/// More names than this are counted.
const MAX_NAMES: usize = 6;

/// Text about a model that is opened without a scene file.
const MODEL_ALONE: &str = "A model that is opened alone has no scene file: all changed settings are written to the \
                           profile, exposure and effects included.";

/// Shows the question; `Some(None)` cancels saving.
pub fn ask(ctx: &Context, project: &Project) -> Option<Option<CameraValueTarget>> {
    let has_scene = project.can_place();
    let (title, choices) = question(has_scene);
    let answer = question::ask(ctx, title, choices, |ui| {
        ui.label(if has_scene { listed(&project.camera_changes()) } else { MODEL_ALONE.to_owned() });
        ui.label(match project.profile.as_deref().and_then(Path::file_name) {
            Some(name) => format!("Other recordings that use {} change, too.", name.to_string_lossy()),
            None => "No profile is open. A new one is named next.".to_owned(),
        });
        if has_scene {
            ui.label("With the scene, they hold for this shot alone.");
        }
    })?;
    Some(match answer {
        Answer::Yes => Some(CameraValueTarget::Profile),
        Answer::No => Some(CameraValueTarget::Scene),
        Answer::Cancel => None,
    })
}

/// The title and the buttons. Enter never overwrites a profile.
fn question(has_scene: bool) -> (&'static str, Choices) {
    let (title, with_scene, default) = if has_scene {
        ("Save camera values to the profile?", "Save with the scene", Answer::No)
    } else {
        ("Save settings to the profile?", "", Answer::Cancel)
    };
    (title, Choices { labels: ["Save to the profile", with_scene, "Cancel"], default })
}

fn listed(names: &[String]) -> String {
    let (shown, more) = names.split_at(names.len().min(MAX_NAMES));
    let more = if more.is_empty() { String::new() } else { format!(" and {} more", more.len()) };
    format!("Changed: {}{more}.", shown.join(", "))
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
