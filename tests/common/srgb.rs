//! The sRGB curve (IEC 61966-2-1), independent of the code under test.

#![allow(dead_code, reason = "each test file uses some of it")]

/// Linear light of an encoded value, both from 0 to 1.
pub fn decode(code: f64) -> f64 {
    if code <= 0.04045 { code / 12.92 } else { ((code + 0.055) / 1.055).powf(2.4) }
}

pub fn encode(light: f64) -> f64 {
    if light <= 0.003_130_8 { 12.92 * light } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 }
}
