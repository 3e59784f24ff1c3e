//! Work on a scan on background threads: reading its file, and alignment by pairs and pictures.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use eframe::egui::{Context, Ui};

use super::super::progress;
use super::super::project::PlacedScan;
use super::super::task::{BackgroundTask, Reporter};
use locard_engine::pose::Pose;
use locard_engine::scene::{self, SceneFile};
use locard_engine::shot::{PairAlignmentError, PickedPair, Shot};
use locard_engine::site::alignment::AlignmentError;
use locard_engine::site::refinement::{NoRefinement, PosePrior};
use locard_engine::site::scan_file::ReadingWatch;
use locard_engine::site::{ScannedSite, SiteScan};
use locard_engine::text::{fixed, number, without_options};

/// A scan that is being read.
#[derive(Debug)]
pub struct ScanReading {
    path: PathBuf,
    watch: ReadingWatch,
    task: BackgroundTask<Result<SiteScan, String>>,
}

impl ScanReading {
    pub fn begin(ctx: &Context, path: PathBuf, metres_per_unit: Option<f64>) -> Result<Self, String> {
        let (watch, wake, file) = (ReadingWatch::default(), ctx.clone(), path.clone());
        let of_thread = watch.clone();
        let read = move || scene::read_scan_watched(&file, metres_per_unit, &of_thread).map_err(|e| e.to_string());
        let task = BackgroundTask::spawn("scan", move || wake.request_repaint(), read).map_err(thread_error)?;
        Ok(Self { path, watch, task })
    }

    /// The scan, or an error, when it has been read.
    pub fn take(&self) -> Option<Result<Arc<SiteScan>, String>> {
        Some(self.task.take()?.and_then(|read| read).map(Arc::new))
    }

    /// Shows the progress. Returns true if it was cancelled.
    pub fn show(&self, ui: &mut Ui) -> bool {
        ui.label(format!("Opening {}", name(&self.path)));
        show_progress(ui, "Opening the scan", self.watch.progress() as f32)
    }
}

impl Drop for ScanReading {
    fn drop(&mut self) {
        self.watch.cancel();
    }
}

/// The inputs of an alignment.
#[derive(Debug)]
pub struct AlignmentRequest {
    pub shot: Shot,
    pub scene: SceneFile,
    pub scene_path: PathBuf,
    pub scan: Arc<SiteScan>,
    pub metres_per_unit: Option<f64>,
    pub pairs: Vec<PickedPair>,
    pub finds_scale: bool,
    pub refines: bool,
}

/// The result of an alignment.
#[derive(Debug)]
pub struct AlignmentOutcome {
    /// Reprojection error of each pair, px; empty if the pairs give no place at all.
    pub errors_px: Vec<f64>,
    /// Index of a pair without which the others agree.
    pub wrong_pair: Option<usize>,
    /// The placed scan with a report; `None` if it was cancelled.
    pub placed: Result<Option<(PlacedScan, Vec<String>)>, String>,
}

/// An alignment in progress.
#[derive(Debug)]
pub struct AlignmentTask(BackgroundTask<AlignmentOutcome>);

impl AlignmentTask {
    pub fn begin(ctx: &Context, request: AlignmentRequest) -> Result<Self, String> {
        let wake = ctx.clone();
        let work = move |reporter: &Reporter<'_, AlignmentOutcome>| _ = reporter.send(aligned(request, reporter));
        let task = BackgroundTask::stream("scan alignment", move || wake.request_repaint(), work);
        task.map(Self).map_err(thread_error)
    }

    pub fn take(&self) -> Option<Result<AlignmentOutcome, String>> {
        self.0.take()
    }

    /// Shows the progress. Returns true if it was cancelled.
    pub fn show(&self, ui: &mut Ui) -> bool {
        show_progress(ui, "Aligning the scan", self.0.control().progress())
    }
}

fn thread_error(error: std::io::Error) -> String {
    format!("its thread could not be started: {error}")
}

fn show_progress(ui: &mut Ui, called: &str, share: f32) -> bool {
    ui.ctx().request_repaint_after_secs(0.1);
    let cancel = ui.button("Cancel").clicked();
    progress::bar(ui, called, share, Some(format!("{called}: {:.0} %", 100.0 * share)));
    cancel
}

