//! Noise calibration compared with known noise, and with real cameras. One file, because the tests
//! share the simulated scenes and their noise.

use crate::common;
use crate::random::Random;
use crate::tier;
use locard::calibrate::noise::{from_known_means, from_scenes};
use locard::calibrate::{self, CalibrateError, NoiseCalibration, NoiseOptions, NoiseSource};
use locard::camera::NoiseProfile;
use locard::fit::quantile::midpoint_median;
use locard::pixels::{Codes, Pixels};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

fn noise_from_paths(
    frames: &[PathBuf],
    means: &[PathBuf],
    options: &NoiseOptions,
) -> Result<NoiseCalibration, CalibrateError> {
    let source = if means.is_empty() { NoiseSource::Rest } else { NoiseSource::KnownMeans(means) };
    let noise = calibrate::noise_from_paths(frames, source, options, &mut |_, _| ControlFlow::Continue(()));
    noise.map(|noise| noise.table)
}

/// A field of unit variance; `rho`: correlation between adjacent pixels in rows and columns.
fn field(random: &mut Random, width: usize, height: usize, rho: f64) -> Vec<f64> {
    let mut field: Vec<f64> = (0..width * height).map(|_| random.normal()).collect();
    let fresh = (1.0 - rho * rho).sqrt();
    for y in 0..height {
        for x in 1..width {
            field[y * width + x] = rho * field[y * width + x - 1] + fresh * field[y * width + x];
        }
    }
    for i in width..width * height {
        field[i] = rho * field[i - width] + fresh * field[i];
    }
    field
}

/// A camera of known noise.
struct Camera {
    /// σ at code 0 and at code 255, linear in between, for each channel.
    sigma: [[f64; 2]; 3],
    neighbour: f64,
    /// Correlation of two channels, 0 to 1.
    shared: f64,
}

const WIDTH: usize = 256;
const HEIGHT: usize = 160;

impl Camera {
    fn sigma(&self, channel: usize, code: f64) -> f64 {
        let [dark, bright] = self.sigma[channel];
        dark + (bright - dark) * code / 255.0
    }

    /// Frames of the scene `mean(x, y, frame, channel)`.
    fn shoot(&self, frames: usize, seed: u64, mean: impl Fn(usize, usize, usize, usize) -> f64) -> Vec<Pixels> {
        let mut random = Random::new(seed);
        (0..frames)
            .map(|frame| {
                let mut fields = [(); 4].map(|()| field(&mut random, WIDTH, HEIGHT, self.neighbour));
                let common = fields[3].clone();
                for field in &mut fields[..3] {
                    for (own, common) in field.iter_mut().zip(&common) {
                        *own = self.shared.sqrt() * common + (1.0 - self.shared).sqrt() * *own;
                    }
                }
                let codes = (0..WIDTH * HEIGHT * 3)
                    .map(|i| {
                        let (x, y, c) = (i / 3 % WIDTH, i / 3 / WIDTH, i % 3);
                        let m = mean(x, y, frame, c);
                        (m + self.sigma(c, m) * fields[c][i / 3]).round().clamp(0.0, 255.0) as u8
                    })
                    .collect();
                Pixels::from_u8(WIDTH as u32, HEIGHT as u32, codes).unwrap()
            })
            .collect()
    }
}

/// A chart from black to white; each channel has a slightly different gradient, which spreads the
/// fractional codes.
fn chart(x: usize, y: usize, _: usize, channel: usize) -> f64 {
    let t = (x as f64 + y as f64 / HEIGHT as f64) / WIDTH as f64;
    255.0 * if channel == 1 { 1.0 - t } else { t }
}

