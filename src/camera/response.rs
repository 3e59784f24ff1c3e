//! The camera's response: code value ↔ linear light. Code values are fractions of full scale.
//!
//! Light is relative to diffuse white, 1. A camera that clips at white has light from 0 to 1; the
//! codes of high dynamic range reach [`Response::max_light`], and those of logarithmic curves go
//! slightly below 0. Sources:
//!
//! - HLG: ITU-R BT.2100-2, table 5, the inverse OETF, over its value at 75 % (the reference white
//!   of ITU-R BT.2408-7, table 1). Its system gamma is left to the display.
//! - PQ: SMPTE ST 2084, the EOTF, over 203 cd/m² (the same table).
//! - S-Log3: Sony, *Technical Summary for S-Gamut3.Cine/S-Log3 and S-Gamut3/S-Log3*.
//! - LogC3 (EI 800) and LogC4: ARRI, *LogC curve – usage in VFX* and *ARRI LogC4 specification*.
//! - Apple Log: Apple, *Apple Log profile white paper*.
//! - D-Log: DJI, *White paper on D-Log and D-Gamut*.
//! - V-Log: Panasonic, *V-Log/V-Gamut reference manual*.
//!
//! Not modelled: other exposure indices of LogC3, OOTFs of displays.

use std::f64::consts::LN_2;

use super::primaries::Primaries;
use super::response_table::ResponseTable;

crate::choices! {
    /// The curve between linear light and code values.
    pub enum Curve {
        /// IEC 61966-2-1.
        Srgb = "srgb",
        /// Code values are proportional to light.
        Linear = "linear",
        /// A power law with `gamma`.
        Gamma = "gamma",
        /// Hybrid log-gamma.
        Hlg = "hlg",
        /// Perceptual quantizer.
        Pq = "pq",
        SLog3 = "s-log3",
        /// ARRI LogC3 at EI 800.
        LogC3 = "logc3",
        LogC4 = "logc4",
        AppleLog = "apple-log",
        DLog = "d-log",
        VLog = "v-log",
        /// Points of `table`, linear between them.
        Table = "table",
    }
}

crate::choices! {
    /// The meaning of code values on curves that are defined by 10-bit codes.
    pub enum Levels {
        /// The code of a curve's definition is 1023 · code.
        Full = "full",
        /// Video of limited range: 64 + 876 · code.
        Video = "video",
    }
}

crate::params! {
    /// Conversion of linear light to code values.
    pub struct Response in "camera.response" at Depth {
        "the curve" curve: Curve = Curve::Srgb;
        "exponent of the curve gamma: code = light^(1/gamma)" gamma: f64 = 2.2, "1", 0.2..=5.0, by_ratio => curve is "gamma";
        "codes that full scale stands for: full (0 to 1023), or video (64 to 940)" levels: Levels = Levels::Full => curve is "s-log3 or v-log or d-log";
        "primaries of the code values" primaries: Primaries = Primaries::Rec709;
        "points of the curve table: pairs of code and light, separated by commas" table: ResponseTable = ResponseTable::default() => curve is "table";
    }
}

/// Number of samples of [`Response::samples`]: between them, S-Log3 deviates from a line by less
/// than 10⁻⁶ of its light.
const SAMPLES: usize = 4096;
/// Diffuse white in HLG, as scene light relative to the peak: the inverse OETF at 75 %.
const HLG_WHITE: f64 = 0.264_962_559_786_400_15;
/// Diffuse white in PQ, cd/m².
const PQ_WHITE: f64 = 203.0;

impl Response {
    /// Light of a code value (0 to 1).
    pub fn decode(&self, code: f64) -> f64 {
        // The code of a definition by 10-bit codes, as a fraction of 1023.
        let ten_bit = match self.levels {
            Levels::Full => code,
            Levels::Video => (64.0 + 876.0 * code) / 1023.0,
        };
        match self.curve {
            Curve::Srgb if code <= 0.04045 => code / 12.92,
            Curve::Srgb => ((code + 0.055) / 1.055).powf(2.4),
            Curve::Linear => code,
            Curve::Gamma => code.max(0.0).powf(self.gamma),
            Curve::Hlg => hlg_light(code) / HLG_WHITE,
            Curve::Pq => pq_luminance(code) / PQ_WHITE,
            Curve::SLog3 if ten_bit >= 171.210_294_692_9 / 1023.0 => {
                10f64.powf((1023.0 * ten_bit - 420.0) / 261.5) * (0.18 + 0.01) - 0.01
            }
            Curve::SLog3 => (1023.0 * ten_bit - 95.0) * 0.011_25 / (171.210_294_692_9 - 95.0),
            Curve::LogC3 if code > 5.367_655 * 0.010_591 + 0.092_809 => {
                (10f64.powf((code - 0.385_537) / 0.247_190) - 0.052_272) / 5.555_556
            }
            Curve::LogC3 => (code - 0.092_809) / 5.367_655,
            Curve::LogC4 => logc4_light(code),
            Curve::AppleLog => apple_log_light(code),
            Curve::DLog if ten_bit > 0.14 => (10f64.powf(3.896_16 * ten_bit - 2.277_52) - 0.0108) / 0.9892,
            Curve::DLog => (ten_bit - 0.0929) / 6.025,
            Curve::VLog if ten_bit >= 0.181 => 10f64.powf((ten_bit - 0.598_206) / 0.241_514) - 0.008_73,
            Curve::VLog => (ten_bit - 0.125) / 5.6,
            Curve::Table => self.table.light(code),
        }
    }

