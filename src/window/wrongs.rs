//! What stands wrong in the scene, looked for on a thread of its own while a person works.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::thread::Builder;
use std::time::{Duration, Instant};

use eframe::egui;

use super::Project;
use crate::frame::Frame;
use crate::shot::{Note, Tilt, Wrong};

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
        if let Some((of, found)) = &self.looking {
            match found.try_recv() {
                Ok(checks) => self.found = Some((*of, checks)),
                Err(TryRecvError::Empty) => return,
                // It broke off, and would again: nothing is known of this one.
                Err(TryRecvError::Disconnected) => self.found = Some((*of, Checks::default())),
            }
            self.looking = None;
        }
        // Objects are told by their places in the list, which another scene numbers otherwise.
        if self.found.as_ref().is_some_and(|((version, _), _)| *version != project.scene_version()) {
            self.found = None;
        }
        let Some(frame) = frame else { return };
        let of = (project.scene_version(), frame.index);
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

    /// What is wrong with an object of the loaded scene.
    pub fn of(&self, object: usize) -> impl Iterator<Item = &Note> {
        let all = self.found.iter().flat_map(|(_, checks)| &checks.wrongs);
        all.filter(move |wrong| wrong.objects.contains(&object)).map(|wrong| &wrong.note)
    }

    /// The tilted surface below an object of the loaded scene.
    pub fn tilt(&self, object: usize) -> Option<Tilt> {
        self.found.as_ref()?.1.tilts.iter().find(|tilt| tilt.object == object).copied()
    }
}