/// Largest relative error over the bins that have 4,000 independent samples.
fn worst(calibration: &NoiseCalibration, camera: &Camera) -> f64 {
    let mut worst = 0.0f64;
    for (channel, bins) in calibration.bins.iter().enumerate() {
        let good: Vec<_> = bins.iter().filter(|b| b.independent_count >= 4000.0).collect();
        assert!(good.len() >= 14, "only {} good bins:\n{calibration}", good.len());
        for bin in good {
            assert!(!bin.filled_from_neighbours);
            worst = worst.max((bin.sigma / camera.sigma(channel, bin.code) - 1.0).abs());
        }
    }
    println!("{calibration}worst relative error {worst:.4}");
    worst
}

const WHITE: Camera = Camera { sigma: [[0.3, 6.0], [1.0, 2.0], [0.8, 0.8]], neighbour: 0.0, shared: 0.0 };

/// Refused before reading: the zeros take no memory.
#[test]
fn picture_too_large_for_memory_is_refused() {
    let (width, height) = (1 << 13, (1 << 13) + 1);
    let large = Pixels::from_u8(width, height, vec![0; 3 * (width * height) as usize]).unwrap();
    let error = from_scenes(&[vec![large]], &NoiseOptions::default()).unwrap_err().to_string();
    assert!(error.contains("8192x8193") && error.contains("expected up to 67108864 pixels"), "{error}");
}

#[test]
fn white_noise_is_recovered_from_ten_frames() {
    let scene = WHITE.shoot(10, 1, chart);
    let calibration = from_scenes(&[scene], &NoiseOptions::default()).unwrap();
    assert!(worst(&calibration, &WHITE) < 0.05);
    assert_eq!(calibration.excluded_share, 0.0);
    let p = &calibration.profile;
    assert!(p.channel_correlation.iter().chain(&p.neighbour_correlation).all(|c| c.abs() < 0.02), "{p:?}");
    // The interval contains the truth about as often as claimed.
    let inside = (0..48).filter(|i| {
        let bin = &calibration.bins[i / 16][i % 16];
        let [low, high] = bin.sigma_ci95.unwrap();
        (low..=high).contains(&WHITE.sigma(i / 16, bin.code))
    });
    assert!(inside.count() >= 40);
}

#[test]
fn few_frames_and_small_sigma_are_not_biased() {
    let camera = Camera { sigma: [[0.3, 0.3], [0.5, 0.5], [0.9, 0.9]], neighbour: 0.0, shared: 0.0 };
    for frames in [2, 5] {
        // Integer codes contain little information on a σ of 0.3: with two scenes the worst of 48
        // bins is off by 5 % by chance alone.
        let scenes: Vec<_> = (0..8).map(|s| camera.shoot(frames, 10 + s, chart)).collect();
        let calibration = from_scenes(&scenes, &NoiseOptions::default()).unwrap();
        assert!(worst(&calibration, &camera) < 0.05);
    }
}

#[test]
fn correlated_noise_and_its_correlations_are_recovered() {
    let camera = Camera { sigma: [[1.0, 4.0], [2.0, 3.0], [3.0, 5.0]], neighbour: 0.6, shared: 0.4 };
    let scenes = [2, 3].map(|seed| camera.shoot(10, seed, chart));
    let calibration = from_scenes(&scenes, &NoiseOptions::default()).unwrap();
    assert!(worst(&calibration, &camera) < 0.05);
    assert!(calibration.excluded_share < 0.002);
    let p = &calibration.profile;
    assert!(p.channel_correlation.iter().all(|c| (c - 0.4).abs() < 0.03), "{p:?}");
    assert!(p.neighbour_correlation.iter().all(|c| (c - 0.6).abs() < 0.03), "{p:?}");
}

