//! Actions that replace or close the open document.

use super::super::project::Project;
use super::super::recent::DocumentRef;
use super::super::recovery_search::RecoverableWork;

/// Action that waits until unsaved work is safe.
#[derive(Debug)]
pub(super) enum PendingAction {
    Close,
    Open(Box<DocumentRef>, Option<RecoverableWork>),
    /// Replaces the open document with the loaded one.
    Show(Box<LoadedDocument>),
}

impl PendingAction {
    pub(super) fn open(document: DocumentRef) -> Self {
        Self::Open(Box::new(document), None)
    }

    /// True if recovered work replaces the picture.
    pub(super) fn recovers(&self) -> bool {
        match self {
            Self::Open(_, recoverable) => recoverable.is_some(),
            Self::Show(loaded) => loaded.recoverable.is_some(),
            Self::Close => false,
        }
    }
}

/// A loaded document and the reference it was loaded from.
#[derive(Debug)]
pub(super) struct LoadedDocument {
    pub(super) document: DocumentRef,
    pub(super) project: Box<Project>,
    pub(super) recoverable: Option<RecoverableWork>,
}
