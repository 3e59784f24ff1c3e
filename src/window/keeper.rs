//! What keeps a person's work: opening and saving, what is asked before anything is lost, what a crash leaves, and what
//! leaves the window as files.

mod choosing;
mod files;

use std::path::{Path, PathBuf};
use std::time::Instant;

use eframe::egui;

use super::air::Air;
use super::analysing::Analysing;
use super::autosave::{Autosave, HISTORY_STEPS, Left, Work};
use super::camera_values::CameraValueTarget;
use super::chooser::{Chooser, Seeks};
use super::errand::Errand;
use super::habits::{Habits, Use};
use super::jobs::{Jobs, State};
use super::kind::Kind;
use super::looking::Looking;
use super::message::MessageWindow;
use super::missing;
use super::opening::Opening;
use super::output::{Ask, Output, Situation, proposed};
use super::project::{Project, SaveError, Written};
use super::recent::{At, Opened, Recent};
use super::restart;
use super::saving::Saved;
use super::session::Session;
use super::watch::{Change, Watch};
use locard_engine::live;

/// What a dialog chooses a path for.
#[derive(Debug)]
enum Purpose {
    Open,
    OpenProfile,
    OpenScene,
    /// A file that the scene names and that cannot be read.
    Locate(PathBuf),
    SaveProfile,
    SaveScene,
    Put(Ask),
    /// A camera's pictures from now on; its last seconds.
    Record,
    Keep,
}

impl Purpose {
    fn of(&self) -> Use {
        match self {
            Self::Open => Use::Recording,
            Self::OpenProfile | Self::SaveProfile => Use::Profile,
            Self::OpenScene | Self::SaveScene | Self::Locate(_) => Use::Scene,
            Self::Put(_) | Self::Record | Self::Keep => Use::Output,
        }
    }
}

/// What is done once nothing is lost by it.
#[derive(Debug)]
enum Then {
    Close,
    Open(Box<Opened>, Option<Left>),
    /// What was opened takes the place of what is open.
    Show(Box<Shown>),
}

/// What was opened, and what it was opened from.
#[derive(Debug)]
struct Shown {
    opened: Opened,
    project: Box<Project>,
    left: Option<Left>,
}

/// Something that was opened, to be shown from now on.
#[derive(Debug)]
pub struct Turn {
    pub project: Project,
    /// In place of a recording.
    pub camera: Option<live::Opened>,
    pub at: At,
}

/// The project's version and the history's revision while no button was down.
#[derive(Clone, Copy, Debug, Default)]
struct AtRest {
    version: u64,
    revision: u64,
}

/// The user's documents: open files, unsaved work, exports, and the dialogs about them.
#[derive(Debug, Default)]
pub struct Keeper {
    autosave: Option<Autosave>,
    at_rest: AtRest,
    left: Vec<Left>,
    /// Where work that was left is to be looked for.
    look_in: Option<PathBuf>,
    looking: Option<Looking>,
    recent: Recent,
    habits: Habits,
    watch: Option<Watch>,
    jobs: Option<Jobs>,
    analysing: Analysing,
    output: Output,
    pub shows_output: bool,
    /// The page that a start without a recording has.
    pub shows_start: bool,
    /// The message that is shown whole.
    pub message: Option<MessageWindow>,
    /// Why the last profile was not opened, until it is read.
    pub refused_profile: Option<String>,
    chooser: Option<(Purpose, Chooser)>,
    /// Asks for a camera.
    air: Option<Air>,
    /// As it was answered last.
    aired: Option<Air>,
    /// The user's folder for what lies between two sessions.
    folder: Option<PathBuf>,
    opening: Option<Opening>,
    /// What was dropped, and what it is.
    looked_at: Vec<(PathBuf, Errand<Kind>)>,
    /// A model that was dropped and can be read.
    dropped_model: Option<PathBuf>,
    writing: Option<Errand<Result<Written, SaveError>>>,
    /// Files that a person has agreed to be written; `None` while nothing is being saved.
    saving: Option<Vec<PathBuf>>,
    /// Written since it was begun to save.
    saved: Vec<Saved>,
    asks_whether: Option<PathBuf>,
    /// A profile that others use too is to be written for the first time.
    asks_first: Option<PathBuf>,
    /// Such profiles that may be written from now on.
    shared: Vec<PathBuf>,
    /// Where changed values of the camera go is asked, and the answer for what is being saved.
    asks_camera_values: bool,
    camera_values: Option<CameraValueTarget>,
    /// Waits for an answer, or for what is being saved.
    then: Option<Then>,
    /// May be shown: nothing is lost by it.
    agreed: Option<Box<Shown>>,
    /// The person who saves before it knows that the camera's recording ends.
    ends_recording: bool,
    /// A recording that was not opened: a profile may be what it lacks.
    not_opened: Option<Opened>,
    may_close: bool,
    /// It has been told that the device is gone.
    has_lost: bool,
    /// Starts the program anew, or says why not; `None`: as [`restart::again`].
    pub restarts_by: Option<fn() -> String>,
    /// Files that are left as they are on the screen, though they were changed on disk.
    passed_over: Vec<PathBuf>,
}

