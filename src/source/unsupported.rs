//! Picture formats that are recognised but not decoded, each with a command that converts it.

use std::collections::BTreeSet;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

use crate::text::count;

/// Names of the supported depth formats for messages.
pub const DEPTH_FORMATS: &str = "16-bit grey PNG, OpenEXR or NumPy arrays (.npy)";

/// A kind of file that is not decoded.
#[derive(Debug)]
pub struct UnsupportedKind {
    name: &'static str,
    /// Extensions, in lower case.
    endings: &'static [&'static str],
    is_begun_by: fn(&[u8]) -> bool,
    convert: &'static str,
    /// The command that preserves depth values, if files of this kind may contain depth.
    convert_depth: Option<&'static str>,
    /// True if a folder's files of this kind count as frames.
    is_picture: bool,
}

/// True if a file of the ISO base media format has one of these brands.
fn has_brand(start: &[u8], brands: &[&[u8; 4]]) -> bool {
    start.get(4..8) == Some(b"ftyp") && brands.iter().any(|brand| start.get(8..12) == Some(*brand))
}

const DEPTH_TIFF: &str = "python3 -c \"import cv2, numpy; numpy.save('FILE.npy', cv2.imread('FILE.tif', -1))\"";
const DEPTH_PPM: &str = "python3 -c \"import cv2, numpy; numpy.save('FILE.npy', cv2.imread('FILE.pgm', -1))\"";

/// Camera raw files begin like TIFF files, so only their names distinguish them.
static KINDS: [UnsupportedKind; 13] = [
    UnsupportedKind {
        name: "HEIC",
        endings: &["heic", "heif", "hif"],
        is_begun_by: |start| has_brand(start, &[b"heic", b"heix", b"heim", b"heis", b"mif1", b"msf1", b"hevc"]),
        convert: "heif-convert FILE.heic FILE.png",
        convert_depth: None,
        is_picture: true,
    },
    UnsupportedKind {
        name: "AVIF",
        endings: &["avif"],
        is_begun_by: |start| has_brand(start, &[b"avif"]),
        convert: "ffmpeg -i FILE.avif FILE.png",
        convert_depth: None,
        is_picture: true,
    },
    UnsupportedKind {
        name: "a camera's raw file",
        endings: &["dng", "cr2", "cr3", "nef", "arw", "raf", "orf", "rw2", "pef", "srw"],
        is_begun_by: |start| has_brand(start, &[b"crx "]) || start.starts_with(b"FUJIFILM"),
        convert: "darktable-cli FILE.dng FILE.png",
        convert_depth: None,
        is_picture: true,
    },
    UnsupportedKind {
        name: "TIFF",
        endings: &["tif", "tiff"],
        is_begun_by: |start| start.starts_with(b"II*\0") || start.starts_with(b"MM\0*"),
        convert: "ffmpeg -i FILE.tif FILE.png",
        convert_depth: Some(DEPTH_TIFF),
        is_picture: true,
    },
    UnsupportedKind {
        name: "OpenEXR",
        endings: &["exr"],
        is_begun_by: |start| start.starts_with(b"\x76\x2f\x31\x01"),
        convert: "ffmpeg -apply_trc iec61966_2_1 -i FILE.exr -pix_fmt rgb48be FILE.png",
        convert_depth: None,
        is_picture: true,
    },
    UnsupportedKind {
        name: "WebP",
        endings: &["webp"],
        is_begun_by: |start| start.starts_with(b"RIFF") && start.get(8..12) == Some(b"WEBP"),
        convert: "ffmpeg -i FILE.webp FILE.png",
        convert_depth: None,
        is_picture: true,
    },
    UnsupportedKind {
        name: "JPEG XL",
        endings: &["jxl"],
        is_begun_by: |start| start.starts_with(b"\xff\x0a") || start.starts_with(b"\0\0\0\x0cJXL "),
        convert: "djxl FILE.jxl FILE.png",
        convert_depth: None,
        is_picture: true,
    },
    UnsupportedKind {
        name: "JPEG 2000",
        endings: &["jp2", "j2k"],
        is_begun_by: |start| start.starts_with(b"\0\0\0\x0cjP  ") || start.starts_with(b"\xff\x4f\xff\x51"),
        convert: "ffmpeg -i FILE.jp2 FILE.png",
        convert_depth: None,
        is_picture: true,
    },
    UnsupportedKind {
        name: "JPEG-LS",
        endings: &["jls"],
        // Before its frame header it is like a JPEG.
        is_begun_by: |start| start.starts_with(b"\xff\xd8\xff\xf7"),
        convert: "ffmpeg -i FILE.jls FILE.png",
        convert_depth: None,
        is_picture: true,
    },
    UnsupportedKind {
        name: "BMP",
        endings: &["bmp"],
        is_begun_by: |start| start.starts_with(b"BM"),
        convert: "ffmpeg -i FILE.bmp FILE.png",
        convert_depth: None,
        is_picture: true,
    },
    UnsupportedKind {
        name: "GIF",
        endings: &["gif"],
        // Its content is a video.
        is_begun_by: |_| false,
        convert: "ffmpeg -i FILE.gif FILE.png",
        convert_depth: None,
        is_picture: true,
    },
    UnsupportedKind {
        name: "PPM",
        endings: &["ppm", "pgm", "pnm"],
        is_begun_by: |start| start.starts_with(b"P5") || start.starts_with(b"P6"),
        convert: "ffmpeg -i FILE.ppm FILE.png",
        convert_depth: Some(DEPTH_PPM),
        is_picture: true,
    },
    UnsupportedKind {
        name: "a NumPy array",
        endings: &["npy"],
        is_begun_by: |start| start.starts_with(b"\x93NUMPY"),
        convert: "python3 -c \"import cv2, numpy; cv2.imwrite('FILE.png', cv2.cvtColor(numpy.load('FILE.npy'), cv2.COLOR_RGB2BGR))\" (8 or 16 bits, R, G, B)",
        convert_depth: None,
        is_picture: false,
    },
];

