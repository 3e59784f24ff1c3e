//! A recording that is being opened: on a thread of its own, since the headers of all its frames are read.

use std::path::Path;

use super::autosave::Left;
use super::errand::Errand;
use super::project::Project;
use super::recent::Opened;
use crate::recording::OpenOptions;
use crate::shot::Given;

/// What came of it.
#[derive(Debug)]
pub struct Done {
    pub opened: Opened,
    pub project: Result<Box<Project>, String>,
    /// Work that is taken up with it.
    pub left: Option<Left>,
    /// They are the files that are open.
    pub is_again: bool,
}

/// Something is being opened.
#[derive(Debug)]
pub struct Opening {
    opened: Opened,
    left: Option<Left>,
    is_again: bool,
    errand: Errand<Result<Box<Project>, String>>,
}

impl Opening {
    /// `wake` is called from the thread when it is over. Work that was left goes into what is opened.
    pub fn begin(opened: Opened, left: Option<Left>, wake: impl FnOnce() + Send + 'static) -> std::io::Result<Self> {
        let (wanted, edit) = (opened.clone(), left.as_ref().map(|left| left.work.edit.clone()));
        let errand = Errand::begin("opening", wake, move || {
            let mut project = open(&wanted)?;
            if let Some(edit) = edit {
                project.take_up(edit).map_err(|error| error.to_string())?;
            }
            Ok(Box::new(project))
        })?;
        Ok(Self { opened, left, is_again: false, errand })
    }

    /// Reads the files that are open again.
    pub fn again(opened: Opened, wake: impl FnOnce() + Send + 'static) -> std::io::Result<Self> {
        Ok(Self { is_again: true, ..Self::begin(opened, None, wake)? })
    }

    pub fn what(&self) -> &Path {
        &self.opened.recording
    }

    /// What came of it, once it is there.
    pub fn take(self) -> Result<Done, Box<Self>> {
        let Some(project) = self.errand.take() else { return Err(Box::new(self)) };
        let project = project.and_then(|project| project);
        Ok(Done { opened: self.opened, project, left: self.left, is_again: self.is_again })
    }
}

/// Opens what is there. A profile that is not there is one that will be made.
fn open(opened: &Opened) -> Result<Project, String> {
    let there = |path: &Option<std::path::PathBuf>| path.clone().filter(|path| path.exists());
    let given = Given { profile: there(&opened.profile), sets: Vec::new(), scene: there(&opened.scene) };
    let options = OpenOptions { metres_per_unit: opened.metres_per_unit, ..OpenOptions::default() };
    let mut project = Project::open(&opened.recording, &options, &given).map_err(|error| error.to_string())?;
    project.profile.clone_from(&opened.profile);
    Ok(project)
}
