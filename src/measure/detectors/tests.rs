//! Each family separates the defect that it is for, and not two draws of the same process.

use super::synthetic::{Normals, grey_picture};
use super::*;

/// Side of the pictures, px: 64 patches each.
const SIDE: usize = 256;

/// White noise of variance 1.
fn white(seed: u64) -> Vec<f64> {
    let mut normals = Normals::new(seed);
    (0..SIDE * SIDE).map(|_| normals.next()).collect()
}

/// Noise of variance 1 with a correlation of 0.4 between neighbours in a row.
fn correlated(seed: u64) -> Vec<f64> {
    let white = white(seed);
    let at = |i: usize| white[i % white.len()];
    // Taps a, b, a with b² + 2a² = 1 and 2ab = 0.4.
    let (a, b) = (0.2222, 0.9493);
    (0..white.len()).map(|i| a * at(i + white.len() - 1) + b * at(i) + a * at(i + 1)).collect()
}

/// Content of slow waves with noise of σ = 5 codes.
fn picture(noise: &[f64]) -> Pixels {
    let content = |i: usize| 120.0 + 30.0 * ((i % SIDE) as f64 / 40.0).sin() + 20.0 * ((i / SIDE) as f64 / 25.0).cos();
    grey_picture(SIDE, &noise.iter().enumerate().map(|(i, n)| content(i) + 5.0 * n).collect::<Vec<_>>())
}

fn scores(real: &PatchSource, virtual_: &PatchSource, family: DetectorFamily) -> Vec<DetectorScore> {
    let options = SeparabilityOptions { families: vec![family], ..SeparabilityOptions::default() };
    separability(&[*real], &[*virtual_], &options).unwrap()
}

fn assert_separates(real: &Pixels, virtual_: &Pixels, family: DetectorFamily) {
    for score in scores(&PatchSource::new(real), &PatchSource::new(virtual_), family) {
        assert!(score.auc > 0.95, "{score:?}");
        assert_eq!((score.real_patches, score.virtual_patches), (64, 64));
    }
}

/// Several pictures a side: with 64 patches the area scatters 1.4 times as much as its standard
/// error.
fn assert_chance(real: &[PatchSource], virtual_: &[PatchSource], family: DetectorFamily) {
    let options = SeparabilityOptions { families: vec![family], ..SeparabilityOptions::default() };
    for score in separability(real, virtual_, &options).unwrap() {
        assert!((score.auc - 0.5).abs() < 3.5 * score.standard_error, "{score:?}");
        assert!((0.02..0.04).contains(&score.standard_error), "{score:?}");
    }
}

fn jpeg(pixels: &Pixels) -> Pixels {
    let mut file = Vec::new();
    let mut encoder = image::codecs::jpeg::JpegEncoder::new_with_quality(&mut file, 85);
    let codes: Vec<u8> = pixels.each(|codes| codes.map(|code| code as u8)).concat();
    encoder.encode(&codes, pixels.width, pixels.height, image::ExtendedColorType::Rgb8).unwrap();
    let decoded = image::load_from_memory(&file).unwrap().to_rgb8();
    Pixels::from_u8(pixels.width, pixels.height, decoded.into_raw()).unwrap()
}

/// Noise whose 64×64 px cells are all parts of one example of 96×96 px.
fn repeated(seed: u64) -> Vec<f64> {
    let example = white(seed);
    let start = |cell: usize| [cell * 7 % 33, cell * 11 % 33];
    (0..SIDE * SIDE)
        .map(|i| {
            let (x, y) = (i % SIDE, i / SIDE);
            let [dx, dy] = start(y / 64 * 4 + x / 64);
            example[(y % 64 + dy) * SIDE + x % 64 + dx]
        })
        .collect()
}

#[test]
fn residual_moments_and_cooccurrences_separate_white_from_correlated_noise() {
    let (real, virtual_) = (picture(&correlated(1)), picture(&white(2)));
    assert_separates(&real, &virtual_, DetectorFamily::ResidualMoments);
    assert_separates(&real, &virtual_, DetectorFamily::Cooccurrences);
}

#[test]
fn block_dct_separates_noise_that_was_not_coded() {
    let (real, virtual_) = (jpeg(&picture(&white(3))), picture(&white(4)));
    assert_separates(&real, &virtual_, DetectorFamily::BlockDct);
}

#[test]
fn block_dct_separates_another_grid_of_blocks() {
    let coded = jpeg(&picture(&white(3)));
    let source = PatchSource::new(&coded);
    for score in scores(&source, &PatchSource { block_origin_px: [4, 0], ..source }, DetectorFamily::BlockDct) {
        assert!(score.auc > 0.95, "{score:?}");
    }
}

