//! Errors of scenes.

use std::fmt::Display;
use std::path::{Path, PathBuf};

use crate::document::Problem;
use crate::site::scan_file::ScanError;
use crate::text::{brief, reason, shown};

/// Error of a scene. Each names the file, the place in it, the value found and the accepted ones.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// The file is missing or cannot be read.
    #[error("{}: cannot be read: {}{}", file.display(), reason(source), named_in(needed_by))]
    Read {
        file: PathBuf,
        /// The file that references this one.
        needed_by: Option<PathBuf>,
        source: std::io::Error,
    },
    /// An invalid value.
    #[error("{}: {location}: found {actual}; expected: {accepted}", file.display())]
    Invalid {
        file: PathBuf,
        /// The place, such as `meshes[2].primitives[0].attributes.POSITION` or `line 3`.
        location: String,
        actual: String,
        accepted: String,
    },
    #[error(
        "{}: {}; expected .glb, .gltf or .toml (Blender imports other models and exports .glb)",
        file.display(),
        unsupported(extension.as_deref())
    )]
    UnsupportedExtension { file: PathBuf, extension: Option<String> },
    /// The scene file is not TOML, or has other keys or types.
    #[error("{}: {source}; docs/scenes.md lists the keys and values", file.display())]
    Syntax { file: PathBuf, source: Problem },
    /// The file is truncated.
    #[error("{} is incomplete ({}); copy or download it again", file.display(), sizes(*actual, *needed))]
    Incomplete { file: PathBuf, actual: usize, needed: usize },
    #[error(transparent)]
    Scan(ScanError),
    #[error("{} is not a glTF file; export the model as .glb, in Blender by File, Export, glTF 2.0", file.display())]
    NotGltf { file: PathBuf },
    #[error("{} is empty (0 bytes); a .glb or .gltf file is needed: export or download it again", file.display())]
    Empty { file: PathBuf },
    /// A decoder of pictures or text panicked.
    #[error("{}: reading it failed inside ({message}); the file is probably damaged: export it again", file.display())]
    DecoderPanic { file: PathBuf, message: String },
}

fn named_in(needed_by: &Option<PathBuf>) -> String {
    needed_by.as_ref().map(|file| format!(" (named in {})", file.display())).unwrap_or_default()
}

fn unsupported(extension: Option<&str>) -> String {
    extension.map_or_else(|| "no extension".to_owned(), |extension| format!("unsupported extension .{extension}"))
}

/// Two sizes in the largest unit that distinguishes them.
fn sizes(actual: usize, needed: usize) -> String {
    let units = [(1_000_000, "MB"), (1000, "kB"), (1, "bytes")];
    let in_unit = |(bytes, name): (usize, &str)| {
        let round = |size: usize| (size + bytes / 2) / bytes;
        let [actual, needed] = [round(actual), round(needed)];
        (needed >= 10 && actual < needed).then(|| format!("{actual} of {needed} {name}"))
    };
    units.into_iter().find_map(in_unit).unwrap_or_else(|| format!("{actual} of {needed} bytes"))
}

impl SceneError {
    /// Replaces the path of the file by the user's own.
    pub fn with_path(mut self, from: &Path, to: &Path) -> Self {
        match &mut self {
            Self::Read { file, .. }
            | Self::Invalid { file, .. }
            | Self::UnsupportedExtension { file, .. }
            | Self::Syntax { file, .. }
            | Self::Incomplete { file, .. }
            | Self::NotGltf { file }
            | Self::Empty { file }
            | Self::DecoderPanic { file, .. } => {
                if file == from {
                    *file = to.to_owned();
                }
            }
            Self::Scan(_) => {}
        }
        self
    }

    pub(super) fn bad(file: &Path, location: impl Display, actual: impl Display, accepted: impl Display) -> Self {
        Self::Invalid {
            file: file.to_owned(),
            location: location.to_string(),
            // The text may contain anything from a file.
            actual: shown(&brief(&actual.to_string())),
            accepted: accepted.to_string(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::sizes;

    #[test]
    fn sizes_use_the_largest_unit_that_distinguishes_them() {
        let messages = [(2000, 73_960), (3, 12), (73_900, 73_960), (1_000_000, 25_000_000)].map(|(a, b)| sizes(a, b));
        assert_eq!(messages, ["2 of 74 kB", "3 of 12 bytes", "73900 of 73960 bytes", "1 of 25 MB"]);
    }
}
