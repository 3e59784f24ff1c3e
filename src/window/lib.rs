//! The tuner's window: a recording as it plays, its evidence in it, and every parameter beside the picture.
//!
//! - `project`: what a person edits, as plain values; what is undone and saved. `history`: its past.
//! - `session`: a recording that is open. `player`: which frame is due. `maker` makes pictures on threads of its
//!   own, of frames that `reader` decodes. `viewer`: the window's textures that it all goes into; `canvas` shows them,
//!   `placed` where they lie on the screen. `painter` paints the window again where `changes` says.
//!   A camera in a recording's place: `session/live`, with `session/past`, and `camera` below the picture; `air` asks for it.
//! - `side`: the tabs beside the picture. `matching`: plots of real and virtual, by `analysis` of a picture, and `pointer`.
//!   `light`: how bright frames are by themselves; `times`: the GPU's. `calibrating`: noise and sharpness from picked places, each
//!   with its verdict, and a camera's lens from a board; `reasons`: what calibration says, in the window's words. `plots`: how plots look.
//! - `background`: work on another thread, of which what was asked for last counts; `errand`: work that is done once there.
//!   `progress`: how far it is. `fields`: numbers to drag and to type, with a `slider`.
//! - `measure`: what the window costs. `app`: the window. `fit`: its size at the start. `theme`: its colours. `actions`: what keys do, `keys` the page of them. `picture` with its `loupe`, `controls` (`row_widths`),
//!   `evidence`, `timeline` with its `thumbnails`: its parts. `hand`: places in the picture that another part asks for; `steered` by keys.
//!   `obstacle`: why nothing can be placed; `notice` shows it over the picture. `warnings`: of the recording.
//!   `handles`: objects and lamps in the picture, selected and moved. `library`: what can be placed. `ground`, with its `finder`: the
//!   surface that it is placed on, and the scale. `list`: what is placed; `wrongs`: what stands wrong of it; `things`: what is
//!   done to what is selected. `lamps`: those of the scene, and one more.
//! - `missing`: files that the scene lacks; `tilt`: upright things on tilted surfaces.
//! - `camera_values`: the question where changed values of the camera are saved.
//! - `analysing`: the footage analysed, and what was found taken over where one is.
//! - `keeper`: opening and saving, and the questions before anything is lost (`chooser`, `dialogs`,
//!   `question`, `message`, `kind`, `saving`, `opening`, `watch`, `recent`, `titles`, `habits`,
//!   `start` where there is nothing to show); work that a crash leaves (`autosave`, `held`,
//!   `looking`, in the folder of `state`); a new start where the device is lost (`restart`).
//!   `output`: exported files, by the queue of `jobs`, with the camera's `dials`.
//!   `command`: the same by command line.
//!
//! It talks to the [`Shot`](locard_engine::shot::Shot) alone: nothing is composited here that the program would not composite alike.

mod actions;
mod air;
mod analysing;
mod analysis;
mod app;
mod autosave;
mod background;
mod calibrating;
mod camera;
mod camera_values;
mod canvas;
mod changes;
mod chooser;
mod command;
mod controls;
mod dialogs;
mod dials;
mod errand;
mod evidence;
mod fields;
mod finder;
mod fit;
mod ground;
mod habits;
mod hand;
mod handles;
mod held;
mod history;
mod jobs;
mod keeper;
mod keys;
mod kind;
mod lamps;
mod library;
mod light;
mod list;
mod looking;
mod loupe;
mod maker;
mod matching;
mod measure;
mod message;
mod missing;
mod notice;
mod obstacle;
mod opening;
mod output;
mod painter;
mod picture;
mod placed;
mod player;
mod plots;
mod pointer;
mod progress;
mod project;
mod question;
mod reader;
mod reasons;
mod recent;
mod restart;
mod room_light;
mod row_widths;
mod saving;
mod session;
mod side;
mod slider;
mod start;
mod state;
mod steered;
mod theme;
mod things;
mod thumbnails;
mod tilt;
mod timeline;
mod times;
mod titles;
mod viewer;
mod warnings;
mod watch;
mod wrongs;

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::path::PathBuf;
use std::sync::{Arc, OnceLock};

use eframe::egui;
use eframe::egui_wgpu::{WgpuSetup, WgpuSetupCreateNew};

pub use app::App;
pub use autosave::{Autosave, Left, Work};
pub use command::{Line, composite as command_line};
pub use eframe::Error;
pub use history::{History, Record};
pub use jobs::{Jobs, State, Task};
pub use measure::Measure;
pub use picture::View;
pub use player::{Pace, Player};
pub use project::{Draft, Edit, Origin, Other, ProfileScope, Project, SaveError, Written};
pub use saving::{DEMO, DEMO_SCENE};
pub use start::Start;

use locard_engine::gpu::Gpu;
use locard_engine::live;

/// What the window begins with.
#[derive(Default)]
pub struct First {
    pub project: Option<Project>,
    /// The project is of its recording, which arrives from now on.
    pub camera: Option<live::Opened>,
    /// What comes from the camera is recorded into this folder.
    pub record: Option<PathBuf>,
    /// The page that says what can be opened; there is nothing else where there is no project.
    pub start: bool,
    /// It works by itself, and keeps nothing.
    pub measure: Option<Measure>,
}

/// Opens the window and waits until it is closed.
pub fn open(first: First) -> Result<(), eframe::Error> {
    let mut setup = WgpuSetupCreateNew::without_display_handle();
    setup.device_descriptor = Arc::new(Gpu::wanted);
    let size = egui::vec2(1280.0, 800.0);
    let mut options = eframe::NativeOptions {
        viewport: egui::ViewportBuilder::default()
            .with_title("Locard")
            .with_app_id("locard")
            .with_inner_size(size)
            .with_min_inner_size(egui::vec2(640.0, 400.0))
            .with_drag_and_drop(true),
        renderer: eframe::Renderer::Wgpu,
        // It would change the picture's code values.
        dithering: false,
        ..Default::default()
    };
    options.wgpu_options.wgpu_setup = WgpuSetup::CreateNew(setup);
    let device = Arc::new(OnceLock::new());
    let of_window = Arc::clone(&device);
    let run = move || {
        let app = move |context: &eframe::CreationContext<'_>| -> Result<Box<dyn eframe::App>, Box<dyn std::error::Error + Send + Sync>> {
            if let Some(state) = context.wgpu_render_state.clone() {
                let _ = of_window.set(state);
            }
            let First { project, camera, record, start, measure } = first;
            let Some(project) = project else {
                return Ok(Box::new(Start::new(context, state::folder().as_deref())?));
            };
            let mut app = App::new(context, project, camera)?;
            if let Some(measure) = measure {
                return Ok(Box::new(app.measured(measure)));
            }
            if let Some(folder) = state::folder() {
                app.keep_in(&folder);
            }
            context.egui_ctx.set_theme(app.keeper().theme());
            app.show_start(start);
            record.into_iter().for_each(|folder| app.record(folder));
            Ok(Box::new(app))
        };
        eframe::run_native("locard", options, Box::new(app))
    };
    // egui's own drawing panics where the device is lost in the middle of a frame.
    catch_unwind(AssertUnwindSafe(run)).unwrap_or_else(|panic| {
        device.get().into_iter().for_each(restart::where_lost);
        resume_unwind(panic)
    })
}
