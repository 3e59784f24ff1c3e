//! Case card: the first frame of a series, with the case's data and patches of grey and colour.

use std::path::Path;

use image::{Rgb, RgbImage};
use serde::{Deserialize, Serialize};

use crate::hash::pcg3d;
use crate::pixels::{Codes, Pixels};
use crate::sink::lettering::{Style, missing_characters, width_px, write};
use crate::source::file as plain;
use crate::text::reason;

/// Data of a case card, as in its TOML file.
#[derive(Clone, Debug, Default, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct CaseCard {
    pub case_number: String,
    /// Date, and time if it matters, as it shall be printed.
    pub date: String,
    pub place: String,
    pub photographer: String,
    /// Camera and lens.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub camera: String,
    /// A line of remarks.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub remarks: String,
}

const CARD_PX: (u32, u32) = (1800, 1200);
/// Length of the longest accepted value, characters.
const MAX_CHARACTERS: usize = 120;
const MARGIN_PX: u32 = 90;
const INK: Rgb<u8> = Rgb([28, 30, 34]);
/// Paper in the middle of the card; it falls off by `FALLOFF` towards the corners, as under one
/// lamp.
const PAPER: [f32; 3] = [236.0, 234.0, 228.0];
const FALLOFF: f32 = 0.06;
/// Amplitude of the grain, codes.
const GRAIN: f32 = 2.0;
/// Side of a patch, and the top of the row, px.
const PATCH_PX: u32 = 125;
const PATCH_TOP_PX: u32 = 950;
/// Nominal sRGB values of the last two rows of the usual 24-patch chart: six greys, then blue,
/// green, red, yellow, magenta, cyan. A screen or printer that is not calibrated changes them.
const PATCHES: [[u8; 3]; 12] = [
    [243, 243, 242],
    [200, 200, 200],
    [160, 160, 160],
    [122, 122, 121],
    [85, 85, 85],
    [52, 52, 52],
    [56, 61, 150],
    [70, 148, 73],
    [175, 54, 60],
    [231, 199, 31],
    [187, 86, 149],
    [8, 133, 161],
];

impl CaseCard {
    /// Reads a card's TOML file. The error names file, key and accepted values.
    pub fn read(path: &Path) -> Result<Self, String> {
        let text = plain::read_text(path, plain::MAX_DOCUMENT_BYTES)
            .map_err(|error| format!("{}: cannot be read: {}", path.display(), reason(&error)))?;
        let card: Self = toml::from_str(&text).map_err(|error| {
            let at = error.span().map_or(String::new(), |span| {
                format!(", line {}", text[..span.start.min(text.len())].matches('\n').count() + 1)
            });
            format!(
                "{}{at}: {}; expected case_number, date, place and photographer, and optionally camera and remarks, as \
                 texts in quotes",
                path.display(),
                error.message()
            )
        })?;
        for (key, value) in card.rows() {
            if value.chars().count() > MAX_CHARACTERS || value.chars().any(char::is_control) {
                return Err(format!(
                    "{}: {key}: expected one line of up to {MAX_CHARACTERS} characters",
                    path.display()
                ));
            }
        }
        let undrawn = |(key, value): (&'static str, &str)| {
            let missing = missing_characters(value);
            (!missing.is_empty())
                .then(|| format!("{key}: the card's font has no {missing}; expected Latin, Greek or Cyrillic letters"))
        };
        if let Some(problem) = card.rows().into_iter().find_map(undrawn) {
            return Err(format!("{}: {problem}", path.display()));
        }
        let required = [("case_number", &card.case_number), ("date", &card.date), ("place", &card.place)];
        match required.iter().chain(&[("photographer", &card.photographer)]).find(|(_, value)| value.trim().is_empty())
        {
            Some((key, _)) => Err(format!("{}: {key} is empty: the card identifies the series by it", path.display())),
            None => Ok(card),
        }
    }

    /// Labels and values, in the order of the card. Empty optional values are left out.
    pub fn rows(&self) -> Vec<(&'static str, &str)> {
        let all = [
            ("Case", &self.case_number),
            ("Date", &self.date),
            ("Place", &self.place),
            ("Photographer", &self.photographer),
            ("Camera", &self.camera),
            ("Remarks", &self.remarks),
        ];
        all.into_iter().filter(|(_, value)| !value.is_empty()).map(|(label, value)| (label, value.as_str())).collect()
    }

