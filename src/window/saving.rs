//! The steps of saving: files to write, and the questions before.

use std::path::{Path, PathBuf};

use super::camera_values::CameraValueTarget;
use super::file_watch::{Change, FileWatch};
use super::project::Project;
use locard_engine::assets;

/// The demonstration, which opens without a recording. Save does not overwrite it.
pub const DEMO: &str = "recordings/demo";
pub const DEMO_SCENE: &str = "scenes/demo.toml";
/// The supplied profiles.
pub const PROFILES: &str = "profiles";

/// Next step of a save.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SaveStep {
    /// A name is needed.
    NameScene,
    NameProfile,
    /// Question whether changed camera values go into the profile or the scene.
    AskCameraValues,
    /// A shared profile whose overwriting is not approved yet.
    AskSharedProfile(PathBuf),
    /// A file that another program has changed since it was read.
    AskOverwrite(PathBuf),
    WriteScene(PathBuf),
    WriteProfile(PathBuf),
    Done,
}

/// Answers of the user.
#[derive(Clone, Copy, Debug)]
pub struct Approvals<'a> {
    /// Files that may be overwritten.
    pub replaced: &'a [PathBuf],
    /// Shared profiles that may be overwritten.
    pub shared: &'a [PathBuf],
    /// The target for changed camera values.
    pub camera: Option<CameraValueTarget>,
}

/// The next step.
pub fn next_step(project: &Project, watch: &FileWatch, approvals: Approvals<'_>) -> SaveStep {
    let has = |paths: &[PathBuf], path: &Path| paths.iter().any(|approvals| approvals == path);
    let changed = |path: &Path| watch.change(path) == Some(Change::Changed) && !has(approvals.replaced, path);
    // A model that is opened alone has no scene file. Values that its profile does not accept
    // cannot be saved.
    let has_changes = if project.can_place() { project.camera_is_changed() } else { project.profile_is_changed() };
    match approvals.camera.filter(|_| has_changes) {
        None if has_changes => return SaveStep::AskCameraValues,
        Some(CameraValueTarget::Profile) => return profile_step(project, approvals, changed),
        _ => {}
    }
    if project.scene_is_changed() {
        return match project.scene.clone().filter(|path| !is_demo(path) || has(approvals.replaced, path)) {
            None => SaveStep::NameScene,
            Some(path) if changed(&path) => SaveStep::AskOverwrite(path),
            Some(path) => SaveStep::WriteScene(path),
        };
    }
    SaveStep::Done
}

fn profile_step(project: &Project, approvals: Approvals<'_>, changed: impl Fn(&Path) -> bool) -> SaveStep {
    match project.profile.clone() {
        None => SaveStep::NameProfile,
        Some(path) if profile_owner(project, &path).is_some() && !approvals.shared.contains(&path) => {
            SaveStep::AskSharedProfile(path)
        }
        Some(path) if changed(&path) => SaveStep::AskOverwrite(path),
        Some(path) => SaveStep::WriteProfile(path),
    }
}

/// True for the demonstration's recording.
pub fn is_demonstration(recording: &Path) -> bool {
    assets::is_supplied(recording, DEMO)
}

/// True for the demonstration's scene.
pub fn is_demo(scene: &Path) -> bool {
    assets::is_supplied(scene, DEMO_SCENE)
}

/// Owner of a profile that is also used elsewhere.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ProfileOwner {
    Program,
    Recording,
}

pub fn profile_owner(project: &Project, profile: &Path) -> Option<ProfileOwner> {
    if assets::is_supplied_profile(profile) {
        return Some(ProfileOwner::Program);
    }
    let profile = profile.canonicalize().ok()?;
    let recording = project.shot().recording.path.canonicalize().ok()?;
    profile.starts_with(recording).then_some(ProfileOwner::Recording)
}

/// A file that was written.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SavedFile {
    pub kind: &'static str,
    pub path: PathBuf,
}

/// The message at the end of a save: the written files, and the names of changes that no file
/// stores.
pub fn end_message(written: &[SavedFile], unsavable: &[String]) -> String {
    if unsavable.is_empty() {
        return summary(written);
    }
    let saved = if written.is_empty() { String::new() } else { format!("{}. ", summary(written)) };
    format!("{saved}Not saved without a scene: {}", unsavable.join(", "))
}

/// Lists the written files by name, with their folder once if it is the same.
pub fn summary(written: &[SavedFile]) -> String {
    let absolute = |path: &Path| std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let Some(first) = written.first() else { return "Nothing has changed since it was saved".to_owned() };
    let folder = absolute(&first.path).parent().map(Path::to_owned).unwrap_or_default();
    let is_one = written.iter().all(|file| absolute(&file.path).parent() == Some(&folder));
    let named = written.iter().map(|file| {
        let name = file.path.file_name().filter(|_| is_one).map_or_else(|| absolute(&file.path), PathBuf::from);
        format!("the {} {}", file.kind, name.display())
    });
    let end = if is_one { format!(", in {}", folder.display()) } else { String::new() };
    format!("Saved {}{end}", named.collect::<Vec<_>>().join(" and "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn summary_names_the_written_files() {
        let [scene, profile, other] =
            [("scene", "/a/desk.toml"), ("profile", "/a/mine.toml"), ("profile", "/b/mine.toml")]
                .map(|(kind, path)| SavedFile { kind, path: path.into() });
        assert_eq!(summary(&[scene.clone(), profile]), "Saved the scene desk.toml and the profile mine.toml, in /a");
        assert_eq!(summary(&[scene, other.clone()]), "Saved the scene /a/desk.toml and the profile /b/mine.toml");
        assert_eq!(summary(&[other]), "Saved the profile mine.toml, in /b");
        assert_eq!(summary(&[]), "Nothing has changed since it was saved");
        let names = ["Exposure time".to_owned(), "Film speed".to_owned()];
        assert_eq!(end_message(&[], &names), "Not saved without a scene: Exposure time, Film speed");
        let saved = SavedFile { kind: "profile", path: "/b/mine.toml".into() };
        let expected = "Saved the profile mine.toml, in /b. Not saved without a scene: Exposure time";
        assert_eq!(end_message(&[saved], &names[..1]), expected);
    }
}
