//! `locard send`, and `locard inspect` of a stream.

use std::net::UdpSocket;
use std::path::Path;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use crate::program::{program, refused};
use locard::recording::{OpenOptions, Recording};
use locard::stream::{Poses, Sender, StreamPose};

/// A program that is killed at the end of its test.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn started(arguments: &[&str]) -> Running {
    Running(program().args(arguments).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap())
}

fn received(poses: &mut Poses, count: usize) -> Vec<StreamPose> {
    let until = Instant::now() + Duration::from_secs(60);
    let all: Vec<_> = std::iter::from_fn(|| poses.next(until).unwrap()).take(count).collect();
    assert_eq!(all.len(), count, "{:?}", poses.report());
    all
}

fn demo() -> Recording {
    Recording::open(Path::new("recordings/demo"), &OpenOptions::default()).unwrap()
}

#[test]
fn sent_recording_arrives_unchanged() {
    let recording = demo();
    let expected: Vec<_> = recording.track.poses_in_frame_time().collect();
    for (scheme, off_m) in [("opentrackio", 1e-9), ("freed", 2e-5)] {
        let mut poses = Poses::open(&format!("{scheme}://127.0.0.1:0")).unwrap();
        let to = format!("{scheme}://{}", poses.address());
        let sending = started(&["send", "recordings/demo", "--to", &to, "--speed", "2", "--quiet"]);
        let received_poses = received(&mut poses, expected.len());
        for (tracked, (time_s, pose)) in received_poses.iter().zip(&expected) {
            let at_m = tracked.pose.position_in_world_m().distance(pose.position_in_world_m());
            assert!(at_m < off_m, "{scheme}: {at_m} m off at {time_s} s");
            if scheme == "opentrackio" {
                // The resolution is a nanosecond.
                assert!((tracked.time_s - time_s).abs() < 2e-9, "{}", tracked.time_s);
            }
        }
        assert_eq!((poses.report().missed, poses.report().jumps), (0, 0));
        if scheme == "opentrackio" {
            let (camera, off_px) = poses.lens().geometry(640, 480).unwrap();
            let intrinsics = camera.intrinsics;
            assert!((intrinsics.fx_px - 520.0).abs() < 1e-6 && off_px == 0.0, "{}", intrinsics.fx_px);
        }
        drop(sending);
    }
}

#[test]
fn looped_recording_continues_its_clock() {
    let count = demo().track.poses().len();
    let mut poses = Poses::open("opentrackio://127.0.0.1:0").unwrap();
    let to = format!("opentrackio://{}?encoding=cbor", poses.address());
    let _sending = started(&["send", "recordings/demo", "--to", &to, "--speed", "5", "--loop", "--quiet"]);
    let received_poses = received(&mut poses, count + 50);
    assert!(received_poses.windows(2).all(|pair| pair[0].time_s < pair[1].time_s && pair[1].epoch == 0));
    let (first, again) = (&received_poses[3], &received_poses[3 + count]);
    assert!(first.pose.translation_m.distance(again.pose.translation_m) < 1e-9);
    assert!(poses.report().followed.as_ref().unwrap().0.id.as_ref().unwrap().starts_with("urn:uuid:"));
}

#[test]
fn inspect_reports_the_received_stream() {
    let port = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let url = format!("opentrackio://127.0.0.1:{port}");
    let mut listening = started(&["inspect", &url, "--seconds", "0.5"]);
    let mut sender = Sender::open(&url, "walk", 200.0, None).unwrap();
    let recording = demo();
    let until = Instant::now() + Duration::from_secs(60);
    for (i, (_, pose)) in recording.track.poses().iter().cycle().enumerate() {
        if listening.0.try_wait().unwrap().is_some() {
            break;
        }
        assert!(Instant::now() < until, "it still listens");
        // Nobody may listen to the first ones.
        let _ = sender.send(0.005 * i as f64, pose);
        std::thread::sleep(Duration::from_millis(5));
    }
    let mut text = String::new();
    std::io::Read::read_to_string(listening.0.stdout.as_mut().unwrap(), &mut text).unwrap();
    for line in ["stream     opentrackio://127.0.0.1:", "source     urn:uuid:", "number 1", "OpenTrackIO 1.0.1"] {
        assert!(text.contains(line), "{line}: {text}");
    }
    for line in [
        "\nposes      ",
        "200.00 a second",
        "\nclock      its timestamps",
        "\ncamera at  ",
        "\nlens       nothing",
        "\ndrops      ",
    ] {
        assert!(text.contains(line), "{line}: {text}");
    }
}

#[test]
fn errors_are_one_line() {
    for (arguments, expected) in [
        (&["send", "recordings/demo", "--to", "udp://127.0.0.1:9"][..], "opentrackio://HOST:PORT"),
        (&["send", "recordings/demo", "--to", "freed://127.0.0.1:9?id=3"], "interface, encoding, number, ttl"),
        (&["send", "recordings/demo", "--to", "freed://127.0.0.1:9", "--speed", "0"], "0.001 to 10000"),
        (&["inspect", "freed://127.0.0.1:9999999"], "0 to 65535"),
        (&["inspect", "freed://127.0.0.1:0", "--frame", "3"], "this is a stream"),
        (&["inspect", "opentrackio://203.0.113.9"], "0.0.0.0"),
    ] {
        let text = refused(arguments);
        assert!(text.contains(expected), "{text}");
    }
}
