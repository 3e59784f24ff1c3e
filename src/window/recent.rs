//! What was opened lately, the last one first.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::project::Project;
use super::state;

const MOST: usize = 12;

/// A recording with what was opened with it. Paths are absolute.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize)]
pub struct Opened {
    pub recording: PathBuf,
    pub scene: Option<PathBuf>,
    pub profile: Option<PathBuf>,
    pub metres_per_unit: f64,
}

impl Opened {
    /// What is open.
    pub fn of(project: &Project) -> Self {
        let whole = |path: &Path| std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
        Self {
            recording: whole(&project.shot().recording.path),
            scene: project.scene.as_deref().map(whole),
            profile: project.profile.as_deref().map(whole),
            metres_per_unit: project.metres_per_unit,
        }
    }
}

/// The list of a file. Without a file it is empty, and is kept nowhere.
#[derive(Clone, Debug, Default)]
pub struct Recent {
    file: Option<PathBuf>,
    pub list: Vec<Opened>,
}

impl Recent {
    pub fn read(file: PathBuf) -> Self {
        let list = state::read(&file);
        Self { file: Some(file), list }
    }

    /// Puts what is opened first. That it cannot be kept is no reason to stop.
    pub fn add(&mut self, opened: Opened) {
        // Another window may have added to it.
        if let Some(file) = &self.file {
            self.list = state::read(file);
        }
        self.list.retain(|other| other.recording != opened.recording);
        self.list.insert(0, opened);
        self.list.truncate(MOST);
        if let Some(file) = &self.file {
            state::keep(file, &self.list);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_comes_first_and_each_once() {
        let temp = tempfile::tempdir().unwrap();
        let file = temp.path().join("new/recent.json");
        let opened = |n: usize| Opened {
            recording: format!("/r/{n}").into(),
            scene: None,
            profile: Some("/p.toml".into()),
            metres_per_unit: 1.0,
        };
        let mut recent = Recent::read(file.clone());
        let mut other = Recent::read(file.clone());
        (0..MOST).for_each(|n| recent.add(opened(n)));
        other.add(opened(99));
        recent.add(opened(5));
        let list = Recent::read(file.clone()).list;
        assert_eq!((list.len(), &list[0], &list[1]), (MOST, &opened(5), &opened(99)));
        assert_eq!(list.iter().filter(|o| **o == opened(5)).count(), 1);
        std::fs::write(&file, "no list").unwrap();
        assert!(Recent::read(file).list.is_empty());
    }
}