impl Keeper {
    /// Keeps work in the user's folder for it, and offers what was left there.
    pub fn keep_in(&mut self, folder: &Path, session: &mut Session) {
        self.recent = Recent::read(folder.join("recent.json"));
        self.habits = Habits::read(folder.join("habits.json"));
        self.folder = Some(folder.to_owned());
        let work = folder.join("work");
        match Autosave::begin(&work) {
            Ok(autosave) => self.autosave = Some(autosave),
            Err(error) => session.say(format!("Your work is not kept for a crash: {}: {error}", work.display())),
        }
        self.look_in = Some(work);
        self.opened(session);
    }

    /// What is open is left, or the window ends: it opens again where one was.
    pub fn leaves(&mut self, project: &Project, at: At) {
        if project.is_frozen() {
            return;
        }
        self.recent.add(Opened { at, ..Opened::of(project) });
    }

    /// Goes on with work that was left, in its place.
    pub fn take_up(&mut self, left: Left) {
        match &mut self.autosave {
            Some(autosave) => autosave.take_up(left),
            None => drop(left),
        }
    }

    /// Closes what can be closed without an answer. `false` where nothing is open.
    pub fn close_windows(&mut self) -> bool {
        let was_open = self.shows_output || self.shows_start || self.message.is_some();
        (self.shows_output, self.shows_start, self.message) = (false, false, None);
        was_open
    }

    /// Closes the notice of a refused profile. The next profile is for the open recording.
    pub fn close_refusal(&mut self) {
        (self.refused_profile, self.not_opened) = (None, None);
    }

    /// A recording is open: from now on its files are watched.
    fn opened(&mut self, session: &Session) {
        let project = &session.project;
        if !project.is_frozen() {
            self.recent.add(Opened::of(project));
        }
        self.passed_over.clear();
        if let Some(watch) = &mut self.watch {
            watch.forget();
        }
        self.watch_files(project);
    }

    fn watch_files(&mut self, project: &Project) {
        let Some(watch) = &mut self.watch else { return };
        let own = [project.profile.as_ref(), project.scene.as_ref()].into_iter().flatten();
        own.chain([&project.shot().recording.path]).for_each(|path| watch.known(path, project.stamp(path)));
    }

    /// Light or dark, as it was chosen last.
    pub fn theme(&self) -> egui::ThemePreference {
        self.habits.theme()
    }

    /// Begins to save what is changed.
    pub fn save(&mut self) {
        if self.saving.is_none() {
            (self.saving, self.saved, self.camera_values) = (Some(Vec::new()), Vec::new(), None);
        }
    }

    /// Whether a click on the window's cross has to be answered first.
    fn closes(&mut self, ctx: &egui::Context, session: &Session) {
        let closes = ctx.input(|i| i.viewport().close_requested());
        if closes && !self.may_close && !self.ending(session, true).is_harmless() {
            ctx.send_viewport_cmd(egui::ViewportCommand::CancelClose);
            self.then = Some(Then::Close);
        }
    }

    /// Everything of a frame of the window that is not a panel. Gives what is to be shown instead.
    pub fn work(&mut self, ctx: &egui::Context, session: &mut Session) -> Option<Turn> {
        if self.watch.is_none() {
            let wake = ctx.clone();
            self.watch = Watch::begin(move || wake.request_repaint()).ok();
            self.watch_files(&session.project);
        }
        self.keep(ctx, session);
        self.closes(ctx, session);
        self.choosing(ctx, session);
        self.saves(ctx, session);
        self.opens_dropped(session);
        self.asks(ctx, session);
        self.out(ctx, session);
        if let Some(message) = &mut self.message
            && message.show(ctx)
        {
            self.message = None;
        }
        self.turn(ctx, session)
    }

