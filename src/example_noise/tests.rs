//! Tests of the model as a whole, on synthetic frames.

use super::atlas::{CELL_PX, CLASSES, OVERLAP_PX, TILE_PX, TileCandidate};
use super::bands::{ALL_BANDS, split};
use super::calibration::{CalibrationFrame, CodedFrame, calibrate, calibrate_coded, synthesise};
use super::cells::{EXPECTED_RANK, cell_count, source, weight};
use super::content::{FEATURES, FeatureScale, Features};
use super::descriptor::{DESCRIPTORS, DescriptorBlocks, DescriptorScale};
use super::file::{ModelFileError, from_bytes, to_bytes};
use super::latent::{LatentStep, LatentTable, NODES};
use super::model_coding::CodingDifference;
use super::path::Planes;
use super::persistence::FrameKeys;
use super::regression::{self, Coefficients};
use super::source_picture::SourcePicture;
use super::synthesis::NoiseContent;
use super::{ModelError, NoiseModel};
use crate::coding::{BlockQuantization, ChromaSampling, ColorMatrix, ColorRange, Decoder, PictureCoding, YcbcrColor};
use crate::grey_image::GreyImage;
use crate::hash::pcg3d;
use std::sync::LazyLock;

fn coding(factor: [u32; 2]) -> PictureCoding {
    PictureCoding {
        color: YcbcrColor { matrix: ColorMatrix::Bt601, range: ColorRange::Full },
        chroma: Some(ChromaSampling::centered(factor)),
        quantization: None,
        decoder: Decoder::Nearest,
    }
}

/// White noise, uniform with this standard deviation.
fn noise(x: usize, y: usize, seed: u32, deviation: f32) -> f32 {
    let word = pcg3d([x as u32, y as u32, seed])[0];
    (word as f32 / u32::MAX as f32 - 0.5) * 12.0f32.sqrt() * deviation
}

const SIDE: usize = 224;

/// Left half dark with σ 2, right half bright with σ 6.
fn frame(seed: u32) -> CalibrationFrame {
    let grey = GreyImage::from_fn(SIDE, SIDE, |x, _| if x < SIDE / 2 { 60.0 } else { 180.0 });
    let noisy = (0..SIDE * SIDE).flat_map(|i| {
        let (x, y) = (i % SIDE, i / SIDE);
        let deviation = if x < SIDE / 2 { 2.0 } else { 6.0 };
        [0, 1, 2].map(|c| (grey.values[i] + noise(x, y, 3 * seed + c, deviation)).round() as u8)
    });
    let noisy = noisy.collect();
    CalibrationFrame {
        mean: [grey.clone(), grey.clone(), grey],
        noisy,
        mask: vec![true; SIDE * SIDE],
        variance_gain: 1.0,
    }
}

pub static MODEL: LazyLock<NoiseModel> = LazyLock::new(|| model([1, 1]));

/// A model of that frame, for chroma of this sampling.
pub fn model(factor: [u32; 2]) -> NoiseModel {
    calibrate(&[frame(1)], &coding(factor), 7).expect("enough tiles")
}

#[test]
fn residuals_of_masked_places_do_not_reach_the_amplitudes_beside_them() {
    let inside = |i: usize| (64..96).contains(&(i % SIDE)) && (96..160).contains(&(i / SIDE));
    let mut masked = frame(1);
    masked.mask.iter_mut().enumerate().for_each(|(i, usable)| *usable = !inside(i));
    let mut changed = masked.clone();
    for (i, code) in changed.noisy.iter_mut().enumerate().filter(|(i, _)| inside(i / 3)) {
        *code += if i % 7 < 3 { 60 } else { 20 };
    }
    let [a, b] = [masked, changed].map(|frame| calibrate(&[frame], &coding([2, 1]), 7).expect("enough tiles").numbers);
    assert_eq!(a, b);
}

fn deviation(values: impl Iterator<Item = f32> + Clone) -> f32 {
    let count = values.clone().count() as f32;
    let mean = values.clone().sum::<f32>() / count;
    (values.map(|v| (v - mean).powi(2)).sum::<f32>() / count).sqrt()
}

