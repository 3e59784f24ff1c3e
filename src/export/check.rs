//! Checks of all output paths before an export starts.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use super::Export;
use super::error::ExportError;
use super::inputs::{Inputs, resolved};
use super::run::{layer_name, mask_name};
use crate::provenance::record_path;
use crate::sink::folder::frame_name;
use crate::sink::{self, OutPath, VideoCodec, is_stdout};

impl Export {
    /// Rejects outputs that would overwrite inputs, existing files without `force`, or other
    /// outputs of this export.
    pub fn check(&self, inputs: &Inputs) -> Result<(), ExportError> {
        match &self.out {
            OutPath::Folder(folder) => inputs.check_folder(folder, self.range.clone().map(frame_name))?,
            OutPath::Video(file) => inputs.check_file(file)?,
            OutPath::Stdout | OutPath::Stream(_) => {}
        }
        sink::check(&self.out, self.force)?;
        for (folder, name, option) in self.more_folders() {
            inputs.check_folder(folder, self.range.clone().map(name))?;
            if folder.exists() && !folder.is_dir() {
                return Err(ExportError::refused(folder, format!("is a file; {option} needs a folder")));
            }
            let mut there = self.range.clone().map(|frame| folder.join(name(frame))).filter(|file| file.exists());
            if let Some(file) = there.next().filter(|_| !self.force) {
                return Err(ExportError::refused(&file, "exists already, and is kept (--force replaces it)"));
            }
        }
        let has_groups = matches!(self.lossy_codec(), Some(VideoCodec::H264 | VideoCodec::Hevc));
        if let (Some(_), false, OutPath::Folder(path) | OutPath::Video(path)) =
            (self.closed_groups, has_groups, &self.out)
        {
            let problem = "--closed-groups is for H.264 and HEVC only; the frames of this output stand alone";
            return Err(ExportError::refused(path, problem));
        }
        if let Some(output) = self.recorded_output() {
            inputs.check_file(&record_path(output))?;
            sink::check_file(&record_path(output), true)?;
        }
        let Some(report) = &self.report else { return self.check_apart() };
        if is_stdout(report) && self.out == OutPath::Stdout {
            return Err(ExportError::refused(report, OWN_FILE));
        }
        self.check_apart()?;
        if is_stdout(report) {
            return Ok(());
        }
        inputs.check_file(report)?;
        Ok(sink::check_file(report, self.force)?)
    }

    /// Folders beside the output, with their files' names and their option.
    fn more_folders(&self) -> impl Iterator<Item = (&Path, fn(usize) -> String, &'static str)> {
        let layers = self.layers.iter().map(|folder| (folder.as_path(), layer_name as fn(usize) -> String, "--layers"));
        let masks = self.masks.iter().map(|folder| (folder.as_path(), mask_name as fn(usize) -> String, "--masks"));
        layers.chain(masks)
    }

    /// Checks that no two outputs have the same path, and that none has the path of another's
    /// folder.
    fn check_apart(&self) -> Result<(), ExportError> {
        let named = |folder: &Path, name: fn(usize) -> String| {
            let folder = resolved(folder);
            self.range.clone().map(move |frame| resolved(&folder.join(name(frame))))
        };
        let mut files: HashSet<PathBuf> = match &self.out {
            OutPath::Folder(folder) => named(folder, frame_name).collect(),
            OutPath::Video(file) => [resolved(file)].into(),
            OutPath::Stdout | OutPath::Stream(_) => HashSet::new(),
        };
        let clashes = |files: &HashSet<PathBuf>, at: &Path| at.ancestors().any(|at| files.contains(at));
        for (folder, name, option) in self.more_folders() {
            if clashes(&files, &resolved(folder)) {
                let problem = format!("is written in this run already; {option} needs a folder of its own");
                return Err(ExportError::refused(folder, problem));
            }
            files.extend(named(folder, name));
        }
        files.extend(self.recorded_output().map(|output| resolved(&record_path(output))));
        if let Some(report) = self.report.as_ref().filter(|report| !is_stdout(report)) {
            let at = resolved(report);
            if clashes(&files, &at) || files.iter().any(|file| file.starts_with(&at)) {
                return Err(ExportError::refused(report, OWN_FILE));
            }
        }
        Ok(())
    }
}

const OWN_FILE: &str = "is the output already; --report needs a file of its own";