/// The name of a file without its folder.
pub fn name(path: &Path) -> String {
    path.file_name().unwrap_or(path.as_os_str()).to_string_lossy().into_owned()
}

/// Aligns a scan in the steps of `locard site`.
fn aligned(request: AlignmentRequest, reporter: &Reporter<'_, AlignmentOutcome>) -> AlignmentOutcome {
    let AlignmentRequest { mut shot, mut scene, scene_path, scan, metres_per_unit, pairs, finds_scale, refines } =
        request;
    let mut errors_px = Vec::new();
    let mut wrong_pair = None;
    let mut align = || {
        let mut report = Vec::new();
        let (world_from_scan, prior) = if pairs.is_empty() {
            let present = shot.recording.site().map(|site| site.world_from_scan);
            let text = if present.is_some() { "the scene's present place" } else { "the axes of the world" };
            report.push(format!("aligned by {text}: no pairs"));
            (present.unwrap_or(Pose::IDENTITY), PosePrior::UNPAIRED)
        } else {
            let by_pairs = shot.site_by_pairs(&scan, &pairs, finds_scale).map_err(|error| {
                if let PairAlignmentError::Alignment(AlignmentError::Inconsistent(pairs)) = &error {
                    errors_px.clone_from(&pairs.errors_px);
                    wrong_pair = pairs.wrong_pair;
                }
                error.to_string()
            })?;
            errors_px.clone_from(&by_pairs.alignment.errors_px);
            report.push(format!("aligned {by_pairs}"));
            if let Some(factor) = by_pairs.unit_factor {
                let unit_m = shot.set_unit_of_site(&mut scene, factor).map_err(|error| error.to_string())?;
                report.push(format!("1 unit of the recording is {} m", number(unit_m)));
            }
            (by_pairs.world_from_scan, by_pairs.prior)
        };
        let mut site = ScannedSite::new(Arc::clone(&scan), world_from_scan);
        if refines {
            let mut on_progress = |share: f64| {
                reporter.control.set_progress(share);
                reporter.wake();
                if reporter.control.is_cancelled() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
            };
            match shot.refined_site(&site, prior, &mut on_progress).map_err(|error| error.to_string())? {
                Ok(refined) => {
                    report.push(format!("refined {refined}"));
                    site = refined.site;
                }
                Err(NoRefinement::Cancelled) => return Ok(None),
                Err(why) => report.push(format!("refined not: {why}")),
            }
        }
        report.extend(shot.site_doubt(&site).map(without_options));
        let scan_name = scene::relative(&scan.path, &scene_path);
        let gauge_frame = pairs.first().map(|pair| pair.view.frame);
        if let Some(up) = shot.put_site(&mut scene, &site, scan_name, metres_per_unit, gauge_frame) {
            let up = up.map(|n| fixed(n, 4)).join(", ");
            report.push(format!("up [{up}], the scan's, is written into the scene file"));
        }
        Ok(Some((PlacedScan { scan: Arc::clone(&scan), scene: std::mem::take(&mut scene) }, report)))
    };
    let placed = align();
    AlignmentOutcome { errors_px, wrong_pair, placed }
}

#[cfg(test)]
mod tests {
    use super::*;
    use locard_engine::recording::OpenOptions;
    use locard_engine::shot::ShotOptions;

    #[test]
    fn cancelled_alignment_places_nothing() {
        let options = ShotOptions::default();
        let shot = Shot::open(Path::new("recordings/demo"), &OpenOptions::default(), &options).unwrap();
        let scan = Arc::new(scene::read_scan(Path::new("scenes/marker-1.glb"), None).unwrap());
        let request = AlignmentRequest {
            shot,
            scene: SceneFile::default(),
            scene_path: "case.toml".into(),
            scan,
            metres_per_unit: None,
            pairs: Vec::new(),
            finds_scale: false,
            refines: true,
        };
        let task = AlignmentTask::begin(&Context::default(), request).unwrap();
        task.0.control().cancel();
        let outcome = loop {
            match task.take() {
                Some(outcome) => break outcome.unwrap(),
                None => std::thread::yield_now(),
            }
        };
        assert!(matches!(outcome.placed, Ok(None)), "{:?}", outcome.placed);
    }
}
