//! Elementary functions on short rows of numbers, without branches and calls: loops over them are
//! compiled to vector instructions.

/// Pixels that are computed together.
pub const LANES: usize = 8;
/// One number for each of them.
pub type Lanes = [f32; LANES];

/// Adding and subtracting it rounds numbers up to 2²² to whole ones, halves to even.
pub const ROUNDING: f32 = 12_582_912.0;

/// 2^x for |x| < 126, within 4·10⁻⁶ of itself: the Taylor series to the fifth power about the
/// nearest whole number.
#[inline(always)]
pub fn exp2(x: f32) -> f32 {
    let shifted = x + ROUNDING;
    let f = x - (shifted - ROUNDING);
    let series = 1.0
        + f * (std::f32::consts::LN_2
            + f * (0.240_226_5 + f * (0.055_504_11 + f * (0.009_618_129 + f * 0.001_333_355_8))));
    // The low bits of the shifted number are the whole one.
    let power = (shifted.to_bits() << 23).wrapping_add(127 << 23);
    series * f32::from_bits(power)
}

/// ln x of a normal number above 0, within 2·10⁻⁷ or two units in the last place:
/// ln m = 2 (s + s³/3 + s⁵/5 + s⁷/7), s = (m − 1)/(m + 1), for the mantissa m from √½ to √2.
#[inline(always)]
pub fn ln(x: f32) -> f32 {
    /// Bits of √½.
    const LOWEST_MANTISSA: u32 = 0x3f35_04f3;
    let bits = x.to_bits();
    let exponent = (bits.wrapping_sub(LOWEST_MANTISSA) as i32) >> 23;
    let m = f32::from_bits(bits.wrapping_sub((exponent as u32) << 23));
    let s = (m - 1.0) / (m + 1.0);
    let t = s * s;
    let series = 2.0 * s * (1.0 + t * (1.0 / 3.0 + t * (0.2 + t * (1.0 / 7.0))));
    exponent as f32 * std::f32::consts::LN_2 + series
}

/// The nearest whole number from 0 to 255; halves up.
#[inline(always)]
pub fn rounded_code(value: f32) -> f32 {
    floor(value.clamp(0.0, 255.0) + 0.5).min(255.0)
}

/// The largest whole number up to `value`, for numbers from 0 to 2²².
#[inline(always)]
pub fn floor(value: f32) -> f32 {
    let whole = (value + ROUNDING) - ROUNDING;
    if whole > value { whole - 1.0 } else { whole }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn powers_and_logarithms_are_near_the_exact_ones() {
        for i in -8_700..=8_700 {
            let x = i as f32 * 1e-3;
            assert!((exp2(x) / f64::from(x).exp2() as f32 - 1.0).abs() < 4e-6, "2^{x}: {}", exp2(x));
            let y = f64::from(exp2(x));
            let expected = y.ln();
            assert!((f64::from(ln(y as f32)) - expected).abs() < 3e-7 * expected.abs().max(1.0), "ln {y}");
        }
    }

    #[test]
    fn codes_are_rounded_half_up_and_clipped() {
        for (value, code) in
            [(-3.0, 0.0), (0.49, 0.0), (0.5, 1.0), (1.5, 2.0), (2.5, 3.0), (254.5, 255.0), (300.0, 255.0)]
        {
            assert_eq!(rounded_code(value), code, "{value}");
        }
        for i in 0..2550 {
            let value = i as f32 * 0.1;
            assert_eq!(rounded_code(value), (value + 0.5).floor(), "{value}");
        }
    }
}
