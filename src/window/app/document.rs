//! The open document, with all state of the window that belongs to it. Another document replaces it
//! as a whole.

use super::super::evidence::EvidencePanel;
use super::super::handles::Handles;
use super::super::notice::Refusal;
use super::super::obstacle::NearestPose;
use super::super::picture::PictureView;
use super::super::picture_transform::PictureTransform;
use super::super::scan_alignment::ScanAlignment;
use super::super::session::Session;
use super::super::side::Side;
use super::super::timeline::StripDrag;
use super::super::tool::ToolStack;
use super::super::warnings::Warnings;

/// The open document.
pub(super) struct OpenDocument {
    /// The project with its history, files and unsaved changes; playback and pictures.
    pub session: Session,
    pub view: PictureView,
    pub side: Side,
    pub evidence: EvidencePanel,
    pub scan_alignment: ScanAlignment,
    pub tools: ToolStack,
    pub handles: Handles,
    /// The user closed the notice that the camera is missing.
    pub hides_obstacle: bool,
    /// Reason why the last click in the picture had no effect.
    pub refusal: Option<Refusal>,
    pub nearest_pose: NearestPose,
    pub warnings: Warnings,
    /// Position of the picture on the screen.
    pub placed: Option<PictureTransform>,
    pub strip_drag: StripDrag,
}

impl OpenDocument {
    pub(super) fn new(session: Session) -> Self {
        Self {
            session,
            view: PictureView::default(),
            side: Side::default(),
            evidence: EvidencePanel::default(),
            scan_alignment: ScanAlignment::default(),
            tools: ToolStack::default(),
            handles: Handles::default(),
            hides_obstacle: false,
            refusal: None,
            nearest_pose: NearestPose::default(),
            warnings: Warnings::default(),
            placed: None,
            strip_drag: StripDrag::default(),
        }
    }
}
