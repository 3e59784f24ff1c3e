//! Families of tags and their patterns.

use kornia_apriltag::family::{TagFamily, TagFamilyKind};

crate::choices! {
    /// A family of AprilTags (Olson 2011; Wang and Olson 2016): a black border one cell wide around
    /// the cells of a code.
    pub enum Family {
        /// 587 tags of 6 by 6 cells that differ in 11 cells at least.
        Tag36h11 = "36h11",
        /// 35 tags of 5 by 5 cells that differ in 9 at least.
        Tag25h9 = "25h9",
        /// Tags of 4 by 4 cells, 30 of them, that differ in 5 at least: the family with the most
        /// false detections.
        Tag16h5 = "16h5",
    }
}

impl Family {
    pub const ALL: [Self; 3] = [Self::Tag36h11, Self::Tag25h9, Self::Tag16h5];

    /// Name in a board's file.
    pub fn name(self) -> &'static str {
        match self {
            Self::Tag36h11 => "36h11",
            Self::Tag25h9 => "25h9",
            Self::Tag16h5 => "16h5",
        }
    }

    pub fn of_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|family| family.name() == name)
    }

    pub(super) fn kind(self) -> TagFamilyKind {
        match self {
            Self::Tag36h11 => TagFamilyKind::Tag36H11,
            Self::Tag25h9 => TagFamilyKind::Tag25H9,
            Self::Tag16h5 => TagFamilyKind::Tag16H5,
        }
    }

    /// Number of tags; their ids count from 0.
    pub fn count(self) -> u32 {
        match self {
            Self::Tag36h11 => 587,
            Self::Tag25h9 => 35,
            Self::Tag16h5 => 30,
        }
    }

    /// Cells along a side of the black square, including its border.
    pub fn cells(self) -> u32 {
        match self {
            Self::Tag36h11 => 8,
            Self::Tag25h9 => 7,
            Self::Tag16h5 => 6,
        }
    }

    /// The white cells of a tag: columns from the left and rows from the top of the black square.
    /// `None` if the family has no such tag.
    pub fn white_cells(self, id: u32) -> Option<Vec<(u32, u32)>> {
        let family = TagFamily::try_from(&self.kind()).ok()?;
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
        for family in Family::ALL {
            let decoder_family = TagFamily::try_from(&family.kind()).unwrap();
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