impl UnsupportedKind {
    pub fn refusal(&self) -> String {
        format!("is {}, which is not read; convert it: {}", self.name, self.convert)
    }

    /// The refusal of a depth file. Commands for colour would change its values.
    pub fn depth_refusal(&self) -> String {
        match self.convert_depth {
            Some(command) => format!(
                "is {}, which is not read as depth; `{command}` keeps its values (Python with opencv-python and numpy): name \
                 the .npy in its place",
                self.name
            ),
            None => format!("is {}, which is not read as depth; expected {}", self.name, DEPTH_FORMATS),
        }
    }
}

/// The kind of a file that is not decoded, by its first bytes.
pub fn by_content(start: &[u8]) -> Option<&'static UnsupportedKind> {
    KINDS.iter().find(|kind| (kind.is_begun_by)(start))
}

/// The kind of a file that is not decoded, by its name.
pub fn by_name(file: &Path) -> Option<&'static UnsupportedKind> {
    let ending = file.extension()?.to_string_lossy().to_ascii_lowercase();
    KINDS.iter().find(|kind| kind.endings.contains(&ending.as_str()))
}

/// The pictures of a folder that are not decoded, by their names, in order. Those with a converted
/// PNG or JPEG beside them are left out. Arrays beside pictures are depth or other data; arrays
/// alone were meant as frames. An unreadable folder has none.
pub fn in_folder(folder: &Path) -> Vec<PathBuf> {
    let files = || std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let is_decoded = |file: &PathBuf| {
        let ending = file.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
        matches!(ending.as_str(), "png" | "jpg" | "jpeg")
    };
    let stem = |file: &PathBuf| file.file_stem().map(OsString::from);
    let converted: BTreeSet<_> = files().filter(is_decoded).map(|file| stem(&file)).collect();
    let is_hidden = |file: &Path| file.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'));
    let unread = |is_picture: bool| -> Vec<PathBuf> {
        let is_of_kind = |file: &PathBuf| by_name(file).is_some_and(|kind| kind.is_picture == is_picture);
        let is_unread = |file: &PathBuf| !is_hidden(file) && !converted.contains(&stem(file)) && file.is_file();
        files().filter(is_of_kind).filter(is_unread).collect()
    };
    let mut unread_files = unread(true);
    if unread_files.is_empty() && converted.is_empty() {
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
        for (start, file, name) in [
            (&b"\0\0\0\x18ftypheic\0\0\0\0"[..], "a/IMG_1.HEIC", "HEIC"),
            (b"\x76\x2f\x31\x01", "f.exr", "OpenEXR"),
            (b"\x93NUMPY\x01", "f.npy", "a NumPy array"),
            (b"II*\0", "f.tif", "TIFF"),
            (b"\xff\xd8\xff\xf7\0\x0b", "f.JLS", "JPEG-LS"),
            (b"RIFF\0\0\0\0WEBP", "f.webp", "WebP"),
        ] {
            assert_eq!(by_content(start).unwrap().name, name);
            assert_eq!(by_name(Path::new(file)).unwrap().name, name);
        }
        assert!(by_content(b"\0\0\0\x18ftypisom").is_none() && by_content(b"").is_none());
        assert!(by_name(Path::new("f.png")).is_none() && by_name(Path::new("heic")).is_none());
    }

    #[test]
    fn depth_formats_have_a_lossless_conversion_command() {
        let refusal = |start: &[u8]| by_content(start).unwrap().depth_refusal();
        assert!(refusal(b"II*\0").contains("numpy.save('FILE.npy', cv2.imread('FILE.tif', -1))"));
        assert!(refusal(b"P5 3 2").contains("numpy.save('FILE.npy', cv2.imread('FILE.pgm', -1))"));
        let other = refusal(b"RIFF\0\0\0\0WEBP");
        assert!(other.ends_with("expected 16-bit grey PNG, OpenEXR or NumPy arrays (.npy)"), "{other}");
    }

    #[test]
    fn unread_pictures_of_a_folder_have_no_converted_copy() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["b.heic", "a.TIF", "c.heic", "c.jpg", ".d.heic", "e.npy", "notes.txt"] {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        let unread = in_folder(folder.path());
        assert_eq!(unread, ["a.TIF", "b.heic"].map(|name| folder.path().join(name)));
        let warning = unread_warning(&unread).unwrap();
        assert!(
            warning.starts_with("2 pictures are not read (first: ") && warning.contains("a.TIF is TIFF, which"),
            "{warning}"
        );
        assert!(in_folder(&folder.path().join("none")).is_empty());
        // Arrays alone.
        for name in ["b.heic", "a.TIF", "c.heic", "c.jpg"] {
            std::fs::remove_file(folder.path().join(name)).unwrap();
        }
        let unread = in_folder(folder.path());
        assert_eq!(unread, [folder.path().join("e.npy")]);
        assert!(
            unread_warning(&unread).unwrap().contains("e.npy is a NumPy array, which is not read; convert it: python3")
        );
    }
}