fn correlation(a: &[f32], b: &[f32]) -> f32 {
    let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f32>();
    dot(a, b) / (dot(a, a) * dot(b, b)).sqrt()
}

fn uniform(side: [usize; 2], code: f32) -> Planes {
    std::array::from_fn(|_| GreyImage::uniform(side[0], side[1], code))
}

fn noise_of(model: &NoiseModel, rgb: &Planes, key: [u32; 3], factor: Option<&GreyImage>) -> Planes {
    model.noise(&NoiseContent { rgb, share: None, factor }, &FrameKeys::single(key))
}

#[test]
fn features_of_a_flat_picture_match_hand_worked_values() {
    let rgb = [51.0, 102.0, 153.0].map(|v| GreyImage::uniform(24, 16, v));
    let features = Features::of(&rgb).at(5 * 24 + 7);
    // y = (0.2 + 2 · 0.4 + 0.6) / 4 = 0.4.
    let expected = [0.4, 0.402f32.sqrt(), -0.2, 0.2, 0.5f32.ln(), 0.5f32.ln(), 0.05f32.ln()];
    for (got, expected) in features.iter().zip(expected) {
        assert!((got - expected).abs() < 1e-4, "{features:?}");
    }
}

#[test]
fn activity_of_a_ramp_is_its_squared_slope() {
    let ramp = GreyImage::from_fn(48, 48, |x, _| 3.0 * x as f32);
    let features = Features::of(&[ramp.clone(), ramp.clone(), ramp]).at(24 * 48 + 24);
    for activity in &features[4..6] {
        assert!((activity - 9.5f32.ln()).abs() < 1e-3, "{features:?}");
    }
}

#[test]
fn clamped_activity_leaves_brightness_and_colour() {
    let values = std::array::from_fn(|_| (0..=1000).map(|i| i as f32 / 1000.0).collect());
    let scale = FeatureScale::of(values);
    let clamped = scale.with_clamped_activity(-0.5);
    assert_eq!((clamped.low, clamped.high[..4].to_vec()), (scale.low, scale.high[..4].to_vec()));
    // The uniform distribution's deviation is √(1/12).
    assert!(clamped.high[4..].iter().all(|high| (high - (0.5 - 0.5 / 12.0f32.sqrt())).abs() < 1e-3), "{clamped:?}");
    let below = scale.with_clamped_activity(-9.0);
    assert!(below.is_valid() && below.high[6] == scale.low[6]);
}

#[test]
fn descriptor_matches_hand_worked_values() {
    // Columns 51 and 102 in turn at the sampled places, which are 2 px apart.
    let stripes = GreyImage::from_fn(96, 96, |x, _| if x / 2 % 2 == 0 { 51.0 } else { 102.0 });
    let red = GreyImage::from_fn(96, 96, |x, _| if x / 2 % 2 == 0 { 51.0 } else { 153.0 });
    let values = DescriptorBlocks::of(&[red, stripes.clone(), stripes], None).tile([1, 1]);
    // y = 0.2 and (0.6 + 2 · 0.4 + 0.4) / 4 = 0.45 in turn; half of the pairs, those across, differ
    // by 63.75 codes.
    let expected = [0.325, 0.327f32.sqrt(), 0.1, 0.0, (0.5 + 0.25 * 63.75f32 * 63.75).ln()];
    for (values, expected) in values.iter().zip(expected) {
        assert!((values - expected).abs() < 1e-3, "{values} {expected}");
    }
}

#[test]
fn descriptor_leaves_out_pixels_without_share_and_blocks_outside() {
    let halves = GreyImage::from_fn(96, 96, |x, _| if x < 40 { 51.0 } else { 204.0 });
    let share = GreyImage::from_fn(96, 96, |x, _| if x < 40 { 0.5 } else { 0.0 });
    let rgb = [halves.clone(), halves.clone(), halves];
    let of = |share, first| DescriptorBlocks::of(&rgb, share).tile(first);
    let dark = DescriptorBlocks::of(&uniform([96, 96], 51.0), None).tile([0, 0]);
    let is_dark = |descriptors: [f32; DESCRIPTORS]| descriptors.iter().zip(dark).all(|(a, b)| (a - b).abs() < 1e-5);
    assert!(is_dark(of(Some(&share), [0, 0])));
    assert!(is_dark(of(None, [-5, -2])), "the blocks to the left of x = 40");
    let black = of(Some(&share), [8, 0]);
    assert!(black[0] == 0.0 && black.iter().all(|v| v.is_finite()), "{black:?}");
}

