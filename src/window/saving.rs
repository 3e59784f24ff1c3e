//! Saving, step by step: what is written, and what has to be asked before.

use std::path::{Path, PathBuf};

use super::project::Project;
use super::watch::{Change, Watch};

/// The demonstration, which opens without a recording. It is not written to by a mere Save.
pub const DEMO: &str = "recordings/demo";
pub const DEMO_SCENE: &str = "scenes/demo.toml";

/// What comes next.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Step {
    /// A name is needed.
    NameScene,
    NameProfile,
    /// A file was changed by somebody else since it was read.
    AskWhether(PathBuf),
    WriteScene(PathBuf),
    WriteProfile(PathBuf),
    Saved,
}

/// The next step. `agreed`: files that a person has chosen by name, or allowed to be replaced.
pub fn next(project: &Project, watch: Option<&Watch>, agreed: &[PathBuf]) -> Step {
    let changed = |path: &Path| {
        let change = watch.and_then(|watch| watch.change(path));
        change == Some(Change::Changed) && !agreed.iter().any(|agreed| agreed == path)
    };
    if project.scene_is_changed() {
        let is_demo = |path: &PathBuf| same(path, Path::new(DEMO_SCENE)) && !agreed.contains(path);
        return match project.scene.clone().filter(|path| !is_demo(path)) {
            None => Step::NameScene,
            Some(path) if changed(&path) => Step::AskWhether(path),
            Some(path) => Step::WriteScene(path),
        };
    }
    if project.profile_is_changed() {
        return match project.profile.clone() {
            None => Step::NameProfile,
            Some(path) if changed(&path) => Step::AskWhether(path),
            Some(path) => Step::WriteProfile(path),
        };
    }
    Step::Saved
}

fn same(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}
