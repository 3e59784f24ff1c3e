//! The export pipeline: decoding, compositing and writing.

use std::io::Write;
use std::path::PathBuf;
use std::sync::mpsc;

use super::Export;
use super::error::ExportError;
use crate::analyse;
use crate::cleanup::MadeFolder;
use crate::compositor::{Composited, Compositor, FrameStats, IN_FLIGHT};
use crate::shot::{AnalysisState, Composites, FrameCounts, Note, Shot};
use crate::sink::atomic::write_atomically;
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
            width: recording.width,
            height: recording.height,
            bits: recording.bits,
        };
        let mut sink = sink::open(&self.out, &options)?;
        if self.sdr {
            sink = Box::new(SdrSink::new(&shot.camera().response, if options.bits == 16 { 65535 } else { 255 }, sink));
        }
        let layers = self.layers.clone().map(|folder| match MadeFolder::make(&folder) {
            Ok(made) => Ok((folder, made)),
            Err(source) => Err(ExportError::Folder { path: folder, source }),
        });
        let writer = Writer { sink, layers: layers.transpose()?, force: self.force };
        let adapter = compositor.gpu().info.clone();
        let mut done = ExportSummary::default();
        // The report lists all frames.
        let mut reported = self.report.as_ref().map(|_| Vec::with_capacity(self.range.len()));
        let frames = shot.frames(compositor, self.range.clone(), writer.layers.is_some(), IN_FLIGHT)?;
        write(frames, writer, |frame| {
            done.tally.add(&frame.stats);
            reported.iter_mut().for_each(|all| all.push(frame.stats.clone()));
            on_frame(&frame.stats)
        })?;
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

/// Writes frames while the next ones are composited.
struct Writer {
    /// Created after the sink's folder, which may contain it, and removed before.
    layers: Option<(PathBuf, MadeFolder)>,
    sink: Box<dyn Sink + Send>,
    force: bool,
}

impl Writer {
    fn write(&mut self, done: &Composited) -> Result<(), ExportError> {
        if let (Some((folder, _)), Some(layer)) = (&self.layers, &done.layer) {
            exr::write_layers(&folder.join(layer_name(done.frame)), layer, self.force)?;
        }
        Ok(self.sink.write(done.frame, &done.pixels)?)
    }

    fn finish(self) -> Result<(), ExportError> {
        self.sink.finish()?;
        self.layers.into_iter().for_each(|(_, made)| made.keep());
        Ok(())
    }
}

pub fn layer_name(frame: usize) -> String {
    format!("layer_{frame:06}.exr")
}

/// Decodes on the recording's threads, composites on the calling thread, and writes on a thread of
/// its own.
fn write(
    mut frames: Composites<'_>,
    mut writer: Writer,
    mut on_frame: impl FnMut(&Composited) -> bool,
) -> Result<(), ExportError> {
    std::thread::scope(|scope| {
        // `None` marks the end: if the channel merely closes, the output is not finished.
        let (sender, receiver) = mpsc::sync_channel::<Option<Composited>>(2);
        let write = move || -> Result<(), ExportError> {
            for frame in receiver {
                match frame {
                    Some(frame) => writer.write(&frame)?,
                    None => return writer.finish(),
                }
            }
            Ok(())
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
        writing.join().map_err(|_| ExportError::Stopped)?.and(finished)
    })
}
