//! What stands wrong in the scene, looked for on a thread of its own while a person works.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::thread::Builder;
use std::time::{Duration, Instant};

use eframe::egui;

use super::Project;
use locard_engine::frame::Frame;
use locard_engine::shot::{Note, Tilt, Wrong};

/// What it is true of: the project's scene, and the frame.
type Of = (u64, usize);

/// So long nothing has changed before it is looked at: while a thing is dragged or it plays, the machine has other work.
const REST: Duration = Duration::from_millis(400);

/// Notes on objects, and the tilted surfaces below them.
#[derive(Default)]
struct Checks {
    wrongs: Vec<Wrong>,
    tilts: Vec<Tilt>,
}

/// What stands wrong, for the list of evidence.
#[derive(Default)]
pub struct Wrongs {
    looking: Option<(Of, Receiver<Checks>)>,
    /// What is shown, and since when.
    waits: Option<(Of, Instant)>,
    found: Option<(Of, Checks)>,
}

impl Wrongs {
    /// Begins to look where scene or frame have changed, and takes what was found. Never waits.
    pub fn look(&mut self, project: &Project, frame: Option<&Arc<Frame>>, ctx: &egui::Context) {
        let version = project.scene_version();
        // Objects are identified by their index, and another scene numbers them differently.
        self.found = self.found.take().filter(|((of, _), _)| *of == version);
        if let Some((of, found)) = &self.looking {
            match found.try_recv() {
                Ok(checks) => self.found = Some((*of, checks)),
                Err(TryRecvError::Empty) => return,
                // It broke off, and would again: nothing is known of this one.
                Err(TryRecvError::Disconnected) => self.found = Some((*of, Checks::default())),
            }
            self.looking = None;
        }
        let Some(frame) = frame else { return };
        let of = (version, frame.index);
        if self.found.as_ref().is_some_and(|(known, _)| *known == of) {
            return;
        }
        let since = match self.waits {
            Some((waits, since)) if waits == of => since.elapsed(),
            _ => {
                self.waits = Some((of, Instant::now()));
                Duration::ZERO
            }
        };
        if since < REST {
            ctx.request_repaint_after(REST - since);
            return;
        }
        let (done, found) = channel();
        let (shot, frame, ctx) = (project.shot().clone(), Arc::clone(frame), ctx.clone());
        let looks = Builder::new().name("window wrongs".to_owned()).spawn(move || {
            if done.send(Checks { wrongs: shot.wrongs(&frame), tilts: shot.tilts() }).is_ok() {
                ctx.request_repaint();
            }
        });
        if looks.is_ok() {
            self.looking = Some((of, found));
        }
    }

    /// The checks of a version of the scene.
    fn checks(&self, version: u64) -> Option<&Checks> {
        self.found.as_ref().filter(|((of, _), _)| *of == version).map(|(_, checks)| checks)
    }

    /// Notes on an object of a version of the scene.
    pub fn of(&self, version: u64, object: usize) -> impl Iterator<Item = &Note> {
        let all = self.checks(version).into_iter().flat_map(|checks| &checks.wrongs);
        all.filter(move |wrong| wrong.objects.contains(&object)).map(|wrong| &wrong.note)
    }

    /// The tilted surface below an object of a version of the scene.
    pub fn tilt(&self, version: u64, object: usize) -> Option<Tilt> {
        self.checks(version)?.tilts.iter().find(|tilt| tilt.object == object).copied()
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use glam::DVec3;

    use super::*;
    use locard_engine::recording::OpenOptions;
    use locard_engine::scene::Support;
    use locard_engine::shot::Given;

    #[test]
    fn checks_of_an_older_scene_are_dropped_while_a_check_runs() {
        let mut project =
            Project::open(Path::new("recordings/demo"), &OpenOptions::default(), &Given::default()).unwrap();
        let support = Support { point_m: DVec3::ZERO, normal: DVec3::Z };
        let checks = || {
            let tilt = Tilt { object: 0, support, degrees: 3.0, gap_m: 0.01 };
            Checks { tilts: vec![tilt], ..Checks::default() }
        };
        let of = (project.scene_version(), 0);
        let (done, running) = channel();
        let mut wrongs = Wrongs { looking: Some((of, running)), waits: None, found: Some((of, checks())) };
        let ctx = egui::Context::default();
        wrongs.look(&project, None, &ctx);
        assert!(wrongs.tilt(of.0, 0).is_some());
        project.change_scene("lamp", |scene| _ = scene.add_lamp(DVec3::Z)).unwrap();
        let version = project.scene_version();
        assert!(version != of.0 && wrongs.tilt(version, 0).is_none(), "changed since the last look");
        wrongs.look(&project, None, &ctx);
        assert!(wrongs.found.is_none(), "the check still runs");
        done.send(checks()).unwrap();
        wrongs.look(&project, None, &ctx);
        assert!(wrongs.tilt(version, 0).is_none(), "the check was of the older scene");
    }
}
