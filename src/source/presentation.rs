//! Display properties of a video: orientation, pixel aspect, colour tags and time code, with the
//! warnings about each. Rotations by quarter turns are applied on reading, and the colour tags give
//! the camera's response. A written video gets the tags that were not applied.

use serde::Deserialize;

use super::orientation::Orientation;
use super::timecode::Timecode;
use crate::camera::{Curve, Primaries, Response};
use crate::text::quoted;

/// The properties in ffprobe's output.
#[derive(Deserialize)]
pub(super) struct ProbedPresentation {
    color_transfer: Option<String>,
    color_primaries: Option<String>,
    sample_aspect_ratio: Option<String>,
    #[serde(default)]
    side_data_list: Vec<SideData>,
}

/// A stream's side data in ffprobe's JSON output.
#[derive(Deserialize)]
struct SideData {
    rotation: Option<f64>,
    displaymatrix: Option<String>,
}

/// Display properties that a file states and that a player applies.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Presentation {
    pub orientation: Orientation,
    /// Width to height of a pixel. `None` if it is square.
    pub pixel_aspect: Option<(u32, u32)>,
    /// ffprobe's names of the transfer function and the primaries.
    pub transfer: Option<&'static str>,
    pub primaries: Option<&'static str>,
    /// ffprobe's name of the matrix between R'G'B' and Y'CbCr, if the file states it.
    pub matrix: Option<&'static str>,
    /// Timecode of the first frame.
    pub timecode: Option<Timecode>,
}

/// Code points of ITU-T H.273, tables 2 and 3.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ColorTags {
    pub primaries: u8,
    pub transfer: u8,
}

const SRGB_CODE: u8 = 13;
const REC709_CODE: u8 = 1;
/// Code points of the transfer functions and primaries that pictures are tagged with.
const TRANSFER_CODES: [(&str, u8); 9] = [
    ("arib-std-b67", 18),
    ("smpte2084", 16),
    ("linear", 8),
    ("bt470m", 4),
    ("bt470bg", 5),
    ("smpte428", 17),
    ("log100", 9),
    ("log316", 10),
    ("bt1361e", 12),
];
const PRIMARIES_CODES: [(&str, u8); 3] = [("bt2020", 9), ("smpte431", 11), ("smpte432", 12)];

/// Name of a transfer function. `None` for those of usual pictures and unknown ones.
pub(super) fn transfer_of_code(code: u16) -> Option<&'static str> {
    TRANSFER_CODES.iter().find(|(_, of)| u16::from(*of) == code).map(|(name, _)| *name)
}

/// Name of primaries. `None` for Rec. 709 and unknown ones.
pub(super) fn primaries_of_code(code: u16) -> Option<&'static str> {
    PRIMARIES_CODES.iter().find(|(_, of)| u16::from(*of) == code).map(|(name, _)| *name)
}

/// Transfer functions, each with its common name if it is far from the response of a usual camera.
const TRANSFERS: [(&str, Option<&str>); 16] = [
    ("bt709", None),
    ("smpte170m", None),
    ("smpte240m", None),
    ("bt470m", None),
    ("iec61966-2-1", None),
    ("iec61966-2-4", None),
    ("bt2020-10", None),
    ("bt2020-12", None),
    ("smpte2084", Some("PQ (high dynamic range)")),
    ("arib-std-b67", Some("HLG (high dynamic range)")),
    ("linear", Some("linear light")),
    ("log100", Some("a logarithmic scale of 100:1")),
    ("log316", Some("a logarithmic scale of 316:1")),
    ("bt470bg", Some("a gamma of 2.8")),
    ("smpte428", Some("a gamma of 2.6 (digital cinema)")),
    ("bt1361e", Some("the extended gamut of BT.1361")),
];
const PRIMARIES: [&str; 10] =
    ["bt709", "bt470m", "bt470bg", "smpte170m", "smpte240m", "film", "bt2020", "smpte428", "smpte431", "smpte432"];
/// ffprobe's names of an unspecified tag.
const UNSPECIFIED: [&str; 3] = ["unknown", "unspecified", "reserved"];

