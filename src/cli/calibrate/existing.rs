//! The profile that a calibration is written to, and checks of its inputs.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};

use locard_engine::calibrate::is_picture;
use locard_engine::profile::ProfileFile;
use locard_engine::sink;
use locard_engine::source::file::{self, MAX_DOCUMENT_BYTES};
use locard_engine::source::{SourceError, still, unsupported};
use locard_engine::text::reason;

/// The profile to extend, and true if it exists already.
pub fn existing(path: &Path) -> Result<(bool, ProfileFile)> {
    sink::check_file(path, true)?;
    match file::read_text(path, MAX_DOCUMENT_BYTES) {
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok((false, ProfileFile::new(""))),
        Err(error) => bail!("{}: cannot be read: {}", path.display(), reason(&error)),
        Ok(text) => {
            let read = ProfileFile::parse(&text, path);
            Ok((true, read.context("the file is not a profile that can be extended")?))
        }
    }
}

/// The pictures in the inputs that are folders. Other files in them, such as a recording's profile,
/// are not read.
pub fn pictures_beside<'a>(inputs: impl Iterator<Item = &'a PathBuf>) -> Vec<PathBuf> {
    let entries = inputs.filter_map(|folder| std::fs::read_dir(folder).ok()).flatten().flatten();
    entries.map(|entry| entry.path()).filter(|path| is_picture(path)).collect()
}

/// Reads the header of each picture among the inputs, also in folders. Returns the number of files,
/// videos included, and the errors.
pub fn unreadable<'a>(inputs: impl Iterator<Item = &'a PathBuf> + Clone) -> (usize, Vec<SourceError>) {
    let is_meant = |path: &&PathBuf| is_picture(path) || unsupported::by_name(path).is_some() || !path.exists();
    let files = inputs.clone().filter(|path| !path.is_dir());
    let videos = files.clone().filter(|path| !is_meant(path)).count();
    let named = files.filter(is_meant).cloned();
    // Unsupported files are ignored in folders with readable pictures.
    let is_alone = |folder: &&PathBuf| pictures_beside(std::iter::once(*folder)).is_empty();
    let unsupported = inputs.clone().filter(is_alone).flat_map(|folder| unsupported::in_folder(folder));
    let pictures: Vec<PathBuf> = named.chain(unsupported).chain(pictures_beside(inputs.clone())).collect();
    (videos + pictures.len(), pictures.iter().filter_map(|picture| still::read_header(picture).err()).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unreadable_picture_beside_a_video_is_one_of_two_files() {
        let folder = tempfile::tempdir().unwrap();
        let inputs = ["clip.mp4", "IMG_1.jls"].map(|name| folder.path().join(name));
        for file in &inputs {
            std::fs::write(file, b"\xff\xd8\xff\xf7\0\x0b").unwrap();
        }
        let (files, problems) = unreadable(inputs.iter());
        assert_eq!((files, problems.len()), (2, 1));
        assert!(problems[0].to_string().contains("IMG_1.jls: is JPEG-LS"), "{}", problems[0]);
    }
}
