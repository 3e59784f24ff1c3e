//! Converts the cameras' Y'CbCr to 8-bit R'G'B' codes.
//!
//! R' = Y' + 2 (1 − Kr) Cr, B' = Y' + 2 (1 − Kb) Cb, G' = (Y' − Kr R' − Kb B') / (1 − Kr − Kb).
//! Sources: ITU-R BT.601-7 §2.5.1 to §2.5.4, BT.709-6 §3 and §4, BT.2020-2 table 4; full range as
//! in JFIF 1.02 (ITU-T T.871 §7). Two (4:2:2) or four (4:2:0) pixels share a chroma sample, without
//! interpolation.

use super::{ColorMatrix, ColorRange};

/// Fixed point: 2^50 units a code. Sums of three terms stay below 2^61.
const ONE: i128 = 1 << 50;
/// Half a code, for rounding. Exact halves go up: the terms are rounded to 2^-51, and no sum comes
/// closer to a half than 10^-13 (the terms' common denominator is below 4 · 10^12), so the 2^-46
/// more decide nothing else.
const HALF: i64 = (1 << 49) + (1 << 4);

/// The conversion's terms for each code.
pub struct Table {
    y: [i64; 256],
    red_cr: [i64; 256],
    green_cb: [i64; 256],
    green_cr: [i64; 256],
    blue_cb: [i64; 256],
}

impl Table {
    /// R'G'B' is not Y'CbCr: its matrix counts as BT.601.
    pub fn new(matrix: ColorMatrix, range: ColorRange) -> Self {
        // The coefficients are in units of 10^-4.
        let [kr, kb] = matrix.luma_coefficients().map(i128::from);
        let kg = 10_000 - kr - kb;
        let (black, y_span, c_span) = match range {
            ColorRange::Limited => (16, 219, 224),
            ColorRange::Full => (0, 255, 255),
        };
        let term = |from: i128, num: i128, den: i128| {
            let converted = |code: usize| {
                let (num, den) = (2 * ONE * (code as i128 - from) * num, 2 * den);
                // To the nearest.
                (num + den / 2).div_euclid(den) as i64
            };
            std::array::from_fn(converted)
        };
        let chroma = |num: i128, den: i128| term(128, 255 * num, c_span * den);
        Self {
            y: term(black, 255, y_span),
            red_cr: chroma(2 * (10_000 - kr), 10_000),
            green_cb: chroma(-2 * (10_000 - kb) * kb, 10_000 * kg),
            green_cr: chroma(-2 * (10_000 - kr) * kr, 10_000 * kg),
            blue_cb: chroma(2 * (10_000 - kb), 10_000),
        }
    }

    /// R'G'B' to the nearest code, exact halves up, cut off at 0 and 255.
    pub fn rgb(&self, [y, cb, cr]: [u8; 3]) -> [u8; 3] {
        let [y, cb, cr] = [y, cb, cr].map(usize::from);
        let code = |sum: i64| ((sum + HALF) >> 50).clamp(0, 255) as u8;
        let light = self.y[y];
        [
            code(light + self.red_cr[cr]),
            code(light + self.green_cb[cb] + self.green_cr[cr]),
            code(light + self.blue_cb[cb]),
        ]
    }

    /// Packed 4:2:2, Y0 Cb Y1 Cr, rows `stride` bytes apart. `None` if there are not enough bytes,
    /// or the width is odd.
    pub fn yuyv(&self, bytes: &[u8], width: u32, height: u32, stride: usize) -> Option<Vec<u8>> {
        let (width, height) = (width as usize, height as usize);
        if width % 2 != 0 || stride < 2 * width {
            return None;
        }
        let mut codes = Vec::with_capacity(3 * width * height);
        for row in 0..height {
            let row = bytes.get(row * stride..row * stride + 2 * width)?;
            for pair in row.chunks_exact(4) {
                codes.extend(self.rgb([pair[0], pair[1], pair[3]]));
                codes.extend(self.rgb([pair[2], pair[1], pair[3]]));
            }
        }
        Some(codes)
    }

