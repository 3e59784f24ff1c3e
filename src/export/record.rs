//! The provenance record of an export.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::mpsc;

use super::Export;
use super::error::ExportError;
use crate::gpu::Gpu;
use crate::pixels::Pixels;
use crate::provenance::{
    InputDigests, MaskRecord, OutputKind, OutputRecord, PictureLines, PictureRecord, RECORD_VERSION, Record,
    SettingsRecord, WorkRecord, file_digest, input_files, pixels_digest, video_programs,
};
use crate::recording::Recording;
use crate::shot::Shot;
use crate::sink::folder::frame_name;
use crate::sink::{OutPath, Sink, SinkError, SinkOptions, VideoCodec, default_codec};

impl Export {
    /// The output that gets a record: a folder or a video, not a stream.
    pub(super) fn recorded_output(&self) -> Option<&Path> {
        match &self.out {
            OutPath::Folder(path) | OutPath::Video(path) if self.recorded => Some(path),
            _ => None,
        }
    }

    /// The folder of an output with a file for each frame.
    pub(super) fn frame_folder(&self) -> Option<PathBuf> {
        match &self.out {
            OutPath::Folder(path) => Some(path.clone()),
            _ => None,
        }
    }

    /// The settings of a shot with those of this export.
    pub fn settings_record(&self, shot: &Shot) -> SettingsRecord {
        let mut settings = SettingsRecord::of(shot);
        settings.sdr = self.sdr;
        settings.mark.clone_from(&self.mark);
        settings.unlabelled = !self.labelled;
        settings.closed_groups = self.closed_groups;
        settings
    }

    /// Codec of a lossy video.
    pub(super) fn lossy_codec(&self) -> Option<VideoCodec> {
        match &self.out {
            OutPath::Video(path) if !self.lossless => Some(self.codec.unwrap_or_else(|| default_codec(path))),
            _ => None,
        }
    }

    fn codec_name(&self, bits: u32) -> &'static str {
        match (self.lossy_codec(), &self.out) {
            (Some(VideoCodec::H264), _) => "h264",
            (Some(VideoCodec::Hevc), _) => "hevc",
            (Some(VideoCodec::ProRes), _) => "prores",
            (None, OutPath::Video(_)) if bits == 16 => "ffv1",
            (None, OutPath::Video(_)) => "h264rgb",
            (None, _) => "png",
        }
    }
}

/// A record under construction: a thread hashes the inputs while frames are composited.
pub struct RecordDraft {
    output: PathBuf,
    record: Record,
    inputs: InputDigests,
}

impl RecordDraft {
    /// The draft of an export, unless it has no record.
    pub fn begin(export: &Export, shot: &Shot, gpu: &Gpu, options: &SinkOptions) -> Result<Option<Self>, ExportError> {
        let Some(output) = export.recorded_output() else { return Ok(None) };
        let Recording { width, height, .. } = *shot.recording;
        let kind = if matches!(export.out, OutPath::Video(_)) { OutputKind::Video } else { OutputKind::Frames };
        let mut work = WorkRecord { settings: export.settings_record(shot), ..WorkRecord::begun(shot, &gpu.info) };
        if kind == OutputKind::Video && work.programs.is_empty() {
            work.programs = video_programs();
        }
        let record = Record {
            version: RECORD_VERSION,
            work,
            range: [export.range.start, export.range.end],
            output: OutputRecord {
                kind,
                path: output.to_owned(),
                width,
                height,
                bits: options.bits,
                codec: export.codec_name(options.bits).to_owned(),
                fps: options.fps,
                sha256: None,
            },
            pictures: Vec::new(),
        };
        let inputs = InputDigests::start(input_files(shot));
        Ok(Some(Self { output: output.to_owned(), record, inputs }))
    }

    /// Writes the record of the finished output. The pictures of earlier parts of the same work in
    /// the same folder are kept.
    pub fn finish(mut self, mut pictures: PictureLines) -> Result<(), ExportError> {
        // Runs that end at once in one folder merge their pictures in turn, if the system locks
        // folders.
        let _turn = File::open(&self.output).and_then(|folder| folder.lock().map(|()| folder)).ok();
        let unread = |(path, source)| ExportError::Sink(SinkError::Read { path, source });
        self.record.work.inputs = self.inputs.finish().map_err(unread)?;
        match self.record.output.kind {
            OutputKind::Video => {
                let digest = file_digest(&self.output);
                let digest = digest.map_err(|source| SinkError::Read { path: self.output.clone(), source })?;
                self.record.output.sha256 = Some(digest.sha256);
            }
            OutputKind::Frames | OutputKind::Photograph => {
                if let Ok(earlier) = Record::read(&self.output)
                    && earlier.is_same_work(&self.record)
                {
                    let path = std::env::temp_dir();
                    self.record.pictures = pictures.read().map_err(|source| SinkError::Write { path, source })?;
                    self.record.add_pictures(earlier);
                    return Ok(self.record.write(&self.output)?);
                }
            }
        }
        Ok(self.record.write_with_pictures(&self.output, pictures)?)
    }
}

