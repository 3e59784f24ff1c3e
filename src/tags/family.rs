//! Families of tags and their patterns.

use kornia_apriltag::errors::AprilTagError;
use kornia_apriltag::family::{TagFamily, TagFamilyKind};

use super::aruco::Dictionary;
use crate::params::{Field, Kind, Value};

crate::choices! {
    /// A family of tags: AprilTags (Olson 2011; Wang and Olson 2016) and ArUco dictionaries, whose
    /// names begin with the size of a code. All have a black border one cell wide around the cells
    /// of a code.
    pub enum Family {
        /// 587 tags of 6 by 6 cells that differ in 11 cells at least.
        Tag36h11 = "36h11",
        /// 35 tags of 5 by 5 cells that differ in 9 at least.
        Tag25h9 = "25h9",
        /// Tags of 4 by 4 cells, 30 of them, that differ in 5 at least: the family with the most
        /// false detections.
        Tag16h5 = "16h5",
        Aruco4x4N50 = "4x4_50",
        Aruco4x4N100 = "4x4_100",
        Aruco4x4N250 = "4x4_250",
        Aruco4x4N1000 = "4x4_1000",
        Aruco5x5N50 = "5x5_50",
        Aruco5x5N100 = "5x5_100",
        Aruco5x5N250 = "5x5_250",
        Aruco5x5N1000 = "5x5_1000",
        Aruco6x6N50 = "6x6_50",
        Aruco6x6N100 = "6x6_100",
        Aruco6x6N250 = "6x6_250",
        Aruco6x6N1000 = "6x6_1000",
        Aruco7x7N50 = "7x7_50",
        Aruco7x7N100 = "7x7_100",
        Aruco7x7N250 = "7x7_250",
        Aruco7x7N1000 = "7x7_1000",
    }
}

impl Family {
    /// The names of all families.
    pub fn names() -> &'static [&'static str] {
        match Self::kind(None) {
            Kind::Choice(names) => names,
            _ => &[],
        }
    }

    /// All families.
    pub fn all() -> impl Iterator<Item = Self> {
        Self::names().iter().filter_map(|name| Self::of_name(name))
    }

    /// Name in a board's file.
    pub fn name(self) -> &'static str {
        Self::names().get(self as usize).copied().unwrap_or_default()
    }

    pub fn of_name(name: &str) -> Option<Self> {
        Self::from_value(&Value::Text(name.to_owned()), &Self::kind(None))
    }

    /// The ArUco dictionary, by the name: side x side _ number of tags. `None` for AprilTags.
    fn dictionary(self) -> Option<Dictionary> {
        let (size, count) = self.name().split_once('_')?;
        let (side, count) = (size.split_once('x')?.0.parse().ok()?, count.parse().ok()?);
        // At most two cells are corrected, for short tables; in dictionaries of a thousand tags and
        // of 4 by 4 cells, which differ less, one fewer each.
        let corrected = 2 - u8::from(count == 1000) - u8::from(side == 4);
        Some(Dictionary { side, count, corrected })
    }

    pub(super) fn decoder_family(self) -> Result<TagFamilyKind, AprilTagError> {
        match self {
            Self::Tag36h11 => Ok(TagFamilyKind::Tag36H11),
            Self::Tag25h9 => Ok(TagFamilyKind::Tag25H9),
            Self::Tag16h5 => Ok(TagFamilyKind::Tag16H5),
            _ => self.dictionary().map_or(Ok(TagFamilyKind::Tag36H11), Dictionary::decoder_family),
        }
    }

    /// Number of tags; their ids count from 0.
    pub fn count(self) -> u32 {
        match self {
            Self::Tag36h11 => 587,
            Self::Tag25h9 => 35,
            Self::Tag16h5 => 30,
            _ => self.dictionary().map_or(0, |dictionary| dictionary.count),
        }
    }

    /// Cells along a side of the black square, including its border.
    pub fn cells(self) -> u32 {
        match self {
            Self::Tag36h11 => 8,
            Self::Tag25h9 => 7,
            Self::Tag16h5 => 6,
            _ => self.dictionary().map_or(0, |dictionary| dictionary.side + 2),
        }
    }

    /// The white cells of a tag: columns from the left and rows from the top of the black square.
    /// `None` if the family has no such tag.
    pub fn white_cells(self, id: u32) -> Option<Vec<(u32, u32)>> {
        if let Some(dictionary) = self.dictionary() {
            let inner = dictionary.white_cells(id)?;
            return Some(inner.into_iter().map(|(x, y)| (x + 1, y + 1)).collect());
        }
        let family = TagFamily::try_from(&self.decoder_family().ok()?).ok()?;
        let code = *family.code_data.get(usize::try_from(id).ok()?)?;
        let cells = family.bit_x.iter().zip(&family.bit_y).enumerate();
        let white = cells.filter(|(i, _)| code >> (family.nbits - 1 - i) & 1 == 1);
        white.map(|(_, (x, y))| Some((u32::try_from(*x).ok()?, u32::try_from(*y).ok()?))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn families_match_the_decoder() {
        for family in Family::all() {
            let decoder_family = TagFamily::try_from(&family.decoder_family().unwrap()).unwrap();
            assert_eq!(decoder_family.code_data.len(), family.count() as usize);
            assert_eq!(decoder_family.width_at_border, family.cells() as usize);
            let inner = 1..family.cells() - 1;
            for id in [0, family.count() - 1] {
                let white = family.white_cells(id).unwrap();
                assert!(white.iter().all(|(x, y)| inner.contains(x) && inner.contains(y)), "{white:?}");
            }
            assert!(family.white_cells(family.count()).is_none());
            assert_eq!(Family::of_name(family.name()), Some(family));
        }
    }

    #[test]
    fn first_tag_matches_its_code() {
        // Its code is 0xd7e00984b, whose bits go around the cells from outside to inside.
        let white = Family::Tag36h11.white_cells(0).unwrap();
        let row = |y: u32| (1..7).map(|x| if white.contains(&(x, y)) { '#' } else { '.' }).collect::<String>();
        assert_eq!((1..7).map(row).collect::<Vec<_>>(), ["##.#.#", ".###.#", ".##...", "#.#...", ".#.##.", "...#.."]);
    }
}
