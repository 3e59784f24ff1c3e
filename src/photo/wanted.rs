//! What is asked of a virtual camera, as plain values.

use std::path::PathBuf;

use crate::camera::Film;
use crate::camera::metering::Mode;

/// What is sharp.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Focus {
    /// What is in the middle.
    Auto,
    /// Up to infinity.
    Metres(f64),
}

/// A series in which one setting goes through its range.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Bracket {
    /// f/2.8 to f/22.
    Aperture,
    /// Three stops to both sides.
    Shutter,
    /// ISO 100 to 25600.
    Iso,
    /// From half the distance to twice.
    Focus,
}

/// A photograph, or a series of them. What is `None` follows from the recording or from the mode.
#[derive(Clone, Debug, PartialEq)]
pub struct Wanted {
    /// Which of the recording's frames.
    pub frame: usize,
    /// `None`: by which of aperture and shutter are set.
    pub mode: Option<Mode>,
    pub f_number: Option<f64>,
    pub time_s: Option<f64>,
    pub iso: Option<f64>,
    /// Stops brighter than correct.
    pub compensation_ev: f64,
    /// The light on the scene, lx.
    pub lux: Option<f64>,
    pub focal_length_mm: Option<f64>,
    /// What is in the middle: `X,Y` in the recorded picture, px, or an object by its name.
    pub aim: Option<String>,
    /// Width of the photograph in columns of the recorded picture. Alternative to a focal length.
    pub across_px: Option<f64>,
    /// The recording's frames are summed while the shutter is open.
    pub hand_held: bool,
    pub focus: Focus,
    pub film: Option<Film>,
    pub width_px: Option<u32>,
    pub bracket: Option<Bracket>,
    /// A `.jpg` or `.png`; a series appends to the name.
    pub output: PathBuf,
    /// Whether pictures that exist may be replaced.
    pub force: bool,
}

impl Wanted {
    /// A frame as a camera on a stand takes it by itself.
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
            force: false,
        }
    }

    /// For a single photograph the given name; in a series, the name with a hyphen and a part appended.
    pub fn path_of(&self, part: &str) -> PathBuf {
        if self.bracket.is_none() {
            return self.output.clone();
        }
        let text = |part: Option<&std::ffi::OsStr>| part.unwrap_or_default().to_string_lossy().into_owned();
        let (stem, extension) = (text(self.output.file_stem()), text(self.output.extension()));
        self.output.with_file_name(format!("{stem}-{part}.{extension}"))
    }
}
