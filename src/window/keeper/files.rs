//! Opening and saving, with what is asked before anything is lost.

use std::path::PathBuf;

use eframe::egui;

use super::super::autosave::Left;
use super::super::camera_values;
use super::super::dialogs::{self, Ending};
use super::super::errand::Errand;
use super::super::jobs::Jobs;
use super::super::kind::Kind;
use super::super::opening::{Opening, Refused};
use super::super::project::{ProfileScope, SaveError};
use super::super::question::Answer;
use super::super::recent::Opened;
use super::super::saving::{self, Agreed, Saved, Step};
use super::super::session::Session;
use super::super::titles;
use super::super::watch::Change;
use super::{Keeper, Shown, Then, Turn};
use locard_engine::live;

impl Keeper {
    /// A file that was dropped into the window, or chosen: what it is tells what becomes of it.
    pub fn dropped(&mut self, ctx: &egui::Context, path: PathBuf, session: &mut Session) {
        let (wake, looked_at) = (ctx.clone(), path.clone());
        match Errand::begin("looking", move || wake.request_repaint(), move || Kind::of(&looked_at)) {
            Ok(looking) => self.looked_at.push((path, looking)),
            Err(error) => session.wrong(format!("no thread can be started that opens it: {error}")),
        }
    }

    /// Begins to open what was dropped, once it is known what it is.
    pub(super) fn opens_dropped(&mut self, session: &mut Session) {
        if self.then.is_some() || self.opening.is_some() {
            return;
        }
        let Some(kind) = self.looked_at.first().and_then(|(_, looking)| looking.take()) else { return };
        let (path, _) = self.looked_at.remove(0);
        match kind {
            Ok(Kind::Profile) => self.open_profile(path, session),
            Ok(Kind::Model) => self.dropped_model = Some(path),
            Ok(Kind::Scene) => {
                self.then =
                    Some(Then::Open(Box::new(Opened { scene: Some(path), ..Opened::of(&session.project) }), None))
            }
            Ok(Kind::Recording) => {
                self.then = Some(Then::Open(Box::new(Opened::recording(path)), None));
            }
            Ok(Kind::Neither(why)) | Err(why) => session.wrong(why),
        }
    }

    /// Opens what is open with another profile, or what could not be opened without one.
    pub(super) fn open_profile(&mut self, path: PathBuf, session: &Session) {
        let opened = self.not_opened.clone().unwrap_or_else(|| Opened::of(&session.project));
        self.then = Some(Then::Open(Box::new(Opened { profile: Some(path), ..opened }), None));
    }

    /// Begins to write a file as all is set now. `chosen`: a person has just chosen it by name, and agreed that it is
    /// replaced.
    pub(super) fn write(&mut self, ctx: &egui::Context, session: &mut Session, step: &Step, chosen: bool) {
        let project = &mut session.project;
        // Saving gives a profile what is the camera's; one that is named from the menu gets all.
        let is_of_camera = self.saving.is_some() && project.can_place();
        let scope = if is_of_camera { ProfileScope::Camera } else { ProfileScope::All };
        let (path, draft) = match step {
            Step::WriteScene(path) => (path, project.scene_draft(path)),
            Step::WriteProfile(path) => (path, Ok(project.profile_draft(path, scope))),
            _ => return,
        };
        let is_agreed = chosen || self.saving.as_ref().is_some_and(|agreed| agreed.contains(path));
        let (known, wake) = (project.stamp(path), ctx.clone());
        let begun = draft.map_err(|error| error.to_string()).and_then(|draft| {
            let draft = if is_agreed { draft } else { draft.unless_changed(known) };
            let begun = Errand::begin("saving", move || wake.request_repaint(), move || draft.write());
            begun.map_err(|error| format!("no thread can be started that writes it: {error}"))
        });
        match begun {
            Ok(writing) => self.writing = Some(writing),
            Err(why) => self.not_saved(session, &why),
        }
    }

