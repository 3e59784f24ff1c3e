//! The export pipeline: decoding, compositing and writing.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::mpsc;

use super::Export;
use super::error::ExportError;
use super::record::{PictureList, RecordDraft};
use crate::analyse;
use crate::cleanup::MadeFolder;
use crate::compositor::{Composited, Compositor, FrameStats, IN_FLIGHT};
use crate::label::SourceLabel;
use crate::provenance::FrameMask;
use crate::recording::Recording;
use crate::shot::{AnalysisState, Composites, FrameCounts, Note, Shot};
use crate::sink::atomic::write_atomically;
use crate::sink::folder::write_frame;
use crate::sink::mark::MarkSink;
use crate::sink::sdr::SdrSink;
use crate::sink::{self, Sink, SinkError, SinkOptions, exr, is_stdout};

/// Summary of an export. Its size does not depend on the number of frames.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ExportSummary {
    tally: FrameCounts,
    undecoded_depth: Option<String>,
}

impl ExportSummary {
    /// Number of written frames.
    pub fn frames(&self) -> usize {
        self.tally.frames()
    }

    /// Notes about the frames.
    pub fn notes(&self) -> Vec<Note> {
        self.undecoded_depth.iter().cloned().map(Note::Recording).chain(self.tally.notes()).collect()
    }
}

impl Export {
    /// Composites the range with the shot's settings and writes it; call [`Export::check`] first.
    /// `on_frame` is called with the statistics of each composite and cancels the export by
    /// `false`.
    pub fn run(
        &self,
        shot: &Shot,
        compositor: &mut Compositor,
        mut on_frame: impl FnMut(&FrameStats) -> bool,
    ) -> Result<ExportSummary, ExportError> {
        let recording = &shot.recording;
        let mut presentation = recording.presentation_from(self.range.start);
        if self.sdr {
            (presentation.transfer, presentation.primaries, presentation.matrix) = (None, None, None);
        }
        let options = SinkOptions {
            force: self.force,
            fps: 1.0 / recording.frame_interval_s,
            times_s: recording.times_unless_steady(self.range.clone()),
            presentation,
            lossless: self.lossless,
            codec: self.codec,
            closed_groups: self.closed_groups,
            soundtrack: if self.sound { recording.soundtrack(self.range.clone()) } else { None },
            label: self.labelled.then(|| SourceLabel::composite(&recording.path).of_frames(self.range.clone())),
            width: recording.width,
            height: recording.height,
            bits: recording.bits,
        };
        let record = RecordDraft::begin(self, shot, compositor.gpu(), &options)?;
        let mut sink = sink::open(&self.out, &options)?;
        let mut pictures = None;
        if record.is_some() {
            let (digesting, list) = PictureList::new(sink, self.frame_folder());
            (sink, pictures) = (Box::new(digesting), Some(list));
        }
        let writer = Writer {
            sink: self.finishing(shot, sink),
            layers: made_folder(self.layers.as_deref())?,
            masks: made_folder(self.masks.as_deref())?,
            label: options.label.clone(),
            pictures,
            force: self.force,
        };
        let adapter = compositor.gpu().info.clone();
        let mut done = ExportSummary::default();
        // The report lists all frames.
        let mut reported = self.report.as_ref().map(|_| Vec::with_capacity(self.range.len()));
        let wants_layers = self.layers.is_some() || self.masks.is_some();
        let frames = shot.frames(compositor, self.range.clone(), wants_layers, IN_FLIGHT)?;
        let pictures = write(frames, writer, |frame| {
            done.tally.add(&frame.stats);
            reported.iter_mut().for_each(|all| all.push(frame.stats.clone()));
            on_frame(&frame.stats)
        })?;
        if let (Some(record), Some(pictures)) = (record, pictures) {
            record.finish(pictures.into_lines())?;
        }
        done.undecoded_depth = recording.undecoded_depth();
        if let Some(path) = &self.report {
            let mut report = serde_json::json!({
                "adapter": adapter.name,
                "driver": format!("{} {}", adapter.driver, adapter.driver_info),
                "seed": shot.settings.seed,
                "frames": reported,
            });
            // The report identifies the analysis that was used.
            if let AnalysisState::Used(folder, _) = &shot.analysis {
                report["analysis_sha256"] = analyse::digest(folder).into();
            }
            let text = format!("{report:#}");
            if is_stdout(path) {
                writeln!(std::io::stdout().lock(), "{text}").map_err(|source| SinkError::Stdout { source })?;
            } else {
                write_atomically(path, self.force, |file| file.write_all(text.as_bytes()))?;
            }
        }
        Ok(done)
    }
}

