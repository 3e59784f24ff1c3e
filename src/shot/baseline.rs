//! The values of the camera and the effects before the scene file's own settings.

use super::load_analysis::EstimatedParam;
use crate::compositor::Settings;
use crate::profile::Rig;

/// Camera and settings by the recording, the profile, the analysis and `--set`, without the scene
/// file's `[settings]`.
#[derive(Clone, Debug)]
pub struct Baseline {
    pub rig: Rig,
    pub settings: Settings,
    /// Parameters that the analysis estimated, for this recording alone.
    pub estimated: Vec<EstimatedParam>,
}

impl Baseline {
    /// Applies the estimated parameters of an analysis.
    pub(super) fn apply(&mut self, estimated: Vec<EstimatedParam>) {
        EstimatedParam::apply(&estimated, &mut self.rig, &mut self.settings);
        self.estimated = estimated;
    }
}
