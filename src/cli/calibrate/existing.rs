//! The profile that a calibration goes into.

use std::path::Path;

use anyhow::{Context, Result, bail};

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
