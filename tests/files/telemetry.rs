//! Exposures that a camera wrote while it filmed.

use std::path::Path;
use std::process::Command;

use crate::files::{describe, frames, open};
use locard::recording::Recording;

const COUNT: usize = 12;

fn ffmpeg(arguments: &[&str], folder: &Path) {
    let mut ffmpeg = Command::new("ffmpeg");
    ffmpeg.args(["-nostdin", "-v", "error", "-y"]).args(arguments).current_dir(folder);
    assert!(ffmpeg.status().expect("this test needs ffmpeg").success(), "{arguments:?}");
}

/// A video of twelve frames at 30 frames a second, and subtitles beside it in which every frame has
/// another film speed.
fn filmed(folder: &Path) {
    let size = ["-f", "lavfi", "-i", "color=gray:s=32x16:r=30", "-frames:v", "12", "v.mkv"];
    ffmpeg(&size, folder);
    let ms = |frame: usize| format!("00:00:00,{:03}", 1000 * frame / 30);
    let cue = |frame: usize| {
        format!(
            "{}\n{} --> {}\n[iso : {}] [shutter : 1/80.0] [fnum : 280] [ev : 0]\n\n",
            frame + 1,
            ms(frame),
            ms(frame + 1),
            100 + frame
        )
    };
    std::fs::write(folder.join("v.SRT"), (0..COUNT).map(cue).collect::<String>()).unwrap();
}

fn recording(folder: &Path, video: &str) -> Recording {
    open(&describe(folder, &format!("[frames]\nvideo = \"{video}\"\n")))
}

/// The film speeds of all frames, after a check of the first frame's other settings.
fn film_speeds(recording: &Recording) -> Vec<Option<f64>> {
    let frames = frames(recording, 0..COUNT);
    let first = &frames[0].exposure;
    assert_eq!((first.time_s, first.photo.f_number), (Some(1.0 / 80.0), Some(2.8)));
    frames.iter().map(|frame| frame.exposure.photo.iso).collect()
}

#[test]
fn subtitles_beside_or_in_a_video_give_each_frame_its_exposure() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path();
    filmed(folder);
    let expected: Vec<_> = (0..COUNT).map(|frame| Some(100.0 + frame as f64)).collect();
    let with_sidecar = recording(folder, "v.mkv");
    assert_eq!(film_speeds(&with_sidecar), expected);
    // An input of the recording, which records of outputs list.
    assert!(with_sidecar.files().any(|file| file.ends_with("v.SRT")));
    ffmpeg(&["-i", "v.mkv", "-i", "v.SRT", "-c", "copy", "-c:s", "mov_text", "-strict", "-2", "inside.mp4"], folder);
    let with_track = recording(folder, "inside.mp4");
    assert_eq!(film_speeds(&with_track), expected);
    assert!(!with_track.files().any(|file| file.ends_with("v.SRT")));
}

#[test]
fn subtitles_of_another_cut_are_left_out_with_a_warning() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path();
    filmed(folder);
    let file = folder.join("v.SRT");
    let longer = std::fs::read_to_string(&file).unwrap()
        + "13\n00:00:09,000 --> 00:00:09,033\n[iso : 900] [shutter : 1/80.0] [fnum : 280]\n\n";
    std::fs::write(&file, longer).unwrap();
    let recording = recording(folder, "v.mkv");
    assert_eq!(frames(&recording, 0..1)[0].exposure.photo.iso, None);
    let warnings = recording.warnings.join("\n");
    assert!(warnings.contains("v.SRT: ends at 9.0 s, the video at 0.4 s"), "{warnings}");
}