#[test]
fn descriptors_are_clamped_to_the_atlas_and_standardised() {
    let scale = DescriptorScale::of(&[[1.0; DESCRIPTORS], [5.0; DESCRIPTORS]]);
    assert!(scale.standardised(&[7.0; DESCRIPTORS]).iter().all(|v| (v - 1.0).abs() < 1e-4));
    assert!(scale.standardised(&[3.0; DESCRIPTORS]).iter().all(|v| v.abs() < 1e-4));
}

#[test]
fn bands_sum_to_the_plane() {
    let plane = GreyImage::from_fn(40, 30, |x, y| noise(x, y, 3, 5.0));
    for index in [0, 1] {
        let bands = split(&plane, index);
        for (i, v) in plane.values.iter().enumerate() {
            let sum: f32 = bands.iter().map(|band| band.values[i]).sum();
            assert!((sum - v).abs() < 1e-4, "plane {index}, pixel {i}: {sum} and {v}");
        }
    }
}

#[test]
fn bands_separate_directions_and_constants() {
    let stripes = GreyImage::from_fn(40, 40, |x, _| if x % 2 == 0 { 1.0 } else { -1.0 });
    let energy = |band: &GreyImage| band.values[20 * 40 + 20].abs();
    // The kernel's response at the highest frequency is 0: all of it is high along x.
    let bands = split(&stripes, 0);
    assert!((energy(&bands[1]) - 1.0).abs() < 1e-5, "{:?}", bands.iter().map(energy).collect::<Vec<_>>());
    let flat = split(&GreyImage::uniform(40, 40, 2.0), 0);
    assert!((energy(&flat[5]) - 2.0).abs() < 1e-5 && flat[..5].iter().all(|band| energy(band) < 1e-5));
}

#[test]
fn regression_recovers_the_coefficients_of_its_energies() {
    let wanted: Coefficients = [1.0, 0.5, -0.3, 0.0, 0.2, 0.0, 0.0, 0.1];
    let row = |i: usize| std::array::from_fn(|f| noise(i, f, 9, 1.0));
    let rows: Vec<[f32; FEATURES]> = (0..3000).map(row).collect();
    let energy = |row: &[f32; FEATURES]| {
        row.iter().zip(&wanted[1..]).fold(wanted[0], |sum, (v, g)| sum + f64::from(*v) * g).exp()
    };
    let energies: Vec<f64> = rows.iter().map(energy).collect();
    let got = regression::fit(&rows, &energies, None);
    // The ridge of 0.001 shrinks by about a thousandth.
    for (got, wanted) in got.iter().zip(wanted) {
        assert!((got - wanted).abs() < 5e-3, "{got} and {wanted}");
    }
}

#[test]
fn linear_system_matches_a_hand_worked_solution() {
    // 2 x + y = 5, x + 3 y = 10: x = 1, y = 3.
    let [x, y] = regression::solved([[2.0, 1.0], [1.0, 3.0]], [5.0, 10.0]);
    assert!((x - 1.0).abs() < 1e-12 && (y - 3.0).abs() < 1e-12, "{x} {y}");
}

#[test]
fn latent_table_starts_as_the_identity_and_steps_towards_real_means() {
    let mut table = LatentTable::default();
    assert_eq!([0.0, 0.75, 20.0, 127.5, 255.0].map(|v| table.at(1, v)), [0.0, 0.75, 20.0, 127.5, 255.0]);
    let mut step = LatentStep::default();
    for _ in 0..200 {
        // All unclipped; synthesised means are 2 above real ones at the node 4.
        step.add(0, 4.0, 4, 6);
        step.add(0, 127.5, 90, 100);
    }
    step.apply(&mut table);
    // 4 − 0.8 · 2 = 2.4 would fall below the node 3, which stays at 3.
    assert_eq!(table.at(0, 4.0), 3.0);
    assert_eq!(table.values[1], NODES, "other channels stay");
    assert_eq!(table.at(0, 127.5), 127.5, "values between 24 and 231 stay");
    assert!(table.is_valid());
}

