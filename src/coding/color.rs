//! Y'CbCr: the matrix from R'G'B' and the range of codes.

use serde::{Deserialize, Serialize};

/// Range of Y' in a file: 16 to 235 of 255, or all.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum ColorRange {
    Limited,
    Full,
}

/// Matrix from R'G'B' to Y'CbCr.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum ColorMatrix {
    /// None: R'G'B' is stored.
    Rgb,
    Bt601,
    Bt709,
    Bt2020,
}

impl ColorMatrix {
    /// Default by height for a file that does not state its matrix.
    pub fn usual(height: u32) -> Self {
        if height < 720 { Self::Bt601 } else { Self::Bt709 }
    }

    /// Its name in ffmpeg's scale filter; `None` if there is nothing to convert.
    pub fn name(self) -> Option<&'static str> {
        match self {
            Self::Rgb => None,
            Self::Bt601 => Some("bt601"),
            Self::Bt709 => Some("bt709"),
            Self::Bt2020 => Some("bt2020"),
        }
    }

    /// Kr and Kb in units of 10⁻⁴. R'G'B' is not Y'CbCr: its matrix counts as BT.601.
    pub fn luma_coefficients(self) -> [i32; 2] {
        match self {
            Self::Rgb | Self::Bt601 => [2990, 1140],
            Self::Bt709 => [2126, 722],
            Self::Bt2020 => [2627, 593],
        }
    }
}

/// Meaning of coded samples as colour. With [`ColorMatrix::Rgb`] the planes are R', G' and B'.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct YcbcrColor {
    pub matrix: ColorMatrix,
    pub range: ColorRange,
}

impl YcbcrColor {
    /// JPEG's (ITU-T T.871): BT.601, full range.
    pub const JFIF: Self = Self { matrix: ColorMatrix::Bt601, range: ColorRange::Full };

    /// Rows of the matrix from R'G'B' codes to coded samples, and the samples of black:
    /// `sample[i] = black[i] + Σ rows[i][j] · code[j]`.
    pub fn forward(self) -> ([[f64; 3]; 3], [f64; 3]) {
        if self.matrix == ColorMatrix::Rgb {
            return ([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], [0.0; 3]);
        }
        let [kr, kb] = self.matrix.luma_coefficients().map(|k| f64::from(k) / 10_000.0);
        let kg = 1.0 - kr - kb;
        let (black, y_scale, c_scale) = match self.range {
            ColorRange::Full => (0.0, 1.0, 1.0),
            ColorRange::Limited => (16.0, 219.0 / 255.0, 224.0 / 255.0),
        };
        let chroma = |luma_share: f64| c_scale / (2.0 * (1.0 - luma_share));
        let (cb, cr) = (chroma(kb), chroma(kr));
        let rows = [
            [kr, kg, kb].map(|k| y_scale * k),
            [-kr * cb, -kg * cb, (1.0 - kb) * cb],
            [(1.0 - kr) * cr, -kg * cr, -kb * cr],
        ];
        (rows, [black, 128.0, 128.0])
    }

    /// Rows of the matrix back: `code[i] = Σ rows[i][j] · (sample[j] − black[j])`.
    pub fn inverse(self) -> [[f64; 3]; 3] {
        if self.matrix == ColorMatrix::Rgb {
            return self.forward().0;
        }
        let [kr, kb] = self.matrix.luma_coefficients().map(|k| f64::from(k) / 10_000.0);
        let kg = 1.0 - kr - kb;
        let (y, c) = match self.range {
            ColorRange::Full => (1.0, 1.0),
            ColorRange::Limited => (255.0 / 219.0, 255.0 / 224.0),
        };
        let (red, blue) = (2.0 * (1.0 - kr) * c, 2.0 * (1.0 - kb) * c);
        [[y, 0.0, red], [y, -kb / kg * blue, -kr / kg * red], [y, blue, 0.0]]
    }
}
