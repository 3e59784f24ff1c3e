//! Pixels through files: pictures and videos are read completely or refused.

use std::path::PathBuf;
use std::process::Command;

use crate::common;
use crate::files::{describe, frames, open, options, picture, refused, write};
use locard::pixels::Pixels;
use locard::recording::{OpenOptions, Recording};
use locard::sink::{self, OutPath, SinkOptions};
use locard::source::still;

/// Y'CbCr of a colour by the definitions: BT.601-7 2.5.1, BT.709-6 3.2 to 3.5, 8 or 10 bits.
fn ycbcr(rgb: [f64; 3], (kr, kb): (f64, f64), full: bool, bits: u32) -> [u16; 3] {
    let [r, g, b] = rgb.map(|c| c / 255.0);
    let y = kr * r + (1.0 - kr - kb) * g + kb * b;
    let (cb, cr) = ((b - y) / (2.0 * (1.0 - kb)), (r - y) / (2.0 * (1.0 - kr)));
    let unit = f64::from(1u32 << (bits - 8));
    let largest = 256.0 * unit - 1.0;
    let (luma, chroma) = if full { ((0.0, largest), largest) } else { ((16.0 * unit, 219.0 * unit), 224.0 * unit) };
    [luma.0 + luma.1 * y, 128.0 * unit + chroma * cb, 128.0 * unit + chroma * cr]
        .map(|v| v.round().clamp(0.0, largest) as u16)
}

/// The test converts the colours to Y'CbCr by formula and stores them losslessly.
#[test]
fn saturated_colours_are_decoded_within_2_codes() {
    let (bt601, bt709) = ((0.299, 0.114), (0.2126, 0.0722));
    // Height, pixel format, tags, matrix coefficients and range.
    let cases: [(u32, &str, &[&str], (f64, f64), bool); 8] = [
        (64, "yuv420p", &["-color_range", "tv", "-colorspace", "smpte170m"], bt601, false),
        (64, "yuv420p", &["-color_range", "tv", "-colorspace", "bt709"], bt709, false),
        (64, "yuv420p", &["-color_range", "pc", "-colorspace", "bt709"], bt709, true),
        (64, "yuv420p", &["-color_range", "pc", "-colorspace", "bt470bg"], bt601, true),
        (64, "yuv420p", &[], bt601, false),
        (720, "yuv420p", &[], bt709, false),
        (64, "yuv444p", &["-color_range", "tv", "-colorspace", "bt709"], bt709, false),
        (64, "yuv420p10le", &["-color_range", "tv", "-colorspace", "bt709"], bt709, false),
    ];
    for (height, format, tags, matrix, full) in cases {
        let folder = tempfile::tempdir().unwrap();
        let (bits, chroma) =
            (if format.ends_with("10le") { 10 } else { 8 }, if format.contains("444") { 1 } else { 4 });
        let colors = [[255.0, 0.0, 0.0], [0.0, 200.0, 10.0], [20.0, 30.0, 250.0], [250.0, 240.0, 5.0]];
        let mut raw = Vec::new();
        for color in colors {
            for (plane, value) in ycbcr(color, matrix, full, bits).into_iter().enumerate() {
                let count = 64 * height as usize / if plane == 0 { 1 } else { chroma };
                let bytes = value.to_le_bytes();
                raw.extend((0..count).flat_map(|_| bytes[..if bits == 8 { 1 } else { 2 }].to_vec()));
            }
        }
        std::fs::write(folder.path().join("raw"), raw).unwrap();
        let size = format!("64x{height}");
        let done = Command::new("ffmpeg")
            .args(["-v", "error", "-f", "rawvideo", "-pix_fmt", format, "-s", &size, "-framerate", "30", "-i"])
            .arg(folder.path().join("raw"))
            .args(["-c:v", "ffv1"])
            .args(tags)
            .arg(folder.path().join("v.mkv"))
            .status();
        assert!(done.expect("this test needs ffmpeg").success());
        let r = open(&describe(folder.path(), "[frames]\nvideo = \"v.mkv\"\n"));
        assert_eq!((r.frame_count(), r.width, r.height, r.bits), (4, 64, height, if bits == 8 { 8 } else { 16 }));
        for (frame, color) in frames(&r, 0..4).iter().zip(colors) {
            let scale = f64::from(frame.pixels.max_code()) / 255.0;
            for (actual, expected) in frame.pixels.at(31, 33).into_iter().zip(color) {
                let off = (f64::from(actual) / scale - expected).abs();
                assert!(off <= 2.0, "{format} {height} {tags:?} {color:?}: {:?}", frame.pixels.at(31, 33));
            }
        }
    }
}