#[test]
fn squares_of_overlapping_weights_sum_to_one() {
    for factor in [1, 2] {
        let overlap = OVERLAP_PX / factor;
        for t in 0..overlap {
            let sum = weight(t, factor).powi(2) + weight(t + CELL_PX / factor, factor).powi(2);
            assert!((sum - 1.0).abs() < 1e-5, "{t}: {sum}");
        }
        assert_eq!(weight(overlap, factor), 1.0);
    }
    // Cells cover 64 i − 16 to 64 i + 63.
    assert_eq!([1, 48, 64, 65].map(cell_count), [1, 1, 2, 2]);
}

#[test]
fn drawn_source_has_the_expected_rank() {
    let candidate = |i: u32| TileCandidate { frame: 0, at: [i, 0], descriptor: [i as f32; DESCRIPTORS] };
    let class: Vec<TileCandidate> = (0..480).map(candidate).collect();
    let candidates: [Vec<TileCandidate>; CLASSES] = std::array::from_fn(|_| class.clone());
    let rank =
        |i: u32| source([i % 40, i / 40], &[0.0; DESCRIPTORS], &candidates, &FrameKeys::single([5, 6, 7])).at[0] as f32;
    let mean = (0..1600).map(rank).sum::<f32>() / 1600.0;
    // The least of 20 draws among 480 has the mean 480 / 21 = 23; its standard error is 0.6.
    assert!((mean - EXPECTED_RANK as f32).abs() < 4.0, "{mean}");
}

#[test]
fn tiles_of_different_classes_do_not_overlap() {
    let classes = &MODEL.candidates;
    for (a, class) in classes.iter().enumerate() {
        for other in &classes[a + 1..] {
            for (p, q) in class.iter().flat_map(|p| other.iter().map(move |q| (p, q))) {
                let apart = (0..2).any(|axis| p.at[axis].abs_diff(q.at[axis]) >= TILE_PX as u32);
                assert!(p.frame != q.frame || apart, "{p:?} {q:?}");
            }
        }
    }
}

#[test]
fn noise_follows_the_brightness_of_the_content() {
    let model = &*MODEL;
    let codes = synthesise(model, &frame(1).mean, &coding([1, 1]), [1, 2, 3]).unwrap();
    for (columns, level, wanted) in [(8..92, 60.0, 2.0f32), (132..216, 180.0, 6.0)] {
        let columns = &columns;
        let green = (0..SIDE).flat_map(|y| columns.clone().map(move |x| 3 * (y * SIDE + x) + 1));
        let got = deviation(green.clone().map(|i| f32::from(codes[i])));
        let mean = green.clone().map(|i| f32::from(codes[i])).sum::<f32>() / green.count() as f32;
        // Rounding adds 1/12 to the variance twice; σ may be off by a tenth.
        assert!((got / (wanted * wanted + 1.0 / 6.0).sqrt() - 1.0).abs() < 0.1, "σ {got} instead of {wanted}");
        assert!((mean - level).abs() < 0.3, "{mean} instead of {level}");
    }
}

#[test]
fn frames_of_different_keys_are_uncorrelated_and_equal_keys_agree() {
    let content = uniform([320, 256], 120.0);
    let of = |key| noise_of(&MODEL, &content, key, None);
    let [a, b] = [of([1, 2, 3]), of([900, 1, 77])];
    assert_eq!(a, of([1, 2, 3]));
    let r = correlation(&a[0].values, &b[0].values);
    assert!(r.abs() < 0.08, "{r}");
}

#[test]
fn noise_of_a_smaller_picture_is_a_part_of_the_larger() {
    let [large, small] = [[320, 256], [200, 144]].map(|side| noise_of(&MODEL, &uniform(side, 90.0), [4, 4, 4], None));
    for (large, small) in large.iter().zip(&small) {
        for y in 0..144 {
            assert_eq!(large.values[y * 320..][..200], small.values[y * 200..][..200], "row {y}");
        }
    }
}

