//! Options with which a shot is opened.

use std::path::PathBuf;

use crate::scene::MissingModels;

/// The user's inputs besides the recording.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ShotOptions {
    /// Profile with the camera and the effects' parameters. Overrides the recording's values, key
    /// by key.
    pub profile: Option<PathBuf>,
    /// Parameters as `table.name=value`, in order of increasing precedence. They override recording
    /// and profile.
    pub sets: Vec<String>,
    /// Scene file. Without one, nothing is added to the footage.
    pub scene: Option<PathBuf>,
    /// The analysis of the footage to use.
    pub analysis: AnalysisChoice,
    /// Keeps the recorded poses and clocks even if an analysis has refined them. A scene's gauge
    /// still applies: in its frame, objects stay where they were placed.
    pub recorded_poses: bool,
    /// Handling of the scene file's models that cannot be read. Nothing is written with
    /// stand-ins ([`Shot::check`]).
    ///
    /// [`Shot::check`]: super::Shot::check
    pub missing_models: MissingModels,
}

/// The analysis to use.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum AnalysisChoice {
    /// The one beside the recording, if one exists and fits.
    #[default]
    Beside,
    /// The one in a folder. It is an error if it does not fit.
    At(PathBuf),
    /// None.
    No,
}
