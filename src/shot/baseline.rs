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
        for Follows { table, name, value } in &found {
            // Within the range: the analysis found it there.
            let _ = self.rig.set(&mut self.settings, table, name, value);
        }
        self.found = found;
    }
}
