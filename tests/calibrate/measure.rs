//! Displacement measurements compared with known shifts of an analytic picture.

use crate::tier;
use locard::grey_image::GreyImage;
use locard::measure::displacement::{DisplacementOptions, Displacements, PatchDisplacement, displacements};

fn hash(mut x: u64) -> f64 {
    x = (x ^ (x >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((x ^ (x >> 31)) >> 11) as f64 / (1u64 << 53) as f64
}

/// Approximately normal, variance 1.
fn noise(seed: u64) -> f64 {
    (0..12).map(|i| hash(seed * 12 + i)).sum::<f64>() - 6.0
}

const SIZE: usize = 128;

/// Forty soft spots and a checkered ramp, exactly shifted, with noise of `sigma` that depends on
/// `seed`.
fn picture(shift: [f64; 2], sigma: f64, seed: u64) -> GreyImage<f64> {
    let spots: Vec<[f64; 4]> = (0..220)
        .map(|i| {
            let r = |k: u64| hash(4 * i + k + 1000);
            [160.0 * r(0) - 16.0, 160.0 * r(1) - 16.0, 1.2 + 3.0 * r(2), 160.0 * r(3) - 80.0]
        })
        .collect();
    let values = (0..SIZE * SIZE)
        .map(|i| {
            let (x, y) = ((i % SIZE) as f64 - shift[0], (i / SIZE) as f64 - shift[1]);
            let content: f64 = spots
                .iter()
                .map(|[cx, cy, s, height]| height * (-((x - cx).powi(2) + (y - cy).powi(2)) / (2.0 * s * s)).exp())
                .sum();
            (120.0 + content + sigma * noise(seed * 1_000_000 + i as u64)).round()
        })
        .collect();
    GreyImage::new(SIZE, SIZE, values).unwrap()
}

#[test]
fn shifts_come_back_within_a_twentieth_of_a_pixel() {
    let options = DisplacementOptions::default();
    for sigma in [0.0, 2.0] {
        let a = picture([0.0, 0.0], sigma, 1);
        let shifts = [[0.0, 0.0], [0.1, -0.2], [0.33, 0.5], [-0.75, 0.25], [1.5, 2.25], [-4.6, 3.3], [6.2, -7.4]];
        let some = tier::fast_or_full(&[0, 2, 3, 6][..], &[0, 1, 2, 3, 4, 5, 6]);
        for &i in some {
            let shift = shifts[i];
            let measured = displacements(&a, &picture(shift, sigma, 2 + i as u64), None, &options).unwrap();
            let [x, y] = measured.median_px().unwrap();
            let errors: Vec<f64> = measured
                .patches
                .iter()
                .map(|p| (p.displacement_px[0] - shift[0]).hypot(p.displacement_px[1] - shift[1]))
                .collect();
            let near = errors.iter().filter(|e| **e < if sigma > 0.0 { 0.3 } else { 0.15 }).count();
            println!(
                "shift {shift:?}, noise {sigma}: {x:.4} {y:.4}, {} patches, {near} near, {} flat, {} unreliable",
                errors.len(),
                measured.flat,
                measured.unreliable
            );
            assert!((x - shift[0]).hypot(y - shift[1]) < 0.05, "{x} {y} for {shift:?}");
            assert!(errors.len() >= 35 && 10 * near >= 9 * errors.len(), "{near} of {}", errors.len());
            let length = measured.median_length_px().unwrap();
            assert!((length - shift[0].hypot(shift[1])).abs() < 0.1);
        }
    }
}

#[test]
fn flat_and_masked_patches_give_no_displacement() {
    let options = DisplacementOptions::default();
    let flat = GreyImage::new(SIZE, SIZE, vec![50.0; SIZE * SIZE]).unwrap();
    let of_flat = displacements(&flat, &flat, None, &options).unwrap();
    assert_eq!((of_flat.patches.len(), of_flat.flat, of_flat.median_length_px()), (0, 49, None));
    // Noise that the pictures do not share is no content.
    let grain = |seed: u64| {
        GreyImage::new(
            SIZE,
            SIZE,
            (0..SIZE as u64 * SIZE as u64).map(|i| 50.0 + 3.0 * noise(seed * 100_000 + i)).collect(),
        )
        .unwrap()
    };
    let of_noise = displacements(&grain(1), &grain(2), None, &options).unwrap();
    assert_eq!(of_noise.patches.len(), 0, "{of_noise:?}");
    let (a, b) = (picture([0.0; 2], 0.0, 1), picture([1.0, 0.0], 0.0, 1));
    let left: Vec<bool> = (0..SIZE * SIZE).map(|i| i % SIZE < 64).collect();
    let of_masked = displacements(&a, &b, Some(&left), &options).unwrap();
    assert!(of_masked.masked == 28 && of_masked.patches.iter().all(|p| p.centre_px[0] <= 48.0), "{of_masked:?}");
}

#[test]
fn standard_error_covers_the_error_and_a_straight_edge_is_not_trusted() {
    let options = DisplacementOptions::default();
    let (a, b) = (picture([0.0; 2], 4.0, 1), picture([0.3, 0.2], 4.0, 2));
    let measured = displacements(&a, &b, None, &options).unwrap();
    let in_sigmas = |p: &PatchDisplacement| (p.displacement_px[0] - 0.3).hypot(p.displacement_px[1] - 0.2) / p.sigma_px;
    let mut errors: Vec<f64> = measured.patches.iter().map(in_sigmas).collect();
    errors.sort_by(f64::total_cmp);
    let (median, p90) = (errors[errors.len() / 2], errors[errors.len() * 9 / 10]);
    // Of two Gaussian numbers in units of the larger one's σ: 1.18 and 2.15.
    assert!((0.5..1.5).contains(&median) && p90 < 3.0, "{median} {p90}");
    // The position along a straight edge is determined by noise alone.
    let edge = |seed: u64| {
        let value = |i: usize| 30.0 + 6.0 * ((i % SIZE) as f64 - 60.0).clamp(0.0, 8.0);
        let values = (0..SIZE * SIZE).map(|i| value(i) + 2.0 * noise(seed * 100_000 + i as u64)).collect();
        GreyImage::new(SIZE, SIZE, values).unwrap()
    };
    let all: Vec<Displacements> =
        (0..20).map(|n| displacements(&edge(2 * n), &edge(2 * n + 1), None, &options).unwrap()).collect();
    let trusted: usize = all.iter().map(|measured| measured.patches.len()).sum();
    let flat: usize = all.iter().map(|measured| measured.flat).sum();
    assert!(flat > 500 && 100 * trusted <= flat, "{trusted} of {flat}");
}

#[test]
fn failed_measurements_name_the_reason() {
    let options = DisplacementOptions::default();
    let (a, small) = (picture([0.0; 2], 0.0, 1), GreyImage::new(2, 1, vec![0.0; 2]).unwrap());
    assert!(displacements(&a, &small, None, &options).unwrap_err().to_string().contains("128x128 and 2x1"));
    assert!(displacements(&a, &a, Some(&[true]), &options).is_err());
    assert!(displacements(&a, &a, None, &DisplacementOptions { patch_px: 4, ..options.clone() }).is_err());
    assert!(displacements(&a, &a, None, &DisplacementOptions { step_px: 0, ..options.clone() }).is_err());
    assert!(displacements(&small, &small, None, &options).unwrap().patches.is_empty());
    let nan = GreyImage::new(SIZE, SIZE, vec![f64::NAN; SIZE * SIZE]).unwrap();
    assert!(displacements(&nan, &nan, None, &options).unwrap().patches.is_empty());
    assert!(GreyImage::new(3, 3, vec![0.0; 8]).is_none());
}
