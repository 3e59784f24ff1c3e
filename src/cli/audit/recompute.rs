//! Recomputes the pictures of an output by the recorded command.

use std::path::Path;
use std::sync::mpsc;

use anyhow::{Context, Result, anyhow, bail};

use super::super::{composite, photo, photo_log, print_line, progress};
use locard_engine::compositor::IN_FLIGHT;
use locard_engine::gpu::Gpu;
use locard_engine::photo::{CaseCard, PhotoContent, read_particulars};
use locard_engine::pixels::Pixels;
use locard_engine::provenance::audit::{ForwardSink, FrameAudit, RecomputedFrame, RecomputedOutcome};
use locard_engine::provenance::{DeviceRecord, FrameMask, Record, SettingsRecord, as_read};
use locard_engine::shot::{AnalysisChoice, Shot};
use locard_engine::sink::{Sink, photograph as files};
use locard_engine::source::still;
use locard_engine::text::count;

/// The error of a command that cannot be repeated.
const NOT_REPEATED: &str = "the recorded command cannot be repeated";

/// Recomputes frames by a recorded `composite`.
pub fn frames(
    command: &composite::Args,
    record: &Record,
    output: &Path,
    frames: &[usize],
    quiet: bool,
) -> Result<Vec<RecomputedFrame>> {
    let (shot, export) = composite::reopen(command, analysis(record)).context(NOT_REPEATED)?;
    check_settings(record, &shot, &export.settings_record(&shot))?;
    let count_now = shot.recording.frame_count();
    if let Some(frame) = frames.iter().find(|frame| **frame >= count_now) {
        bail!("frame {frame}: the recording has {} now", count(count_now, "frame"));
    }
    let mut compositor = shot.compositor(open_device(record)?);
    let (sender, finished) = mpsc::channel();
    let mut sink: Box<dyn Sink + Send> = export.finishing(&shot, Box::new(ForwardSink(sender)));
    let audit = FrameAudit::new(record, output);
    let wants_layer = record.pictures.iter().any(|picture| picture.mask.is_some());
    let bar = progress(quiet, frames.len());
    let mut recomputed = Vec::with_capacity(frames.len());
    for run in frames.chunk_by(|a, b| a + 1 == *b) {
        let range = run[0]..run[run.len() - 1] + 1;
        for composited in shot.frames(&mut compositor, range, wants_layer, IN_FLIGHT)? {
            let composited = composited?;
            let rect_px = composited.stats.rect_px;
            let mask = composited.layer.as_ref().map(|layer| FrameMask::of(layer).record());
            sink.write(composited.frame, &composited.pixels)?;
            let compare = |(frame, pixels): (usize, Pixels)| audit.compare(frame, &pixels, rect_px, mask.as_ref());
            recomputed.extend(finished.try_iter().map(compare));
            bar.inc(1);
        }
    }
    bar.finish_and_clear();
    Ok(recomputed)
}

/// Takes a photograph again by a recorded `photo`.
pub fn photograph(command: &photo::Args, record: &Record, output: &Path) -> Result<RecomputedFrame> {
    let (shot, settings) = command.reopen(analysis(record)).context(NOT_REPEATED)?;
    check_settings(record, &shot, &settings)?;
    let device = open_device(record)?;
    let retaken = command.request().retake(&record.output.path, shot, || Ok(device))?;
    compare(record, output, &retaken.pixels, &retaken.content)
}

/// Draws a card again by a recorded `case-card`.
pub fn card(command: &photo_log::CardArgs, record: &Record, output: &Path) -> Result<RecomputedFrame> {
    let card = CaseCard::read(&command.case).map_err(|problem| anyhow!(problem)).context(NOT_REPEATED)?;
    compare(record, output, &card.picture(), &PhotoContent::Card(card))
}

/// Compares a picture with a photograph after the same encoder, and its particulars with the
/// recorded ones.
fn compare(record: &Record, output: &Path, pixels: &Pixels, content: &PhotoContent) -> Result<RecomputedFrame> {
    let folder = tempfile::tempdir()?;
    let file = folder.path().join(if record.output.codec == "png" { "picture.png" } else { "picture.jpg" });
    files::write(&file, pixels, None, None, false)?;
    let pixels = still::read_pixels(&file)?;
    let frame = record.pictures.first().map_or(0, |picture| picture.frame);
    let recomputed = FrameAudit::new(record, output).compare(frame, &pixels, None, None);
    let recorded = read_particulars(output).map_err(|problem| anyhow!(problem))?;
    let is_recorded = recorded.is_some_and(|recorded| recorded.content == as_read(content));
    if recomputed.outcome == RecomputedOutcome::Equal && !is_recorded {
        bail!("the record states other particulars than the picture has: the record was edited");
    }
    Ok(recomputed)
}

/// The analysis that a record lists.
fn analysis(record: &Record) -> AnalysisChoice {
    let input = record.work.inputs.iter().find(|input| input.role == "analysis");
    let folder = input.and_then(|input| input.path.parent());
    folder.map_or(AnalysisChoice::No, |folder| AnalysisChoice::At(folder.to_owned()))
}

/// Checks that the record's settings equal those of its command.
fn check_settings(record: &Record, shot: &Shot, settings: &SettingsRecord) -> Result<()> {
    if as_read(settings) != as_read(&record.work.settings) || shot.settings.seed != record.work.seed {
        bail!("the recorded command has other settings or another seed than the record states: the record was edited");
    }
    Ok(())
}

/// Opens the device, and mentions it if it is not the recorded one.
fn open_device(record: &Record) -> Result<Gpu> {
    let gpu = Gpu::open()?;
    let device = DeviceRecord::of(&gpu.info);
    if device != record.work.device {
        let text = |device: &DeviceRecord| format!("{}, {}", device.adapter, device.driver);
        print_line(&format!(
            "another device: the output was made on {}, this is {}",
            text(&record.work.device),
            text(&device)
        ))?;
    }
    Ok(gpu)
}