/// Digests the pictures on their way into a sink.
pub struct DigestSink {
    digests: mpsc::Sender<String>,
    inner: Box<dyn Sink + Send>,
}

/// Lists the written pictures with the digests that its sink computes.
pub struct PictureList {
    digests: mpsc::Receiver<String>,
    /// Of the files, if there is one for each frame.
    folder: Option<PathBuf>,
    lines: PictureLines,
}

impl PictureList {
    /// A sink in front of `inner`, and the list of its pictures, which are files in `folder`, or
    /// parts of a video.
    pub fn new(inner: Box<dyn Sink + Send>, folder: Option<PathBuf>) -> (DigestSink, Self) {
        let (sender, digests) = mpsc::channel();
        (DigestSink { digests: sender, inner }, Self { digests, folder, lines: PictureLines::default() })
    }

    /// Adds the picture that was written last.
    pub fn add(&mut self, frame: usize, rect_px: Option<[i32; 4]>, mask: Option<MaskRecord>) -> Result<(), SinkError> {
        let Ok(pixels_sha256) = self.digests.try_recv() else { return Ok(()) };
        let file = self.folder.as_ref().map(|_| frame_name(frame));
        let path = self.folder.as_ref().map(|folder| folder.join(frame_name(frame)));
        let digest = path.map(|path| file_digest(&path).map_err(|source| SinkError::Read { path, source }));
        let file_sha256 = digest.transpose()?.map(|digest| digest.sha256);
        let listed = self.lines.push(&PictureRecord { frame, file, pixels_sha256, file_sha256, rect_px, mask });
        listed.map_err(|source| SinkError::Write { path: std::env::temp_dir(), source })
    }

    pub fn into_lines(self) -> PictureLines {
        self.lines
    }
}

impl Sink for DigestSink {
    fn write(&mut self, frame_index: usize, pixels: &Pixels) -> Result<(), SinkError> {
        // The list is only dropped with the sink.
        let _ = self.digests.send(pixels_digest(pixels));
        self.inner.write(frame_index, pixels)
    }

    fn finish(self: Box<Self>) -> Result<(), SinkError> {
        self.inner.finish()
    }
}

#[cfg(test)]
mod tests {
    use std::thread::scope;

    use super::*;

    /// A record of one frame of 64.
    fn record(frame: usize) -> Record {
        let digest = format!("{frame:064}");
        let value = serde_json::json!({
            "version": RECORD_VERSION,
            "program": { "name": "locard", "version": "1", "build": "" },
            "command": { "arguments": [], "folder": "" },
            "device": { "adapter": "", "driver": "", "kind": "Cpu" },
            "seed": 0,
            "inputs": [],
            "settings": { "parameters": {}, "without": [] },
            "range": [frame, frame + 1],
            "output": { "kind": "frames", "path": "", "width": 1, "height": 1, "bits": 8, "codec": "png", "fps": 30.0 },
            "pictures": [{ "frame": frame, "file": format!("frame_{frame:06}.png"), "pixels_sha256": digest }],
        });
        serde_json::from_value(value).unwrap()
    }

    #[test]
    fn runs_that_end_at_once_in_one_folder_keep_all_pictures() {
        let folder = tempfile::tempdir().unwrap();
        let output = folder.path().join("out");
        std::fs::create_dir(&output).unwrap();
        let finish = |frame: usize| {
            let record = record(frame);
            let mut pictures = PictureLines::default();
            pictures.push(&record.pictures[0]).unwrap();
            let inputs = InputDigests::start(Vec::new());
            RecordDraft { output: output.clone(), record, inputs }.finish(pictures).unwrap();
        };
        scope(|threads| {
            for frame in 0..16 {
                let finish = &finish;
                std::thread::Builder::new().spawn_scoped(threads, move || finish(frame)).unwrap();
            }
        });
        let frames: Vec<usize> = Record::read(&output).unwrap().pictures.iter().map(|picture| picture.frame).collect();
        assert_eq!(frames, (0..16).collect::<Vec<_>>());
    }
}