    /// Has unsaved work written, and looks at the files.
    fn keep(&mut self, ctx: &egui::Context, session: &mut Session) {
        let now = Instant::now();
        let theme = ctx.options(|options| options.theme_preference);
        if theme != self.habits.theme() {
            self.habits.set_theme(theme);
        }
        #[cfg(development)]
        restart::try_it(session.viewer.gpu(), ctx);
        if session.is_lost() && !self.has_lost {
            self.has_lost = true;
            return self.starts_again(ctx, session);
        }
        if let Some(folder) = self.look_in.take() {
            let wake = ctx.clone();
            self.looking = Looking::begin(folder, move || wake.request_repaint()).ok();
        }
        if let Some(left) = self.looking.as_mut().and_then(Looking::take) {
            (self.left, self.looking) = (left, None);
        }
        let project = &session.project;
        let is_dragging = ctx.input(|i| i.pointer.any_down());
        let revision = project.history().revision();
        if !is_dragging {
            self.at_rest = AtRest { version: project.version(), revision };
        }
        // A drag of a slider changes the history. Any other drag does not, and an edit from before it
        // is written meanwhile.
        let is_kept = self.at_rest.revision == revision;
        if let Some(autosave) = self.autosave.as_mut().filter(|_| is_kept) {
            if !is_dragging && ctx.input(|i| i.pointer.any_released()) {
                autosave.hurry();
            }
            // Saving changes what is lost, and not the project's version.
            let version = (self.at_rest.version << 1) | u64::from(project.is_kept_saved());
            let kept = autosave.keep(version, now, || work(session));
            if let Some(wait) = kept.wait {
                ctx.request_repaint_after(wait);
            }
            if let Some(problem) = kept.problem {
                session.say(problem);
            }
        }
        if let Some(watch) = &mut self.watch {
            ctx.request_repaint_after(watch.look(now));
            let recording = &session.project.shot().recording.path;
            if watch.change(recording) == Some(Change::Gone) {
                session
                    .wrong(format!("{} is gone: bring it back, and its frames are shown again", recording.display()));
            }
        }
        self.load_returned_files(session);
    }

    /// Loads the scene again once a file that it lacks is back, but not in the middle of a move.
    fn load_returned_files(&mut self, session: &mut Session) {
        let Some(watch) = &mut self.watch else { return };
        let missing = |project: &Project| -> Vec<PathBuf> {
            project.shot().scene.missing.iter().map(|missing| missing.file.clone()).collect()
        };
        let before = missing(&session.project);
        watch.expect(&before);
        if session.project.history().is_trying() || !watch.take_returned() {
            return;
        }
        match missing::load_again(&mut session.project) {
            Ok(()) if missing(&session.project).len() < before.len() => {
                session.say("A missing file is back, and the scene was loaded again");
            }
            Ok(()) => {}
            Err(error) => session.wrong(error.to_string()),
        }
    }

    /// The graphics device is gone: the program starts anew, and takes up what is kept.
    fn starts_again(&mut self, ctx: &egui::Context, session: &mut Session) {
        let is_kept = match self.autosave.take() {
            Some(autosave) => {
                autosave.leave(work(session));
                true
            }
            None => session.project.is_saved(),
        };
        let again = self.restarts_by.unwrap_or(restart::again);
        let why = if is_kept { again() } else { "your work is not kept: save it first".to_owned() };
        let told = format!("The graphics device was lost: start it again ({why})");
        // The window may no longer show it: nothing draws.
        eprintln!("locard: {told}");
        session.wrong(told);
        if is_kept {
            self.may_close = true;
            ctx.send_viewport_cmd(egui::ViewportCommand::Close);
        }
    }

    /// The line that offers to analyse the footage, or says how far that is.
    pub fn offers(&mut self, ui: &mut egui::Ui, session: &mut Session) {
        if !self.analysing.show(ui, session, self.jobs.as_mut()) {
            return;
        }
        match self.queue(ui.ctx()) {
            true => self.jobs.iter_mut().for_each(|jobs| self.analysing.begin(&session.project, jobs)),
            false => session.wrong("no thread can be started that analyses"),
        }
    }

    /// Begins the queue where there is none; whether there is one.
    fn queue(&mut self, ctx: &egui::Context) -> bool {
        if self.jobs.is_none() {
            let wake = ctx.clone();
            self.jobs = Jobs::new(move || wake.request_repaint()).ok();
        }
        self.jobs.is_some()
    }