/// The tag of that name, if it can be written again.
fn lookup(names: impl IntoIterator<Item = &'static str>, text: Option<&str>) -> Option<&'static str> {
    names.into_iter().find(|name| text == Some(*name))
}

impl Presentation {
    pub(super) fn of(stream: &ProbedPresentation) -> Self {
        let aspect = stream.sample_aspect_ratio.as_deref().and_then(|text| text.split_once(':'));
        let aspect = aspect.and_then(|(width, height)| Some((width.parse().ok()?, height.parse().ok()?)));
        Self {
            orientation: stream.side_data_list.iter().find_map(SideData::orientation).unwrap_or_default(),
            pixel_aspect: aspect.filter(|(width, height)| *width > 0 && *height > 0 && width != height),
            transfer: lookup(TRANSFERS.map(|(name, _)| name), stream.color_transfer.as_deref()),
            primaries: lookup(PRIMARIES, stream.color_primaries.as_deref()),
            matrix: None,
            timecode: None,
        }
    }

    /// Splits off an orientation by quarter turns, which is applied on reading unless the frames
    /// are read `as_stored`.
    pub(super) fn applied(self, as_stored: bool) -> (Self, Orientation) {
        if as_stored || !self.orientation.is_by_quarter_turns() {
            return (self, Orientation::default());
        }
        let is_upright = self.orientation.oriented_size((1, 0)) == (1, 0);
        let pixel_aspect = if is_upright { self.pixel_aspect } else { self.pixel_aspect.map(|(w, h)| (h, w)) };
        (Self { orientation: Orientation::default(), pixel_aspect, ..self }, self.orientation)
    }

    /// The tags of pictures whose transfer function or primaries are not those of usual pictures.
    pub fn color_tags(&self) -> Option<ColorTags> {
        let code = |codes: &[(&str, u8)], name: Option<&str>, usual: u8| {
            codes.iter().find(|(of, _)| name == Some(*of)).map_or(usual, |(_, code)| *code)
        };
        let transfer = code(&TRANSFER_CODES, self.transfer, SRGB_CODE);
        let primaries = code(&PRIMARIES_CODES, self.primaries, REC709_CODE);
        ((primaries, transfer) != (REC709_CODE, SRGB_CODE)).then_some(ColorTags { primaries, transfer })
    }

    /// True for a transfer function of high dynamic range.
    pub fn is_hdr(&self) -> bool {
        matches!(self.transfer, Some("arib-std-b67" | "smpte2084"))
    }

    /// The camera's response that the transfer function and the primaries state. The curves of
    /// usual cameras are all taken for sRGB, the default, and primaries near those of Rec. 709 for
    /// these.
    pub fn response(&self) -> Response {
        let (curve, gamma) = match self.transfer {
            Some("arib-std-b67") => (Curve::Hlg, None),
            Some("smpte2084") => (Curve::Pq, None),
            Some("linear") => (Curve::Linear, None),
            Some("bt470m") => (Curve::Gamma, Some(2.2)),
            Some("bt470bg") => (Curve::Gamma, Some(2.8)),
            Some("smpte428") => (Curve::Gamma, Some(2.6)),
            _ => (Curve::Srgb, None),
        };
        let primaries = match self.primaries {
            Some("bt2020") => Primaries::Rec2020,
            Some("smpte431" | "smpte432") => Primaries::P3,
            _ => Primaries::Rec709,
        };
        let response = Response::default();
        Response { curve, gamma: gamma.unwrap_or(response.gamma), primaries, ..response }
    }

    /// Common name of a transfer function that is not a usual camera's.
    fn unusual_transfer(&self) -> Option<&'static str> {
        TRANSFERS.iter().find(|(name, _)| self.transfer == Some(*name))?.1
    }

    /// The properties that are lost in pictures without tags. `None` if there are none.
    pub fn lost_without_tags(&self) -> Option<String> {
        let shown =
            (self.orientation != Orientation::default()).then(|| format!("should be shown {}", self.orientation));
        let pixels = self.pixel_aspect.map(|(width, height)| format!("has pixels of {width}:{height}"));
        let transfer = self.unusual_transfer().map(|transfer| format!("is in {transfer}"));
        let primaries = self
            .primaries
            .filter(|_| self.response().primaries != Primaries::Rec709)
            .map(|name| format!("has the primaries {name}"));
        let properties: Vec<String> = [shown, pixels, transfer, primaries].into_iter().flatten().collect();
        (!properties.is_empty()).then(|| {
            format!(
                "is tagged: it {}; recorded pictures lose the tag, and their code values are taken for the camera's \
                 usual ones: name the video in a recording.toml instead ([frames] video)",
                properties.join(" and ")
            )
        })
    }

    /// One sentence for each property that is not applied.
    pub(super) fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        if self.orientation != Orientation::default() {
            let shown = self.orientation;
            warnings.push(format!(
                "is tagged to be shown {shown}; it is read as stored; a written .mp4 has the same tag, which players \
                 apply; a .mkv has no such tag, and players show it as stored: write a .mp4"
            ));
        }
        if let Some((width, height)) = self.pixel_aspect {
            warnings.push(format!(
                "its pixels are not square but {width}:{height}; they are read as stored, and a written video has the \
                 same tag; the camera's fx_px must be {height}/{width} of its fy_px"
            ));
        }
        if let Some(transfer) = self.unusual_transfer().filter(|_| self.response().curve == Curve::Srgb) {
            let name = self.transfer.unwrap_or_default();
            warnings.push(format!(
                "is in {transfer}; its code values are taken for the camera's usual ones, so the light on objects is \
                 wrong, and a written video is tagged {name} too; give the profile a response of that kind \
                 ([camera.response] table), or convert it first"
            ));
        }
        warnings
    }
}

impl ProbedPresentation {
    /// One sentence for each tag that cannot be written again.
    pub(super) fn unknown_tags(&self, presentation: &Presentation) -> Vec<String> {
        let tags = [
            ("transfer function", &self.color_transfer, presentation.transfer),
            ("primaries", &self.color_primaries, presentation.primaries),
        ];
        let unknown = tags.into_iter().filter_map(|(what, tag, value)| {
            let tag = tag.as_deref().filter(|tag| value.is_none() && !UNSPECIFIED.contains(tag))?;
            Some(format!("is tagged with the unknown {what} {}; a written video has the usual tag", quoted(tag)))
        });
        unknown.collect()
    }
}

impl SideData {
    /// The orientation by the display matrix, or by the angle if there is none.
    fn orientation(&self) -> Option<Orientation> {
        let of_angle = |rotation_deg| Orientation { is_mirrored: false, rotation_deg };
        match self.displaymatrix.as_deref().and_then(display_matrix) {
            Some(matrix) => Orientation::of_matrix(matrix),
            None => self.rotation.map(of_angle),
        }
    }
}

/// The left upper part of a display matrix, as ffprobe writes it: three lines `number: a b u`.
fn display_matrix(text: &str) -> Option<[f64; 4]> {
    let row = |line: &str| -> Option<[f64; 2]> {
        let mut words = line.split_once(':')?.1.split_whitespace();
        Some([words.next()?.parse().ok()?, words.next()?.parse().ok()?])
    };
    let mut rows = text.trim().lines().map(row);
    let ([a, b], [c, d]) = (rows.next()??, rows.next()??);
    Some([a, b, c, d])
}