#[test]
fn copy_move_separates_repeated_noise() {
    let (real, virtual_) = (picture(&white(5)), picture(&repeated(6)));
    assert_separates(&real, &virtual_, DetectorFamily::CopyMove);
    let repeats = |pixels| find_repeats(&PatchSource::new(pixels)).unwrap().iter().filter(|t| t.is_repeat()).count();
    assert_eq!((repeats(&real), repeats(&virtual_)), (0, 64));
}

#[test]
fn frame_correlation_separates_noise_that_repeats_in_time() {
    let [first, second, other] = [7, 8, 9].map(|seed| picture(&white(seed)));
    let repeated: Vec<f64> = white(9).iter().zip(white(10)).map(|(a, b)| 0.6 * a + 0.8 * b).collect();
    let repeated = picture(&repeated);
    let real = PatchSource { next: Some(&second), ..PatchSource::new(&first) };
    let virtual_ = PatchSource { next: Some(&repeated), ..PatchSource::new(&other) };
    assert!(scores(&real, &virtual_, DetectorFamily::FrameCorrelation).iter().all(|score| score.auc > 0.95));
}

#[test]
fn two_draws_of_one_process_are_at_chance_for_every_family() {
    let pictures: Vec<Pixels> = (20..32).map(|seed| jpeg(&picture(&correlated(seed)))).collect();
    let sources: Vec<PatchSource> =
        (0..6).map(|i| PatchSource { next: Some(&pictures[i + 6]), ..PatchSource::new(&pictures[i]) }).collect();
    for family in DetectorFamily::SINGLE_FRAME.into_iter().chain([DetectorFamily::FrameCorrelation]) {
        if family != DetectorFamily::Combined {
            assert_chance(&sources[..3], &sources[3..], family);
        }
    }
}

#[test]
fn combined_family_has_the_features_of_the_requested_ones() {
    let (real, virtual_) = (picture(&white(13)), picture(&repeated(14)));
    let (real, virtual_) = ([PatchSource::new(&real)], [PatchSource::new(&virtual_)]);
    let families = vec![DetectorFamily::Combined, DetectorFamily::CopyMove, DetectorFamily::ResidualMoments];
    let options = SeparabilityOptions { families, ..SeparabilityOptions::default() };
    let scores = separability(&real, &virtual_, &options).unwrap();
    let families: Vec<_> = scores.iter().step_by(2).map(|score| score.family).collect();
    assert_eq!(families, [DetectorFamily::ResidualMoments, DetectorFamily::CopyMove, DetectorFamily::Combined]);
    assert!(scores[4].auc > 0.95 && scores[5].auc > 0.95, "{scores:?}");
    assert_eq!(scores, separability(&real, &virtual_, &options).unwrap());
}

#[test]
fn too_few_patches_are_an_error_with_the_number_needed() {
    let pixels = picture(&white(15));
    let mask: Vec<bool> = (0..SIDE * SIDE).map(|i| i / SIDE < 192).collect();
    let source = PatchSource::new(&pixels);
    let masked = PatchSource { mask: Some(&mask), ..source };
    let result = separability(&[source], &[masked], &SeparabilityOptions::default());
    let expected = MeasureError::TooFewPatches { side: "the virtual side", actual: 48, needed: 50 };
    assert_eq!(result, Err(expected));
    assert!(matches!(
        separability(&[], &[source], &SeparabilityOptions::default()),
        Err(MeasureError::TooFewPatches { side: "the real side", actual: 0, .. })
    ));
}

#[test]
fn unusable_input_is_an_error() {
    let pixels = picture(&white(16));
    let small = grey_picture(64, &[1.0; 64 * 64]);
    let source = PatchSource::new(&pixels);
    let judged = |source: PatchSource, options: &SeparabilityOptions| separability(&[source], &[source], options);
    let default = SeparabilityOptions::default();
    let short = PatchSource { mask: Some(&[true; 9]), ..source };
    assert!(matches!(judged(short, &default), Err(MeasureError::Length { actual: 9, .. })));
    let other_size = PatchSource { next: Some(&small), ..source };
    assert!(matches!(judged(other_size, &default), Err(MeasureError::Sizes { .. })));
    for folds in [0, 1, 11] {
        let options = SeparabilityOptions { folds, ..default.clone() };
        assert!(matches!(judged(source, &options), Err(MeasureError::Option { what: "folds", .. })));
    }
    let options = SeparabilityOptions { families: vec![DetectorFamily::FrameCorrelation], ..default };
    assert!(matches!(judged(source, &options), Err(MeasureError::Nothing(_))));
    assert!(find_repeats(&PatchSource::new(&grey_picture(32, &[1.0; 1024]))).is_err());
}

#[test]
fn constant_pictures_are_judged_without_undefined_values() {
    let flat = grey_picture(SIDE, &[200.0; SIDE * SIDE]);
    let options = SeparabilityOptions::default();
    for score in separability(&[PatchSource::new(&flat)], &[PatchSource::new(&flat)], &options).unwrap() {
        assert_eq!(score.auc, 0.5, "{score:?}");
    }
}
