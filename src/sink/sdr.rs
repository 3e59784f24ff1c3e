//! Tone mapping of footage in a high dynamic range, or on a logarithmic curve, to standard dynamic
//! range (Rec. 709 primaries, sRGB curve).
//!
//! Light is decoded by the footage's response, with diffuse white at 1, and converted to Rec. 709.
//! Negative components, colours outside of Rec. 709, clip at 0. With m the largest component, all
//! three are multiplied by t(m) / m, which keeps the hue:
//!
//! t(m) = m for m ≤ k, k + (1 − k)·(1 − exp(−(m − k) / (1 − k))) above, with k = 0.75.
//!
//! t and its slope are continuous, diffuse white becomes 0.91, and no light clips.
//!
//! Not modelled: adaptation of the contrast to a display (the OOTF of ITU-R BT.2100), local
//! operators.

use glam::{DMat3, DVec3};

use super::{Sink, SinkError};
use crate::camera::{Curve, Primaries, Response};
use crate::pixels::{Codes, Pixels};

/// Light up to which the conversion is the identity, relative to diffuse white.
const KNEE: f64 = 0.75;

/// t(m).
fn compressed(light: f64) -> f64 {
    if light <= KNEE { light } else { KNEE + (1.0 - KNEE) * (1.0 - (-(light - KNEE) / (1.0 - KNEE)).exp()) }
}

/// Converts frames on their way into a sink.
pub struct SdrSink {
    tone_mapping: ToneMapping,
    inner: Box<dyn Sink + Send>,
}

impl SdrSink {
    /// `response` is that of the frames, `max_code` their largest code value.
    pub fn new(response: &Response, max_code: u32, inner: Box<dyn Sink + Send>) -> Self {
        Self { tone_mapping: ToneMapping::new(response, max_code), inner }
    }
}

impl Sink for SdrSink {
    fn write(&mut self, frame_index: usize, pixels: &Pixels) -> Result<(), SinkError> {
        self.inner.write(frame_index, &self.tone_mapping.apply(pixels))
    }

    fn finish(self: Box<Self>) -> Result<(), SinkError> {
        self.inner.finish()
    }
}

/// Whether codes of this response are not for a display of Rec. 709 or sRGB, as files without tags
/// are shown. A measured table of a camera without highlights is.
pub fn needs_tone_mapping(response: &Response) -> bool {
    let is_for_display = match response.curve {
        Curve::Srgb | Curve::Gamma => true,
        Curve::Table => response.max_light() <= 1.0 + 1e-9,
        _ => false,
    };
    !(is_for_display && response.primaries == Primaries::Rec709)
}

/// Tone mapping of frames with one response.
#[derive(Debug)]
pub struct ToneMapping {
    /// Light of each code.
    light: Vec<f64>,
    to_rec709: DMat3,
    srgb: Response,
    /// True if the response has light above diffuse white.
    has_highlights: bool,
}

impl ToneMapping {
    pub fn new(response: &Response, max_code: u32) -> Self {
        let to_rec709 = response.primaries.from_rec709().map_or(DMat3::IDENTITY, |matrix| matrix.inverse());
        let has_highlights = response.max_light() > 1.0 + 1e-9;
        Self { light: response.table(max_code), to_rec709, srgb: Response::default(), has_highlights }
    }

    /// Linear light in Rec. 709, 0 to 1.
    fn mapped(&self, light: DVec3) -> DVec3 {
        let light = (self.to_rec709 * light).max(DVec3::ZERO);
        let largest = light.max_element();
        if self.has_highlights && largest > KNEE { light * (compressed(largest) / largest) } else { light }
    }

    pub fn apply(&self, pixels: &Pixels) -> Pixels {
        let scale = (self.light.len() - 1) as f64;
        let convert = |codes: [u32; 3]| {
            let light = DVec3::from_array(codes.map(|code| self.light[code as usize]));
            self.mapped(light).to_array().map(|light| (self.srgb.encode(light) * scale).round())
        };
        let converted = pixels.each(convert);
        let codes = match &pixels.codes {
            Codes::U8(_) => Codes::U8(converted.into_flattened().into_iter().map(|code| code as u8).collect()),
            Codes::U16(_) => Codes::U16(converted.into_flattened().into_iter().map(|code| code as u16).collect()),
        };
        Pixels::uncoded(pixels.width, pixels.height, codes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_for_a_display_are_kept() {
        let response = |curve, primaries| Response { curve, primaries, ..Response::default() };
        assert!(!needs_tone_mapping(&Response::default()));
        assert!(!needs_tone_mapping(&response(Curve::Gamma, Primaries::Rec709)));
        for (curve, primaries) in
            [(Curve::Hlg, Primaries::Rec2020), (Curve::Srgb, Primaries::P3), (Curve::Linear, Primaries::Rec709)]
        {
            assert!(needs_tone_mapping(&response(curve, primaries)), "{curve:?} {primaries:?}");
        }
    }

    #[test]
    fn light_below_the_knee_is_kept_and_no_light_clips() {
        for (light, expected) in [(0.18, 0.18), (0.75, 0.75), (1.0, 0.908), (12.0, 1.0)] {
            assert!((compressed(light) - expected).abs() < 1e-3, "{light}");
        }
        let slope = (compressed(0.7501) - compressed(0.75)) / 1e-4;
        assert!((slope - 1.0).abs() < 1e-3 && compressed(3.0) < compressed(3.1) && compressed(3.7) < 1.0);
    }

    #[test]
    fn grey_and_a_colour_of_rec_709_come_back_from_hlg() {
        let response = Response { curve: Curve::Hlg, primaries: Primaries::Rec2020, ..Response::default() };
        let matrix = Primaries::Rec2020.from_rec709().unwrap();
        let lights = [DVec3::splat(0.18), DVec3::new(0.5, 0.1, 0.05), DVec3::splat(3.0)];
        let codes = lights.iter().flat_map(|light| (matrix * *light).to_array());
        let codes = codes.map(|light| (65535.0 * response.encode(light)).round() as u16).collect();
        let sdr = ToneMapping::new(&response, 65535).apply(&Pixels::from_u16(3, 1, codes).unwrap());
        for (x, light) in [(0, lights[0]), (1, lights[1])] {
            let shown = sdr.at(x, 0).map(|code| Response::default().decode(f64::from(code) / 65535.0));
            assert!(DVec3::from_array(shown).abs_diff_eq(light, 2e-4), "{shown:?} {light}");
        }
        let [r, g, b] = sdr.at(2, 0);
        assert!(r > 65_000 && r.abs_diff(g) < 10 && r.abs_diff(b) < 10, "{r} {g} {b}");
    }
}
