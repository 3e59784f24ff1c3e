//! Morton codes: positions on a space-filling curve (Morton 1966).

use glam::Vec3;

/// Bits of a code per axis.
pub const BITS: u32 = 21;

/// Interleaved bits of the integer parts, x lowest.
pub fn morton_code(at: Vec3) -> u64 {
    let spread = |along: f32| {
        let mut bits = u64::from((along.max(0.0) as u32).min((1 << BITS) - 1));
        bits = (bits | bits << 32) & 0x001f_0000_0000_ffff;
        bits = (bits | bits << 16) & 0x001f_0000_ff00_00ff;
        bits = (bits | bits << 8) & 0x100f_00f0_0f00_f00f;
        bits = (bits | bits << 4) & 0x10c3_0c30_c30c_30c3;
        (bits | bits << 2) & 0x1249_2492_4924_9249
    };
    spread(at.x) | spread(at.y) << 1 | spread(at.z) << 2
}

/// Inverse of [`morton_code`].
pub fn demorton(code: u64) -> Vec3 {
    let compact = |shift: u32| {
        let mut bits = code >> shift & 0x1249_2492_4924_9249;
        bits = (bits | bits >> 2) & 0x10c3_0c30_c30c_30c3;
        bits = (bits | bits >> 4) & 0x100f_00f0_0f00_f00f;
        bits = (bits | bits >> 8) & 0x001f_0000_ff00_00ff;
        bits = (bits | bits >> 16) & 0x001f_0000_0000_ffff;
        ((bits | bits >> 32) & 0x1f_ffff) as f32
    };
    Vec3::new(compact(0), compact(1), compact(2))
}

/// Lowest and highest coordinates.
pub fn bounds<'a>(points: impl Iterator<Item = &'a Vec3>) -> (Vec3, Vec3) {
    points.fold((Vec3::INFINITY, Vec3::NEG_INFINITY), |(low, high), point| (low.min(*point), high.max(*point)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn code_interleaves_the_bits_of_the_axes_and_is_inverted() {
        // x = 0b011, y = 0b101, z = 0b110: bits z y x from the highest.
        assert_eq!(morton_code(Vec3::new(3.0, 5.0, 6.0)), 0b110_101_011);
        for at in [[0.0, 0.0, 0.0], [1.0, 2.0, 3.0], [2_097_151.0, 17.0, 1_048_576.0]] {
            assert_eq!(demorton(morton_code(Vec3::from(at))).to_array(), at);
        }
        let outside = Vec3::new(-4.0, 1e9, 0.5);
        assert_eq!(demorton(morton_code(outside)).to_array(), [0.0, 2_097_151.0, 0.0], "clamped");
    }
}
