//! Recordings with an unusable file or frame: the rest opens, and omissions are counted and named.
//! One file, because the tests share the writers of damaged files.

use std::fs;
use std::path::Path;
use std::process::Command;

use crate::files::{describe, frames, open, options, picture, refused, write};
use crate::program;
use image::{ImageBuffer, Luma};
use locard::camera::Curve;
use locard::pixels::Pixels;
use locard::recording::{OpenOptions, Recording};
use locard::sink::SinkOptions;
use locard::source::orientation::Orientation;
use locard::source::presentation::Presentation;
use locard::source::still;

/// Pictures of 8×6 px in `images/` under these names.
fn pictures(folder: &Path, names: &[&str]) {
    fs::create_dir_all(folder.join("images")).unwrap();
    for (i, name) in names.iter().enumerate() {
        let code = |x, y| image::Rgb([x as u8 * 20, y as u8 * 30, i as u8]);
        image::RgbImage::from_fn(8, 6, code).save(folder.join("images").join(name)).unwrap();
    }
}

/// A `transforms.json` for these names, with additional keys for all and for each frame.
fn transforms(folder: &Path, names: &[&str], common: &str, own: impl Fn(usize) -> String) {
    let entry = |(i, name): (usize, &&str)| {
        format!(
            r#"{{"file_path": "images/{name}"{}, "transform_matrix": [[1,0,0,{i}],[0,1,0,0],[0,0,1,0],[0,0,0,1]]}}"#,
            own(i)
        )
    };
    let all: Vec<String> = names.iter().enumerate().map(entry).collect();
    fs::write(folder.join("transforms.json"), format!("{{{common}, \"frames\": [{}]}}", all.join(","))).unwrap();
}

const CAMERA: &str = r#""w": 8, "h": 6, "fl_x": 7"#;

fn depth(file: &Path) {
    ImageBuffer::from_pixel(8, 6, Luma([1500u16])).save(file).unwrap();
}

/// Number of warnings that contain a text.
fn warning_count(recording: &Recording, text: &str) -> usize {
    recording.warnings.iter().filter(|warning| warning.contains(text)).count()
}

const JPEG_LS: &[u8] = b"\xff\xd8\xff\xf7\0\x0b\x08\0\x06\0\x08\x01";

#[test]
fn colmap_pictures_of_another_orientation_are_left_out() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path();
    pictures(folder, &["a1.png", "a2.png", "a3.png"]);
    image::RgbImage::new(6, 8).save(folder.join("images/a2.png")).unwrap();
    let model = folder.join("sparse/0");
    fs::create_dir_all(&model).unwrap();
    fs::write(model.join("cameras.txt"), "1 SIMPLE_PINHOLE 8 6 7 4 3\n2 SIMPLE_PINHOLE 6 8 7 3 4\n").unwrap();
    let line = |i: usize, camera: usize| format!("{i} 1 0 0 0 {i} 0 0 {camera} a{i}.png\n\n");
    fs::write(model.join("images.txt"), line(1, 1) + &line(2, 2) + &line(3, 1)).unwrap();
    let r = open(folder);
    assert_eq!((r.frame_count(), r.width, r.height), (2, 8, 6));
    assert!((r.timestamps_s[1] - 2.0 / 30.0).abs() < 1e-12);
    assert_eq!(r.pose_at_frame(1).unwrap().translation_m.x, 3.0);
    assert_eq!(
        warning_count(&r, "left out because most pictures are 8x6 with 8 bits: 1 of 3 pictures (first: "),
        1,
        "{:?}",
        r.warnings
    );
}

#[test]
fn infinite_seven_scenes_pose_is_ignored() {
    let temp = tempfile::tempdir().unwrap();
    for i in 0..4 {
        image::RgbImage::new(8, 6).save(temp.path().join(format!("frame-00000{i}.color.png"))).unwrap();
        let pose =
            if i == 2 { "-inf -inf -inf -inf\n".repeat(4) } else { "1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n".to_owned() };
        fs::write(temp.path().join(format!("frame-00000{i}.pose.txt")), pose).unwrap();
    }
    let r = open(temp.path());
    let has: Vec<bool> = (0..4).map(|i| r.pose_at_frame(i).is_ok()).collect();
    assert_eq!(has, [true, true, false, true]);
    assert_eq!(
        warning_count(&r, "1 of 4 poses is not finite or has no rotation (first at frame-000002.pose.txt)"),
        1,
        "{:?}",
        r.warnings
    );
}

