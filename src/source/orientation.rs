//! Display orientation of a picture: mirroring and rotation by a video's display matrix or a
//! still's EXIF.

use std::fmt;

use crate::pixels::Pixels;

/// The default is the picture as stored.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Orientation {
    /// Mirrored left to right, before the rotation.
    pub is_mirrored: bool,
    /// Counter-clockwise, degrees.
    pub rotation_deg: f64,
}

impl Orientation {
    /// The orientation of the matrix `[a, b, c, d]` by which (x, y) is shown at (a·x + c·y, b·x +
    /// d·y), y downwards. `None` if it is singular.
    pub fn of_matrix([a, b, c, d]: [f64; 4]) -> Option<Self> {
        let determinant = a * d - b * c;
        let rotation_deg = (100.0 * c.atan2(d).to_degrees()).round() / 100.0;
        (determinant != 0.0).then_some(Self { is_mirrored: determinant < 0.0, rotation_deg })
    }

    /// The orientation of an EXIF value, 1 to 8. Source: CIPA DC-008 (Exif 2.32), 4.6.4.
    pub fn of_exif(orientation: u32) -> Self {
        let rotation_deg = match orientation {
            3 | 4 => 180.0,
            5 | 8 => 90.0,
            6 | 7 => -90.0,
            _ => 0.0,
        };
        Self { is_mirrored: matches!(orientation, 2 | 4 | 5 | 7), rotation_deg }
    }

    /// The EXIF value, 1 to 8; 1 for rotations by other than quarter turns.
    pub fn exif(self) -> u32 {
        (1..=8).find(|value| Self::of_exif(*value) == self).unwrap_or(1)
    }

    /// True if pixels stay pixels: the rotation is by quarter turns.
    pub fn is_by_quarter_turns(self) -> bool {
        self.rotation_deg % 90.0 == 0.0
    }

    /// Size of a picture of this size after the orientation was applied, which is by quarter turns.
    pub fn oriented_size(self, (width, height): (u32, u32)) -> (u32, u32) {
        if self.rotation_deg % 180.0 == 0.0 { (width, height) } else { (height, width) }
    }

    /// Applies the orientation, which is by quarter turns, to a picture. How its codes were coded
    /// is lost, except by the identity.
    pub fn apply(self, pixels: Pixels) -> Pixels {
        if self == Self::default() {
            return pixels;
        }
        let [a, b, c, d] = self.matrix().map(|element| element.round() as i64);
        let (width, height) = self.oriented_size((pixels.width, pixels.height));
        let (last_x, last_y) = (i64::from(pixels.width) - 1, i64::from(pixels.height) - 1);
        // The matrix is orthogonal, so its transpose is its inverse. The origin of the stored
        // picture is where a negative element would lead to negative coordinates.
        let (dx, dy) = ((a + c).min(0), (b + d).min(0));
        let (dx, dy) = (dx * if a == 0 { last_y } else { last_x }, dy * if d == 0 { last_x } else { last_y });
        pixels.rearranged(width, height, |x, y| {
            let (x, y) = (i64::from(x) + dx, i64::from(y) + dy);
            ((a * x + b * y) as u32, (c * x + d * y) as u32)
        })
    }

    /// The matrix of [`Orientation::of_matrix`].
    pub fn matrix(self) -> [f64; 4] {
        let (sin, cos) = (-self.rotation_deg).to_radians().sin_cos();
        let x = if self.is_mirrored { -1.0 } else { 1.0 };
        [x * cos, x * sin, -sin, cos]
    }
}

/// Follows "shown".
impl fmt::Display for Orientation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { is_mirrored, rotation_deg } = *self;
        let angle = rotation_deg.abs();
        match (is_mirrored, angle) {
            (true, 0.0) => return f.write_str("mirrored left to right"),
            (true, 180.0) => return f.write_str("mirrored top to bottom"),
            (true, _) => f.write_str("mirrored left to right and then ")?,
            (false, _) => {}
        }
        let way = if rotation_deg < 0.0 { "clockwise" } else { "counter-clockwise" };
        match angle {
            180.0 => f.write_str("turned by 180°"),
            _ => write!(f, "turned by {angle}° {way}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn display_matrices_and_exif_give_the_same_orientations() {
        // A pixel at (x, y) is shown at (-x, y), (-x, -y), (x, -y), (y, x), (-y, x), (-y, -x) and
        // (y, -x).
        for (exif, matrix, shown) in [
            (2, [-1.0, 0.0, 0.0, 1.0], "mirrored left to right"),
            (3, [-1.0, 0.0, 0.0, -1.0], "turned by 180°"),
            (4, [1.0, 0.0, 0.0, -1.0], "mirrored top to bottom"),
            (5, [0.0, 1.0, 1.0, 0.0], "mirrored left to right and then turned by 90° counter-clockwise"),
            (6, [0.0, 1.0, -1.0, 0.0], "turned by 90° clockwise"),
            (7, [0.0, -1.0, -1.0, 0.0], "mirrored left to right and then turned by 90° clockwise"),
            (8, [0.0, -1.0, 1.0, 0.0], "turned by 90° counter-clockwise"),
        ] {
            let orientation = Orientation::of_exif(exif);
            assert_eq!(Orientation::of_matrix(matrix), Some(orientation), "{exif}");
            let off = orientation.matrix().iter().zip(matrix).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(off < 1e-12 && orientation.to_string() == shown, "{orientation}");
        }
        assert_eq!(Orientation::of_exif(1), Orientation::default());
        assert_eq!(Orientation::of_matrix([1.0, 0.0, 0.0, 1.0]), Some(Orientation::default()));
        assert_eq!(Orientation::of_matrix([0.0; 4]), None);
    }

    #[test]
    fn applied_orientation_moves_pixels_as_exif_defines() {
        // 1 2 3
        // 4 5 6
        let stored = || Pixels::from_u8(3, 2, (1..=6).flat_map(|code| [code; 3]).collect()).unwrap();
        for (exif, size, codes) in [
            (1, (3, 2), [1, 2, 3, 4, 5, 6]),
            (2, (3, 2), [3, 2, 1, 6, 5, 4]),
            (3, (3, 2), [6, 5, 4, 3, 2, 1]),
            (4, (3, 2), [4, 5, 6, 1, 2, 3]),
            (5, (2, 3), [1, 4, 2, 5, 3, 6]),
            (6, (2, 3), [4, 1, 5, 2, 6, 3]),
            (7, (2, 3), [6, 3, 5, 2, 4, 1]),
            (8, (2, 3), [3, 6, 2, 5, 1, 4]),
        ] {
            let orientation = Orientation::of_exif(exif);
            let shown = orientation.apply(stored());
            assert_eq!(orientation.oriented_size((3, 2)), size);
            assert_eq!(((shown.width, shown.height), shown.each(|code| code[0])), (size, codes.to_vec()), "{exif}");
        }
    }
}