    fn not_saved(&mut self, session: &mut Session, why: &str) {
        session.wrong(format!("Not saved: {why}"));
        (self.saving, self.then) = (None, None);
    }

    /// Takes what has been written; whether something is still being written.
    fn is_writing(&mut self, session: &mut Session) -> bool {
        let Some(done) = self.writing.as_ref().map(Errand::take) else { return false };
        let Some(done) = done else { return true };
        self.writing = None;
        match done {
            Ok(Ok(written)) => {
                let path = written.path.clone();
                let what = written.what();
                session.project.written(written);
                self.saved.retain(|saved| saved.what != what);
                self.saved.push(Saved { what, path: path.clone() });
                session.say(saving::ended(&self.saved, &session.project.unsavable_changes()));
                self.recent.add(Opened::of(&session.project));
                self.passed_over.retain(|passed| *passed != path);
                if let Some(watch) = &mut self.watch {
                    watch.known(&path, session.project.stamp(&path));
                }
            }
            Ok(Err(SaveError::Changed(path))) => self.asks_whether = Some(path),
            Ok(Err(error)) => self.not_saved(session, &error.to_string()),
            Err(why) => self.not_saved(session, &why),
        }
        false
    }

    /// Goes on with what is being saved, until something has to be asked or waited for.
    pub(super) fn saves(&mut self, ctx: &egui::Context, session: &mut Session) {
        while !self.is_writing(session)
            && self.chooser.is_none()
            && self.asks_whether.is_none()
            && self.asks_first.is_none()
            && !self.asks_camera_values
        {
            let Some(replaced) = &self.saving else { return };
            let project = &session.project;
            let agreed = Agreed { replaced, shared: &self.shared, camera: self.camera_values };
            match saving::next(project, self.watch.as_ref(), agreed) {
                Step::Saved => {
                    self.saving = None;
                    session.say(saving::ended(&self.saved, &session.project.unsavable_changes()));
                }
                Step::NameScene => self.name_scene(project),
                Step::NameProfile => self.name_profile(project),
                Step::AskCamera => self.asks_camera_values = true,
                Step::AskFirst(path) => self.asks_first = Some(path),
                Step::AskWhether(path) => self.asks_whether = Some(path),
                step => self.write(ctx, session, &step, false),
            }
        }
    }

    pub(super) fn asks(&mut self, ctx: &egui::Context, session: &mut Session) {
        if self.chooser.is_some() || self.opening.is_some() {
            return;
        }
        if let Some(air) = &mut self.air {
            if let Some(answer) = air.show(ctx) {
                self.aired = self.air.take();
                self.then = answer.map(|opened| Then::Open(Box::new(opened), None));
            }
            return;
        }
        if let Some(path) = self.asks_whether.clone() {
            match dialogs::whether_to_replace(ctx, &path) {
                Some(Answer::Yes) => {
                    self.saving.get_or_insert_default().push(path);
                    self.asks_whether = None;
                }
                Some(Answer::No) => {
                    self.read_again(ctx, session);
                    (self.asks_whether, self.saving, self.then) = (None, None, None);
                }
                Some(Answer::Cancel) => (self.asks_whether, self.saving, self.then) = (None, None, None),
                None => {}
            }
            return;
        }
        if let Some(path) = self.asks_first.clone() {
            let owner = saving::profile_owner(&session.project, &path);
            let answer = dialogs::whether_to_write(ctx, &path, owner);
            match answer {
                Some(Answer::Yes) => self.shared.push(path),
                Some(Answer::No) => self.name_profile(&session.project),
                Some(Answer::Cancel) => (self.saving, self.then) = (None, None),
                None => return,
            }
            self.asks_first = None;
            return;
        }
        if self.asks_camera_values {
            let Some(answer) = camera_values::ask(ctx, &session.project) else { return };
            (self.asks_camera_values, self.camera_values) = (false, answer);
            if answer.is_none() {
                (self.saving, self.then) = (None, None);
            }
            return;
        }
        if self.saving.is_some() || self.writing.is_some() {
            return;
        }
        self.goes_on(ctx, session);
        if self.then.is_some() {
            return;
        }
        if let Some(left) = self.left.pop() {
            match dialogs::left(ctx, &left.work) {
                Some(Answer::Yes) => self.then = Some(Then::Open(Box::new(left.opened()), Some(left))),
                Some(Answer::No) => left.throw_away(),
                // It stays where it is, and is offered at the next start.
                Some(Answer::Cancel) => drop(left),
                None => self.left.push(left),
            }
            return;
        }
        self.changed_on_disk(ctx, session);
        if self.shows_start {
            let name = titles::of_recording(&session.project);
            let behind = match saving::is_demonstration(&session.project.shot().recording.path) {
                true => dialogs::Behind::Demonstration,
                false => dialogs::Behind::Recording(&name),
            };
            match dialogs::start(ctx, self.recent.shown(ctx), behind) {
                Some(dialogs::Start::Open) => self.open(&session.project),
                Some(dialogs::Start::Camera) => self.asks_camera(ctx, &session.project),
                Some(dialogs::Start::Recent(opened)) => self.then = Some(Then::Open(opened, None)),
                Some(dialogs::Start::Leave) => self.shows_start = false,
                None => {}
            }
        }
    }