#[test]
fn amplitude_factor_scales_luma_by_pixel_and_chroma_by_its_mean() {
    let model = model([2, 1]);
    let content = uniform([64, 64], 120.0);
    let factor = GreyImage::from_fn(64, 64, |x, _| if x % 2 == 0 { 1.0 } else { 0.5 });
    let [whole, scaled] = [None, Some(&factor)].map(|factor| noise_of(&model, &content, [1, 1, 1], factor));
    for (i, (whole, scaled)) in whole[0].values.iter().zip(&scaled[0].values).enumerate() {
        assert_eq!(whole * factor.values[i], *scaled);
    }
    assert!(deviation(whole[1].values.iter().copied()) > 0.5, "there is noise in chroma");
    for (whole, scaled) in whole[1].values.iter().zip(&scaled[1].values) {
        assert_eq!(whole * 0.75, *scaled);
    }
}

#[test]
fn frames_at_rest_restore_the_variance_that_their_mean_takes() {
    let frames: Vec<Vec<u8>> = (0..5).map(|seed| frame(seed).noisy).collect();
    let mask = vec![true; SIDE * SIDE];
    let pairs = CalibrationFrame::at_rest(&frames, [SIDE, SIDE], &mask, 2).unwrap();
    assert_eq!((pairs.len(), pairs[1].noisy == frames[2], pairs[0].variance_gain), (2, true, 1.25));
    assert_eq!(
        CalibrationFrame::at_rest(&frames[..3], [SIDE, SIDE], &mask, 2),
        Err(ModelError::TooFewFrames { count: 3 })
    );
    let short = vec![frames[0].clone(), vec![0; 6], frames[0].clone(), frames[0].clone()];
    let refused = CalibrationFrame::at_rest(&short, [SIDE, SIDE], &mask, 2);
    assert!(matches!(refused, Err(ModelError::Size { frame: 1, .. })), "{refused:?}");
}

#[test]
fn unusable_frames_are_refused() {
    let none = calibrate(&[], &coding([1, 1]), 1);
    assert_eq!(none.err(), Some(ModelError::NoFrames));
    let masked = CalibrationFrame { mask: vec![false; SIDE * SIDE], ..frame(1) };
    let refused = calibrate(&[masked], &coding([1, 1]), 1);
    assert_eq!(refused.err(), Some(ModelError::TooFewTiles { actual: [0; CLASSES] }));
    let cut = CalibrationFrame { noisy: vec![0; 3], ..frame(1) };
    assert!(matches!(calibrate(&[cut], &coding([1, 1]), 1).err(), Some(ModelError::Size { frame: 0, .. })));
    let grey = PictureCoding { chroma: None, ..coding([1, 1]) };
    assert_eq!(calibrate(&[frame(1)], &grey, 1).err(), Some(ModelError::Grey));
}

#[test]
fn frames_of_different_quantisation_share_a_model_and_other_codings_are_refused() {
    let jpeg = |step: u16, origin: [i32; 2]| PictureCoding {
        quantization: Some(BlockQuantization { steps: [[step; 64]; 3], origin }),
        ..coding([1, 1])
    };
    let frames = [frame(1), frame(2)];
    let calibrated = |codings: [PictureCoding; 2]| {
        let coded: Vec<CodedFrame<'_>> =
            frames.iter().zip(&codings).map(|(frame, coding)| CodedFrame { frame, coding }).collect();
        calibrate_coded(&coded, 7)
    };
    let model = calibrated([jpeg(1, [0, 0]), jpeg(2, [0, 0])]).unwrap();
    assert_eq!(model.numbers.coding.difference(&jpeg(5, [-3, 0])), None);
    assert_eq!(model.numbers.coding.difference(&coding([1, 1])), Some(CodingDifference::Quantization));
    let refused = Some(ModelError::Coding { frame: 1 });
    assert_eq!(calibrated([jpeg(1, [0, 0]), jpeg(1, [-3, 0])]).err(), refused);
    assert_eq!(calibrated([jpeg(1, [0, 0]), coding([1, 1])]).err(), refused);
}