#[test]
fn clipped_codes_are_not_counted_as_quiet() {
    // Half of the picture is near the ends, a quarter of it beyond them.
    let camera = Camera { sigma: [[3.0, 6.0], [6.0, 3.0], [4.0, 4.0]], neighbour: 0.0, shared: 0.0 };
    let scene = camera.shoot(10, 4, |x, y, frame, c| {
        let t = chart(x, 0, frame, c);
        match y % 4 {
            0 => t / 12.0 - 8.0,
            1 => 263.0 - t / 12.0,
            _ => t,
        }
    });
    let calibration = from_scenes(&[scene], &NoiseOptions::default()).unwrap();
    assert!(calibration.bins[0][0].clipped_share > 0.3);
    assert!(worst(&calibration, &camera) < 0.05);
    assert!(calibration.excluded_share < 0.002, "{}", calibration.excluded_share);
}

#[test]
fn black_and_white_bins_are_filled_from_neighbours() {
    let camera = Camera { sigma: [[2.0, 2.0]; 3], neighbour: 0.0, shared: 0.0 };
    let scene = camera.shoot(10, 5, |x, _, _, _| [-30.0, 120.0, 130.0, 290.0][x / 64]);
    let calibration = from_scenes(&[scene], &NoiseOptions::default()).unwrap();
    for bins in &calibration.bins {
        for (i, bin) in bins.iter().enumerate() {
            assert_eq!(bin.filled_from_neighbours, !(7..=8).contains(&i), "{calibration}");
            assert!((bin.sigma - 2.0).abs() < 0.1, "{calibration}");
        }
    }
}

/// A busy patch that crosses the chart from above.
fn with_patch(x: usize, y: usize, frame: usize, channel: usize) -> f64 {
    let (left, top) = (30 + 9 * frame, 40 + 5 * frame);
    if (left..left + 40).contains(&x) && (top..top + 30).contains(&y) {
        return if ((x - left) / 3).is_multiple_of(2) { 200.0 } else { 90.0 };
    }
    chart(x, y, frame, channel)
}

#[test]
fn moving_patch_is_excluded_and_its_share_reported() {
    let camera = Camera { sigma: [[0.5, 3.0], [1.0, 2.0], [0.8, 0.8]], neighbour: 0.0, shared: 0.0 };
    for neighbour in [0.0, 0.5] {
        let camera = Camera { neighbour, ..camera };
        let scenes = [camera.shoot(10, 6, with_patch), camera.shoot(10, 7, chart)];
        let calibration = from_scenes(&scenes, &NoiseOptions::default()).unwrap();
        assert!(worst(&calibration, &camera) < 0.05);
        // The patch sweeps 121 × 75 pixels, less two corners: 16 % of one scene of two.
        assert!((0.05..0.13).contains(&calibration.excluded_share), "{}", calibration.excluded_share);
        let blind = NoiseOptions { leave_out_motion: false, ..NoiseOptions::default() };
        let blind = from_scenes(&scenes, &blind).unwrap();
        assert!(blind.bins[0][7].sigma > 1.5 * camera.sigma(0, 120.0), "the patch matters");
    }
}

#[test]
fn bright_flickering_area_is_not_counted_as_noise() {
    let camera = Camera { sigma: [[1.0, 2.0]; 3], neighbour: 0.0, shared: 0.0 };
    let scene = camera.shoot(10, 11, |x, y, frame, c| {
        let sign = (100..140).contains(&x) && (50..90).contains(&y);
        if sign { 190.0 + (x * 7 + y * 13 + frame * frame * 5) as f64 % 60.0 } else { 0.6 * chart(x, y, frame, c) }
    });
    let calibration = from_scenes(&[scene], &NoiseOptions::default()).unwrap();
    for (c, bins) in calibration.bins.iter().enumerate() {
        for bin in bins {
            assert!(bin.sigma < 1.1 * camera.sigma(c, bin.code), "{calibration}");
            assert_eq!(bin.filled_from_neighbours, bin.code > 160.0, "{calibration}");
        }
    }
}