    /// Does what waits, once nothing is lost by it.
    fn goes_on(&mut self, ctx: &egui::Context, session: &mut Session) {
        let Some(then) = self.then.take() else {
            self.ends_recording = false;
            return;
        };
        // What cannot be opened is refused before anything is asked. A camera can be opened only
        // once the one that is shown has ended.
        let then = match then {
            Then::Open(opened, left) if opened.camera.is_none() => return self.begin(ctx, session, *opened, left),
            then => then,
        };
        let ending = self.ending(session, matches!(then, Then::Close));
        let answer = match ending.is_harmless() {
            true => Some(Answer::No),
            false => dialogs::before_it_is_lost(ctx, ending),
        };
        match (answer, then) {
            (None, then) => self.then = Some(then),
            (Some(Answer::Cancel), _) => {}
            (Some(Answer::Yes), then) => {
                self.save();
                // It may have files in common with what is saved, and is opened again.
                let then = match then {
                    Then::Show(shown) => Then::Open(Box::new(shown.opened), shown.left),
                    then => then,
                };
                (self.then, self.ends_recording) = (Some(then), true);
            }
            (Some(Answer::No), Then::Close) => {
                self.may_close = true;
                if let Some(jobs) = &mut self.jobs {
                    jobs.cancel_all();
                }
                ctx.send_viewport_cmd(egui::ViewportCommand::Close);
            }
            (Some(Answer::No), Then::Open(opened, left)) => self.begin(ctx, session, *opened, left),
            (Some(Answer::No), Then::Show(shown)) => self.agreed = Some(shown),
        }
    }

    /// What ends, or is lost, if the window is closed or something else is opened.
    pub(super) fn ending(&self, session: &Session, closes: bool) -> Ending {
        Ending {
            closes,
            is_changed: !session.project.is_saved(),
            is_busy: self.jobs.as_ref().is_some_and(Jobs::is_busy),
            is_recording: session.is_recording() && !self.ends_recording,
        }
    }

    /// Offers to read again what somebody else has changed.
    fn changed_on_disk(&mut self, ctx: &egui::Context, session: &mut Session) {
        let project = &session.project;
        let files = [project.profile.clone(), project.scene.clone()].into_iter().flatten();
        let is_new = |path: &PathBuf| {
            let change = self.watch.as_ref().and_then(|watch| watch.change(path));
            change == Some(Change::Changed) && !self.passed_over.contains(path)
        };
        let Some(path) = files.into_iter().find(is_new) else { return };
        match dialogs::changed_on_disk(ctx, &path, !project.is_saved()) {
            Some(Answer::Yes) => self.read_again(ctx, session),
            Some(_) => self.passed_over.push(path),
            None => {}
        }
    }

