//! The mask of a composited frame: the pixels that virtual objects change, and those that their
//! shadows and reflections change. All other pixels are the camera's, bit for bit.

use crate::pixels::{LayerImage, Pixels};

/// A bit for each class; a pixel may have both.
const SYNTHETIC: u8 = 1;
const SHADED: u8 = 2;

/// The classes of each pixel, row by row.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FrameMask {
    pub width: u32,
    pub height: u32,
    classes: Vec<u8>,
}

/// A frame's mask in a record.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct MaskRecord {
    pub synthetic: RunLengths,
    pub shaded: RunLengths,
}

/// A mask as run lengths, in the format of COCO's uncompressed masks: column by column, the first
/// run is of pixels outside the mask.
#[derive(Clone, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct RunLengths {
    /// Height and width, px.
    pub size: [u32; 2],
    pub counts: Vec<u32>,
}

impl FrameMask {
    /// The mask of a layer. A pixel is synthetic where the layer has light or coverage, and shaded
    /// where it multiplies the camera's light by other than 1. Noise alone makes neither: it is
    /// only drawn on such pixels.
    pub fn of(layer: &LayerImage) -> Self {
        let class = |(rgba, left): (&[f32; 4], &[f32; 3])| {
            let synthetic = if *rgba == [0.0; 4] { 0 } else { SYNTHETIC };
            synthetic | if *left == [1.0; 3] { 0 } else { SHADED }
        };
        let classes = layer.rgba.iter().zip(&layer.left).map(class).collect();
        Self { width: layer.width, height: layer.height, classes }
    }

    /// The mask of a picture that [`FrameMask::picture`] made.
    pub fn of_picture(pixels: &Pixels) -> Self {
        let Pixels { width, height, .. } = *pixels;
        let class = |[red, green, _]: [u32; 3]| {
            let synthetic = if red == 0 { 0 } else { SYNTHETIC };
            synthetic | if green == 0 { 0 } else { SHADED }
        };
        let classes = (0..height).flat_map(|y| (0..width).map(move |x| class(pixels.at(x, y)))).collect();
        Self { width, height, classes }
    }

    /// A picture of the mask: synthetic pixels are red, shaded ones green, both yellow, and the
    /// camera's own black.
    pub fn picture(&self) -> Option<Pixels> {
        let white = |class: u8, bit: u8| if class & bit == 0 { 0 } else { 255 };
        let codes = self.classes.iter().flat_map(|class| [white(*class, SYNTHETIC), white(*class, SHADED), 0]);
        Pixels::from_u8(self.width, self.height, codes.collect())
    }

    pub fn record(&self) -> MaskRecord {
        MaskRecord { synthetic: self.run_lengths(SYNTHETIC), shaded: self.run_lengths(SHADED) }
    }

    fn run_lengths(&self, bit: u8) -> RunLengths {
        let (width, height) = (self.width as usize, self.height as usize);
        let (mut counts, mut run, mut is_inside) = (Vec::new(), 0, false);
        for x in 0..width {
            for y in 0..height {
                if (self.classes[y * width + x] & bit != 0) != is_inside {
                    counts.push(run);
                    (run, is_inside) = (0, !is_inside);
                }
                run += 1;
            }
        }
        counts.push(run);
        RunLengths { size: [self.height, self.width], counts }
    }
}

impl MaskRecord {
    /// Number of pixels with other classes than in a mask of a record, which may have been edited.
    pub fn differing_px(&self, recorded: &Self) -> usize {
        let size = self.synthetic.size;
        let area_px = size.iter().map(|px| *px as usize).product();
        if recorded.synthetic.size != size || recorded.shaded.size != size {
            return area_px;
        }
        self.classes().zip(recorded.classes()).take(area_px).filter(|(own, other)| own != other).count()
    }

    fn classes(&self) -> impl Iterator<Item = (bool, bool)> {
        self.synthetic.pixels().zip(self.shaded.pixels())
    }
}

impl RunLengths {
    /// For each pixel, column by column, whether it is in the mask; `false` without end behind the
    /// last run.
    fn pixels(&self) -> impl Iterator<Item = bool> {
        let run = |(number, count): (usize, &u32)| std::iter::repeat_n(number % 2 == 1, *count as usize);
        self.counts.iter().enumerate().flat_map(run).chain(std::iter::repeat(false))
    }

    /// Number of pixels in the mask.
    pub fn area_px(&self) -> u64 {
        self.counts.iter().skip(1).step_by(2).map(|count| u64::from(*count)).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Light without coverage, coverage, shadow, and both, in a picture of 3×2.
    #[test]
    fn mask_separates_objects_from_shading_column_by_column() {
        let mut layer = LayerImage::empty(3, 2);
        layer.rgba[0] = [0.5, 0.0, 0.0, 0.0];
        layer.rgba[4] = [0.0, 0.0, 0.0, 1.0];
        layer.left[4] = [1.0, 0.5, 1.0];
        layer.left[5] = [0.9; 3];
        let mask = FrameMask::of(&layer);
        let record = mask.record();
        // Columns: (0, 3), (1, 4), (2, 5).
        assert_eq!(record.synthetic, RunLengths { size: [2, 3], counts: vec![0, 1, 2, 1, 2] });
        assert_eq!(record.shaded, RunLengths { size: [2, 3], counts: vec![3, 1, 1, 1] });
        assert_eq!((record.synthetic.area_px(), record.shaded.area_px()), (2, 2));
        let picture = mask.picture().unwrap();
        assert_eq!(FrameMask::of_picture(&picture), mask);
        assert_eq!(picture.at(0, 0), [255, 0, 0]);
        assert_eq!((picture.at(1, 1), picture.at(2, 1)), ([255, 255, 0], [0, 255, 0]));
        assert_eq!(picture.at(1, 0), [0; 3]);
        let mut other = record.clone();
        assert_eq!(record.differing_px(&other), 0);
        // Pixel (0, 1) joins the mask, and pixel (1, 1) leaves it.
        other.synthetic.counts = vec![0, 2, 2, 0, 2];
        assert_eq!(record.differing_px(&other), 2);
        other.synthetic.counts = vec![u32::MAX];
        assert_eq!(record.differing_px(&other), 2, "the longest run that a record can state");
        other.synthetic.size = [1, 1];
        assert_eq!(record.differing_px(&other), 6);
    }
}