#[test]
fn sigma_refers_to_the_bin_centre_for_any_distribution_of_codes() {
    let camera = Camera { sigma: [[0.3, 6.0], [6.0, 1.0], [2.0, 3.0]], neighbour: 0.0, shared: 0.0 };
    let scene = camera.shoot(10, 12, |x, y, frame, c| {
        let code = chart(x, y, frame, c);
        16.0 * (code / 16.0).floor() + 11.0 + (code % 16.0) / 4.0
    });
    let calibration = from_scenes(&[scene], &NoiseOptions::default()).unwrap();
    println!("{calibration}");
    for (c, bins) in calibration.bins.iter().enumerate() {
        for bin in &bins[1..15] {
            assert!((bin.sigma / camera.sigma(c, bin.code) - 1.0).abs() < 0.05, "{calibration}");
        }
    }
}

#[test]
fn creeping_camera_is_detected_where_there_is_detail() {
    let camera = Camera { sigma: [[1.0, 1.0]; 3], neighbour: 0.0, shared: 0.0 };
    // Stripes in the lower third, drifting by 0.3 pixels in total: a sixth more variance, too
    // little to stand out itself.
    let scene = camera.shoot(16, 8, |x, y, frame, c| {
        let m = 0.8 * chart(x, y, 0, c) + 20.0;
        let phase = (x as f64 + 0.02 * frame as f64) * 0.8;
        if y > 2 * HEIGHT / 3 { m + 8.5 * phase.sin() } else { m }
    });
    let calibration = from_scenes(&[scene], &NoiseOptions::default()).unwrap();
    println!("{calibration}");
    assert!((0.25..0.38).contains(&calibration.excluded_share), "{}", calibration.excluded_share);
    for bin in calibration.bins.iter().flatten().filter(|b| b.independent_count > 4000.0) {
        assert!((bin.sigma - 1.0).abs() < 0.05, "{calibration}");
    }
}

#[test]
fn single_noisy_frame_with_its_mean_is_sufficient() {
    let camera = Camera { sigma: [[0.4, 6.0], [1.0, 2.0], [0.8, 0.8]], neighbour: 0.0, shared: 0.0 };
    let still = Camera { sigma: [[0.0; 2]; 3], neighbour: 0.0, shared: 0.0 };
    let mean = still.shoot(1, 1, chart).remove(0);
    let scenes: Vec<_> = (0..4).map(|s| (mean.clone(), camera.shoot(1, 20 + s, chart))).collect();
    let calibration = from_known_means(&scenes, &NoiseOptions::default()).unwrap();
    assert!(worst(&calibration, &camera) < 0.05);
    // The last scene against a brighter mean: reported.
    let brighter = match &mean.codes {
        Codes::U8(codes) => codes.iter().map(|c| c.saturating_add(3)).collect(),
        Codes::U16(_) => unreachable!(),
    };
    let brighter = Pixels::from_u8(mean.width, mean.height, brighter).unwrap();
    let wrong = from_known_means(&[(brighter, scenes[0].1.clone())], &NoiseOptions::default()).unwrap();
    assert!(
        wrong.bins[1][8].mu < -2.5 && wrong.warnings.iter().any(|w| w.to_string().contains("same scene")),
        "{wrong}"
    );
}

#[test]
fn mean_of_another_scene_is_reported() {
    let camera = Camera { sigma: [[1.0, 2.0]; 3], neighbour: 0.0, shared: 0.0 };
    let frame = camera.shoot(1, 20, chart).remove(0);
    let other = match &frame.codes {
        Codes::U8(codes) => codes.rchunks(3).flatten().copied().collect(),
        Codes::U16(_) => unreachable!(),
    };
    let other = Pixels::from_u8(frame.width, frame.height, other).unwrap();
    let error = from_known_means(&[(other, vec![frame])], &NoiseOptions::default()).unwrap_err().to_string();
    assert!(error.contains("the mean is probably of another scene"), "{error}");
}