    fn read_again(&mut self, ctx: &egui::Context, session: &mut Session) {
        let wake = ctx.clone();
        self.begun(session, Opening::again(&session.project, move || wake.request_repaint()));
    }

    fn begin(&mut self, ctx: &egui::Context, session: &mut Session, opened: Opened, left: Option<Left>) {
        // A camera is one program's, and one window's.
        if opened.camera.is_some() {
            session.let_camera_go();
        }
        let is_open = opened.recording == Opened::of(&session.project).recording;
        let has_camera = is_open && !session.lacks_camera();
        let wake = ctx.clone();
        self.begun(session, Opening::begin(opened, left, has_camera, move || wake.request_repaint()));
    }

    fn begun(&mut self, session: &mut Session, opening: std::io::Result<Opening>) {
        match opening {
            Ok(opening) => self.opening = Some(opening),
            Err(error) => session.wrong(format!("no thread can be started that opens it: {error}")),
        }
    }

    /// What was opened meanwhile.
    pub(super) fn turn(&mut self, ctx: &egui::Context, session: &mut Session) -> Option<Turn> {
        if let Some(shown) = self.agreed.take() {
            return Some(self.shows(*shown, None));
        }
        let done = match self.opening.take()?.take() {
            Ok(done) => done,
            Err(opening) => {
                dialogs::opening(ctx, opening.what());
                self.opening = Some(*opening);
                return None;
            }
        };
        match done.project {
            Ok((fresh, _)) if done.is_again => {
                session.project.read_again(*fresh);
                session.say("Read again from the files; undo brings back what you had");
                self.passed_over.clear();
                self.watch_files(&session.project);
                None
            }
            Ok((project, camera)) => {
                let shown = Shown { opened: done.opened, project, left: done.left };
                if camera.is_none() && !self.ending(session, false).is_harmless() {
                    self.then = Some(Then::Show(Box::new(shown)));
                    ctx.request_repaint();
                    return None;
                }
                Some(self.shows(shown, camera))
            }
            // The dialog is there again, with all that was typed.
            Err(Refused { why, .. }) if done.opened.camera.is_some() && self.aired.is_some() => {
                self.air = self.aired.take().map(|air| air.refused(why));
                self.left.extend(done.left);
                None
            }
            Err(Refused { why, is_unfit_profile: true, .. }) => {
                session.wrong(why.clone());
                self.refused_profile = Some(why);
                // The next profile is for the recording that was refused, which may be another one
                // than the open one.
                let is_open = done.opened.recording == Opened::of(&session.project).recording;
                self.not_opened = Some(Opened { profile: None, ..done.opened }).filter(|_| !is_open);
                self.left.extend(done.left);
                None
            }
            Err(Refused { why, lacks_camera, .. }) => {
                let lacks_profile = lacks_camera && done.opened.profile.is_none();
                let then = if lacks_profile { ". Choose a camera profile for it: File, Open a profile…" } else { "" };
                session.wrong(format!("{why}{then}"));
                self.not_opened = if lacks_profile {
                    Some(done.opened)
                } else {
                    self.not_opened.take().filter(|waiting| waiting.recording == done.opened.recording)
                };
                self.left.extend(done.left);
                None
            }
        }
    }

    /// What was opened takes the place of what is open.
    fn shows(&mut self, shown: Shown, camera: Option<live::Opened>) -> Turn {
        let Shown { opened, project, left } = shown;
        if let Some(left) = left {
            self.take_up(left);
        }
        (self.shows_start, self.not_opened, self.refused_profile) = (false, None, None);
        Turn { project: *project, camera, at: opened.at }
    }
}