#[test]
fn unreadable_depth_is_left_out() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path();
    let names = ["a1.png", "a2.png", "a3.png"];
    pictures(folder, &names);
    let own = |i: usize| format!(r#", "depth_file_path": "d{i}""#);
    transforms(folder, &names, CAMERA, own);
    for i in 0..3 {
        fs::write(folder.join(format!("d{i}")), b"\x93NUMPY\x01\0").unwrap();
    }
    let r = open(folder);
    assert_eq!((r.frame_count(), r.has_depth()), (3, false));
    let message = "3 of 3 depth pictures cannot be read, and their frames have no depth (first: ";
    assert_eq!(warning_count(&r, message), 1, "{:?}", r.warnings);
    assert_eq!(warning_count(&r, "the array is truncated in its header"), 1, "{:?}", r.warnings);
    fs::write(folder.join("d0"), b"BM").unwrap();
    let message = "is not a depth picture, but BMP; expected 16-bit grey PNG, TIFF or PGM, floating-point TIFF, OpenEXR or NumPy arrays";
    assert_eq!(warning_count(&open(folder), message), 1);
    // One missing depth file among others.
    image::save_buffer(folder.join("d.png"), &[1; 96], 8, 6, image::ExtendedColorType::L16).unwrap();
    for i in 0..2 {
        fs::copy(folder.join("d.png"), folder.join(format!("d{i}"))).unwrap();
    }
    fs::remove_file(folder.join("d2")).unwrap();
    let r = open(folder);
    assert_eq!(frames(&r, 0..3).iter().map(|frame| frame.depth.is_some()).collect::<Vec<_>>(), [true, true, false]);
    assert_eq!(warning_count(&r, "1 of 3 depth pictures cannot be read"), 1, "{:?}", r.warnings);
}

#[test]
fn truncated_depth_is_counted_when_it_is_decoded() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path();
    write(&folder.join("rgb"), &options(8, 6, 8), &[0, 1, 2].map(|i| picture(i, 8, 6, 8)));
    let list = |name: &dyn Fn(usize) -> String| (0..3).map(|i| format!("{i} {}\n", name(i))).collect::<String>();
    fs::write(folder.join("rgb.txt"), list(&|i| format!("rgb/frame_00000{i}.png"))).unwrap();
    fs::write(folder.join("depth.txt"), list(&|i| format!("d{i}.png"))).unwrap();
    fs::write(folder.join("groundtruth.txt"), "0 0 0 0 0 0 0 1\n2 0 0 0 0 0 0 1\n").unwrap();
    for i in 0..3 {
        depth(&folder.join(format!("d{i}.png")));
    }
    let whole = fs::read(folder.join("d1.png")).unwrap();
    fs::write(folder.join("d1.png"), &whole[..40]).unwrap();
    let r = open(folder);
    assert_eq!(r.undecoded_depth(), None);
    // `inspect` decodes none of them.
    let inspected = program::stdout_of(&["inspect", folder.to_str().unwrap()]);
    assert!(
        inspected.contains("odd        1 of 3 depth pictures cannot be read, and its frames have no depth"),
        "{inspected}"
    );
    assert_eq!(frames(&r, 0..3).iter().map(|frame| frame.depth.is_some()).collect::<Vec<_>>(), [true, false, true]);
    let warning = r.undecoded_depth().unwrap();
    assert!(warning.starts_with("1 of 3 depth pictures cannot be read") && warning.contains("d1.png: "), "{warning}");
}