/// Videos of the program's encoder, lossy x264 with tags, decode to the same colour.
#[test]
fn lossy_video_keeps_colours_within_2_codes() {
    for (width, height, name) in [(64, 48, "a.mp4"), (64, 720, "a.mkv"), (33, 47, "odd.mp4")] {
        let folder = tempfile::tempdir().unwrap();
        let colors = [[255u8, 0, 0], [0, 200, 10], [20, 30, 250]];
        let pictures = colors.map(|c| Pixels::from_u8(width, height, c.repeat((width * height) as usize)).unwrap());
        write(&folder.path().join(name), &SinkOptions { lossless: false, ..options(width, height, 8) }, &pictures);
        let r = open(&describe(folder.path(), &format!("[frames]\nvideo = \"{name}\"\n")));
        assert_eq!((r.width, r.height), (width, height));
        for (frame, color) in frames(&r, 0..3).iter().zip(colors) {
            for (actual, expected) in frame.pixels.at(width / 2, height / 2).into_iter().zip(color) {
                assert!(actual.abs_diff(expected.into()) <= 2, "{name} {color:?}: {:?}", frame.pixels.at(9, 9));
            }
        }
    }
}

#[test]
fn lossless_video_keeps_every_code_in_any_range() {
    for (name, bits) in [("a.mp4", 8), ("a.mkv", 8), ("a.mkv", 16)] {
        let folder = tempfile::tempdir().unwrap();
        let pictures: Vec<Pixels> = (0..20).map(|i| picture(i, 34, 22, bits)).collect();
        write(&folder.path().join(name), &options(34, 22, bits), &pictures);
        let r = open(&describe(folder.path(), &format!("[frames]\nvideo = \"{name}\"\n")));
        assert_eq!((r.frame_count(), r.bits), (20, bits), "{name}");
        assert!(r.timestamps_s.iter().enumerate().all(|(i, t)| (t - i as f64 / 30.0).abs() < 1e-12), "{name}");
        for range in [0..20, 7..13, 19..20, 5..5] {
            let got = frames(&r, range.clone());
            assert_eq!(got.len(), range.len());
            for (frame, i) in got.iter().zip(range) {
                assert!(frame.index == i && *frame.pixels == pictures[i], "{name}, {bits} bits, frame {i}");
            }
        }
        // Dropped in the middle: the child is killed, and another one starts.
        let mut half = r.frames(0..20).unwrap();
        half.next().unwrap().unwrap();
        drop(half);
    }
}

