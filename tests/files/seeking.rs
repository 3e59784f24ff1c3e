//! Frames from the middle of a video equal those of decoding from its start.

use std::path::Path;
use std::process::Command;

use crate::tier;
use locard::pixels::Pixels;
use locard::source::video::{Overrides, Video, probe};

/// Four seconds of stripes that move.
const STRIPES: &str = "nullsrc=size=64x48:rate=30:duration=4,geq=lum='mod(4*X+Y+5*N,200)+20':cb=128:cr=128";
const SOURCE: [&str; 8] = ["-nostdin", "-v", "error", "-f", "lavfi", "-i", STRIPES, "-vf"];
const STEADY: &str = "null";
/// Intervals that grow, and every seventh frame missing.
const VARYING: &str = "setpts='if(lt(N,40),N,40+(N-40)*2.37)/30/TB',select='not(eq(mod(n,7),3))'";

fn encode(file: &Path, times: &str, codec: &[&str]) -> Video {
    let mut ffmpeg = Command::new("ffmpeg");
    ffmpeg.args(SOURCE).args([times, "-vsync", "vfr"]).args(codec).arg(file);
    assert!(ffmpeg.status().expect("this test needs ffmpeg").success(), "{}", file.display());
    probe(file, &Overrides::default()).unwrap()
}

fn read(video: &Video, range: std::ops::Range<usize>) -> Vec<Pixels> {
    video.read(range).unwrap().map(Result::unwrap).collect()
}

const CLOSED: [&str; 6] = ["-c:v", "libx264", "-g", "12", "-bf", "3"];

#[test]
fn range_matches_decoding_from_the_start() {
    let temp = tempfile::tempdir().unwrap();
    let open = ["-c:v", "libx264", "-bf", "3", "-x264opts", "open-gop=1:keyint=12:min-keyint=4"];
    let strips = ["-c:v", "libx264", "-x264opts", "intra-refresh=1:keyint=20"];
    let cases: [(&str, &str, &[&str]); 8] = [
        ("steady.mp4", STEADY, &CLOSED),
        ("steady.mkv", STEADY, &CLOSED),
        ("varying.mp4", VARYING, &CLOSED),
        ("varying.mkv", VARYING, &CLOSED),
        ("stream.ts", STEADY, &["-c:v", "mpeg2video", "-g", "12", "-bf", "2"]),
        ("open.mkv", STEADY, &open),
        ("strips.mkv", STEADY, &strips),
        // Without timestamps for each frame.
        ("untimed.avi", STEADY, &["-c:v", "mpeg4", "-g", "12", "-bf", "2"]),
    ];
    // The first two differ from the next two only in their times.
    for (name, times, codec) in &cases[tier::fast_or_full(2, 0)..] {
        let video = encode(&temp.path().join(name), times, codec);
        let count = video.timestamps_s.len();
        let all = read(&video, 0..count);
        assert!(count > 60 && all.len() == count, "{name}");
        assert!(all.windows(2).all(|pair| pair[0] != pair[1]), "{name}: each frame looks different");
        // Before a keyframe, at one, after it; the end.
        for &start in tier::fast_or_full(&[11, 24, count - 1][..], &[1, 11, 24, 25, 37, count - 1]) {
            let end = (start + 3).min(count);
            assert!(read(&video, start..end) == all[start..end], "{name}: frames {start}..{end}");
        }
    }
}

/// An edit list hides the frames between a keyframe and the cut.
#[test]
fn frames_hidden_by_an_edit_list_are_not_counted() {
    let temp = tempfile::tempdir().unwrap();
    let (whole, cut) = (temp.path().join("whole.mp4"), temp.path().join("cut.mp4"));
    encode(&whole, STEADY, &CLOSED);
    let mut ffmpeg = Command::new("ffmpeg");
    ffmpeg.args(["-nostdin", "-v", "error", "-ss", "1.13", "-i"]).arg(&whole).args(["-c", "copy"]).arg(&cut);
    assert!(ffmpeg.status().unwrap().success());
    let video = probe(&cut, &Overrides::default()).unwrap();
    let all = read(&video, 0..video.timestamps_s.len());
    assert!(read(&video, 60..64) == all[60..64]);
}

/// The pictures of the second second are destroyed: decoding from the start fails on them.
#[test]
fn seeking_decodes_nothing_far_before_the_range() {
    let temp = tempfile::tempdir().unwrap();
    let file = temp.path().join("a.mkv");
    let video = encode(&file, STEADY, &CLOSED);
    let whole = read(&video, 100..103);
    let mut bytes = std::fs::read(&file).unwrap();
    let at = bytes.len() * 3 / 10;
    bytes[at..at + 400].fill(0x5a);
    std::fs::write(&file, bytes).unwrap();
    let from_start = video.read(0..103).unwrap().find_map(Result::err);
    assert!(from_start.is_some(), "the damage is none");
    assert!(read(&video, 100..103) == whole);
}

/// A file changed since it was opened: no other frames are returned in place of the requested ones.
#[test]
fn frames_missing_from_a_changed_file_are_an_error() {
    let temp = tempfile::tempdir().unwrap();
    let file = temp.path().join("a.mp4");
    let video = encode(&file, STEADY, &CLOSED);
    std::fs::remove_file(&file).unwrap();
    encode(&file, "trim=end_frame=40", &CLOSED);
    let error = video.read(100..103).unwrap().find_map(Result::err).unwrap().to_string();
    assert!(error.contains("a.mp4: ends before frame 100"), "{error}");
}