/// An array of 6×8 floats as written by `numpy.save`.
fn npy(file: &Path, metres: f32) {
    let text = "{'descr': '<f4', 'fortran_order': False, 'shape': (6, 8), }\n";
    let head = [b"\x93NUMPY\x01\0", &(text.len() as u16).to_le_bytes()[..], text.as_bytes()].concat();
    fs::write(file, [head, metres.to_le_bytes().repeat(48)].concat()).unwrap();
}

#[test]
fn floating_point_depth_uses_the_recorded_unit_and_a_missing_unit_is_reported() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path();
    pictures(folder, &["0.png", "1.png"]);
    npy(&folder.join("d0.npy"), 1.5);
    exr::prelude::write_rgb_file(folder.join("d1.exr"), 8, 6, |_, _| (1.5f32, 1.5f32, 1.5f32)).unwrap();
    let own = |i: usize| format!(r#", "depth_file_path": "d{i}.{}""#, ["npy", "exr"][i]);
    let metres =
        |r: &Recording| -> Vec<f32> { frames(r, 0..2).iter().map(|f| f.depth.as_ref().unwrap().depth_m[9]).collect() };
    transforms(folder, &["0.png", "1.png"], &format!(r#"{CAMERA}, "depth_unit_scale_factor": 1.0"#), own);
    let r = open(folder);
    assert_eq!((metres(&r), warning_count(&r, "floating-point depth")), (vec![1.5; 2], 0));
    transforms(folder, &["0.png", "1.png"], CAMERA, own);
    let r = open(folder);
    assert_eq!(
        (metres(&r), warning_count(&r, "d0.npy: holds floating-point depth")),
        (vec![0.0015; 2], 1),
        "{:?}",
        r.warnings
    );
    assert_eq!(warning_count(&r, "write \"depth_unit_scale_factor\": 1.0 into the file"), 1, "{:?}", r.warnings);
    describe(folder, "[frames]\nimages = \"images\"\nfps = 1.0\n[depth]\nlist = \"d.txt\"\nscale = 1.0\n");
    fs::write(folder.join("d.txt"), "0 d0.npy\n1 d1.exr\n").unwrap();
    let r = open(folder);
    assert_eq!((metres(&r), warning_count(&r, "floating-point depth")), (vec![1.5; 2], 0));
}

#[test]
fn nerfstudio_names_without_an_extension_match_any_picture() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path();
    pictures(folder, &["a1.png", "a2.jpg", "a.3.JPEG"]);
    transforms(folder, &["a1", "a2", "a.3"], CAMERA, |_| String::new());
    assert_eq!(open(folder).frame_count(), 3);
    transforms(folder, &["a1", "none"], CAMERA, |_| String::new());
    assert!(refused(folder).contains("images/none: cannot be read"), "{}", refused(folder));
}

#[test]
fn unreadable_pictures_of_a_folder_are_named_and_keep_their_index() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path();
    pictures(folder, &["f000.jpg", "f002.jpg", "f004.jpg"]);
    for name in ["f001.jls", "f003.jls"] {
        fs::write(folder.join("images").join(name), JPEG_LS).unwrap();
    }
    describe(folder, "[frames]\nimages = \"images\"\nfps = 30.0\n");
    let r = open(folder);
    let times: Vec<f64> = r.timestamps_s.iter().map(|time_s| (time_s * 30.0).round()).collect();
    assert_eq!(times, [0.0, 2.0, 4.0]);
    assert_eq!(warning_count(&r, "2 pictures are not read (first: "), 1, "{:?}", r.warnings);
    assert_eq!(warning_count(&r, "f001.jls is JPEG-LS, which is not read; convert it: ffmpeg "), 1, "{:?}", r.warnings);
    assert_eq!(warning_count(&r, "missing by their numbers"), 0, "{:?}", r.warnings);
    for name in ["f000.jpg", "f002.jpg", "f004.jpg"] {
        fs::remove_file(folder.join("images").join(name)).unwrap();
    }
    let error = refused(folder);
    assert!(error.contains("2 pictures are not read") && error.contains("ffmpeg"), "{error}");
    // Only arrays.
    fs::create_dir(folder.join("arrays")).unwrap();
    npy(&folder.join("arrays/0.npy"), 1.0);
    describe(folder, "[frames]\nimages = \"arrays\"\nfps = 30.0\n");
    let error = refused(folder);
    assert!(error.contains("1 picture is not read (first: ") && error.contains("0.npy is a NumPy array"), "{error}");
    // Without any file that describes a recording.
    let error = refused(&folder.join("images"));
    assert!(error.contains("not a recording: 2 pictures are not read") && error.contains("ffmpeg"), "{error}");
}

