//! Saving, step by step: what is written, and what has to be asked before.

use std::path::{Path, PathBuf};

use super::camera_values::CameraValueTarget;
use super::project::Project;
use super::watch::{Change, Watch};
use locard_engine::assets;

/// The demonstration, which opens without a recording. It is not written to by a mere Save.
pub const DEMO: &str = "recordings/demo";
pub const DEMO_SCENE: &str = "scenes/demo.toml";
/// The profiles that come with the program.
pub const PROFILES: &str = "profiles";

/// What comes next.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Step {
    /// A name is needed.
    NameScene,
    NameProfile,
    /// Values of the camera are changed: in its profile, or with the scene?
    AskCamera,
    /// A profile was opened that is others' too, and is not yet agreed to be written.
    AskFirst(PathBuf),
    /// A file was changed by somebody else since it was read.
    AskWhether(PathBuf),
    WriteScene(PathBuf),
    WriteProfile(PathBuf),
    Saved,
}

/// What a person has agreed to.
#[derive(Clone, Copy, Debug)]
pub struct Agreed<'a> {
    /// Files that were chosen by name, or are allowed to be replaced.
    pub replaced: &'a [PathBuf],
    /// Profiles of others that may be written.
    pub shared: &'a [PathBuf],
    /// Where changed values of the camera go.
    pub camera: Option<CameraValueTarget>,
}

/// The next step.
pub fn next(project: &Project, watch: Option<&Watch>, agreed: Agreed<'_>) -> Step {
    let has = |paths: &[PathBuf], path: &Path| paths.iter().any(|agreed| agreed == path);
    let changed = |path: &Path| {
        let change = watch.and_then(|watch| watch.change(path));
        change == Some(Change::Changed) && !has(agreed.replaced, path)
    };
    // A model that is opened alone has no scene file. Values that its profile does not take cannot
    // be saved.
    let asks = if project.can_place() { project.camera_is_changed() } else { project.profile_is_changed() };
    match agreed.camera.filter(|_| asks) {
        None if asks => return Step::AskCamera,
        Some(CameraValueTarget::Profile) => return profile_step(project, agreed, changed),
        _ => {}
    }
    if project.scene_is_changed() {
        return match project.scene.clone().filter(|path| !is_demo(path) || has(agreed.replaced, path)) {
            None => Step::NameScene,
            Some(path) if changed(&path) => Step::AskWhether(path),
            Some(path) => Step::WriteScene(path),
        };
    }
    Step::Saved
}

fn profile_step(project: &Project, agreed: Agreed<'_>, changed: impl Fn(&Path) -> bool) -> Step {
    match project.profile.clone() {
        None => Step::NameProfile,
        Some(path) if profile_owner(project, &path).is_some() && !agreed.shared.contains(&path) => Step::AskFirst(path),
        Some(path) if changed(&path) => Step::AskWhether(path),
        Some(path) => Step::WriteProfile(path),
    }
}

/// Whether that is the demonstration's recording.
pub fn is_demonstration(recording: &Path) -> bool {
    assets::is_supplied(recording, DEMO)
}

/// Whether that is the scene file of the demonstration.
pub fn is_demo(scene: &Path) -> bool {
    assets::is_supplied(scene, DEMO_SCENE)
}

/// The owner of a profile that others use, too.
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
pub struct Saved {
    pub what: &'static str,
    pub path: PathBuf,
}

/// The message at the end of saving: what was written, and the names of changes that no file keeps.
pub fn ended(written: &[Saved], unsavable: &[String]) -> String {
    if unsavable.is_empty() {
        return told(written);
    }
    let saved = if written.is_empty() { String::new() } else { format!("{}. ", told(written)) };
    format!("{saved}Not saved without a scene: {}", unsavable.join(", "))
}

/// Says what was written, by name; the folder once where it is one.
pub fn told(written: &[Saved]) -> String {
    let whole = |path: &Path| std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let Some(first) = written.first() else { return "Nothing has changed since it was saved".to_owned() };
    let folder = whole(&first.path).parent().map(Path::to_owned).unwrap_or_default();
    let is_one = written.iter().all(|file| whole(&file.path).parent() == Some(&folder));
    let named = written.iter().map(|file| {
        let name = file.path.file_name().filter(|_| is_one).map_or_else(|| whole(&file.path), PathBuf::from);
        format!("the {} {}", file.what, name.display())
    });
    let end = if is_one { format!(", in {}", folder.display()) } else { String::new() };
    format!("Saved {}{end}", named.collect::<Vec<_>>().join(" and "))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_written_is_named() {
        let [scene, profile, other] =
            [("scene", "/a/desk.toml"), ("profile", "/a/mine.toml"), ("profile", "/b/mine.toml")]
                .map(|(what, path)| Saved { what, path: path.into() });
        assert_eq!(told(&[scene.clone(), profile]), "Saved the scene desk.toml and the profile mine.toml, in /a");
        assert_eq!(told(&[scene, other.clone()]), "Saved the scene /a/desk.toml and the profile /b/mine.toml");
        assert_eq!(told(&[other]), "Saved the profile mine.toml, in /b");
        assert_eq!(told(&[]), "Nothing has changed since it was saved");
        let names = ["Exposure time".to_owned(), "Film speed".to_owned()];
        assert_eq!(ended(&[], &names), "Not saved without a scene: Exposure time, Film speed");
        let saved = Saved { what: "profile", path: "/b/mine.toml".into() };
        let expected = "Saved the profile mine.toml, in /b. Not saved without a scene: Exposure time";
        assert_eq!(ended(&[saved], &names[..1]), expected);
    }
}