impl Export {
    /// The last steps of each frame before a sink: tone mapping to standard dynamic range, the
    /// visible mark.
    pub fn finishing(&self, shot: &Shot, mut sink: Box<dyn Sink + Send>) -> Box<dyn Sink + Send> {
        let Recording { width, height, bits, .. } = *shot.recording;
        if let Some(text) = &self.mark {
            sink = Box::new(MarkSink::new(text, (width, height), sink));
        }
        if self.sdr {
            sink = Box::new(SdrSink::new(&shot.camera().response, if bits == 16 { 65535 } else { 255 }, sink));
        }
        sink
    }
}

/// A folder for more files of each frame.
fn made_folder(folder: Option<&Path>) -> Result<Option<(PathBuf, MadeFolder)>, ExportError> {
    let made = folder.map(|folder| match MadeFolder::make(folder) {
        Ok(made) => Ok((folder.to_owned(), made)),
        Err(source) => Err(ExportError::Folder { path: folder.to_owned(), source }),
    });
    made.transpose()
}

/// Writes frames while the next ones are composited.
struct Writer {
    /// Created after the sink's folder, which may contain them, and removed before.
    layers: Option<(PathBuf, MadeFolder)>,
    masks: Option<(PathBuf, MadeFolder)>,
    sink: Box<dyn Sink + Send>,
    label: Option<SourceLabel>,
    /// Digests of the pictures, for the record.
    pictures: Option<PictureList>,
    force: bool,
}

impl Writer {
    fn write(&mut self, done: &Composited) -> Result<(), ExportError> {
        let label = self.label.as_ref().map(|label| label.of_frame(done.frame));
        let mut mask_record = None;
        if let Some(layer) = &done.layer {
            if let Some((folder, _)) = &self.layers {
                exr::write_layers(&folder.join(layer_name(done.frame)), layer, label.as_ref(), self.force)?;
            }
            let mask = FrameMask::of(layer);
            if let (Some((folder, _)), Some(picture)) = (&self.masks, mask.picture()) {
                write_frame(&folder.join(mask_name(done.frame)), &picture, None, label.as_ref(), self.force)?;
            }
            mask_record = self.pictures.is_some().then(|| mask.record());
        }
        self.sink.write(done.frame, &done.pixels)?;
        if let Some(list) = &mut self.pictures {
            list.add(done.frame, done.stats.rect_px, mask_record)?;
        }
        Ok(())
    }

    /// Completes the output; returns the list of its pictures.
    fn finish(self) -> Result<Option<PictureList>, ExportError> {
        self.sink.finish()?;
        self.layers.into_iter().chain(self.masks).for_each(|(_, made)| made.keep());
        Ok(self.pictures)
    }
}

pub fn layer_name(frame: usize) -> String {
    format!("layer_{frame:06}.exr")
}

/// The file name of a frame's mask.
pub fn mask_name(frame: usize) -> String {
    format!("mask_{frame:06}.png")
}

/// Decodes on the recording's threads, composites on the calling thread, and writes on a thread of
/// its own.
fn write(
    mut frames: Composites<'_>,
    mut writer: Writer,
    mut on_frame: impl FnMut(&Composited) -> bool,
) -> Result<Option<PictureList>, ExportError> {
    std::thread::scope(|scope| {
        // `None` marks the end: if the channel merely closes, the output is not finished.
        let (sender, receiver) = mpsc::sync_channel::<Option<Composited>>(2);
        let write = move || -> Result<Option<PictureList>, ExportError> {
            for frame in receiver {
                match frame {
                    Some(frame) => writer.write(&frame)?,
                    None => return writer.finish(),
                }
            }
            Ok(None)
        };
        let writing = std::thread::Builder::new().name("writer".to_owned());
        let writing = writing.spawn_scoped(scope, write).map_err(|source| ExportError::Thread { source })?;
        let drawn = frames.try_for_each(|frame| {
            let frame = frame?;
            if !on_frame(&frame) {
                return Err(ExportError::Cancelled);
            }
            sender.send(Some(frame)).map_err(|_| ExportError::Stopped)
        });
        let finished = drawn.and_then(|()| sender.send(None).map_err(|_| ExportError::Stopped));
        drop(sender);
        // The writer's error takes precedence: it is the cause of `Stopped`.
        let pictures = writing.join().map_err(|_| ExportError::Stopped)??;
        finished.map(|()| pictures)
    })
}
