//! Findings: faults of a photograph or of a series, with their numbers and remedies.

/// A check.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Check {
    NoRecord,
    Exposure,
    ClippedHighlights,
    ShutterByHand,
    MotionBlur,
    TiltedView,
    ScaleOutOfPlane,
    ScaleHeight,
    ScaleCutOff,
    ScaleTooSmall,
    OutOfFocus,
    SubjectTooSmall,
    SubjectCutOff,
    NoFixedPoint,
    NoCaseCard,
    Numbers,
    NoOverview,
    NoMidRange,
    NoCloseUp,
    NoCloseUpWithScale,
    CloseUpNotSquare,
}

impl Check {
    /// Name of the check in the log, as in docs/photo-log.md.
    pub fn name(self) -> &'static str {
        match self {
            Self::NoRecord => "no-record",
            Self::Exposure => "exposure",
            Self::ClippedHighlights => "clipped-highlights",
            Self::ShutterByHand => "shutter-by-hand",
            Self::MotionBlur => "motion-blur",
            Self::TiltedView => "tilted-view",
            Self::ScaleOutOfPlane => "scale-out-of-plane",
            Self::ScaleHeight => "scale-height",
            Self::ScaleCutOff => "scale-cut-off",
            Self::ScaleTooSmall => "scale-too-small",
            Self::OutOfFocus => "out-of-focus",
            Self::SubjectTooSmall => "subject-too-small",
            Self::SubjectCutOff => "subject-cut-off",
            Self::NoFixedPoint => "no-fixed-point",
            Self::NoCaseCard => "no-case-card",
            Self::Numbers => "numbers",
            Self::NoOverview => "no-overview",
            Self::NoMidRange => "no-mid-range",
            Self::NoCloseUp => "no-close-up",
            Self::NoCloseUpWithScale => "no-close-up-with-scale",
            Self::CloseUpNotSquare => "close-up-not-square",
        }
    }
}

/// A fault that a check found.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    pub check: Check,
    /// The fault, with its numbers.
    pub fault: String,
    /// How to do better.
    pub remedy: String,
}

impl Finding {
    pub fn new(check: Check, fault: String, remedy: impl Into<String>) -> Self {
        Self { check, fault, remedy: remedy.into() }
    }
}
