//! Coded samples to R'G'B' codes in the decoders' integer arithmetic: BT.601, full range (ITU-T
//! T.871, section 7).
//!
//! R' = Y' + 1.402 Cr, G' = Y' − 0.344136 Cb − 0.714136 Cr, B' = Y' + 1.772 Cb.

/// Fixed point of a conversion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct IntegerConversion {
    /// Fraction of the constants, bits.
    bits: u32,
    /// Added before the fraction is cut off.
    half: i32,
    red_cr: i32,
    green_cb: i32,
    green_cr: i32,
    blue_cb: i32,
}

impl IntegerConversion {
    /// 14 bits: the `image` crate's JPEG decoder. No sum of its constants is an exact half.
    pub const ZUNE: Self =
        Self { bits: 14, half: 1 << 13, red_cr: 22970, green_cb: -5638, green_cr: -11700, blue_cb: 29032 };
    /// 16 bits: libjpeg and libjpeg-turbo.
    pub const LIBJPEG: Self =
        Self { bits: 16, half: 1 << 15, red_cr: 91881, green_cb: -22554, green_cr: -46802, blue_cb: 116_130 };

    pub fn rgb(&self, [y, cb, cr]: [u8; 3]) -> [u8; 3] {
        let [y, cb, cr] = [i32::from(y), i32::from(cb) - 128, i32::from(cr) - 128];
        // Whole codes of luma have no fraction: it makes no difference whether they are added
        // before or after the shift.
        let code = |chroma: i32| (y + ((chroma + self.half) >> self.bits)).clamp(0, 255) as u8;
        [code(cr * self.red_cr), code(cb * self.green_cb + cr * self.green_cr), code(cb * self.blue_cb)]
    }
}
