//! Videos that are written: codec, sound and time code.

use std::path::Path;
use std::process::Command;

use locard::pixels::Pixels;
use locard::recording::{OpenOptions, Recording};
use locard::sink::{SinkOptions, VideoCodec};
use locard::source::presentation::Presentation;
use locard::source::timecode::Timecode;
use locard::source::video::Soundtrack;

use crate::files::{options, picture, write};

fn probe(file: &Path, entries: &str) -> String {
    let output = Command::new("ffprobe")
        .args(["-v", "error", "-show_entries", entries, "-of", "default=nw=1"])
        .arg(file)
        .output()
        .unwrap();
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// Two seconds of pictures and sound with a time code.
fn filmed(file: &Path, codec: &str) {
    let mut ffmpeg = Command::new("ffmpeg");
    ffmpeg.args(["-v", "error", "-f", "lavfi", "-i", "testsrc=s=32x16:d=2:r=25", "-f", "lavfi", "-i", "sine=440:d=2"]);
    ffmpeg.args(["-pix_fmt", "yuv420p", "-c:a", codec, "-timecode", "10:00:00:20"]).arg(file);
    assert!(ffmpeg.status().unwrap().success());
}

#[test]
fn sound_and_time_code_are_those_of_the_written_frames() {
    let temp = tempfile::tempdir().unwrap();
    let pictures: Vec<Pixels> = (0..20).map(|i| picture(i, 32, 16, 8)).collect();
    for (source, codec, out, expected) in [
        ("a.mp4", "aac", "out.mp4", "codec_name=aac"),
        ("b.mov", "pcm_s16le", "out.mov", "codec_name=pcm_s16le"),
        // Cut exactly, without loss.
        ("b.mov", "pcm_s16le", "out.mkv", "codec_name=flac"),
        // PCM has no place in an MP4.
        ("b.mov", "pcm_s16le", "pcm.mp4", "codec_name=aac"),
    ] {
        let (source, out) = (temp.path().join(source), temp.path().join(out));
        if !source.exists() {
            filmed(&source, codec);
        }
        std::fs::write(
            temp.path().join("recording.toml"),
            format!("version = 1\n[frames]\nvideo = {:?}\n", source.file_name().unwrap()),
        )
        .unwrap();
        let recording = Recording::open(temp.path(), &OpenOptions::default()).unwrap();
        let soundtrack = recording.soundtrack(10..30);
        let Soundtrack { start_s, length_s, .. } = soundtrack.clone().unwrap();
        assert!((start_s - 0.4).abs() < 0.05 && (length_s - 0.8).abs() < 1e-6, "{start_s} {length_s}");
        let presentation = recording.presentation_from(10);
        assert_eq!(presentation.timecode, Timecode::parse("10:00:01:05"));
        let written =
            SinkOptions { presentation, soundtrack, lossless: false, fps: 25.0, codec: None, ..options(32, 16, 8) };
        write(&out, &written, &pictures);
        let probed =
            probe(&out, "stream=codec_name,duration:stream_tags=timecode:format_tags=timecode:format=duration");
        assert!(probed.contains(expected), "{out:?}: {probed}");
        assert!(probed.to_ascii_lowercase().contains("tag:timecode=10:00:01:05"), "{out:?}: {probed}");
        let durations = probed.lines().filter_map(|line| line.strip_prefix("duration=")?.parse().ok());
        let longest_s = durations.fold(0.0, f64::max);
        assert!((longest_s - 0.8).abs() < 0.03, "{out:?}: {probed}");
        std::fs::remove_file(&out).unwrap();
    }
}

#[test]
fn hevc_and_prores_have_ten_bits() {
    let temp = tempfile::tempdir().unwrap();
    let pictures = [picture(0, 32, 16, 16)];
    for (name, codec, expected) in [
        ("a.mp4", Some(VideoCodec::Hevc), ["codec_name=hevc", "pix_fmt=yuv420p10le"]),
        ("a.mov", None, ["codec_name=prores", "pix_fmt=yuv422p10le"]),
        ("a.mkv", Some(VideoCodec::ProRes), ["codec_name=prores", "pix_fmt=yuv422p10le"]),
        ("b.mov", Some(VideoCodec::H264), ["codec_name=h264", "pix_fmt=yuv420p"]),
    ] {
        let file = temp.path().join(name);
        let presentation = Presentation { primaries: Some("bt2020"), ..Presentation::default() };
        write(&file, &SinkOptions { presentation, lossless: false, codec, ..options(32, 16, 16) }, &pictures);
        let probed = probe(&file, "stream=codec_name,pix_fmt,color_primaries");
        for text in expected.into_iter().chain(["color_primaries=bt2020"]) {
            assert!(probed.contains(text), "{name}: {probed}");
        }
    }
}
