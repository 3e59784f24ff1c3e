//! Manifest of a simulated recording's files in truth.toml, sealed by its last line: only
//! unmodified files are ever replaced.

use std::collections::BTreeMap;
use std::path::Path;

use serde::Deserialize;
use toml_edit::Table;

use crate::document;
use crate::source::file::{self, MAX_LISTING_BYTES};

pub const TRUTH: &str = "truth.toml";
/// Prefix of the checksum of all lines above.
const SEAL: &str = "# crc32 of all lines above: ";

/// Files by name relative to the recording's folder, with `/`.
#[derive(Debug, Default)]
pub struct Manifest(BTreeMap<String, FileDigest>);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct FileDigest {
    bytes: u64,
    crc32: u32,
}

impl FileDigest {
    fn of(bytes: &[u8]) -> Self {
        Self { bytes: bytes.len() as u64, crc32: crc32fast::hash(bytes) }
    }

    fn parse(text: &str) -> Option<Self> {
        let (bytes, crc32) = text.split_once(' ')?;
        Some(Self { bytes: bytes.parse().ok()?, crc32: u32::from_str_radix(crc32, 16).ok()? })
    }
}

impl Manifest {
    pub fn add(&mut self, name: &str, bytes: &[u8]) {
        self.0.insert(name.to_owned(), FileDigest::of(bytes));
    }

    pub fn table(&self) -> Table {
        let text = |content: &FileDigest| toml_edit::value(format!("{} {:08x}", content.bytes, content.crc32));
        self.0.iter().map(|(name, content)| (name.as_str(), text(content))).collect()
    }

    /// The files listed in a recording's truth.toml; `None` if there is none, or if it was
    /// modified.
    pub fn of(folder: &Path) -> Option<Self> {
        #[derive(Deserialize)]
        struct Truth {
            files: BTreeMap<String, String>,
        }
        let path = folder.join(TRUTH);
        if !path.symlink_metadata().ok()?.is_file() {
            return None;
        }
        let text = file::read_text(&path, MAX_LISTING_BYTES).ok()?;
        let start = text.rfind(SEAL)?;
        if sealed(&text[..start]) != text {
            return None;
        }
        let truth: Truth = document::read(&text).ok()?;
        let parsed = truth.files.into_iter().map(|(name, content)| Some((name, FileDigest::parse(&content)?)));
        parsed.collect::<Option<_>>().map(Self)
    }

    /// True if a file of this name was written.
    pub fn lists(&self, name: &str) -> bool {
        name == TRUTH || self.0.contains_key(name)
    }

    /// True if a folder of this name was created for files.
    pub fn lists_folder(&self, name: &str) -> bool {
        self.0.keys().any(|file| file.split_once('/').is_some_and(|(folder, _)| folder == name))
    }

    /// True if a file is as it was written. The list itself is sealed.
    pub fn is_unchanged(&self, folder: &Path, name: &str) -> bool {
        let is_same = |content: &FileDigest| {
            file::read(&folder.join(name), content.bytes).is_ok_and(|bytes| FileDigest::of(&bytes) == *content)
        };
        name == TRUTH || self.0.get(name).is_some_and(is_same)
    }
}

/// The text of a truth.toml with its seal line.
pub fn sealed(text: &str) -> String {
    format!("{text}{SEAL}{:08x}\n", crc32fast::hash(text.as_bytes()))
}
