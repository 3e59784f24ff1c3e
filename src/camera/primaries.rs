//! Primaries of the footage's R, G, B. Colours of virtual objects are given in Rec. 709 and
//! converted, so that they are lit and mixed in the footage's own. All have the white D65.
//!
//! Not modelled: other whites (DCI-P3 of cinemas), camera gamuts such as S-Gamut3 or ARRI Wide
//! Gamut, in which saturated colours of objects are too saturated.

use glam::{DMat3, DVec3};

crate::choices! {
    /// Primaries of code values.
    #[derive(Default, Hash)]
    pub enum Primaries {
        /// ITU-R BT.709 and sRGB.
        #[default]
        Rec709 = "rec709",
        /// SMPTE EG 432-1 (Display P3).
        P3 = "p3",
        /// ITU-R BT.2020 and BT.2100.
        Rec2020 = "rec2020",
    }
}

/// CIE 1931 chromaticity of D65.
const D65: [f64; 2] = [0.3127, 0.3290];

impl Primaries {
    /// CIE 1931 chromaticities of R, G, B.
    fn chromaticities(self) -> [[f64; 2]; 3] {
        match self {
            Self::Rec709 => [[0.640, 0.330], [0.300, 0.600], [0.150, 0.060]],
            Self::P3 => [[0.680, 0.320], [0.265, 0.690], [0.150, 0.060]],
            Self::Rec2020 => [[0.708, 0.292], [0.170, 0.797], [0.131, 0.046]],
        }
    }

    /// Tristimulus values of linear R, G, B, where the white (1, 1, 1) has Y = 1. Source: SMPTE RP
    /// 177-1993.
    fn to_xyz(self) -> DMat3 {
        let xyz = |[x, y]: [f64; 2]| DVec3::new(x / y, 1.0, (1.0 - x - y) / y);
        let [red, green, blue] = self.chromaticities().map(xyz);
        let columns = DMat3::from_cols(red, green, blue);
        columns * DMat3::from_diagonal(columns.inverse() * xyz(D65))
    }

    /// Linear R, G, B of these primaries from those of Rec. 709. `None` for Rec. 709.
    pub fn from_rec709(self) -> Option<DMat3> {
        (self != Self::Rec709).then(|| self.to_xyz().inverse() * Self::Rec709.to_xyz())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// ITU-R BT.2087-0, equation 2-2, and the matrix of Rec. 709 to Display P3 by Apple's profiles.
    #[test]
    fn conversions_have_the_published_coefficients_and_keep_white() {
        let rec2020 = [[0.6274, 0.3293, 0.0433], [0.0691, 0.9195, 0.0114], [0.0164, 0.0880, 0.8956]];
        let p3 = [[0.8225, 0.1775, 0.0], [0.0332, 0.9668, 0.0], [0.0171, 0.0724, 0.9105]];
        for (primaries, rows) in [(Primaries::Rec2020, rec2020), (Primaries::P3, p3)] {
            let matrix = primaries.from_rec709().unwrap();
            for (at, row) in rows.iter().enumerate() {
                assert!(matrix.row(at).abs_diff_eq(DVec3::from_array(*row), 6e-5), "{primaries:?} {matrix}");
            }
            assert!((matrix * DVec3::ONE).abs_diff_eq(DVec3::ONE, 1e-12));
        }
        assert_eq!(Primaries::Rec709.from_rec709(), None);
    }
}