#[test]
fn foreign_format_named_jpg_affects_only_its_own_frame() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path();
    pictures(folder, &["f0.jpg", "f1.jpg", "f4.jpg"]);
    let pointer = b"version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 123456\n";
    let foreign: [(&str, &[u8]); 2] = [("f2.jpg", JPEG_LS), ("f3.jpg", pointer)];
    for (name, bytes) in foreign {
        fs::write(folder.join("images").join(name), bytes).unwrap();
    }
    let names = ["f0.jpg", "f1.jpg", "f2.jpg", "f3.jpg", "f4.jpg"];
    let times = |r: &Recording| -> Vec<f64> { r.timestamps_s.iter().map(|s| (s * 30.0).round()).collect() };
    describe(folder, "[frames]\nimages = \"images\"\nfps = 30.0\n");
    let of_folder = open(folder);
    transforms(folder, &names, r#""fl_x": 7"#, |_| String::new());
    let of_nerfstudio = open(&folder.join("transforms.json"));
    for r in [of_folder, of_nerfstudio] {
        assert_eq!((times(&r), frames(&r, 0..3).len()), (vec![0.0, 1.0, 4.0], 3));
        assert_eq!(warning_count(&r, "2 of 5 pictures are not read and left out (first: "), 1, "{:?}", r.warnings);
        assert_eq!(
            warning_count(&r, "f2.jpg: is JPEG-LS, which is not read; convert it: ffmpeg "),
            1,
            "{:?}",
            r.warnings
        );
        assert_eq!(warning_count(&r, "no focal length"), 0, "{:?}", r.warnings);
    }
    // If there are no others, the recording is refused with advice.
    for ((_, bytes), message) in foreign.into_iter().zip(["ffmpeg -i", "`git lfs pull`"]) {
        for name in names {
            fs::write(folder.join("images").join(name), bytes).unwrap();
        }
        assert!(refused(folder).contains(message), "{}", refused(folder));
        assert!(refused(&folder.join("transforms.json")).contains(message));
    }
    // One that is damaged, and one that is not a picture.
    pictures(folder, &names);
    let damaged: [(&[u8], &str); 3] = [
        (b"\xff\xd8\xff\xe0\0", "f2.jpg: the JPEG is truncated"),
        (b"x\n", "f2.jpg: is no picture; expected PNG, JPEG, HEIC"),
        (b"", "f2.jpg: is no picture; expected PNG, JPEG, HEIC"),
    ];
    for (bytes, message) in damaged {
        fs::write(folder.join("images/f2.jpg"), bytes).unwrap();
        for r in [open(folder), open(&folder.join("transforms.json"))] {
            assert_eq!(times(&r), [0.0, 1.0, 3.0, 4.0]);
            assert_eq!(warning_count(&r, "1 of 5 pictures is not read and left out (first: "), 1, "{:?}", r.warnings);
            assert_eq!(warning_count(&r, message), 1, "{:?}", r.warnings);
        }
    }
}