/// ffmpeg conceals errors in the middle and reports them; a missing end shows in a Matroska file's
/// length.
#[test]
fn damaged_video_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.mkv");
    // 16 bits are encoded as ffv1, whose slices have checksums.
    let pictures: Vec<Pixels> = (0..30).map(|i| picture(i, 64, 48, 16)).collect();
    write(&file, &options(64, 48, 16), &pictures);
    let whole = std::fs::read(&file).unwrap();
    let folder = describe(folder.path(), "[frames]\nvideo = \"a.mkv\"\n");
    assert_eq!(frames(&open(&folder), 0..30).len(), 30);
    assert!(!open(&folder).warnings.iter().any(|w| w.contains("a.mkv")), "{:?}", open(&folder).warnings);

    std::fs::write(&file, &whole[..whole.len() / 2]).unwrap();
    let error = refused(&folder);
    assert!(
        error.contains("a.mkv: ends after 0.") && error.contains("its header gives 1.000 s: is it truncated?"),
        "{error}"
    );

    let mut damaged = whole.clone();
    let middle = whole.len() / 2;
    damaged[middle..middle + 3000].fill(0);
    std::fs::write(&file, damaged).unwrap();
    let error = refused(&folder);
    assert!(error.contains("a.mkv: is damaged: ffprobe reports: "), "{error}");

    // A small hole inside a picture.
    let mut damaged = whole.clone();
    let inside = whole.len() / 2 + 1000;
    damaged[inside..inside + 40].fill(0);
    std::fs::write(&file, damaged).unwrap();
    let read: Result<Vec<_>, _> = open(&folder).frames(0..30).unwrap().collect();
    let error = read.map(|frames| frames.len()).unwrap_err().to_string();
    assert!(error.contains("a.mkv: is damaged at frame ") && error.contains("ffmpeg reports: "), "{error}");
}

#[test]
fn truncated_video_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let pictures: Vec<Pixels> = (0..20).map(|i| picture(i, 34, 22, 8)).collect();
    let file = folder.path().join("a.mp4");
    write(&file, &options(34, 22, 8), &pictures);
    let whole = std::fs::read(&file).unwrap();
    std::fs::write(&file, &whole[..whole.len() / 2]).unwrap();
    let folder = describe(folder.path(), "[frames]\nvideo = \"a.mp4\"\n");
    let error = match Recording::open(&folder, &OpenOptions::default()) {
        Err(e) => e.to_string(),
        Ok(r) => r.frames(0..r.frame_count()).unwrap().find_map(Result::err).expect("an error").to_string(),
    };
    assert!(error.contains("a.mp4"), "{error}");
    std::fs::write(&file, b"this is no video").unwrap();
    assert!(refused(&folder).contains("a.mp4: is not a video but text"), "{}", refused(&folder));
}

#[test]
fn png_folder_keeps_every_code_and_is_not_overwritten() {
    for bits in [8, 16] {
        let folder = tempfile::tempdir().unwrap();
        let out = folder.path().join("out");
        let pictures: Vec<Pixels> = (0..3).map(|i| picture(i, 5, 3, bits)).collect();
        write(&out, &options(5, 3, bits), &pictures);
        let mut names: Vec<_> = std::fs::read_dir(&out).unwrap().map(|e| e.unwrap().file_name()).collect();
        names.sort();
        assert_eq!(names, ["frame_000000.png", "frame_000001.png", "frame_000002.png"]);
        let r = open(&describe(folder.path(), "[frames]\nimages = \"out\"\nfps = 25.0\n"));
        assert_eq!((r.bits, r.frame_interval_s), (bits, 0.04));
        assert!(frames(&r, 0..3).iter().zip(&pictures).all(|(frame, p)| *frame.pixels == *p));
        let error = sink::open(&OutPath::parse(&out).unwrap(), &options(5, 3, bits)).err().unwrap().to_string();
        assert!(error.contains("exists already") && error.contains("--force"), "{error}");
        let forced = SinkOptions { force: true, ..options(5, 3, bits) };
        write(&out, &forced, &pictures[1..2]);
        assert!(*open(folder.path()).frames(0..1).unwrap().next().unwrap().unwrap().pixels == pictures[1]);
    }
}

