//! ArUco dictionaries (Garrido-Jurado et al. 2014), as OpenCV's predefined ones: the codes of 1,000
//! tags for each size, of which a dictionary has the first 50, 100, 250 or all.

use std::sync::Arc;

use kornia_apriltag::decoder::{QuickDecode, SharpeningBuffer};
use kornia_apriltag::errors::AprilTagError;
use kornia_apriltag::family::{TagFamily, TagFamilyKind};

/// Codes as hexadecimal numbers: cells row by row from the upper left, the first one in the highest
/// bit, 1 for white.
const CODES_4X4: &str = include_str!("aruco_4x4.txt");
const CODES_5X5: &str = include_str!("aruco_5x5.txt");
const CODES_6X6: &str = include_str!("aruco_6x6.txt");
const CODES_7X7: &str = include_str!("aruco_7x7.txt");

/// Size of the buffer in which the decoder sharpens samples, as in its own families.
const SHARPENING_BUFFER_CELLS: usize = 64;

/// A dictionary: cells along the side of a code, number of tags, and number of wrong cells that are
/// corrected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Dictionary {
    pub side: u32,
    pub count: u32,
    pub corrected: u8,
}

impl Dictionary {
    /// The code of a tag. `None` if the dictionary has no such tag.
    fn code(self, id: u32) -> Option<u64> {
        self.codes().nth(usize::try_from(id).ok()?)
    }

    fn codes(self) -> impl Iterator<Item = u64> {
        let text = match self.side {
            4 => CODES_4X4,
            5 => CODES_5X5,
            6 => CODES_6X6,
            _ => CODES_7X7,
        };
        let numbers = text.split_ascii_whitespace().filter_map(|word| u64::from_str_radix(word, 16).ok());
        numbers.take(self.count as usize)
    }

    /// True if a cell is white, by column and row.
    fn is_white(self, code: u64, (x, y): (u32, u32)) -> bool {
        code >> (self.side * self.side - 1 - (y * self.side + x)) & 1 == 1
    }

    /// The white cells of a tag within its black border. `None` if the dictionary has no such tag.
    pub fn white_cells(self, id: u32) -> Option<Vec<(u32, u32)>> {
        let code = self.code(id)?;
        let cells = (0..self.side).flat_map(|y| (0..self.side).map(move |x| (x, y)));
        Some(cells.filter(|cell| self.is_white(code, *cell)).collect())
    }

    /// The cells in the decoder's order: it turns a code by a quarter by moving each quarter of its
    /// bits to the place of the next, and the centre of odd sides is last.
    fn cell_order(self) -> Vec<(u32, u32)> {
        let side = self.side;
        let mut quarter: Vec<(u32, u32)> = (0..side / 2).flat_map(|y| (y..side - 1 - y).map(move |x| (x, y))).collect();
        let mut order = Vec::new();
        for _ in 0..4 {
            order.extend(&quarter);
            quarter.iter_mut().for_each(|(x, y)| (*x, *y) = (side - 1 - *y, *x));
        }
        order.extend((side % 2 == 1).then_some((side / 2, side / 2)));
        order
    }

    /// The dictionary for the decoder.
    pub fn decoder_family(self) -> Result<TagFamilyKind, AprilTagError> {
        let order = self.cell_order();
        let codes: Vec<usize> = self
            .codes()
            .map(|code| order.iter().fold(0, |bits, cell| bits << 1 | usize::from(self.is_white(code, *cell))))
            .collect();
        let border = |cell: u32| cell as i8 + 1;
        Ok(TagFamilyKind::Custom(Arc::new(TagFamily {
            name: format!("aruco_{0}x{0}_{1}", self.side, self.count),
            width_at_border: self.side as usize + 2,
            reversed_border: false,
            total_width: self.side as usize + 4,
            nbits: order.len(),
            bit_x: order.iter().map(|(x, _)| border(*x)).collect(),
            bit_y: order.iter().map(|(_, y)| border(*y)).collect(),
            quick_decode: QuickDecode::new(order.len(), &codes, self.corrected)?,
            code_data: codes,
            min_hamming: 2 * self.corrected + 1,
            sharpening_buffer: SharpeningBuffer::new(SHARPENING_BUFFER_CELLS),
        })))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_size_has_its_codes() {
        for side in 4..=7 {
            let dictionary = Dictionary { side, count: 1000, corrected: 0 };
            let codes: std::collections::BTreeSet<u64> = dictionary.codes().collect();
            assert_eq!((codes.len(), dictionary.code(1000)), (1000, None), "{side}");
            assert!(codes.iter().all(|code| code >> (side * side) == 0), "{side}");
            let order = dictionary.cell_order();
            assert_eq!(order.iter().collect::<std::collections::BTreeSet<_>>().len(), (side * side) as usize);
        }
    }

    /// Its bytes in OpenCV are 0xb5, 0x32: rows 1011, 0101, 0011, 0010.
    #[test]
    fn first_tag_of_4x4_matches_its_code() {
        let white = Dictionary { side: 4, count: 50, corrected: 1 }.white_cells(0).unwrap();
        let row = |y: u32| (0..4).map(|x| if white.contains(&(x, y)) { '#' } else { '.' }).collect::<String>();
        assert_eq!((0..4).map(row).collect::<Vec<_>>(), ["#.##", ".#.#", "..##", "..#."]);
    }

    /// Codes of a dictionary differ by at least twice the corrected cells and one, also when
    /// turned.
    #[test]
    fn corrected_cells_cannot_confuse_two_tags() {
        for (side, count, corrected) in [(4, 50, 1), (4, 250, 1), (5, 100, 2), (6, 250, 2), (7, 100, 2)] {
            let dictionary = Dictionary { side, count, corrected };
            let codes: Vec<Vec<bool>> = dictionary
                .codes()
                .map(|code| (0..side * side).map(|at| dictionary.is_white(code, (at % side, at / side))).collect())
                .collect();
            let turned = |cells: &[bool]| -> Vec<bool> {
                (0..side * side).map(|at| cells[((side - 1 - at % side) * side + at / side) as usize]).collect()
            };
            let mut min_distance = side * side;
            for (n, code) in codes.iter().enumerate() {
                let mut other = code.clone();
                for turn in 0..4 {
                    for (m, second) in codes.iter().enumerate() {
                        if turn > 0 || m != n {
                            let apart = other.iter().zip(second).filter(|(a, b)| a != b).count() as u32;
                            min_distance = min_distance.min(apart);
                        }
                    }
                    other = turned(&other);
                }
            }
            assert!(min_distance > 2 * u32::from(corrected), "{side} {count}: {min_distance}");
        }
    }
}