#[test]
fn calibration_names_unreadable_photographs() {
    let temp = tempfile::tempdir().unwrap();
    let (folder, file) = (temp.path().join("photos"), temp.path().join("photos/board.jls"));
    fs::create_dir(&folder).unwrap();
    fs::write(&file, JPEG_LS).unwrap();
    let profile = temp.path().join("p.toml");
    for (kind, path) in [("camera", &file), ("camera", &folder), ("noise", &folder)] {
        let arguments = ["calibrate", kind, path.to_str().unwrap(), "-o", profile.to_str().unwrap()];
        let error = program::refused(&arguments);
        assert!(
            error.contains("is JPEG-LS, which is not read") && error.contains("ffmpeg -i"),
            "{arguments:?}: {error}"
        );
    }
    // By content, if the name has no known extension.
    let unnamed = temp.path().join("board.bin");
    fs::copy(&file, &unnamed).unwrap();
    let error = program::refused(&["calibrate", "camera", unnamed.to_str().unwrap(), "-o", profile.to_str().unwrap()]);
    assert!(error.contains("board.bin is JPEG-LS") || error.contains("board.bin: is JPEG-LS"), "{error}");
}

/// A JPEG with another frame header marker and another sample precision.
fn jpeg_of_kind(marker: u8, bits: u8) -> Vec<u8> {
    let mut bytes = Vec::new();
    image::codecs::jpeg::JpegEncoder::new(&mut bytes).encode(&[90; 8 * 6], 8, 6, image::ExtendedColorType::L8).unwrap();
    let at = bytes.windows(2).position(|pair| pair == [0xff, 0xc0]).unwrap();
    (bytes[at + 1], bytes[at + 4]) = (marker, bits);
    bytes
}

#[test]
fn jpegs_of_other_kinds_are_reported_as_unsupported() {
    let temp = tempfile::tempdir().unwrap();
    let file = temp.path().join("f.jpg");
    for (marker, bits, message) in [
        (0xc3, 8, "is a lossless JPEG, which is not supported; convert it: ffmpeg"),
        (0xc9, 8, "is an arithmetic-coded JPEG, which is not supported; convert it: jpegtran"),
        (0xc1, 12, "is a JPEG of more than 8 bits, which is not supported"),
        (0xc5, 8, "is a hierarchical JPEG, which is not supported"),
        (0xf7, 8, "is a JPEG-LS picture, which is not supported; convert it: ffmpeg"),
    ] {
        let bytes = jpeg_of_kind(marker, bits);
        fs::write(&file, &bytes).unwrap();
        let errors = [
            still::read_header(&file).map(drop).unwrap_err().to_string(),
            still::read_pixels(&file).map(drop).unwrap_err().to_string(),
            still::check_end(&file).unwrap_err().to_string(),
            still::decode_pixels(&bytes).unwrap_err(),
        ];
        assert!(errors.iter().all(|error| error.contains(message)), "{errors:?}");
    }
}

#[test]
fn jpegs_without_huffman_tables_use_the_standard_ones() {
    let temp = tempfile::tempdir().unwrap();
    let file = temp.path().join("f.jpg");
    for (color, channels) in [(image::ExtendedColorType::L8, 1), (image::ExtendedColorType::Rgb8, 3)] {
        let codes: Vec<u8> = (0..24 * 16 * channels).map(|i| (i * 7 % 251) as u8).collect();
        let mut whole = Vec::new();
        image::codecs::jpeg::JpegEncoder::new(&mut whole).encode(&codes, 24, 16, color).unwrap();
        let mut bare = whole.clone();
        while let Some(at) = bare.windows(2).position(|pair| pair == [0xff, 0xc4]) {
            let length = usize::from(u16::from_be_bytes([bare[at + 2], bare[at + 3]]));
            bare.drain(at..at + 2 + length);
        }
        assert!(bare.len() < whole.len());
        fs::write(&file, &bare).unwrap();
        still::check_end(&file).unwrap();
        assert_eq!(still::read_pixels(&file).unwrap(), still::decode_pixels(&whole).unwrap());
    }
}

#[test]
fn jpeg_without_quantisation_tables_is_reported_by_inspect_and_the_decoder() {
    let temp = tempfile::tempdir().unwrap();
    let file = temp.path().join("f.jpg");
    pictures(temp.path(), &["f.jpg"]);
    let mut bytes = fs::read(temp.path().join("images/f.jpg")).unwrap();
    while let Some(at) = bytes.windows(2).position(|pair| pair == [0xff, 0xdb]) {
        let length = usize::from(u16::from_be_bytes([bytes[at + 2], bytes[at + 3]]));
        bytes.drain(at..at + 2 + length);
    }
    fs::write(&file, &bytes).unwrap();
    for error in [still::check_end(&file), still::read_pixels(&file).map(drop)] {
        let error = error.unwrap_err().to_string();
        assert!(error.contains("f.jpg: the JPEG has no quantisation tables (an abbreviated file"), "{error}");
    }
}