    /// The card as a picture, 1800×1200 px: lit paper with grain, the data, and exact patches.
    pub fn picture(&self) -> Pixels {
        let (width, height) = CARD_PX;
        let mut card = RgbImage::from_fn(width, height, paper);
        let right = (width - MARGIN_PX) as f32;
        write(&mut card, (MARGIN_PX as f32, 60.0), right, "PHOTOGRAPHIC RECORD", Style { height_px: 64.0, ink: INK });
        for (row, (label, value)) in (0u32..).zip(self.rows()) {
            let top = (190 + 118 * row) as f32;
            write(
                &mut card,
                (MARGIN_PX as f32, top + 20.0),
                right,
                label,
                Style { height_px: 44.0, ink: Rgb([96, 98, 104]) },
            );
            let left = 400.0;
            // Long values are reduced until they fit the line.
            let full_px = if row == 0 { 92.0 } else { 68.0 };
            let height_px = full_px * ((right - left) / width_px(value, full_px).max(1.0)).min(1.0);
            write(&mut card, (left, top + 0.5 * (84.0 - height_px)), right + 1.0, value, Style { height_px, ink: INK });
        }
        for (n, patch) in (0u32..).zip(PATCHES) {
            let left = MARGIN_PX + n * (PATCH_PX + 10);
            for y in PATCH_TOP_PX..PATCH_TOP_PX + PATCH_PX {
                for x in left..left + PATCH_PX {
                    card.put_pixel(x, y, Rgb(patch));
                }
            }
        }
        Pixels::uncoded(width, height, Codes::U8(card.into_raw()))
    }
}

/// Paper at a pixel.
fn paper(x: u32, y: u32) -> Rgb<u8> {
    let off = [x as f32 / CARD_PX.0 as f32 - 0.5, y as f32 / CARD_PX.1 as f32 - 0.5];
    let light = 1.0 - FALLOFF * 2.0 * (off[0] * off[0] + off[1] * off[1]);
    let noise = pcg3d([x, y, 0]).map(|h| (h >> 8) as f32 / (1 << 24) as f32);
    // The sum of three uniform values is about normal.
    let grain = GRAIN * (noise[0] + noise[1] + noise[2] - 1.5);
    Rgb(PAPER.map(|code| (code * light + grain).round().clamp(0.0, 255.0) as u8))
}

#[cfg(test)]
mod tests {
    use super::*;

    const TOML: &str =
        "case_number = \"2026-0142\"\ndate = \"30 Nov 2026\"\nplace = \"Office\"\nphotographer = \"A. B.\"\n";

    fn read(text: &str) -> Result<CaseCard, String> {
        let temp = tempfile::tempdir().unwrap();
        let path = temp.path().join("case.toml");
        std::fs::write(&path, text).unwrap();
        CaseCard::read(&path)
    }

    #[test]
    fn card_shows_text_and_exact_patches() {
        let card = read(TOML).unwrap();
        assert_eq!(card.rows().len(), 4);
        let picture = card.picture();
        assert_eq!((picture.width, picture.height), CARD_PX);
        for (n, patch) in (0u32..).zip(PATCHES) {
            assert_eq!(picture.at(MARGIN_PX + n * 135 + 60, PATCH_TOP_PX + 60), patch.map(u32::from));
        }
        let dark = |top: u32| {
            (top..top + 84)
                .flat_map(|y| (400..1700).map(move |x| (x, y)))
                .filter(|&(x, y)| picture.at(x, y)[0] < 90)
                .count()
        };
        // Four lines of text, and paper below.
        assert!((0..4).all(|row| dark(190 + 118 * row) > 300));
        assert_eq!(dark(190 + 118 * 4), 0);
    }

    #[test]
    fn long_value_is_reduced_to_the_line() {
        let card = CaseCard { place: "W".repeat(120), ..read(TOML).unwrap() };
        let picture = card.picture();
        assert!((0..1200).all(|y| picture.at(1750, y)[0] > 150));
    }

    #[test]
    fn bad_card_is_refused_with_key_and_remedy() {
        let refusal = |text: &str| read(text).unwrap_err();
        assert!(refusal(&TOML.replace("2026-0142", " ")).contains("case_number is empty"));
        assert!(
            refusal(&format!("{TOML}colour = 3\n")).contains("line 5"),
            "{}",
            refusal(&format!("{TOML}colour = 3\n"))
        );
        assert!(refusal("date = 1").contains("expected case_number"));
        assert!(refusal(&TOML.replace("Office", &"x".repeat(121))).contains("Place: expected one line"));
        assert!(CaseCard::read(Path::new("/none/case.toml")).unwrap_err().contains("cannot be read"));
    }
}