#[test]
fn sixteen_bit_pictures_give_the_same_profile() {
    let camera = Camera { sigma: [[0.05, 0.1], [1.0, 2.0], [3.0, 3.0]], neighbour: 0.0, shared: 0.0 };
    let mut random = Random::new(9);
    let frames: Vec<Pixels> = (0..6)
        .map(|_| {
            let codes = (0..WIDTH * HEIGHT * 3).map(|i| {
                let m = chart(i / 3 % WIDTH, i / 3 / WIDTH, 0, i % 3);
                (257.0 * (m + camera.sigma(i % 3, m) * random.normal())).round().clamp(0.0, 65535.0) as u16
            });
            Pixels::from_u16(WIDTH as u32, HEIGHT as u32, codes.collect()).unwrap()
        })
        .collect();
    let calibration = from_scenes(&[frames], &NoiseOptions::default()).unwrap();
    assert!(worst(&calibration, &camera) < 0.05);
}

#[test]
fn failed_calibrations_name_the_reason() {
    let one = WHITE.shoot(1, 1, chart);
    let options = NoiseOptions::default();
    let error = from_scenes(std::slice::from_ref(&one), &options).unwrap_err().to_string();
    assert!(error.contains("--mean"), "{error}");
    assert!(matches!(from_scenes(&[], &options), Err(CalibrateError::NoFrames)));
    let small = Pixels::from_u8(2, 2, vec![9; 12]).unwrap();
    let error = from_scenes(&[vec![one[0].clone(), small.clone()]], &options).unwrap_err().to_string();
    assert!(error.contains("2x2") && error.contains("256x160"), "{error}");
    let error = from_scenes(&[vec![small.clone(), small.clone()]], &options).unwrap_err().to_string();
    assert!(error.contains("1000 independent samples"), "{error}");
    let deep = Pixels::from_u16(2, 2, vec![9; 12]).unwrap();
    assert!(matches!(
        from_scenes(&[vec![small, deep]], &options),
        Err(CalibrateError::Depth { expected: 8, actual: 16 })
    ));
    let none = NoiseOptions { bins: 0, ..options };
    assert!(matches!(from_scenes(&[one], &none), Err(CalibrateError::Bins { actual: 0 })));
}

fn save(pixels: &Pixels, path: &Path) {
    let Codes::U8(codes) = &pixels.codes else { unreachable!() };
    image::save_buffer(path, codes, pixels.width, pixels.height, image::ColorType::Rgb8).unwrap();
}

#[test]
fn folders_are_scenes_and_loose_files_are_one() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    std::fs::create_dir(at("a")).unwrap();
    let frames = WHITE.shoot(3, 30, chart);
    for (i, frame) in frames.iter().enumerate() {
        save(frame, &at(&format!("a/{i}.png")));
        save(frame, &at(&format!("{i}.png")));
    }
    std::fs::write(at("a/notes.txt"), "no picture").unwrap();
    let options = NoiseOptions::default();
    let loose: Vec<PathBuf> = (0..3).map(|i| at(&format!("{i}.png"))).collect();
    let from_files = noise_from_paths(&loose, &[], &options).unwrap();
    assert_eq!((from_files.scenes, from_files.frames), (1, 3));
    assert_eq!(from_files, noise_from_paths(&[at("a")], &[], &options).unwrap());
    assert_eq!(from_files, from_scenes(&[frames], &options).unwrap());
    let both = noise_from_paths(&[at("a"), at("0.png"), at("1.png")], &[], &options).unwrap();
    assert_eq!((both.scenes, both.frames), (2, 5));

    // Stopped before the second of the three frames.
    let mut progress = Vec::new();
    let stopped = calibrate::noise_from_paths(&loose, NoiseSource::Rest, &options, &mut |done, all| {
        progress.push((done, all));
        if done == 1 { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    });
    assert!(matches!(stopped, Err(CalibrateError::Stopped)) && progress == [(0, 3), (1, 3)], "{progress:?}");
    let failure =
        |frames: &[PathBuf], means: &[PathBuf]| noise_from_paths(frames, means, &options).unwrap_err().to_string();
    let error = failure(&loose[..1], &[]);
    assert!(error.contains("0.png") && error.contains("--mean"), "{error}");
    std::fs::write(at("broken.png"), &std::fs::read(&loose[0]).unwrap()[..2000]).unwrap();
    let error = failure(&[loose[0].clone(), at("broken.png")], &[]);
    assert!(error.contains("broken.png"), "{error}");
    save(&Pixels::from_u8(2, 2, vec![9; 12]).unwrap(), &at("small.png"));
    let error = failure(&[loose[0].clone(), at("small.png")], &[]);
    assert!(error.contains("small.png") && error.contains("2x2"), "{error}");
    let error = failure(&[at("nowhere.png"), loose[0].clone()], &[]);
    assert!(error.contains("nowhere.png"), "{error}");
    std::fs::create_dir(at("empty")).unwrap();
    assert!(failure(&[at("empty")], &[]).contains("no pictures in this folder"));
    assert!(failure(&loose, &loose[..2]).contains("2 means for 3"));
}