    /// 4:2:0 in two planes: Y', then Cb Cr by turns, rows of both `stride` bytes apart. `None` if
    /// there are not enough bytes, or a side is odd.
    pub fn nv12(&self, bytes: &[u8], width: u32, height: u32, stride: usize) -> Option<Vec<u8>> {
        let (width, height) = (width as usize, height as usize);
        if width % 2 != 0 || height % 2 != 0 || stride < width {
            return None;
        }
        let (luma, chroma) = bytes.split_at_checked(stride * height)?;
        let mut codes = Vec::with_capacity(3 * width * height);
        for row in 0..height {
            let y = luma.get(row * stride..row * stride + width)?;
            let c = chroma.get(row / 2 * stride..row / 2 * stride + width)?;
            for (y, c) in y.chunks_exact(2).zip(c.chunks_exact(2)) {
                codes.extend(self.rgb([y[0], c[0], c[1]]));
                codes.extend(self.rgb([y[1], c[0], c[1]]));
            }
        }
        Some(codes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const MATRICES: [ColorMatrix; 3] = [ColorMatrix::Bt601, ColorMatrix::Bt709, ColorMatrix::Bt2020];

    #[test]
    fn codes_match_computed_values() {
        use {ColorMatrix::*, ColorRange::*};
        let rgb = |matrix, range, yuv| Table::new(matrix, range).rgb(yuv);
        for matrix in MATRICES {
            // Black, white, and codes beyond them.
            assert_eq!(rgb(matrix, Limited, [16, 128, 128]), [0; 3]);
            assert_eq!(rgb(matrix, Limited, [235, 128, 128]), [255; 3]);
            assert_eq!(rgb(matrix, Limited, [255, 128, 128]), [255; 3]);
            assert_eq!(rgb(matrix, Full, [77, 128, 128]), [77; 3]);
            // 126 of 219: 128.08.
            assert_eq!(rgb(matrix, Limited, [126, 128, 128]), [128; 3]);
        }
        // Red of the 100 % bars, BT.601: 76.544 + 1.5960·112 = 254.4, 76.05 − 0.3918·(−38) −
        // 0.8130·112 = −0.1.
        assert_eq!(rgb(Bt601, Limited, [81, 90, 240]), [254, 0, 0]);
        // The same in BT.709: Y' 63, Cb 102, Cr 240 (63 − 16)·255/219 = 54.73; + 1.7927·112 =
        // 255.5; G' 54.73 + 0.2132·26 − 0.5329·112 = 0.58; B' 54.73 − 2.1124·26 = −0.2.
        assert_eq!(rgb(Bt709, Limited, [63, 102, 240]), [255, 1, 0]);
        // JFIF: 150 + 1.402·50 = 220.1; 150 − 0.344136·(−28) − 0.714136·50 = 123.93; 150 − 1.772·28
        // = 100.38.
        assert_eq!(rgb(Bt601, Full, [150, 100, 178]), [220, 124, 100]);
        // BT.2020, full: 100 + 1.4746·40 = 158.98; 100 − 0.16455·20 − 0.57135·40 = 73.85; 100 +
        // 1.8814·20 = 137.63.
        assert_eq!(rgb(Bt2020, Full, [100, 148, 168]), [159, 74, 138]);
    }

    /// The formulas at the file's head in whole numbers, without a table.
    fn exact(matrix: ColorMatrix, range: ColorRange, [y, cb, cr]: [u8; 3]) -> [u8; 3] {
        let (kr, kb) = match matrix {
            ColorMatrix::Bt709 => (2126, 722),
            ColorMatrix::Bt2020 => (2627, 593),
            _ => (2990i128, 1140i128),
        };
        let kg = 10_000 - kr - kb;
        let (black, ys, cs) = if range == ColorRange::Limited { (16, 219, 224) } else { (0, 255, 255) };
        // All times ys · cs · 10^4 · kg.
        let whole = ys * cs * 10_000 * kg;
        let light = 255 * (i128::from(y) - black) * cs * 10_000 * kg;
        let (cb, cr) = (255 * (i128::from(cb) - 128) * ys, 255 * (i128::from(cr) - 128) * ys);
        let red = light + cr * 2 * (10_000 - kr) * kg;
        let blue = light + cb * 2 * (10_000 - kb) * kg;
        // Kg G' = Y' − Kr R' − Kb B', in units of 10^-4.
        let green = (light * 10_000 - kr * red - kb * blue) / kg;
        let code = |sum: i128| (2 * sum + whole).div_euclid(2 * whole).clamp(0, 255) as u8;
        [red, green, blue].map(code)
    }

    #[test]
    fn every_code_is_the_nearest() {
        for matrix in MATRICES {
            for range in [ColorRange::Limited, ColorRange::Full] {
                let table = Table::new(matrix, range);
                // Every second code and step of three others, in turn: a twelfth of all.
                for at in (0..1u32 << 24).step_by(13) {
                    let [_, y, cb, cr] = at.to_be_bytes();
                    assert_eq!(table.rgb([y, cb, cr]), exact(matrix, range, [y, cb, cr]), "{matrix:?} {y} {cb} {cr}");
                }
            }
        }
    }

    #[test]
    fn pixels_share_their_chroma_and_rows_may_be_padded() {
        let table = Table::new(ColorMatrix::Bt601, ColorRange::Full);
        let grey = |codes: Vec<u8>| codes.chunks(3).map(|rgb| rgb[0]).collect::<Vec<_>>();
        let yuyv = [1, 128, 2, 128, 99, 99, 3, 128, 4, 128];
        assert_eq!(grey(table.yuyv(&yuyv, 2, 2, 6).unwrap()), [1, 2, 3, 4]);
        let nv12 = [1, 2, 99, 3, 4, 99, 128, 178];
        // The red of all four is raised by 1.402 · 50 = 70.1.
        assert_eq!(grey(table.nv12(&nv12, 2, 2, 3).unwrap()), [71, 72, 73, 74]);
        for short in 0..10 {
            assert_eq!(table.yuyv(&yuyv[..short], 2, 2, 6), None);
        }
        for short in 0..8 {
            assert_eq!(table.nv12(&nv12[..short], 2, 2, 3), None);
        }
        assert_eq!((table.yuyv(&yuyv, 1, 1, 6), table.nv12(&nv12, 2, 1, 3)), (None, None));
    }

    proptest! {
        #[test]
        fn arbitrary_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..200), w in 0u32..12, h in 0u32..12, stride in 0usize..30) {
            let table = Table::new(ColorMatrix::Bt709, ColorRange::Limited);
            let whole = 3 * w as usize * h as usize;
            for codes in [table.yuyv(&bytes, w, h, stride), table.nv12(&bytes, w, h, stride)].into_iter().flatten() {
                prop_assert_eq!(codes.len(), whole);
            }
        }
    }
}