#[test]
fn unfinished_video_is_removed_and_a_finished_one_kept() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mp4");
    let count = || std::fs::read_dir(folder.path()).unwrap().count();
    let open_sink = |force| sink::open(&OutPath::Video(path.clone()), &SinkOptions { force, ..options(16, 16, 8) });
    let mut unfinished = open_sink(false).unwrap();
    unfinished.write(0, &picture(0, 16, 16, 8)).unwrap();
    assert!(!path.exists(), "looks finished but is not");
    drop(unfinished);
    assert_eq!(count(), 0);
    write(&path, &options(16, 16, 8), &[picture(0, 16, 16, 8)]);
    let kept = std::fs::read(&path).unwrap();
    assert!(open_sink(false).err().unwrap().to_string().contains("exists already"));
    let mut forced = open_sink(true).unwrap();
    forced.write(0, &picture(5, 16, 16, 8)).unwrap();
    assert!(forced.write(1, &picture(5, 16, 8, 8)).unwrap_err().to_string().contains("16x8 with 8 bits; 16x16"));
    drop(forced);
    assert_eq!(std::fs::read(&path).unwrap(), kept);
    assert_eq!(count(), 1);
}

/// All truncations of pictures from other programs; progressive ones may end between two scans.
#[test]
fn truncated_jpeg_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let cut = folder.path().join("cut.jpg");
    for name in ["baseline-420", "grey-optimised", "restarts-422", "progressive-420"] {
        let file = PathBuf::from(format!("tests/jpeg/{name}.jpg"));
        let bytes = std::fs::read(&file).unwrap();
        let pixels = still::read_pixels(&file).unwrap();
        assert_eq!((pixels.width, pixels.height), (45, 37));
        let data = bytes.windows(2).position(|pair| pair == b"\xff\xda").unwrap() + 14;
        let passes = |length: &usize| {
            std::fs::write(&cut, [&bytes[..*length], b"\xff\xd9"].concat()).unwrap();
            let ends = still::check_end(&cut);
            assert_eq!(ends.is_ok(), still::read_pixels(&cut).is_ok());
            ends.is_ok()
        };
        let passed: Vec<usize> = (data..bytes.len() - 2).filter(passes).collect();
        let between = |at: &usize| bytes[*at] == 0xff && bytes[at + 1] != 0;
        let fits = |length: &usize| name.starts_with("progressive") && (between(length) || between(&(length - 1)));
        assert!(passed.iter().all(fits), "{name}: cut off after {passed:?} of {} bytes", bytes.len());
    }
}

/// Pictures of real cameras are accepted, but not without their second half.
#[test]
fn jpegs_of_real_cameras_are_accepted_and_truncated_ones_refused() {
    let Some(folder) = common::data("chessboard/camera_cal") else { return };
    let temp = tempfile::tempdir().unwrap();
    let cut = temp.path().join("cut.jpg");
    let mut count = 0;
    let more = ["chessboard/test_images", "lund-door-dslr/images"].into_iter().filter_map(common::data);
    for folder in std::iter::once(folder).chain(more) {
        for file in std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
            if !file.extension().is_some_and(|e| e.eq_ignore_ascii_case("jpg")) {
                continue;
            }
            still::check_end(&file).unwrap();
            let bytes = std::fs::read(&file).unwrap();
            std::fs::write(&cut, [&bytes[..bytes.len() / 2], b"\xff\xd9"].concat()).unwrap();
            let error = still::check_end(&cut).unwrap_err().to_string();
            assert!(error.contains("cut.jpg: the JPEG is truncated after"), "{}: {error}", file.display());
            count += 1;
        }
    }
    assert!(count >= 40, "{count}");
}

#[test]
fn video_without_its_index_is_reported_as_truncated() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mp4");
    let source = ["-v", "error", "-f", "lavfi", "-i", "testsrc=duration=1:size=64x48"];
    assert!(Command::new("ffmpeg").args(source).arg(&path).status().unwrap().success());
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() / 3]).unwrap();
    let error = refused(&describe(folder.path(), "[frames]\nvideo = \"a.mp4\"\n"));
    assert!(error.contains("a.mp4: is not a video, or is truncated before its index"), "{error}");
}
