//! Checks the placement of objects on a background thread.

use std::sync::Arc;
use std::time::{Duration, Instant};

use eframe::egui;

use super::Project;
use super::task::BackgroundTask;
use locard_engine::frame::Frame;
use locard_engine::shot::{Note, ObjectIssue};
use locard_engine::support::TiltedSupport;

/// Scene version and frame index of a check.
type CheckedState = (u64, usize);

/// Delay after the last change before a check starts: the machine is busy during drags and
/// playback.
const SETTLE_TIME: Duration = Duration::from_millis(400);

/// Notes on objects, and the tilted surfaces below them.
#[derive(Default)]
struct CheckResults {
    issues: Vec<ObjectIssue>,
    tilts: Vec<TiltedSupport>,
}

/// Placement checks for the list of evidence.
#[derive(Default)]
pub struct SceneChecks {
    running: Option<(CheckedState, BackgroundTask<CheckResults>)>,
    /// The state to check, and since when it has been current.
    pending: Option<(CheckedState, Instant)>,
    /// No memo: those of another frame are shown until the newer ones have arrived.
    results: Option<(CheckedState, CheckResults)>,
}

impl SceneChecks {
    /// Starts a check when the scene or the frame has changed, and takes its result. Never blocks.
    /// Returns why a check failed.
    pub fn update(&mut self, project: &Project, frame: Option<&Arc<Frame>>, ctx: &egui::Context) -> Option<String> {
        let version = project.scene_version();
        // Objects are identified by their index, and another scene numbers them differently.
        self.results = self.results.take().filter(|((state, _), _)| *state == version);
        let mut failure = None;
        if let Some((state, task)) = &self.running {
            // A check that panicked would do so again: no results for this state.
            let checks = task.take()?.unwrap_or_else(|why| {
                failure = Some(format!("The placement is not checked: {why}"));
                CheckResults::default()
            });
            self.results = Some((*state, checks));
            self.running = None;
        }
        let Some(frame) = frame else { return failure };
        let state = (version, frame.index);
        if self.results.as_ref().is_some_and(|(known, _)| *known == state) {
            return failure;
        }
        let since = match self.pending {
            Some((pending, since)) if pending == state => since.elapsed(),
            _ => {
                self.pending = Some((state, Instant::now()));
                Duration::ZERO
            }
        };
        if since < SETTLE_TIME {
            ctx.request_repaint_after(SETTLE_TIME - since);
            return failure;
        }
        let (shot, frame, wake) = (project.shot().clone(), Arc::clone(frame), ctx.clone());
        let check = move || CheckResults { issues: shot.object_issues(&frame), tilts: shot.tilts() };
        let task = BackgroundTask::spawn("check placement", move || wake.request_repaint(), check);
        self.running = task.ok().map(|task| (state, task));
        failure
    }

    /// The results for a version of the scene.
    fn checks(&self, version: u64) -> Option<&CheckResults> {
        self.results.as_ref().filter(|((state, _), _)| *state == version).map(|(_, checks)| checks)
    }

    /// Notes on an object of a version of the scene.
    pub fn notes(&self, version: u64, object: usize) -> impl Iterator<Item = &Note> {
        let all = self.checks(version).into_iter().flat_map(|checks| &checks.issues);
        all.filter(move |issue| issue.objects.contains(&object)).map(|issue| &issue.note)
    }

    /// The tilted surface below an object of a version of the scene.
    pub fn tilt(&self, version: u64, object: usize) -> Option<TiltedSupport> {
        self.checks(version)?.tilts.iter().find(|tilt| tilt.object == object).copied()
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use glam::DVec3;

    use super::*;
    use locard_engine::plane::Plane;
    use locard_engine::recording::OpenOptions;
    use locard_engine::shot::ShotOptions;

    #[test]
    fn results_for_an_older_scene_are_dropped_while_a_check_runs() {
        let mut project =
            Project::open(Path::new("recordings/demo"), &OpenOptions::default(), &ShotOptions::default()).unwrap();
        let support = Plane { point_m: DVec3::ZERO, normal: DVec3::Z };
        let checks = || {
            let tilt = TiltedSupport { object: 0, support, degrees: 3.0, gap_m: 0.01 };
            CheckResults { tilts: vec![tilt], ..CheckResults::default() }
        };
        let state = (project.scene_version(), 0);
        let (done, awaited) = std::sync::mpsc::channel();
        let running = BackgroundTask::spawn("test", || (), move || awaited.recv().unwrap()).unwrap();
        let mut scene_checks =
            SceneChecks { running: Some((state, running)), pending: None, results: Some((state, checks())) };
        let ctx = egui::Context::default();
        scene_checks.update(&project, None, &ctx);
        assert!(scene_checks.tilt(state.0, 0).is_some());
        project.change_scene("lamp", |scene| _ = scene.add_lamp(DVec3::Z)).unwrap();
        let version = project.scene_version();
        assert!(version != state.0 && scene_checks.tilt(version, 0).is_none(), "changed since the last look");
        scene_checks.update(&project, None, &ctx);
        assert!(scene_checks.results.is_none(), "the check still runs");
        done.send(checks()).unwrap();
        while scene_checks.running.is_some() {
            scene_checks.update(&project, None, &ctx);
        }
        assert!(scene_checks.tilt(version, 0).is_none(), "the check was of the older scene");
    }
}
