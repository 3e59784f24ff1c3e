//! The window where there is nothing to show yet: a start without a recording where the demonstration is lacking. It offers
//! what can be opened, and becomes the tuner with it.

use std::path::{Path, PathBuf};

use eframe::egui::{self, Ui};
use eframe::egui_wgpu::RenderState;

use super::actions::{self, Action};
use super::air::Air;
use super::app::App;
use super::autosave::Left;
use super::chooser::{Begin, Chooser, Chosen, Seeks};
use super::dialogs;
use super::errand::Errand;
use super::fit;
use super::habits::{Habits, Use};
use super::keeper::Turn;
use super::keys;
use super::kind::Kind;
use super::looking::Looking;
use super::message::MessageWindow;
use super::opening::Opening;
use super::painter;
use super::question::Answer;
use super::recent::{Opened, Recent};
use super::saving::DEMO;
use super::theme;
use locard_engine::assets;

/// Something that was opened, with the work that is taken up in it.
type Begun = (Turn, Option<Left>);

/// See above.
pub struct Start {
    window: RenderState,
    /// Where work is kept.
    folder: Option<PathBuf>,
    recent: Recent,
    habits: Habits,
    left: Vec<Left>,
    looking: Option<Looking>,
    chooser: Option<Chooser>,
    /// Where the demonstration was looked for.
    places: Vec<PathBuf>,
    air: Option<Air>,
    /// As it was answered last.
    aired: Option<Air>,
    opening: Option<Opening>,
    /// What was dropped, and what it is.
    looked_at: Option<(PathBuf, Errand<Kind>)>,
    told: Option<MessageWindow>,
    shows_keys: bool,
    /// What became of it.
    app: Option<Box<App>>,
}

impl Start {
    /// Offers what lies in the user's folder for work.
    pub fn new(context: &eframe::CreationContext<'_>, folder: Option<&Path>) -> Result<Self, String> {
        let ctx = &context.egui_ctx;
        theme::install(ctx);
        // From the first frame on: it keeps the textures that egui hands over once.
        let window = painter::of_window(context)?;
        let read = |name: &str| folder.map(|folder| folder.join(name));
        let habits = read("habits.json").map_or_else(Habits::default, Habits::read);
        ctx.set_theme(habits.theme());
        let wake = ctx.clone();
        let looking = read("work").and_then(|work| Looking::begin(work, move || wake.request_repaint()).ok());
        Ok(Self {
            window,
            folder: folder.map(Path::to_owned),
            recent: read("recent.json").map_or_else(Recent::default, Recent::read),
            habits,
            left: Vec::new(),
            looking,
            chooser: None,
            places: assets::folders(),
            air: None,
            aired: None,
            opening: None,
            looked_at: None,
            told: None,
            shows_keys: false,
            app: None,
        })
    }

    /// The tuner, once something is open.
    pub fn app(&self) -> Option<&App> {
        self.app.as_deref()
    }

    fn begin(&mut self, ctx: &egui::Context, opened: Opened, left: Option<Left>) {
        let wake = ctx.clone();
        match Opening::begin(opened, left, false, move || wake.request_repaint()) {
            Ok(opening) => self.opening = Some(opening),
            Err(error) => {
                self.told = Some(MessageWindow::new(format!("No thread can be started that opens it: {error}")))
            }
        }
    }

    fn drop(&mut self, ctx: &egui::Context, path: PathBuf) {
        let (wake, dropped) = (ctx.clone(), path.clone());
        match Errand::begin("looking", move || wake.request_repaint(), move || Kind::of(&dropped)) {
            Ok(looking) => self.looked_at = Some((path, looking)),
            Err(error) => {
                self.told = Some(MessageWindow::new(format!("No thread can be started that opens it: {error}")))
            }
        }
    }

    fn chooses(&mut self) {
        let last = self.habits.folder(Use::Recording).map(Path::to_owned);
        let begin = Begin::within(last.into_iter().chain(std::env::home_dir()));
        self.chooser = Some(Chooser::new("Open a recording", Seeks::Recording, begin));
    }

