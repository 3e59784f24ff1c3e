//! Photograph requests as plain values.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};

use crate::camera::Film;
use crate::camera::metering::Mode;

/// Focus setting.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Focus {
    /// Autofocus in the centre.
    Auto,
    /// Up to infinity.
    Metres(f64),
}

/// A series over the range of one setting.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bracket {
    /// f/2.8 to f/22.
    Aperture,
    /// Three stops to both sides.
    Shutter,
    /// ISO 100 to 25600.
    Iso,
    /// Distances of focus from half to twice the given one.
    Focus,
}

/// Request for a photograph or a series. `None` values follow from the recording or from the mode.
#[derive(Clone, Debug, PartialEq)]
pub struct PhotoRequest {
    /// Frame index in the recording.
    pub frame: usize,
    /// `None`: determined by which of aperture and shutter are set.
    pub mode: Option<Mode>,
    pub f_number: Option<f64>,
    pub time_s: Option<f64>,
    pub iso: Option<f64>,
    /// Stops brighter than correct.
    pub compensation_ev: f64,
    /// Illuminance of the scene, lx.
    pub lux: Option<f64>,
    pub focal_length_mm: Option<f64>,
    /// Centre of the photograph: `X,Y` in the recorded picture, px, or the name of an object.
    pub aim: Option<String>,
    /// Width of the photograph in columns of the recorded picture. Alternative to a focal length.
    pub across_px: Option<f64>,
    /// True if the recording's frames are summed during the exposure.
    pub hand_held: bool,
    pub focus: Focus,
    pub film: Option<Film>,
    pub width_px: Option<u32>,
    pub bracket: Option<Bracket>,
    /// A `.jpg` or `.png`; a series appends to the name.
    pub output: PathBuf,
    /// Text of a visible mark on each photograph.
    pub mark: Option<String>,
    /// Labels the pictures as composites ([`crate::label`]).
    pub labelled: bool,
    /// True if existing pictures may be replaced.
    pub force: bool,
    /// Name of the subject, for the record: an object of the scene. `None`: the object that is
    /// aimed at, or the evidence nearest to the picture's centre.
    pub subject: Option<String>,
    /// Number in the series, for the record. `None`: the replaced photograph's, or the next one in
    /// its folder.
    pub number: Option<u32>,
}

impl PhotoRequest {
    /// A frame on a tripod in automatic mode.
    pub fn new(frame: usize, output: PathBuf) -> Self {
        Self {
            frame,
            mode: None,
            f_number: None,
            time_s: None,
            iso: None,
            compensation_ev: 0.0,
            lux: None,
            focal_length_mm: None,
            aim: None,
            across_px: None,
            hand_held: false,
            focus: Focus::Auto,
            film: None,
            width_px: None,
            bracket: None,
            output,
            mark: None,
            labelled: true,
            force: false,
            subject: None,
            number: None,
        }
    }

    /// The given path for a single photograph; in a series, the file name with a hyphen and a part
    /// appended.
    pub fn path_of(&self, part: &str) -> PathBuf {
        if self.bracket.is_none() {
            return self.output.clone();
        }
        let (stem, extension) = parts(&self.output);
        self.output.with_file_name(format!("{stem}-{part}.{extension}"))
    }
}

fn parts(path: &Path) -> (String, String) {
    let text = |part: Option<&OsStr>| part.unwrap_or_default().to_string_lossy().into_owned();
    (text(path.file_stem()), text(path.extension()))
}

/// Existing pictures of a series of that name, in the order of their names: those that another
/// series may replace.
pub fn existing_series(output: &Path) -> Vec<PathBuf> {
    let (stem, extension) = parts(output);
    let is_part = |name: &str| {
        let rest = name.strip_prefix(&format!("{stem}-")).and_then(|rest| rest.strip_suffix(&format!(".{extension}")));
        rest.is_some_and(|part| part == "sheet" || !part.is_empty() && part.bytes().all(|b| b.is_ascii_digit()))
    };
    let folder = output.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let mut there: Vec<PathBuf> =
        entries.filter(|path| path.file_name().is_some_and(|name| is_part(&name.to_string_lossy()))).collect();
    there.sort();
    there
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn existing_series_matches_the_name() {
        let temp = tempfile::tempdir().unwrap();
        for name in ["a-1.jpg", "a-12.jpg", "a-sheet.jpg", "a.jpg", "a-1.png", "a-1b.jpg", "a-.jpg", "b-1.jpg"] {
            std::fs::write(temp.path().join(name), "").unwrap();
        }
        let there = existing_series(&temp.path().join("a.jpg"));
        assert_eq!(there, ["a-1.jpg", "a-12.jpg", "a-sheet.jpg"].map(|name| temp.path().join(name)));
        let request = PhotoRequest { bracket: Some(Bracket::Iso), ..PhotoRequest::new(0, temp.path().join("a.jpg")) };
        assert_eq!(request.path_of("12"), there[1]);
        assert!(existing_series(&temp.path().join("none/a.jpg")).is_empty());
    }
}