/// Pictures with an EXIF orientation each.
fn oriented(folder: &Path, orientations: &[(&str, u8)]) -> Recording {
    let names: Vec<&str> = orientations.iter().map(|(name, _)| *name).collect();
    pictures(folder, &names);
    // A little-endian TIFF header, and one entry: Orientation, SHORT, 1 value.
    let exif = |orientation: u8| {
        let entry = [0x12, 1, 3, 0, 1, 0, 0, 0, orientation, 0, 0, 0];
        [&b"Exif\0\0II*\0\x08\0\0\0\x01\0"[..], &entry, &[0; 4]].concat()
    };
    for (name, orientation) in orientations {
        let file = folder.join("images").join(name);
        let bytes = fs::read(&file).unwrap();
        let exif = exif(*orientation);
        let head = [0xff, 0xd8, 0xff, 0xe1, 0, exif.len() as u8 + 2];
        fs::write(&file, [&head[..], &exif, &bytes[2..]].concat()).unwrap();
    }
    open(&describe(folder, "[frames]\nimages = \"images\"\nfps = 30.0\n"))
}

#[test]
fn exif_orientation_is_reported_once() {
    let temp = tempfile::tempdir().unwrap();
    let r = oriented(temp.path(), &[("f0.jpg", 1), ("f1.jpg", 6), ("f2.jpg", 6)]);
    let message = "f1.jpg: is tagged to be shown turned by 90° clockwise (EXIF orientation 6)";
    assert_eq!(warning_count(&r, message), 1, "{:?}", r.warnings);
    assert_eq!(warning_count(&r, "2 pictures with this tag; a written video has no such tag"), 1, "{:?}", r.warnings);
    assert_eq!(r.presentation().orientation, Orientation::default());
}

#[test]
fn stills_of_one_orientation_set_the_rotation_of_the_video() {
    for exif in [6, 4] {
        let temp = tempfile::tempdir().unwrap();
        let r = oriented(temp.path(), &[("f0.jpg", exif), ("f1.jpg", exif)]);
        let presentation = r.presentation();
        assert_eq!(presentation.orientation, Orientation::of_exif(exif.into()));
        assert_eq!(warning_count(&r, "a written .mp4 has the same tag"), 1, "{:?}", r.warnings);
        let changed = SinkOptions { presentation, ..options(32, 16, 8) };
        let video = written(&temp.path().join("a.mp4"), changed);
        assert_eq!(video.presentation().orientation, presentation.orientation);
    }
}

fn written(file: &Path, changed: SinkOptions) -> Recording {
    let pictures: Vec<Pixels> = (0..4).map(|i| picture(i, 32, 16, changed.bits)).collect();
    write(file, &changed, &pictures);
    let name = file.file_name().unwrap().to_string_lossy();
    open(&describe(file.parent().unwrap(), &format!("[frames]\nvideo = \"{name}\"\nrotation = \"stored\"\n")))
}

#[test]
fn rotation_of_a_video_is_applied_on_reading_unless_stored_frames_are_wanted() {
    let temp = tempfile::tempdir().unwrap();
    for exif in [6, 3, 5] {
        let orientation = Orientation::of_exif(exif);
        let presentation = Presentation { orientation, ..Presentation::default() };
        let stored =
            written(&temp.path().join("a.mp4"), SinkOptions { presentation, force: true, ..options(32, 16, 8) });
        assert_eq!((stored.width, stored.height, stored.presentation().orientation), (32, 16, orientation));
        assert!(*frames(&stored, 1..2)[0].pixels == picture(1, 32, 16, 8));
        let turned = open(&describe(temp.path(), "[frames]\nvideo = \"a.mp4\"\n"));
        assert_eq!((turned.width, turned.height), orientation.oriented_size((32, 16)));
        assert_eq!(turned.presentation().orientation, Orientation::default());
        assert_eq!(warning_count(&turned, &format!("its frames are {orientation} on reading")), 1);
        assert!(*frames(&turned, 1..2)[0].pixels == orientation.apply(picture(1, 32, 16, 8)), "{exif}");
    }
}

