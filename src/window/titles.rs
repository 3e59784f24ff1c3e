//! Names of recordings, scenes and profiles: recordings of equal name are distinguished by their
//! folders.

use std::path::{Component, Path};

use super::project::Project;

/// A name for each path: its last component, with as many of the folders above as no two names are
/// equal.
pub fn distinct(paths: &[&Path]) -> Vec<String> {
    let name = |path: &Path| {
        let depth = path.components().count();
        let is_unique = |count: &usize| {
            let name = tail(path, *count);
            paths.iter().filter(|other| tail(other, *count) == name).count() == 1
        };
        tail(path, (1..=depth).find(is_unique).unwrap_or(depth))
    };
    paths.iter().map(|path| name(path)).collect()
}

/// The last components of a path.
fn tail(path: &Path, count: usize) -> String {
    let components: Vec<Component<'_>> = path.components().collect();
    let last = &components[components.len().saturating_sub(count)..];
    last.iter().collect::<std::path::PathBuf>().display().to_string()
}

/// The recording's folder with the one above it; a camera's name.
pub fn of_recording(project: &Project) -> String {
    let recording = &project.shot().recording;
    if project.camera.is_some() {
        return recording.name.clone();
    }
    tail(&std::path::absolute(&recording.path).unwrap_or_else(|_| recording.path.clone()), 2)
}

/// The end of a name that fits, after an ellipsis where it is cut: names of one folder differ at
/// their ends.
pub fn elided(name: &str, fits: impl Fn(&str) -> bool) -> String {
    let ends = name.char_indices().skip(1).map(|(at, _)| format!("…{}", &name[at..]));
    std::iter::once(name.to_owned()).chain(ends).find(|text| fits(text)).unwrap_or_else(|| "…".to_owned())
}

/// The window's title: the recording with its folder, the scene and the profile. A dot stands
/// before it while there are unsaved changes.
pub fn of_window(project: &Project) -> String {
    let recording = of_recording(project);
    let files = [project.scene.as_deref(), project.profile.as_deref()].into_iter().flatten();
    let names = std::iter::once(recording).chain(files.map(|file| tail(file, 1)));
    let star = if project.is_saved() { "" } else { "• " };
    format!("{star}{} – Locard", names.collect::<Vec<_>>().join(" – "))
}

/// The whole paths of the recording, the scene and the profiles that are open, a line each.
pub fn paths(project: &Project) -> String {
    let shot = project.shot();
    let mut lines = vec![format!("Recording: {}", shot.recording.path.display())];
    lines.push(project.scene.as_ref().map_or("No scene file".to_owned(), |path| format!("Scene: {}", path.display())));
    match shot.profiles() {
        [] => lines.push("No camera profile".to_owned()),
        profiles => lines.extend(profiles.iter().map(|path| format!("Profile: {}", path.display()))),
    }
    lines.join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use locard_engine::recording::OpenOptions;
    use locard_engine::shot::ShotOptions;

    #[test]
    fn paths_of_equal_name_are_distinguished_by_their_folders() {
        let paths = ["/cases/a/room", "/cases/b/room", "/cases/b/desk", "/other/a/room"].map(Path::new);
        assert_eq!(distinct(&paths), ["cases/a/room", "b/room", "desk", "other/a/room"]);
        assert_eq!(distinct(&[Path::new("room")]), ["room"]);
        assert_eq!(distinct(&[Path::new("/room"), Path::new("/room")]), ["/room", "/room"]);
    }

    #[test]
    fn long_names_keep_their_ends() {
        let fits = |text: &str| text.chars().count() <= 6;
        assert_eq!(["room", "case 7/room", "case 7/Büro"].map(|name| elided(name, fits)), ["room", "…/room", "…/Büro"]);
        assert_eq!(elided("room", |_| false), "…");
    }

    #[test]
    fn title_names_the_files_and_marks_unsaved_changes() {
        let options = ShotOptions {
            scene: Some("scenes/demo.toml".into()),
            profile: Some("profiles/simulated.toml".into()),
            ..ShotOptions::default()
        };
        let mut project = Project::open(Path::new("recordings/demo"), &OpenOptions::default(), &options).unwrap();
        assert_eq!(of_window(&project), "recordings/demo – demo.toml – simulated.toml – Locard");
        project.switch("noise", false);
        assert!(of_window(&project).starts_with("• recordings/demo"));
        assert!(paths(&project).contains("Scene: scenes/demo.toml\nProfile: "));
    }
}
