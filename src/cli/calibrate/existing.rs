//! The profile that a calibration goes into, and what it must not be written over.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};

use crate::calibrate::is_picture;
use crate::profile::Document;
use crate::sink;
use crate::source::file::{self, MOST_DOCUMENT};
use crate::words::reason;

/// A profile that is to be extended, and whether it is there already.
pub fn existing(path: &Path) -> Result<(bool, Document)> {
    sink::check_file(path, true)?;
    match file::read_text(path, MOST_DOCUMENT) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok((false, Document::new(""))),
        Err(error) => bail!("{}: cannot be read: {}", path.display(), reason(&error)),
        Ok(text) => {
            let read = Document::parse(&text, path);
            Ok((true, read.context("the file is no profile that could be added to")?))
        }
    }
}

/// The pictures in those inputs that are folders. Anything else there, such as a recording's profile, is not read.
pub fn pictures_beside<'a>(inputs: impl Iterator<Item = &'a PathBuf>) -> Vec<PathBuf> {
    let entries = inputs.filter_map(|folder| std::fs::read_dir(folder).ok()).flatten().flatten();
    entries.map(|entry| entry.path()).filter(|path| is_picture(path)).collect()
}
