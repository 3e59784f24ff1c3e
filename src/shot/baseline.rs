//! The values of the camera and the effects before the scene file's own settings.

use super::analysed::Follows;
use crate::compositor::Settings;
use crate::profile::Rig;

/// Camera and settings by the recording, the profile, the analysis and `--set`, without the scene
/// file's `[settings]`.
#[derive(Clone, Debug)]
pub struct Baseline {
    pub rig: Rig,
    pub settings: Settings,
    /// Values of the analysis, which hold for this recording alone.
    pub found: Vec<Follows>,
}

impl Baseline {
    /// Takes over the values of an analysis.
    pub(super) fn follow(&mut self, found: Vec<Follows>) {
        Follows::apply(&found, &mut self.rig, &mut self.settings);
        self.found = found;
    }
}
