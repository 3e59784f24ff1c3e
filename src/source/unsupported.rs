//! Picture formats that are recognised but not decoded, each with a command that converts it.

use std::path::{Path, PathBuf};

use super::still_format;
use crate::text::count;

/// Names of the supported depth formats for messages.
pub const DEPTH_FORMATS: &str = "16-bit grey PNG, TIFF or PGM, floating-point TIFF, OpenEXR or NumPy arrays (.npy)";

/// A kind of file that is not decoded.
#[derive(Debug)]
pub struct UnsupportedKind {
    name: &'static str,
    /// Extensions, in lower case.
    extensions: &'static [&'static str],
    matches_signature: fn(&[u8]) -> bool,
    convert: &'static str,
    /// True if a folder's files of this kind count as frames beside other pictures.
    is_picture: bool,
}

static KINDS: [UnsupportedKind; 3] = [
    UnsupportedKind {
        name: "JPEG-LS",
        extensions: &["jls"],
        // Before its frame header it is like a JPEG.
        matches_signature: |start| start.starts_with(b"\xff\xd8\xff\xf7"),
        convert: "ffmpeg -i FILE.jls FILE.png",
        is_picture: true,
    },
    UnsupportedKind {
        name: "GIF",
        extensions: &["gif"],
        // Its content is a video.
        matches_signature: |_| false,
        convert: "ffmpeg -i FILE.gif FILE.png",
        is_picture: true,
    },
    UnsupportedKind {
        name: "a NumPy array",
        extensions: &["npy"],
        matches_signature: |start| start.starts_with(b"\x93NUMPY"),
        convert: "python3 -c \"import cv2, numpy; cv2.imwrite('FILE.png', cv2.cvtColor(numpy.load('FILE.npy'), cv2.COLOR_RGB2BGR))\" (8 or 16 bits, R, G, B)",
        is_picture: false,
    },
];

impl UnsupportedKind {
    pub fn refusal(&self) -> String {
        format!("is {}, which is not read; convert it: {}", self.name, self.convert)
    }
}

/// The kind of a file that is not decoded, by its first bytes.
pub fn by_content(start: &[u8]) -> Option<&'static UnsupportedKind> {
    KINDS.iter().find(|kind| (kind.matches_signature)(start))
}

/// The kind of a file that is not decoded, by its name.
pub fn by_name(file: &Path) -> Option<&'static UnsupportedKind> {
    let extension = file.extension()?.to_string_lossy().to_ascii_lowercase();
    KINDS.iter().find(|kind| kind.extensions.contains(&extension.as_str()))
}

/// The pictures of a folder that are not decoded, by their names, in order. Those with a decodable
/// picture of the same name beside them are left out. Arrays beside pictures are depth or other
/// data; arrays alone were meant as frames. An unreadable folder has none.
pub fn in_folder(folder: &Path) -> Vec<PathBuf> {
    let decoded = still_format::pictures_in(folder).unwrap_or_default();
    let is_converted = |file: &Path| decoded.iter().any(|other| other.file_stem() == file.file_stem());
    let is_hidden = |file: &Path| file.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'));
    let files = || std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let unread = |is_picture: bool| -> Vec<PathBuf> {
        let is_of_kind = |file: &PathBuf| by_name(file).is_some_and(|kind| kind.is_picture == is_picture);
        files().filter(is_of_kind).filter(|file| !is_hidden(file) && !is_converted(file) && file.is_file()).collect()
    };
    let mut unread_files = unread(true);
    if unread_files.is_empty() && decoded.is_empty() {
        unread_files = unread(false);
    }
    unread_files.sort();
    unread_files
}

/// Warning with the number of undecoded pictures and a remedy for the first; `None` if there are
/// none.
pub fn unread_warning(files: &[PathBuf]) -> Option<String> {
    let first = files.first()?;
    let are = if files.len() == 1 { "is" } else { "are" };
    let refusal = by_name(first)?.refusal();
    Some(format!("{} {are} not read (first: {} {refusal})", count(files.len(), "picture"), first.display()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_are_recognised_by_content_and_by_name() {
        for (start, file, name) in
            [(&b"\x93NUMPY\x01"[..], "f.npy", "a NumPy array"), (b"\xff\xd8\xff\xf7\0\x0b", "f.JLS", "JPEG-LS")]
        {
            assert_eq!(by_content(start).unwrap().name, name);
            assert_eq!(by_name(Path::new(file)).unwrap().name, name);
        }
        assert!(by_content(b"\0\0\0\x18ftypisom").is_none() && by_content(b"").is_none());
        assert!(by_name(Path::new("f.png")).is_none() && by_name(Path::new("gif")).is_none());
    }

    #[test]
    fn unread_pictures_of_a_folder_have_no_converted_copy() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["b.gif", "a.JLS", "c.gif", "c.jpg", ".d.gif", "e.npy", "notes.txt"] {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        let unread = in_folder(folder.path());
        assert_eq!(unread, ["a.JLS", "b.gif"].map(|name| folder.path().join(name)));
        let warning = unread_warning(&unread).unwrap();
        assert!(
            warning.starts_with("2 pictures are not read (first: ") && warning.contains("a.JLS is JPEG-LS, which"),
            "{warning}"
        );
        assert!(in_folder(&folder.path().join("none")).is_empty());
        // Arrays alone.
        for name in ["b.gif", "a.JLS", "c.gif", "c.jpg"] {
            std::fs::remove_file(folder.path().join(name)).unwrap();
        }
        let unread = in_folder(folder.path());
        assert_eq!(unread, [folder.path().join("e.npy")]);
        assert!(
            unread_warning(&unread).unwrap().contains("e.npy is a NumPy array, which is not read; convert it: python3")
        );
    }
}