#[test]
fn frame_times_are_kept_in_every_video_format() {
    let times_s = [5.0, 5.0333, 5.2, 5.2333];
    for (name, lossless, bits) in [("a.mp4", false, 8), ("a.mkv", false, 16), ("a.mkv", true, 8), ("a.mkv", true, 16)] {
        let temp = tempfile::tempdir().unwrap();
        let changed = SinkOptions { times_s: Some(times_s.into()), lossless, ..options(32, 16, bits) };
        let r = written(&temp.path().join(name), changed);
        assert_eq!(r.frame_count(), 4, "{name} {lossless} {bits}");
        for (time_s, expected_s) in r.timestamps_s.iter().zip(times_s) {
            // Matroska timestamps are in milliseconds.
            assert!((time_s - (expected_s - 5.0)).abs() < 6e-4, "{name} {lossless} {bits}: {:?}", r.timestamps_s);
        }
        if lossless {
            assert!(frames(&r, 0..4).iter().enumerate().all(|(i, frame)| *frame.pixels == picture(i, 32, 16, bits)));
        }
    }
}

/// Neither ffmpeg nor ffprobe supports Matroska's rotation, so this is reported in advance.
#[test]
fn rotated_video_names_an_output_format_that_stays_upright() {
    let temp = tempfile::tempdir().unwrap();
    let orientation = Orientation { is_mirrored: false, rotation_deg: 90.0 };
    let presentation = Presentation { orientation, ..Presentation::default() };
    for (name, is_turned) in [("a.mp4", 1), ("a.mkv", 0)] {
        let r = written(&temp.path().join(name), SinkOptions { presentation, lossless: false, ..options(32, 16, 8) });
        assert_eq!(
            warning_count(&r, "a .mkv has no such tag, and players show it as stored: write a .mp4"),
            is_turned,
            "{name}"
        );
    }
}

#[test]
fn frames_with_equal_times_are_all_kept_in_the_video() {
    let temp = tempfile::tempdir().unwrap();
    let changed = SinkOptions { times_s: Some([0.0, 0.0, 0.5, 0.5].into()), ..options(32, 16, 8) };
    assert_eq!(written(&temp.path().join("a.mp4"), changed).frame_count(), 4);
}

#[test]
fn video_keeps_its_presentation_tags() {
    for (is_mirrored, rotation_deg, aspect) in
        [(false, -90.0, (16, 15)), (false, 180.0, (99, 160)), (true, 0.0, (16, 15)), (true, 90.0, (160, 117))]
    {
        let temp = tempfile::tempdir().unwrap();
        let orientation = Orientation { is_mirrored, rotation_deg };
        let presentation = Presentation { orientation, pixel_aspect: Some(aspect), ..Presentation::default() };
        let changed = SinkOptions { presentation, lossless: false, ..options(32, 16, 8) };
        let r = written(&temp.path().join("a.mp4"), changed);
        let presentation = r.presentation();
        assert_eq!((presentation.orientation, presentation.pixel_aspect), (orientation, Some(aspect)));
        assert_eq!(warning_count(&r, &format!("to be shown {orientation}; it")), 1, "{:?}", r.warnings);
    }
}