    /// Light of the largest code value.
    pub fn max_light(&self) -> f64 {
        self.decode(1.0)
    }

    /// The light of each code from 0 to `max_code`.
    pub fn table(&self, max_code: u32) -> Vec<f64> {
        (0..=max_code).map(|code| self.decode(f64::from(code) / f64::from(max_code))).collect()
    }

    /// Light at equidistant codes from 0 to 1, for shaders. `None` for curves that shaders compute.
    pub fn samples(&self) -> Option<Vec<f32>> {
        let is_computed = matches!(self.curve, Curve::Srgb | Curve::Linear | Curve::Gamma);
        (!is_computed).then(|| self.table(SAMPLES as u32 - 1).into_iter().map(|light| light as f32).collect())
    }

    /// Code value (0 to 1) of light. Light beyond the range of the codes clips.
    pub fn encode(&self, light: f64) -> f64 {
        let light = light.clamp(self.decode(0.0), self.max_light());
        match self.curve {
            Curve::Srgb if light <= 0.003_130_8 => light * 12.92,
            Curve::Srgb => 1.055 * light.powf(1.0 / 2.4) - 0.055,
            Curve::Linear => light,
            Curve::Gamma => light.powf(1.0 / self.gamma),
            _ => self.bisected_code(light),
        }
    }

    /// [`Response::encode`] for many values: the curves without a formula of their inverse are
    /// inverted by their samples, exact to a tenth of a 10-bit code.
    pub fn encoder(&self) -> impl Fn(f64) -> f64 + Sync + use<'_> {
        let samples = self.samples();
        move |light| {
            let Some(samples) = &samples else { return self.encode(light) };
            let after = samples.partition_point(|sample| f64::from(*sample) <= light).clamp(1, samples.len() - 1);
            let (from, to) = (f64::from(samples[after - 1]), f64::from(samples[after]));
            let share = (light - from) / (to - from).max(f64::MIN_POSITIVE);
            ((after - 1) as f64 + share.clamp(0.0, 1.0)) / (samples.len() - 1) as f64
        }
    }

    /// The code of a light by bisection. Every curve ascends.
    fn bisected_code(&self, light: f64) -> f64 {
        let (mut low, mut high) = (0.0, 1.0);
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            if self.decode(middle) <= light { low = middle } else { high = middle }
        }
        0.5 * (low + high)
    }

    /// Slope d code / d light at a code value (0 to 1).
    pub fn slope_at_code(&self, code: f64) -> f64 {
        match self.curve {
            Curve::Srgb if code <= 0.04045 => 12.92,
            // light = ((c + 0.055)/1.055)^2.4, so d code/d light = 1.055/2.4 · ((c +
            // 0.055)/1.055)^-1.4.
            Curve::Srgb => 1.055 / 2.4 * ((code + 0.055) / 1.055).powf(-1.4),
            Curve::Linear => 1.0,
            // light = c^γ, so d code/d light = c^(1-γ)/γ; kept finite at black.
            Curve::Gamma => code.max(1.0 / 255.0).powf(1.0 - self.gamma) / self.gamma,
            // Over the interval of the samples around it; PQ is flat at black.
            _ => {
                let step = 0.5 / (SAMPLES - 1) as f64;
                let (low, high) = ((code - step).max(0.0), (code + step).min(1.0));
                (high - low) / (self.decode(high) - self.decode(low)).max(1e-9)
            }
        }
    }
}

/// Scene light relative to the peak.
fn hlg_light(code: f64) -> f64 {
    const A: f64 = 0.178_832_77;
    const B: f64 = 1.0 - 4.0 * A;
    const C: f64 = 0.559_910_73;
    if code <= 0.5 { code * code.abs() / 3.0 } else { (((code - C) / A).exp() + B) / 12.0 }
}

