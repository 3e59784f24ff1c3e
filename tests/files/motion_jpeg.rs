//! Videos of JPEG files: pixels and coding are those of a folder of the files.

use std::path::{Path, PathBuf};
use std::process::Command;

use crate::files::{describe, frames, open};
use image::ExtendedColorType;
use image::codecs::jpeg::JpegEncoder;
use locard::coding::Decoder;
use locard::source::video::{Overrides, probe};

const COUNT: usize = 24;
/// No multiple of a block.
const SIZE: [u32; 2] = [100, 60];

/// JPEG files in the folder `rgb`, with other quantisation tables from frame to frame.
fn pictures(folder: &Path) -> Vec<PathBuf> {
    std::fs::create_dir(folder.join("rgb")).unwrap();
    let write = |frame: usize| {
        let code = |i: u32| (128.0 + 100.0 * (f64::from(i) * 0.013 + frame as f64).sin()) as u8;
        let codes: Vec<u8> = (0..3 * SIZE[0] * SIZE[1]).map(code).collect();
        let file = folder.join(format!("rgb/{frame:05}.jpg"));
        let mut bytes = Vec::new();
        let mut encoder = JpegEncoder::new_with_quality(&mut bytes, 60 + frame as u8);
        encoder.encode(&codes, SIZE[0], SIZE[1], ExtendedColorType::Rgb8).unwrap();
        std::fs::write(&file, bytes).unwrap();
        file
    };
    (0..COUNT).map(write).collect()
}

/// A video that is made of the folder's pictures.
fn video(folder: &Path, name: &str, options: &[&str]) -> PathBuf {
    let file = folder.join(name);
    let mut ffmpeg = Command::new("ffmpeg");
    ffmpeg.args(["-nostdin", "-v", "error", "-framerate", "30", "-i"]).arg(folder.join("rgb/%05d.jpg"));
    assert!(ffmpeg.args(options).arg(&file).status().expect("this test needs ffmpeg").success(), "{name}");
    file
}

#[test]
fn copied_jpegs_equal_the_folder_in_pixels_and_coding() {
    let temp = tempfile::tempdir().unwrap();
    pictures(temp.path());
    let folder = open(&describe(temp.path(), "[frames]\nimages = \"rgb\"\nfps = 30.0\n"));
    let stills = frames(&folder, 0..COUNT);
    assert_ne!(stills[0].pixels.coding, stills[9].pixels.coding);
    for name in ["v.avi", "v.mov", "v.mkv"] {
        video(temp.path(), name, &["-c", "copy"]);
        let recording = open(&describe(temp.path(), &format!("[frames]\nvideo = \"{name}\"\n")));
        // From the start, and from the middle by the index.
        for range in [0..COUNT, 15..18, COUNT - 1..COUNT] {
            let decoded = frames(&recording, range.clone());
            assert_eq!(decoded.len(), range.len(), "{name}");
            for (frame, still) in decoded.iter().zip(&stills[range]) {
                assert!(frame.pixels == still.pixels, "{name}: frame {}", still.index);
                assert!(frame.pixels.coding.as_ref().is_some_and(|coding| coding.quantization.is_some()), "{name}");
            }
        }
        let format = recording.stored_format().unwrap();
        assert!(format.starts_with("video, chroma 4:4:4, quantisation steps "), "{format}");
    }
}

#[test]
fn frames_at_uneven_times_are_counted() {
    let temp = tempfile::tempdir().unwrap();
    pictures(temp.path());
    let uneven = ["-vf", "setpts='if(lt(N,4),N,4+(N-4)*2.37)/30/TB'", "-vsync", "vfr", "-c:v", "mjpeg"];
    let file = video(temp.path(), "v.mkv", &uneven);
    let video = probe(&file, &Overrides::default()).unwrap();
    let read = |range| video.read(range).unwrap().map(Result::unwrap).collect::<Vec<_>>();
    let all = read(0..COUNT);
    assert!(all.len() == COUNT && all.windows(2).all(|pair| pair[0] != pair[1]));
    assert!(all.iter().all(|pixels| pixels.coding.as_ref().is_some_and(|c| c.decoder == Decoder::ZuneJpeg)));
    for start in [1, 3, 4, 11, COUNT - 2] {
        assert!(read(start..start + 2) == all[start..start + 2], "{start}");
    }
}

/// ffmpeg converts by the user's matrix, and JPEG has one matrix only.
#[test]
fn stated_colours_that_are_not_of_jpeg_are_decoded_by_ffmpeg() {
    let temp = tempfile::tempdir().unwrap();
    pictures(temp.path());
    let file = video(temp.path(), "v.mov", &["-c", "copy"]);
    let matrix = Some(locard::coding::ColorMatrix::Bt709);
    let video = probe(&file, &Overrides { matrix, ..Overrides::default() }).unwrap();
    let pixels = video.read(2..3).unwrap().next().unwrap().unwrap();
    let coding = pixels.coding.unwrap();
    assert!(matches!(coding.decoder, Decoder::Swscale { .. }) && coding.quantization.is_none());
}

#[test]
fn truncated_picture_is_an_error_that_names_the_frame() {
    let temp = tempfile::tempdir().unwrap();
    let files = pictures(temp.path());
    let bytes = std::fs::read(&files[9]).unwrap();
    std::fs::write(&files[9], &bytes[..bytes.len() / 2]).unwrap();
    // The decoder is not needed for a copy, and ffmpeg would conceal the damage.
    let file = video(temp.path(), "v.avi", &["-c", "copy"]);
    let video = probe(&file, &Overrides::default()).unwrap();
    let read: Vec<_> = video.read(0..COUNT).unwrap().collect();
    assert_eq!(read.len(), 10);
    let error = read[9].as_ref().unwrap_err().to_string();
    assert!(error.contains("v.avi: frame 9: the JPEG is truncated"), "{error}");
    assert!(video.read(12..14).unwrap().all(|pixels| pixels.is_ok()));
}
