//! What is given with a recording.

use std::path::PathBuf;

use crate::scene::MissingModels;

/// A person's input in addition to the recording.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Given {
    /// The camera and the effects' parameters. Overrides what the recording brings, key by key.
    pub profile: Option<PathBuf>,
    /// Override both, one after another: `table.name=value`.
    pub sets: Vec<String>,
    /// Put into the footage. Without it the footage stays as it is.
    pub scene: Option<PathBuf>,
    /// What the footage says of itself.
    pub analysis: Analysed,
    /// The camera stays where the recording says, and its clocks go as it says, whatever an analysis found of them. A scene's
    /// gauge holds all the same: in its frame things stand where they were put.
    pub recorded_poses: bool,
    /// What becomes of the scene file's models that cannot be read. Nothing is written with
    /// stand-ins ([`Shot::check`]).
    ///
    /// [`Shot::check`]: super::Shot::check
    pub missing_models: MissingModels,
}

/// Which analysis is used.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Analysed {
    /// The one beside the recording, if there is one that fits.
    #[default]
    Beside,
    /// This one; that it does not fit is an error.
    At(PathBuf),
    /// None.
    No,
}