type Bins = [[(f64, usize); 16]; 3];

/// Independent reference: the plain standard deviation by channel and bin of `real` − `mean`, and
/// the number of samples.
fn plain(mean: &Path, real: &Path) -> Bins {
    let (mean, real) = (image::open(mean).unwrap().into_rgb8(), image::open(real).unwrap().into_rgb8());
    let mut sums = [[(0.0, 0.0, 0usize); 16]; 3];
    for (m, r) in mean.pixels().zip(real.pixels()) {
        for c in 0..3 {
            let v = f64::from(r.0[c]) - f64::from(m.0[c]);
            let bin = &mut sums[c][usize::from(m.0[c]) / 16];
            *bin = (bin.0 + v, bin.1 + v * v, bin.2 + 1);
        }
    }
    sums.map(|c| c.map(|(s, s2, n)| ((s2 / n.max(1) as f64 - (s / n.max(1) as f64).powi(2)).max(0.0).sqrt(), n)))
}

/// Relative errors of the calibration and of the plain average in each bin of the third scene.
fn prediction_errors(folder: &Path, camera: &str, test: usize) -> Vec<(f64, f64)> {
    let file = |scene: usize, what: &str| folder.join(format!("{camera}_{scene}_{what}.png"));
    let training: Vec<usize> = (1..=3).filter(|s| *s != test).collect();
    let paths = |what: &str| training.iter().map(|s| file(*s, what)).collect::<Vec<_>>();
    let calibration = noise_from_paths(&paths("real"), &paths("mean"), &NoiseOptions::default()).unwrap();
    let p = &calibration.profile;
    assert!(p.neighbour_correlation.iter().all(|r| (0.45..0.80).contains(r)), "{p:?}");
    assert!(calibration.excluded_share < 0.01);
    println!("{camera}, scene {test} from the other two\n{calibration}");
    println!("  codes channel      n  direct  calibrated  plain");
    let truth = plain(&file(test, "mean"), &file(test, "real"));
    let plains: Vec<Bins> = training.iter().map(|s| plain(&file(*s, "mean"), &file(*s, "real"))).collect();
    let mut errors = Vec::new();
    for c in 0..3 {
        for bin in (0..16).filter(|b| truth[c][*b].1 >= 5000) {
            let (sigma, n) = truth[c][bin];
            let sigmas: Vec<f64> = plains.iter().map(|p| p[c][bin]).filter(|p| p.1 > 1).map(|p| p.0).collect();
            let average = sigmas.iter().sum::<f64>() / sigmas.len() as f64;
            let predicted = p.sigma(c, calibration.bins[c][bin].code);
            println!("{:7} {:>7} {n:6} {sigma:7.3} {predicted:11.3} {average:6.3}", 16 * bin, ["R", "G", "B"][c]);
            if !sigmas.is_empty() {
                errors.push(((predicted / sigma - 1.0).abs(), (average / sigma - 1.0).abs()));
            }
        }
    }
    errors
}

