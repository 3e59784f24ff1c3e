//! Frames on their way into files.

use std::io::Write;
use std::path::PathBuf;
use std::sync::mpsc;

use super::Export;
use super::error::ExportError;
use crate::analyse;
use crate::cleanup::MadeFolder;
use crate::compositor::{Composited, Compositor, FrameStats, IN_FLIGHT};
use crate::shot::{AnalysisState, Composites, Note, Shot, Tally};
use crate::sink::atomic::write_atomically;
use crate::sink::{self, Sink, SinkError, SinkOptions, exr, is_stdout};

/// What was done. It is as small for a long recording as for a short one.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Exported {
    tally: Tally,
    undecoded_depth: Option<String>,
}

impl Exported {
    /// How many frames were written.
    pub fn frames(&self) -> usize {
        self.tally.frames()
    }

    /// What is odd about the frames.
    pub fn notes(&self) -> Vec<Note> {
        self.undecoded_depth.iter().cloned().map(Note::Recording).chain(self.tally.notes()).collect()
    }
}

impl Export {
    /// Composites the range as the shot is set and writes it, after [`Export::check`]. `goes_on` is called with each frame
    /// that was drawn, and ends the export by `false`.
    pub fn run(
        &self,
        shot: &Shot,
        compositor: &mut Compositor,
        mut goes_on: impl FnMut(&FrameStats) -> bool,
    ) -> Result<Exported, ExportError> {
        let recording = &shot.recording;
        let options = SinkOptions {
            force: self.force,
            fps: 1.0 / recording.frame_interval_s,
            times_s: recording.times_unless_steady(self.range.clone()),
            presentation: recording.presentation(),
            lossless: self.lossless,
            width: recording.width,
            height: recording.height,
            bits: recording.bits,
        };
        let sink = sink::open(&self.out, &options)?;
        let layers = self.layers.clone().map(|folder| match MadeFolder::make(&folder) {
            Ok(made) => Ok((folder, made)),
            Err(source) => Err(ExportError::Folder { path: folder, source }),
        });
        let writer = Writer { sink, layers: layers.transpose()?, force: self.force };
        let adapter = compositor.gpu().info.clone();
        let mut done = Exported::default();
        // The report names each.
        let mut reported = self.report.as_ref().map(|_| Vec::with_capacity(self.range.len()));
        let frames = shot.frames(compositor, self.range.clone(), writer.layers.is_some(), IN_FLIGHT)?;
        write(frames, writer, |frame| {
            done.tally.add(&frame.stats);
            reported.iter_mut().for_each(|all| all.push(frame.stats.clone()));
            goes_on(&frame.stats)
        })?;
        done.undecoded_depth = recording.undecoded_depth();
        if let Some(path) = &self.report {
            let mut report = serde_json::json!({
                "adapter": adapter.name,
                "driver": format!("{} {}", adapter.driver, adapter.driver_info),
                "seed": shot.settings.seed,
                "frames": reported,
            });
            // What followed an analysis says which one.
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

/// Receives frames while the next ones are drawn.
struct Writer {
    /// Made after the sink's folder, which may hold it, and removed before.
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

/// Decodes on the recording's threads, draws here, and writes on a thread of its own.
fn write(
    mut frames: Composites<'_>,
    mut writer: Writer,
    mut goes_on: impl FnMut(&Composited) -> bool,
) -> Result<(), ExportError> {
    std::thread::scope(|scope| {
        // The end is announced: if the frames merely stop, the writer must not report the output as finished.
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
            if !goes_on(&frame) {
                return Err(ExportError::Cancelled);
            }
            sender.send(Some(frame)).map_err(|_| ExportError::Stopped)
        });
        let finished = drawn.and_then(|()| sender.send(None).map_err(|_| ExportError::Stopped));
        drop(sender);
        // The writer's error comes first: it is why the frames stopped.
        writing.join().map_err(|_| ExportError::Stopped)?.and(finished)
    })
}