#[test]
fn high_dynamic_range_is_kept_in_ten_bits() {
    for (transfer, curve) in [("arib-std-b67", Curve::Hlg), ("smpte2084", Curve::Pq)] {
        let temp = tempfile::tempdir().unwrap();
        let presentation =
            Presentation { transfer: Some(transfer), primaries: Some("bt2020"), ..Presentation::default() };
        let file = temp.path().join("a.mp4");
        let r = written(&file, SinkOptions { presentation, lossless: false, ..options(32, 16, 16) });
        let expected = Presentation { matrix: Some("bt2020nc"), ..presentation };
        assert_eq!((r.presentation(), r.bits), (expected, 16));
        assert_eq!(r.response().curve, curve);
        assert!(r.warnings.is_empty(), "{:?}", r.warnings);
        let probe = Command::new("ffprobe")
            .args(["-v", "error", "-show_entries", "stream=pix_fmt,color_space", "-of", "csv=p=0"])
            .arg(&file)
            .output()
            .unwrap();
        assert_eq!(String::from_utf8_lossy(&probe.stdout).trim(), "yuv420p10le,bt2020nc");
    }
}

/// Describes a recording of 32×16 px with a camera at rest.
fn describe_resting(folder: &Path, frames: &str) {
    fs::write(folder.join("poses.txt"), "-1 0 0 0 0 0 0 1\n9 0 0 0 0 0 0 1\n").unwrap();
    fs::write(
        folder.join("camera.toml"),
        "version = 1\n[camera]\nwidth_px = 32\nheight_px = 16\nfx_px = 30\nfy_px = 30\ncx_px = 16\ncy_px = 8\n",
    )
    .unwrap();
    let rest = "[poses]\ntrajectory = \"poses.txt\"\nmax_gap_s = 100.0\n[camera]\nprofile = \"camera.toml\"\n";
    describe(folder, &format!("[frames]\n{frames}\n{rest}"));
}

/// Composites a recording into a video beside it and opens that.
fn composited(folder: &Path, more: &[&str]) -> Recording {
    let out = folder.join("out.mp4");
    let arguments = ["composite", folder.to_str().unwrap(), "--scene", "scenes/marker-1.glb", "--plain", "-o"];
    program::stdout_of(&[&arguments[..], &[out.to_str().unwrap()], more].concat());
    Recording::open(
        &describe(folder, "[frames]\nvideo = \"out.mp4\"\nrotation = \"stored\"\n"),
        &OpenOptions::default(),
    )
    .unwrap()
}

#[test]
fn composite_keeps_the_times_and_tags_of_its_recording() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path();
    let orientation = Orientation { is_mirrored: true, rotation_deg: 90.0 };
    let presentation = Presentation { orientation, pixel_aspect: Some((16, 15)), ..Presentation::default() };
    let times_s = [0.0, 0.1, 0.1333, 0.4];
    let changed = SinkOptions { presentation, times_s: Some(times_s.into()), ..options(32, 16, 8) };
    written(&folder.join("a.mp4"), changed);
    describe_resting(folder, "video = \"a.mp4\"\nrotation = \"stored\"");
    let r = composited(folder, &[]);
    assert_eq!((r.presentation().orientation, r.presentation().pixel_aspect), (orientation, Some((16, 15))));
    for (time_s, expected_s) in r.timestamps_s.iter().zip(times_s) {
        assert!((time_s - expected_s).abs() < 2e-4, "{:?}", r.timestamps_s);
    }
}

#[test]
fn missing_pictures_leave_a_gap_in_the_video_times() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path();
    let times_s = [0.0, 0.1, 0.2, 0.3];
    let line = |(i, time_s): (usize, &f64)| format!("{time_s} {i}.png\n");
    fs::write(folder.join("rgb.txt"), times_s.iter().enumerate().map(line).collect::<String>()).unwrap();
    for i in [0, 1, 3] {
        image::RgbImage::from_pixel(32, 16, image::Rgb([50 * i as u8; 3]))
            .save(folder.join(format!("{i}.png")))
            .unwrap();
    }
    describe_resting(folder, "list = \"rgb.txt\"");
    let r = composited(folder, &["--skip-missing"]);
    assert_eq!(r.frame_count(), 3);
    for (time_s, expected_s) in r.timestamps_s.iter().zip([0.0, 0.1, 0.3]) {
        assert!((time_s - expected_s).abs() < 2e-4, "{:?}", r.timestamps_s);
    }
}