#[test]
fn two_scenes_of_a_real_camera_predict_the_third() {
    let Some(folder) = common::data("noise-pairs") else { return };
    let compare = |what: &str, errors: &[(f64, f64)]| {
        let (ours, theirs) = (
            midpoint_median(errors.iter().map(|e| e.0)).unwrap(),
            midpoint_median(errors.iter().map(|e| e.1)).unwrap(),
        );
        let ratio = ours / theirs;
        println!("{what}: {} bins, median relative error {ours:.3}, plain {theirs:.3}, ratio {ratio:.3}", errors.len());
        assert!(ratio <= 1.1, "{what}: {ours} against {theirs}");
    };
    let cameras = ["5dmark3_iso3200", "d800_iso1600", "d800_iso3200"];
    for camera in tier::fast_or_full(&cameras[1..2], &cameras) {
        let mut all = Vec::new();
        for test in 1..=3 {
            let errors = prediction_errors(&folder, camera, test);
            compare(&format!("RESULT {camera} {test}"), &errors);
            all.extend(errors);
        }
        compare(&format!("RESULT {camera}"), &all);
    }
}

#[test]
fn noise_of_a_resting_machine_vision_camera_matches_its_known_values() {
    let Some(folder) = common::data("static-burst-grey") else { return };
    let calibration = noise_from_paths(&[folder], &[], &NoiseOptions::default()).unwrap();
    println!("{calibration}");
    assert_eq!(calibration.frames, 16);
    let good: Vec<_> = calibration.bins[0].iter().filter(|b| !b.filled_from_neighbours).collect();
    // Including rounding: 0.8 at code 40, 1.8 at code 232.
    assert!((0.70..0.80).contains(&calibration.bins[0][2].sigma), "{calibration}");
    assert!((1.65..1.80).contains(&calibration.bins[0][14].sigma), "{calibration}");
    assert!(good.len() >= 13 && good.windows(2).all(|w| w[0].sigma < 1.1 * w[1].sigma), "{calibration}");
    assert_eq!(calibration.profile.channel_correlation, [1.0; 3]);
    // Grey is stored three times.
    let NoiseProfile { bins: [r, g, b], .. } = &calibration.profile;
    assert!(r == g && g == b);
}

fn refused(frames: &[PathBuf]) -> String {
    noise_from_paths(frames, &[], &NoiseOptions::default()).unwrap_err().to_string()
}

/// Frames of a hand-held camera, slow and fast, and of distant views. The message names the folder
/// and gives advice.
#[test]
fn frames_of_a_moving_real_camera_are_refused() {
    let Some(folder) = common::data("tum-fr1-rpy/rgb") else { return };
    let mut files: Vec<PathBuf> = std::fs::read_dir(&folder).unwrap().map(|f| f.unwrap().path()).collect();
    files.sort();
    for (some, message) in [
        (files[..6].to_vec(), "the whole picture moves"),
        (files[40..46].to_vec(), "the whole picture moves"),
        (files[70..76].to_vec(), "the whole picture moves"),
        (files.iter().step_by(30).cloned().collect(), "changes in whole patches"),
    ] {
        let error = refused(&some);
        assert!(
            error.contains(message) && error.contains("scene 1 is not at rest") && error.contains("rgb: "),
            "{error}"
        );
    }
}

/// The demonstration's camera is hand-held: at its slowest (first frames) and at its fastest.
#[test]
fn frames_of_a_simulated_hand_are_refused() {
    let frame = |i: usize| PathBuf::from(format!("recordings/demo/rgb/{i:05}.jpg"));
    for start in [0, 28, 60] {
        let error = refused(&(start..start + 6).map(frame).collect::<Vec<_>>());
        assert!(error.contains("is not at rest: the whole picture moves"), "{start}: {error}");
    }
}
