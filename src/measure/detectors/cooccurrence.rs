//! Co-occurrences of quantised, truncated residues: a reduced SPAM model (Pevný, Bas and Fridrich
//! 2010) with the joint counts and the symmetries of rich models (Fridrich and Kodovský 2012).
//!
//! The residue is the first difference d of neighbours along rows or columns of Y', Cb and Cr,
//! quantised and truncated to r = clamp(round(d/q), −2, 2). Three successive r form one of 125
//! triples. Triples that are equal up to sign or order are counted together, which leaves 39 shares
//! per direction and plane. q is the median over all patches of the standard deviation of d, so
//! that the bins suit the noise. Sensitive to dependences between neighbours that the covariance
//! does not show: edges of quantisation, interpolation, clipped tails.

use super::patches::{PATCH_PX, Planes};
use crate::grey_image::GreyImage;

/// Largest quantised residue.
const TRUNCATION: i32 = 2;
const LEVELS: usize = 2 * TRUNCATION as usize + 1;
const TRIPLES: usize = LEVELS * LEVELS * LEVELS;
/// Smallest quantisation step, codes.
const MIN_STEP: f64 = 0.25;

/// Quantisation and grouping of triples, the same for all patches that are compared.
#[derive(Clone, Debug)]
pub(super) struct CooccurrenceModel {
    /// Quantisation step of each plane's differences, codes.
    steps: [f64; 3],
    /// The class of each triple under change of sign and reversal.
    classes: [usize; TRIPLES],
    class_count: usize,
}

impl CooccurrenceModel {
    /// The model for patches in Y', Cb, Cr.
    pub fn new<'a>(patches: impl Iterator<Item = &'a Planes> + Clone) -> Self {
        let steps = [0, 1, 2].map(|channel: usize| {
            let mut deviations: Vec<f64> =
                patches.clone().map(|planes| difference_deviation(&planes[channel])).collect();
            deviations.sort_by(f64::total_cmp);
            deviations.get(deviations.len() / 2).map_or(MIN_STEP, |median| median.max(MIN_STEP))
        });
        let mut classes = [0; TRIPLES];
        let mut class_count = 0;
        for triple in 0..TRIPLES {
            let [a, b, c] = [triple / (LEVELS * LEVELS), triple / LEVELS % LEVELS, triple % LEVELS];
            let negative = |level: usize| LEVELS - 1 - level;
            let equivalent = [
                index(c, b, a),
                index(negative(a), negative(b), negative(c)),
                index(negative(c), negative(b), negative(a)),
            ];
            let [x, y, z] = equivalent;
            let first = x.min(y).min(z);
            if first < triple {
                classes[triple] = classes[first];
            } else {
                classes[triple] = class_count;
                class_count += 1;
            }
        }
        Self { steps, classes, class_count }
    }

    /// Square roots of the shares of the classes: their variance hardly depends on the share.
    pub fn features(&self, ycbcr: &Planes) -> Vec<f64> {
        let mut features = Vec::with_capacity(6 * self.class_count);
        for (plane, step) in ycbcr.iter().zip(self.steps) {
            for strides in [[1, PATCH_PX], [PATCH_PX, 1]] {
                let mut counts = vec![0usize; self.class_count];
                let mut total = 0;
                for line in 0..PATCH_PX {
                    let levels: Vec<usize> = line_differences(plane, strides, line).map(|d| level(d, step)).collect();
                    for triple in levels.windows(3) {
                        counts[self.classes[index(triple[0], triple[1], triple[2])]] += 1;
                        total += 1;
                    }
                }
                features.extend(counts.iter().map(|count| (*count as f64 / f64::from(total)).sqrt()));
            }
        }
        features
    }
}

fn index(a: usize, b: usize, c: usize) -> usize {
    (a * LEVELS + b) * LEVELS + c
}

/// The quantised difference, from 0 for −[`TRUNCATION`] on.
fn level(difference: f64, step: f64) -> usize {
    let limit = f64::from(TRUNCATION);
    ((difference / step).round().clamp(-limit, limit) + limit) as usize
}

/// Differences of neighbours in a line; `strides` along it and across lines.
fn line_differences(
    plane: &GreyImage,
    [along, across]: [usize; 2],
    line: usize,
) -> impl Iterator<Item = f64> + use<'_> {
    let at = move |i: usize| f64::from(plane.values[line * across + i * along]);
    (1..PATCH_PX).map(move |i| at(i) - at(i - 1))
}

/// Standard deviation of the differences along rows and columns, around 0, codes.
fn difference_deviation(plane: &GreyImage) -> f64 {
    let lines = (0..PATCH_PX).flat_map(|line| [([1, PATCH_PX], line), ([PATCH_PX, 1], line)]);
    let squares: f64 =
        lines.map(|(strides, line)| line_differences(plane, strides, line).map(|d| d * d).sum::<f64>()).sum();
    (squares / (2 * PATCH_PX * (PATCH_PX - 1)) as f64).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn planes(value: impl Fn(usize, usize) -> f32 + Copy) -> Planes {
        [0, 1, 2].map(|_| GreyImage::from_fn(PATCH_PX, PATCH_PX, value))
    }

    #[test]
    fn triples_form_39_classes_by_burnsides_lemma() {
        // (125 + 1 + 25 + 5)/4: identity, sign, reversal, both.
        let model = CooccurrenceModel::new([planes(|x, _| x as f32)].iter());
        assert_eq!(model.class_count, 39);
        let class = |a, b, c| model.classes[index(a, b, c)];
        assert_eq!(class(4, 2, 1), class(1, 2, 4));
        assert_eq!(class(4, 2, 1), class(0, 2, 3));
        assert_ne!(class(4, 2, 1), class(4, 2, 0));
    }

    #[test]
    fn shares_of_a_line_pattern_match_hand_calculation() {
        // Rows step by 10, −10, …: d = ±q, triples (1, −1, 1) and its negative. Columns: d = 0.
        let stripes = planes(|x, _| 10.0 * (x % 2) as f32);
        let model = CooccurrenceModel::new([planes(|x, y| 10.0 * ((x + y) % 2) as f32)].iter());
        assert_eq!(model.steps, [10.0; 3]);
        let shares = model.features(&stripes);
        assert_eq!(shares.len(), 6 * 39);
        let alternating = model.classes[index(3, 1, 3)];
        let flat = model.classes[index(2, 2, 2)];
        for (i, share) in shares.iter().enumerate() {
            let expected = if i % 78 == alternating || i % 78 == 39 + flat { 1.0 } else { 0.0 };
            assert_eq!(*share, expected, "{i}");
        }
    }

    #[test]
    fn large_differences_are_truncated() {
        assert_eq!([-9.0, -2.4, -0.4, 0.6, 40.0].map(|d| level(d, 1.0)), [0, 0, 2, 3, 4]);
    }
}
