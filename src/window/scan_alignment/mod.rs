//! The panel that aligns a scan of the place with the footage, as `locard site` does: a view of the
//! scan, pairs of clicks in the picture and in the scan, and the alignment by them.
//!
//! - `panel`: its controls.
//! - `view`: the scan's picture and the pointer in it, with `orbit` (camera) and `shading`.
//! - `pairs`: their list and marks. `edges`: those of the scan over the picture.
//! - `tasks`: reading and alignment on background threads.

mod edges;
mod orbit;
mod pairs;
mod panel;
mod shading;
mod tasks;
mod view;

use std::path::PathBuf;
use std::sync::Arc;

use eframe::egui::{self, Pos2};
use glam::DVec3;

use self::edges::ScanEdges;
use self::pairs::PairList;
use self::tasks::{AlignmentOutcome, AlignmentRequest, AlignmentTask, ScanReading};
use self::view::FreeView;
use super::picture::PictureOutput;
use super::project::Project;
use super::scan_pick::ScanPick;
use super::session::Session;
use super::tool::{Tool, ToolStack};
use locard_engine::shot::Shot;
use locard_engine::site::SiteScan;

/// State of the panel.
pub struct ScanAlignment {
    is_open: bool,
    scan: Option<Arc<SiteScan>>,
    /// Length of the scan's unit, m; `None`: that of its format.
    metres_per_unit: Option<f64>,
    reading: Option<ScanReading>,
    view: FreeView,
    pairs: PairList,
    edges: ScanEdges,
    shows_edges: bool,
    finds_scale: bool,
    refines: bool,
    aligning: Option<AlignmentTask>,
    /// The last alignment's report.
    report: Vec<String>,
    error: Option<String>,
    /// A file is to be chosen.
    chooses_file: bool,
}

impl Default for ScanAlignment {
    fn default() -> Self {
        Self {
            is_open: false,
            scan: None,
            metres_per_unit: None,
            reading: None,
            view: FreeView::default(),
            pairs: PairList::default(),
            edges: ScanEdges::default(),
            shows_edges: true,
            finds_scale: false,
            refines: true,
            aligning: None,
            report: Vec::new(),
            error: None,
            chooses_file: false,
        }
    }
}

impl ScanAlignment {
    pub fn is_open(&self) -> bool {
        self.is_open
    }

    /// Opens the panel with its scan, or with that of the scene. Without a scan a file is to be
    /// chosen first.
    pub fn open(&mut self, project: &Project, tools: &mut ToolStack) {
        if self.scan.is_none()
            && let Some(site) = project.shot().recording.site()
        {
            self.scan = Some(Arc::clone(&site.scan));
            self.metres_per_unit = project.edit().scene.site.as_ref().and_then(|site| site.metres_per_unit);
        }
        if self.scan.is_none() {
            self.chooses_file = true;
        } else {
            self.is_open = true;
            tools.begin(Tool::PickScan(ScanPick::default()));
        }
    }

    /// True once after a request for a file.
    pub fn take_file_request(&mut self) -> bool {
        std::mem::take(&mut self.chooses_file)
    }

    /// Reads a scan in place of the present one. Pairs stay if only the unit changes.
    pub fn read(&mut self, ctx: &egui::Context, path: PathBuf) {
        if self.scan.as_ref().is_none_or(|scan| scan.path != path) {
            self.metres_per_unit = None;
        }
        self.is_open = true;
        self.begin_reading(ctx, path);
    }

    fn begin_reading(&mut self, ctx: &egui::Context, path: PathBuf) {
        self.error = None;
        match ScanReading::begin(ctx, path, self.metres_per_unit) {
            Ok(reading) => self.reading = Some(reading),
            Err(why) => self.error = Some(why),
        }
    }

    fn close(&mut self, tools: &mut ToolStack) {
        self.is_open = false;
        self.pairs.pending_point = None;
        self.aligning = None;
        if tools.scan_pick().is_some() {
            tools.cancel();
        }
    }

    /// Position of a visible point of the scan, m, in its view on the screen.
    pub fn on_screen(&self, point_m: DVec3) -> Option<Pos2> {
        self.view.on_screen(point_m)
    }

    /// True if the view shows the scan at rest.
    pub fn is_settled(&self, now_s: f64) -> bool {
        self.view.is_settled(now_s)
    }

    /// Takes results of background work, and completes pairs. Runs whether the panel is shown or
    /// not.
    pub fn poll(&mut self, session: &mut Session, tools: &mut ToolStack) {
        if let Some(read) = self.reading.as_ref().and_then(ScanReading::take) {
            let is_new_file = |scan: &Arc<SiteScan>| self.scan.as_ref().is_none_or(|old| old.path != scan.path);
            match read {
                Ok(scan) => {
                    if is_new_file(&scan) {
                        self.pairs = PairList::default();
                    }
                    if !scan.warnings.is_empty() {
                        session.show_message(scan.warnings.join("; "));
                    }
                    self.report.clear();
                    self.view.fit();
                    self.scan = Some(scan);
                    if self.is_open {
                        tools.begin(Tool::PickScan(ScanPick::default()));
                    }
                }
                Err(why) => self.fail(session, why),
            }
            self.reading = None;
        }
        if let Some(outcome) = self.aligning.as_ref().and_then(AlignmentTask::take) {
            self.aligning = None;
            match outcome {
                Ok(outcome) => self.take_outcome(session, outcome),
                Err(why) => self.fail(session, why),
            }
        }
        self.pairs.complete(tools);
    }

    fn fail(&mut self, session: &mut Session, why: String) {
        session.show_error(why.clone());
        self.error = Some(why);
    }

    fn take_outcome(&mut self, session: &mut Session, outcome: AlignmentOutcome) {
        let AlignmentOutcome { errors_px, wrong_pair, placed } = outcome;
        self.pairs.set_errors(&errors_px, wrong_pair);
        let done = placed.and_then(|placed| {
            let Some((placed, report)) = placed else { return Ok(None) };
            session.project.place_scan(placed).map_err(|error| error.to_string())?;
            Ok(Some(report))
        });
        match done {
            Ok(Some(report)) => {
                session.show_message(format!("Scan {}", report.join("; ")));
                self.report = report;
            }
            Ok(None) => session.show_message("The alignment was cancelled"),
            Err(why) => self.fail(session, why),
        }
    }

    /// Paints the marks of a frame, and the edges of the scan, over the picture.
    pub fn paint(&mut self, picture: &PictureOutput, shot: &Shot, frame: usize, tools: &ToolStack) {
        if self.is_open {
            if self.shows_edges {
                self.edges.paint(picture, shot, frame);
            }
            self.pairs.paint(picture, frame, tools);
        }
    }

    fn begin_alignment(&mut self, ctx: &egui::Context, session: &mut Session) {
        let Some(scan) = self.scan.clone() else { return };
        self.error = None;
        self.report.clear();
        let project = &session.project;
        let request = AlignmentRequest {
            shot: project.shot().clone(),
            scene: project.edit().scene.clone(),
            scene_path: project.scene_path(),
            scan,
            metres_per_unit: self.metres_per_unit,
            pairs: self.pairs.pairs().collect(),
            finds_scale: self.finds_scale,
            refines: self.refines,
        };
        match AlignmentTask::begin(ctx, request) {
            Ok(task) => self.aligning = Some(task),
            Err(why) => self.fail(session, why),
        }
    }
}