/// Luminance of a display, cd/m².
fn pq_luminance(code: f64) -> f64 {
    const M1: f64 = 2610.0 / 16384.0;
    const M2: f64 = 2523.0 / 32.0;
    const C1: f64 = 3424.0 / 4096.0;
    const C2: f64 = 2413.0 / 128.0;
    const C3: f64 = 2392.0 / 128.0;
    let power = code.max(0.0).powf(1.0 / M2);
    10_000.0 * ((power - C1).max(0.0) / (C2 - C3 * power)).powf(1.0 / M1)
}

fn logc4_light(code: f64) -> f64 {
    const A: f64 = (262_144.0 - 16.0) / 117.45;
    const B: f64 = (1023.0 - 95.0) / 1023.0;
    const C: f64 = 95.0 / 1023.0;
    if code >= 0.0 {
        return (2f64.powf(14.0 * (code - C) / B + 6.0) - 64.0) / A;
    }
    let s = 7.0 * LN_2 * 2f64.powf(7.0 - 14.0 * C / B) / (A * B);
    code * s + (2f64.powf(14.0 * (-C / B) + 6.0) - 64.0) / A
}

fn apple_log_light(code: f64) -> f64 {
    const R0: f64 = -0.056_410_88;
    const RT: f64 = 0.01;
    const C: f64 = 47.287_112_36;
    const PT: f64 = C * (RT - R0) * (RT - R0);
    if code >= PT {
        2f64.powf((code - 0.693_369_45) / 0.085_504_79) - 0.009_640_52
    } else {
        (code.max(0.0) / C).sqrt() + R0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LOG_AND_HDR: [Curve; 8] =
        [Curve::Hlg, Curve::Pq, Curve::SLog3, Curve::LogC3, Curve::LogC4, Curve::AppleLog, Curve::DLog, Curve::VLog];

    fn of(curve: Curve) -> Response {
        Response { curve, ..Response::default() }
    }

    #[test]
    fn response_matches_known_values_and_round_trips() {
        let srgb = Response::default();
        // 18 % grey is code 0.4614 (117.6 of 255).
        assert!((srgb.encode(0.18) - 0.461_356).abs() < 1e-5);
        for curve in [Curve::Srgb, Curve::Linear, Curve::Gamma] {
            let r = Response { curve, gamma: 2.2, ..Response::default() };
            for i in 0..=255 {
                let code = f64::from(i) / 255.0;
                assert!((r.encode(r.decode(code)) - code).abs() < 1e-6);
                if (2..254).contains(&i) {
                    let h = 1e-6;
                    let numeric = 2.0 * h / (r.decode(code + h) - r.decode(code - h));
                    assert!((r.slope_at_code(code) / numeric - 1.0).abs() < 1e-3, "{curve:?} {i}");
                }
            }
        }
    }

    /// Light at nine codes from 0.12 to 0.9, by the library colour-science 0.4.
    #[test]
    fn curves_agree_with_another_implementation() {
        for (curve, expected) in [
            (
                Curve::SLog3,
                [0.004097872, 0.02338144, 0.07033957, 0.1833544, 0.4553486, 1.109961, 2.685426, 6.477119, 15.60264],
            ),
            (
                Curve::LogC3,
                [0.005065713, 0.02821666, 0.08389865, 0.2219842, 0.564422, 1.413632, 3.519584, 8.742126, 21.69349],
            ),
            (
                Curve::LogC4,
                [0.009658351, 0.08010656, 0.2800194, 0.8473174, 2.457155, 7.025434, 19.98896, 56.77593, 161.1673],
            ),
            (
                Curve::AppleLog,
                [-0.006035397, 0.01147704, 0.03690784, 0.09296365, 0.2165246, 0.4888836, 1.089231, 2.412545, 5.329458],
            ),
            (
                Curve::DLog,
                [0.004497925, 0.02663215, 0.07913262, 0.2050364, 0.506972, 1.231058, 2.967521, 7.131813, 17.11839],
            ),
            (
                Curve::VLog,
                [-0.0008928571, 0.01779583, 0.05847047, 0.1615155, 0.4225695, 1.083923, 2.759394, 7.004028, 17.75737],
            ),
            (
                Curve::Hlg,
                [0.01811577, 0.05951313, 0.124829, 0.2140633, 0.3274486, 0.4999285, 0.7974489, 1.310659, 2.195924],
            ),
            (
                Curve::Pq,
                [0.002612356, 0.01576073, 0.05965423, 0.1831513, 0.5021271, 1.290521, 3.202878, 7.838578, 19.23963],
            ),
        ] {
            for (at, expected) in expected.into_iter().enumerate() {
                let code = 0.12 + 0.0975 * at as f64;
                let light = of(curve).decode(code);
                assert!(
                    (light - expected).abs() < 1e-4 * expected.abs() + 1e-6,
                    "{curve:?} {code}: {light}, {expected}"
                );
            }
        }
    }

    /// 10-bit codes of grey and white as the makers publish them.
    #[test]
    fn log_curves_have_the_published_codes_of_grey_and_white() {
        for (curve, light, code) in [
            (Curve::SLog3, 0.0, 95.0),
            (Curve::SLog3, 0.18, 420.0),
            (Curve::SLog3, 0.9, 598.0),
            (Curve::LogC3, 0.18, 400.0),
            (Curve::LogC4, 0.0, 95.0),
            (Curve::LogC4, 0.18, 284.6),
            (Curve::VLog, 0.0, 128.0),
            (Curve::VLog, 0.18, 433.0),
            (Curve::VLog, 0.9, 602.0),
            (Curve::DLog, 0.18, 408.0),
            (Curve::AppleLog, 0.18, 500.0),
        ] {
            let encoded = 1023.0 * of(curve).encode(light);
            assert!((encoded - code).abs() < 1.0, "{curve:?}: {light} is at {encoded}");
        }
    }

    #[test]
    fn hdr_curves_have_diffuse_white_at_the_level_of_bt_2408() {
        assert!((of(Curve::Hlg).decode(0.75) - 1.0).abs() < 1e-9);
        // 12 times the light of code 0.5, 1/12 of the peak: BT.2100, table 5.
        assert!((of(Curve::Hlg).max_light() * HLG_WHITE - 1.0).abs() < 1e-6);
        assert!((of(Curve::Hlg).decode(0.5) * HLG_WHITE - 1.0 / 12.0).abs() < 1e-9);
        // 58 % is 203 cd/m².
        assert!((of(Curve::Pq).encode(1.0) - 0.5807).abs() < 1e-4);
        assert!((of(Curve::Pq).max_light() * PQ_WHITE - 10_000.0).abs() < 1e-6);
        // 100 cd/m² is code 0.508 078.
        assert!((of(Curve::Pq).encode(100.0 / PQ_WHITE) - 0.508_078).abs() < 1e-6);
    }

    #[test]
    fn log_and_hdr_curves_ascend_and_round_trip() {
        for curve in LOG_AND_HDR {
            for levels in [Levels::Full, Levels::Video] {
                let r = Response { levels, ..of(curve) };
                for i in 0..1000 {
                    let (code, next) = (f64::from(i) / 1000.0, f64::from(i + 1) / 1000.0);
                    assert!(r.decode(code) < r.decode(next) || curve == Curve::Pq && i < 2, "{curve:?} {i}");
                    assert!((r.encode(r.decode(code)) - code).abs() < 1e-6 || curve == Curve::Pq, "{curve:?} {i}");
                    let numeric = (next - code) / (r.decode(next) - r.decode(code));
                    let slope = r.slope_at_code(0.5 * (code + next));
                    assert!((slope / numeric - 1.0).abs() < 0.03 || i < 200, "{curve:?} {i}: {slope}, {numeric}");
                }
            }
        }
    }

    #[test]
    fn video_levels_map_the_range_of_video_onto_10_bit_codes() {
        let full = of(Curve::SLog3);
        let video = Response { levels: Levels::Video, ..full.clone() };
        // Grey, code 420, is 40.6 % of the video range.
        assert!((video.decode((420.0 - 64.0) / 876.0) - 0.18).abs() < 1e-9);
        assert!((full.decode(420.0 / 1023.0) - 0.18).abs() < 1e-9);
    }

    #[test]
    fn samples_deviate_from_the_curve_by_less_than_quantisation() {
        for curve in LOG_AND_HDR {
            let r = of(curve);
            let samples = r.samples().unwrap();
            for i in (0..SAMPLES - 1).step_by(7) {
                let middle = 0.5 * (f64::from(samples[i]) + f64::from(samples[i + 1]));
                let code = (i as f64 + 0.5) / (SAMPLES - 1) as f64;
                let off = (r.encode(middle) - code).abs();
                // A tenth of a code of 10 bits.
                assert!(off < 0.1 / 1023.0 || curve == Curve::Pq && i < 40, "{curve:?} {i}: {off}");
            }
        }
        assert_eq!(of(Curve::Srgb).samples(), None);
        for curve in LOG_AND_HDR {
            let r = of(curve);
            let encode = r.encoder();
            for light in [-9.0, 0.0, 0.01, 0.18, 1.0, 3.0, 1e6] {
                assert!((encode(light) - r.encode(light)).abs() < 0.1 / 1023.0, "{curve:?} {light}");
            }
        }
    }
}