#[test]
fn model_read_from_its_file_is_equal() {
    let bytes = to_bytes(&MODEL).unwrap();
    assert!(from_bytes(&bytes).unwrap() == *MODEL, "numbers, atlas and candidates are the same bits");
}

#[test]
fn older_file_does_not_state_its_pictures() {
    let [source] = &MODEL.sources[..] else { panic!() };
    assert_eq!(source.picture, Some(SourcePicture { size_px: source.size, steps: None }));
    let mut older = NoiseModel::clone(&MODEL);
    older.sources[0].picture = None;
    let bytes = to_bytes(&older).unwrap();
    assert!(!bytes.windows(9).any(|window| window == b"\"picture\""));
    let read = from_bytes(&bytes).unwrap();
    let small = SourcePicture { size_px: [8, 8], steps: None };
    assert!(read == older && read.mismatch(small).is_none() && MODEL.mismatch(small).is_some());
    let resized = NoiseModel::clone(&MODEL).with_picture_sizes([[8, 8]]);
    assert!(resized.mismatch(small).is_none());
}

#[test]
fn damaged_files_are_refused() {
    let bytes = to_bytes(&MODEL).unwrap();
    assert!(matches!(from_bytes(b"PNG"), Err(ModelFileError::NoModel)));
    for length in [8, 11, 12, 19, 20, 100, bytes.len() / 2, bytes.len() - 1] {
        assert!(matches!(from_bytes(&bytes[..length]), Err(ModelFileError::Damaged { .. })), "{length} bytes");
    }
    let mut newer = bytes.clone();
    newer[8] = 2;
    assert!(matches!(from_bytes(&newer), Err(ModelFileError::Version { actual: 2 })));
    let mut flipped = bytes.clone();
    flipped[bytes.len() - 9] ^= 1;
    assert!(matches!(from_bytes(&flipped), Err(ModelFileError::Damaged { .. })));
    // A size in the header that its pictures do not have, under a valid checksum.
    let text = b"\"size\":[224,224]";
    let at = bytes.windows(text.len()).position(|window| window == text).unwrap();
    let mut other = bytes.clone();
    other[at + 8..at + 11].copy_from_slice(b"240");
    let sum = crc32fast::hash(&other[16..]).to_le_bytes();
    other[12..16].copy_from_slice(&sum);
    assert!(matches!(from_bytes(&other), Err(ModelFileError::Size { frame: 0, part: 0, .. })));
    // A size beyond the limit, with as many digits.
    let mut vast = bytes.clone();
    vast[at + 8..at + 15].copy_from_slice(b"9999999");
    let sum = crc32fast::hash(&vast[16..]).to_le_bytes();
    vast[12..16].copy_from_slice(&sum);
    assert!(matches!(from_bytes(&vast), Err(ModelFileError::Header(_) | ModelFileError::TooLarge { .. })));
}

#[test]
fn numbers_out_of_range_are_refused() {
    let refused = |change: &dyn Fn(&mut super::ModelNumbers)| {
        let mut numbers = MODEL.numbers;
        change(&mut numbers);
        NoiseModel::new(numbers, MODEL.sources.clone()).err()
    };
    assert_eq!(refused(&|n| n.gains[ALL_BANDS - 1][0] = f32::NAN), Some(ModelError::Numbers));
    assert_eq!(refused(&|n| n.scale.deviation[2] = 0.0), Some(ModelError::Numbers));
    assert_eq!(refused(&|n| n.latent.values[0][4] = -1.0), Some(ModelError::Numbers));
    assert_eq!(refused(&|n| n.coding.chroma.factor = [0, 1]), Some(ModelError::Numbers));
}

#[test]
fn clean_picture_of_another_size_is_synthesised() {
    let clean: Planes = std::array::from_fn(|_| GreyImage::uniform(37, 21, 120.0));
    assert_eq!(synthesise(&MODEL, &clean, &coding([1, 1]), [0, 0, 0]).unwrap().len(), 3 * 37 * 21);
}
