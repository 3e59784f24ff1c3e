//! Warnings about a recording, which hold as long as it is open.

use std::sync::{Arc, Weak};

use super::project::Project;
use locard_engine::recording::Recording;
use locard_engine::text::without_options;

/// The warnings, with the ones that need every frame's pose cached.
#[derive(Debug, Default)]
pub struct Warnings {
    poses: Option<MissingPoses>,
}

/// Text about missing poses, by recording. No memo: a memo's key would keep the recording in
/// memory, and with it its temporary folder.
#[derive(Debug)]
struct MissingPoses {
    recording: Weak<Recording>,
    /// `None` if every frame has a pose.
    missing: Option<String>,
}

impl Warnings {
    /// Each warning, in plain words.
    pub fn of(&mut self, project: &Project) -> Vec<String> {
        let recording = &project.shot().recording;
        let missing = self.missing_poses(recording);
        let all = recording.warnings.iter().cloned().chain(missing);
        all.map(|text| without_options(&text)).collect()
    }

    fn missing_poses(&mut self, recording: &Arc<Recording>) -> Option<String> {
        // The panel of a live camera reports its poses.
        if recording.is_live() {
            return None;
        }
        let is_of = |poses: &&MissingPoses| std::ptr::eq(poses.recording.as_ptr(), Arc::as_ptr(recording));
        if let Some(poses) = self.poses.as_ref().filter(is_of) {
            return poses.missing.clone();
        }
        let missing = recording.missing_poses(0..recording.frame_count());
        self.poses = Some(MissingPoses { recording: Arc::downgrade(recording), missing: missing.clone() });
        missing
    }
}