    /// One frame of the window. Gives what was opened.
    fn show(&mut self, ctx: &egui::Context) -> Option<Begun> {
        for file in ctx.input(|i| i.raw.dropped_files.clone()) {
            self.drop(ctx, file.path().to_owned());
        }
        if let Some((path, kind)) = self.looked_at.take() {
            match kind.take() {
                None => self.looked_at = Some((path, kind)),
                Some(Ok(Kind::Recording)) => self.begin(ctx, Opened::recording(path), None),
                Some(Ok(Kind::Neither(why)) | Err(why)) => self.told = Some(MessageWindow::new(why)),
                Some(Ok(Kind::Scene | Kind::Profile | Kind::Model)) => {
                    let why = format!("{}: open a recording first, then drop it again", path.display());
                    self.told = Some(MessageWindow::new(why));
                }
            }
        }
        if let Some(opening) = self.opening.take() {
            match opening.take() {
                Err(opening) => {
                    dialogs::opening(ctx, opening.what());
                    self.opening = Some(*opening);
                }
                Ok(done) => match done.project {
                    Ok((project, camera)) => {
                        return Some((Turn { project: *project, camera, at: done.opened.at }, done.left));
                    }
                    Err(refused) => {
                        self.left.extend(done.left);
                        // The dialog is there again, with all that was typed.
                        match self.aired.take().filter(|_| done.opened.camera.is_some()) {
                            Some(air) => self.air = Some(air.refused(refused.why)),
                            None => self.told = Some(MessageWindow::new(refused.why)),
                        }
                    }
                },
            }
            return None;
        }
        if let Some(chooser) = &mut self.chooser {
            match chooser.show(ctx) {
                None => {}
                Some(Chosen::Nothing) => self.chooser = None,
                Some(Chosen::Path { path, .. }) => {
                    self.chooser = None;
                    self.habits.used(Use::Recording, &path);
                    self.drop(ctx, path);
                }
            }
            return None;
        }
        if let Some(air) = &mut self.air {
            match air.show(ctx) {
                Some(Some(opened)) => {
                    self.aired = self.air.take();
                    self.begin(ctx, opened, None);
                }
                Some(None) => self.air = None,
                None => {}
            }
            return None;
        }
        if let Some(left) = self.looking.as_mut().and_then(Looking::take) {
            (self.left, self.looking) = (left, None);
        }
        if let Some(left) = self.left.pop() {
            match dialogs::left(ctx, &left.work) {
                Some(Answer::Yes) => self.begin(ctx, left.opened(), Some(left)),
                Some(Answer::No) => left.throw_away(),
                // It stays where it is, and is offered at the next start.
                Some(Answer::Cancel) => drop(left),
                None => self.left.push(left),
            }
            return None;
        }
        for action in actions::pressed(ctx, false) {
            match action {
                Action::Keys => self.shows_keys = !self.shows_keys,
                Action::Leave => (self.shows_keys, self.told) = (false, None),
                Action::Open => self.chooses(),
                Action::Theme => theme::exchange(ctx),
                // There is nothing open that the others act on.
                _ => {}
            }
        }
        keys::show(ctx, &mut self.shows_keys);
        let places: Vec<PathBuf> = self.places.iter().map(|folder| folder.join(DEMO)).collect();
        match dialogs::start(ctx, self.recent.shown(ctx), dialogs::Behind::Nothing(&places)) {
            Some(dialogs::Start::Open) => self.chooses(),
            Some(dialogs::Start::Camera) => self.air = Some(Air::new(ctx, None, None)),
            Some(dialogs::Start::Recent(opened)) => self.begin(ctx, *opened, None),
            Some(dialogs::Start::Leave) | None => {}
        }
        if let Some(message) = &mut self.told
            && message.show(ctx)
        {
            self.told = None;
        }
        None
    }
}

impl eframe::App for Start {
    fn clear_color(&self, visuals: &egui::Visuals) -> [f32; 4] {
        visuals.panel_fill.to_normalized_gamma_f32()
    }

    fn ui(&mut self, ui: &mut Ui, frame: &mut eframe::Frame) {
        if let Some(app) = &mut self.app {
            return app.ui(ui, frame);
        }
        let ctx = ui.ctx().clone();
        fit::to_screen(&ctx);
        egui::CentralPanel::default().show(ui, |_| ());
        let Some((turn, left)) = self.show(&ctx) else { return };
        match App::begin(&ctx, self.window.clone(), turn.project, turn.camera) {
            Ok(mut app) => {
                // What is left is the tuner's to offer from now on.
                (self.left, self.looking, self.recent) = (Vec::new(), None, Recent::default());
                if let Some(folder) = &self.folder {
                    app.keep_in(folder);
                }
                app.go_on(turn.at, left);
                self.app = Some(Box::new(app));
                ctx.request_repaint();
            }
            Err(why) => self.told = Some(MessageWindow::new(why)),
        }
    }

    fn on_exit(&mut self) {
        if let Some(app) = &mut self.app {
            app.on_exit();
        }
    }
}
