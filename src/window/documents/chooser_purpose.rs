//! Purposes of paths that are chosen in a dialog.

use std::path::PathBuf;

use super::super::output::OutputRequest;
use super::super::state::FolderUse;

/// Purpose of a path chosen in a dialog.
#[derive(Debug)]
pub(super) enum ChooserPurpose {
    Open,
    OpenProfile,
    OpenScene,
    /// A missing file that the scene refers to.
    Locate(PathBuf),
    /// A scan of the place, to be aligned.
    Scan,
    SaveProfile,
    SaveScene,
    Output(OutputRequest),
    /// Folder for the camera's frames from now on.
    Record,
    /// Folder for the frozen last seconds.
    KeepFrozen,
}

impl ChooserPurpose {
    pub(super) fn folder_use(&self) -> FolderUse {
        match self {
            Self::Open => FolderUse::Recording,
            Self::OpenProfile | Self::SaveProfile => FolderUse::Profile,
            Self::OpenScene | Self::SaveScene | Self::Locate(_) => FolderUse::Scene,
            Self::Scan => FolderUse::Scan,
            Self::Output(_) | Self::Record | Self::KeepFrozen => FolderUse::Output,
        }
    }
}