    /// The window of what leaves as files.
    fn out(&mut self, ctx: &egui::Context, session: &mut Session) {
        for over in self.jobs.iter_mut().flat_map(Jobs::take).collect::<Vec<_>>() {
            let Some(jobs) = &mut self.jobs else { continue };
            self.analysing.ended(over, jobs, session);
            let Some(entry) = jobs.entries.get(over) else { continue };
            match &entry.state {
                State::Done(said) => session.say(format!("Written {}: {said}", entry.name)),
                // It names the file already, or one in the folder.
                State::Failed(why) if why.starts_with(&entry.name) => session.wrong(why.clone()),
                State::Failed(why) => session.wrong(format!("{}: {why}", entry.name)),
                _ => {}
            }
        }
        if !self.shows_output {
            return;
        }
        if session.is_live() {
            self.shows_output = false;
            return session
                .say("Freeze the camera first (Space): its last seconds can be exported and photographed then");
        }
        let player = &session.player;
        let looped = Some(player.range()).filter(|range| range.len() < player.count());
        let now = Situation { frame: player.frame(), count: player.count(), looped };
        let mut ask = None;
        let mut is_open = true;
        let at = ctx.content_rect().right_top() + egui::vec2(-424.0, 44.0);
        egui::Window::new("Export and photograph")
            .default_pos(at)
            .open(&mut is_open)
            .default_size([400.0, 560.0])
            .vscroll(false)
            .show(ctx, |ui| ask = self.output.show(ui, &now, self.jobs.as_mut()));
        self.shows_output = is_open;
        if let Some(ask) = ask {
            let (title, seeks) = match &ask {
                Ask::Folder(_) => ("Write pictures into a folder", Seeks::NewFolder),
                Ask::Video { lossless: false, .. } => ("Write a video", Seeks::NewFile(&["mp4", "mkv"])),
                Ask::Video { .. } => ("Write a video", Seeks::NewFile(&["mkv", "mp4"])),
                Ask::Photograph(wanted) if wanted.bracket.is_some() => {
                    ("Write a series of photographs", Seeks::NewSeries(&["jpg", "jpeg", "png"]))
                }
                Ask::Photograph(_) => ("Write a photograph", Seeks::NewFile(&["jpg", "jpeg", "png"])),
                Ask::Snapshot(_) => ("Write the frame", Seeks::NewFile(&["png"])),
            };
            let name = proposed(&ask, &session.project.shot().recording.path);
            self.choose(&session.project, Purpose::Put(ask), title, seeks, Some(&name));
        }
    }

    /// The model that was dropped: the next click places it.
    pub fn take_model(&mut self) -> Option<PathBuf> {
        self.dropped_model.take()
    }

    /// What was opened is shown.
    pub fn turned(&mut self, session: &Session) {
        self.opened(session);
    }

    /// Whether the picture can wait: it keeps the graphics device busy at first, and what is asked of work that was left would
    /// stand behind it. Once that is taken up, the picture is another one.
    pub fn holds_picture(&self) -> bool {
        let takes_up = self.opening.as_ref().is_some_and(Opening::takes_up);
        let takes_up = takes_up
            || match &self.then {
                Some(Then::Open(_, left)) => left.is_some(),
                Some(Then::Show(shown)) => shown.left.is_some(),
                Some(Then::Close) | None => false,
            };
        !self.left.is_empty() || takes_up
    }

    /// Whether a dialog is open that wants an answer.
    pub fn is_asking(&self) -> bool {
        let asks =
            self.chooser.is_some() || self.asks_whether.is_some() || self.then.is_some() || self.opening.is_some();
        let asks = asks || self.asks_first.is_some() || self.asks_camera_values || self.air.is_some();
        asks || !self.left.is_empty()
    }

    /// The window closes, whatever is not saved.
    pub fn close_without_asking(&mut self) {
        self.may_close = true;
    }

    pub fn jobs(&self) -> Option<&Jobs> {
        self.jobs.as_ref()
    }
}

/// The work that a crash would lose. It has the state before a drag and before a tried change.
fn work(session: &Session) -> Option<Work> {
    let project = &session.project;
    if project.is_kept_saved() {
        return None;
    }
    let (recording, unit) = (&project.shot().recording.path, project.metres_per_unit);
    let (profile, scene) = (project.profile.as_deref(), project.scene.as_deref());
    let mut work = Work::new(recording, unit, profile, scene, project.history().kept().clone())
        .with_history(project.history().record(HISTORY_STEPS));
    work.frame = session.player.frame();
    work.camera = project.camera.clone().filter(|_| session.is_live());
    Some(work)
}
