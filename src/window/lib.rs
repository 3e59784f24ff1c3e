//! The tuner's window: plays a recording with its evidence, and has a control for every parameter.
//!
//! It only uses the [`Shot`](locard_engine::shot::Shot): the window composites nothing that the
//! program would not composite alike.
//!
//! - Documents: `project` is the edited state with its undo `history`; `documents` opens and saves
//!   files, and has the one open modal dialog. Its parts: `opening`, `saving`, `file_watch`
//!   (changes on disk), `file_kind` (of a file), `state` (between sessions) with `recent`,
//!   `chooser` (file dialog), `camera_dialog`, `camera_values`, `dialogs`, `question`, `message`,
//!   `titles`. `start` is the window without a document.
//! - Recovery: `autosave` and `recovery_search` of `unsaved_work`, with `session_lock` and
//!   `file_lock`; `restart` after the graphics device was lost.
//! - Output: the queue `jobs` with `output` and `dials`, `analysing`, and `command` for the same by
//!   command line.
//! - Playback: `session` is an open recording or live camera, `player` selects the due frame,
//!   `frame_renderer` composites on background threads frames that `reader` decodes. `viewer` has
//!   the textures, `canvas` draws them, and `picture_transform` is their position on the screen.
//! - Window: `app`, `actions` and `keys`, `picture` with `loupe`, `timeline` with `thumbnails`,
//!   `camera`, `theme`, `window_size` (initial size), `painter` with `damage`, `measure`
//!   (performance).
//! - Panels: `side`, `controls` with `row_widths`, `fields`, `slider`, `progress`,
//!   `brightness_plot`, `gpu_times`, `plots`, `matching` with `analysis` and `pointer_probe`,
//!   `calibrating` with `calibration_messages`.
//! - Scene: `evidence`, `library`, `list`, `object_actions`, `scene_checks`, `missing`, `tilt`,
//!   `lamps`, `environment_light`, `ground`, `obstacle`, `notice`, `warnings`. `scan_alignment`
//!   aligns a scan of the place.
//! - Input in the picture: `tool` is the active tool, and only it gets clicks, drags and Esc.
//!   Tools: `handles` (transforms), `placement`, `ground_pick`, `lamp_pick`, `scan_pick`,
//!   `region_picker`.
//!   `point_picker`, `picked_ground`, `click_context` and `keyboard_cursor` serve several of them.
//! - Background work: `task` starts all threads. `background` is for a value of which the latest
//!   request wins.

mod actions;
mod analysing;
mod analysis;
mod app;
mod autosave;
mod background;
mod brightness_plot;
mod calibrating;
mod calibration_messages;
mod camera;
mod camera_dialog;
mod camera_values;
mod canvas;
mod chooser;
mod click_context;
mod command;
mod controls;
mod damage;
mod dialogs;
mod dials;
mod documents;
mod environment_light;
mod evidence;
mod fields;
mod file_kind;
mod file_lock;
mod file_watch;
mod frame_renderer;
mod gpu_times;
mod ground;
mod ground_pick;
mod handles;
mod history;
mod jobs;
mod keyboard_cursor;
mod keys;
mod lamp_pick;
mod lamps;
mod library;
mod list;
mod loupe;
mod matching;
mod measure;
mod message;
mod missing;
mod noise_match;
mod notice;
mod object_actions;
mod obstacle;
mod opening;
mod output;
mod painter;
mod parameter_help;
mod picked_ground;
mod picture;
mod picture_transform;
mod placement;
mod player;
mod plots;
mod point_picker;
mod pointer_probe;
mod progress;
mod project;
mod question;
mod reader;
mod recent;
mod recovery_search;
mod region_picker;
mod restart;
mod row_widths;
mod saving;
mod scan_alignment;
mod scan_pick;
mod scene_checks;
mod scene_compositor;
mod session;
mod session_lock;
mod side;
mod slider;
mod start;
mod state;
mod task;
mod theme;
mod thumbnails;
mod tilt;
mod timeline;
mod titles;
mod tool;
mod unsaved_work;
mod viewer;
mod warnings;
mod window_size;

use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::path::PathBuf;
use std::sync::{Arc, OnceLock};

use eframe::egui;
use eframe::egui_wgpu::{WgpuSetup, WgpuSetupCreateNew};

pub use app::App;
pub use autosave::Autosave;
pub use command::{CommandLine, composite as command_line};
pub use eframe::Error;
pub use history::{History, HistoryRecord};
pub use jobs::{JobKind, JobState, Jobs};
pub use measure::Measure;
pub use picture::PictureView;
pub use player::{Pace, Player};
pub use project::{ComparisonVariant, Draft, Edit, Origin, ProfileScope, Project, SaveError, WrittenFile};
pub use recovery_search::RecoverableWork;
pub use saving::{DEMO, DEMO_SCENE};
pub use start::Start;
pub use unsaved_work::UnsavedWork;

use locard_engine::gpu::Gpu;
use locard_engine::live;
use locard_engine::user_folders;

/// The initial content of the window.
#[derive(Default)]
pub struct InitialContent {
    pub project: Option<Project>,
    /// Camera of the project, whose recording arrives from now on.
    pub camera: Option<live::LiveInput>,
    /// Records the camera into this folder.
    pub record: Option<PathBuf>,
    /// Shows the welcome page; without a project there is only that page.
    pub start: bool,
    /// Runs a measurement without a user, and stores nothing.
    pub measure: Option<Measure>,
}

/// Opens the window and waits until it is closed.
pub fn open(first: InitialContent) -> Result<(), eframe::Error> {
    let mut setup = WgpuSetupCreateNew::without_display_handle();
    setup.device_descriptor = Arc::new(Gpu::device_descriptor);
    let size = egui::vec2(1280.0, 800.0);
    let mut options = eframe::NativeOptions {
        viewport: egui::ViewportBuilder::default()
            .with_title("Locard")
            .with_app_id("locard")
            .with_inner_size(size)
            .with_min_inner_size(egui::vec2(640.0, 400.0))
            .with_drag_and_drop(true),
        renderer: eframe::Renderer::Wgpu,
        // Dithering would change the picture's code values.
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
            let InitialContent { project, camera, record, start, measure } = first;
            let Some(project) = project else {
                return Ok(Box::new(Start::new(context, user_folders::state().as_deref())?));
            };
            let mut app = App::new(context, project, camera)?;
            if let Some(measure) = measure {
                return Ok(Box::new(app.measured(measure)));
            }
            if let Some(folder) = user_folders::state() {
                app.set_state_folder(&folder);
            }
            context.egui_ctx.set_theme(app.documents().theme());
            app.show_start(start);
            record.into_iter().for_each(|folder| app.record(folder));
            Ok(Box::new(app))
        };
        eframe::run_native("locard", options, Box::new(app))
    };
    // egui's own drawing panics if the device is lost during a frame.
    catch_unwind(AssertUnwindSafe(run)).unwrap_or_else(|panic| {
        device.get().into_iter().for_each(restart::restart_if_lost);
        resume_unwind(panic)
    })
}
