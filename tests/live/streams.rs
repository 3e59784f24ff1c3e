//! Pose streams over real sockets of this machine, and the receiver with arbitrary input. One file,
//! because the tests share the receiver and the packets.

use std::net::{SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

use crate::common;
use crate::tier;
use glam::{DQuat, DVec3};
use locard::camera::{CameraExposure, Distortion, Geometry, Intrinsics, Lens};
use locard::pose::Pose;
use locard::stream::freed::D1;
use locard::stream::{
    Clock, DropReason, Encoding, LensState, ListenOptions, Poses, Receiver, Sample, Sender, StreamPose, packets,
    pose_of,
};

/// Exceeds the duration of any step on a working machine.
fn deadline() -> Instant {
    Instant::now() + Duration::from_secs(20)
}

/// The i-th pose of a walk with constant rotation.
fn walked(i: usize) -> (f64, Pose) {
    let t = i as f64 / 50.0;
    let turn =
        DQuat::from_rotation_z(0.3 * t) * DQuat::from_rotation_x(-1.4 + 0.1 * t) * DQuat::from_rotation_y(0.05 * t);
    (1_305_031_102.0 + t, Pose::from_camera_in_world(DVec3::new(t, 1.0 - 0.5 * t, 1.6), turn))
}

fn geometry() -> Geometry {
    let intrinsics = Intrinsics {
        fx_px: 517.3,
        fy_px: 516.5,
        cx_px: 318.6,
        cy_px: 255.3,
        film_width_mm: 6.4,
        ..Intrinsics::default()
    };
    let distortion =
        Distortion { k1: 0.2624, k2: -0.9531, p1: -0.0054, p2: 0.0026, k3: 1.1633, ..Distortion::default() };
    Geometry::new(intrinsics, distortion)
}

fn lens_state() -> LensState {
    let lens = Lens { f_number: Some(2.8), focus_distance_m: Some(1.5), ..Lens::default() };
    let exposure = CameraExposure { time_s: Some(0.008), iso: Some(400.0), ..CameraExposure::default() };
    LensState::of(&geometry(), &lens, &exposure, 50.0)
}

fn received(poses: &mut Poses, count: usize) -> Vec<StreamPose> {
    let until = deadline();
    let all: Vec<_> = std::iter::from_fn(|| poses.next(until).unwrap()).take(count).collect();
    assert_eq!(all.len(), count, "{:?}", poses.report());
    all
}

/// Sends poses of the walk to a listener one by one and returns the received ones.
fn send_walk(listen: &str, target: impl Fn(SocketAddr) -> String, count: usize) -> (Vec<StreamPose>, Poses) {
    let mut poses = Poses::open(listen).unwrap();
    let mut sender = Sender::open(&target(poses.address()), "walk", 50.0, Some(lens_state())).unwrap();
    let mut received_poses = Vec::new();
    for i in 0..count {
        let (time_s, pose) = walked(i);
        sender.send(time_s, &pose).unwrap();
        received_poses.extend(received(&mut poses, 1));
    }
    (received_poses, poses)
}

fn assert_walked(received_poses: &[StreamPose], off_m: f64, off_rad: f64) {
    for (i, tracked) in received_poses.iter().enumerate() {
        let (_, pose) = walked(i);
        let at_m = tracked.pose.position_in_world_m().distance(pose.position_in_world_m());
        assert!(at_m <= off_m, "{i}: {at_m} m off");
        let rad = 2.0 * (tracked.pose.rotation * pose.rotation.conjugate()).xyz().length().min(1.0).asin();
        assert!(rad <= off_rad, "{i}: {rad} rad off");
    }
}

#[test]
fn opentrackio_round_trips_in_both_encodings() {
    for encoding in ["json", "cbor"] {
        let target = |at| format!("opentrackio://{at}?encoding={encoding}&number=9");
        let (received_poses, poses) = send_walk("opentrackio://127.0.0.1:0", target, 120);
        assert_walked(&received_poses, 1e-12, 1e-12);
        for (i, tracked) in received_poses.iter().enumerate() {
            // A nanosecond, and the resolution of seconds since 1970.
            assert!((tracked.time_s - walked(i).0).abs() < 5e-7 && tracked.epoch == 0, "{i}: {}", tracked.time_s);
            assert_eq!((tracked.clock, tracked.message.freed()), (Clock::Timestamp, None));
        }
        let report = poses.report();
        assert_eq!((report.poses, report.missed, report.jumps, report.incomplete), (120, 0, 0, 0));
        assert!(report.dropped.is_empty(), "{report:?}");
        assert_eq!(report.version.as_deref(), Some("1.0.1"));
        assert_eq!(report.followed.as_ref().unwrap().0.number, Some(9));
        assert!((report.interval_s.unwrap() - 0.02).abs() < 1e-6);
        // The lens is repeated each second, and gives the same camera.
        let (camera, off_px) = poses.lens().geometry(640, 480).unwrap();
        for at in [[0.5, 0.5], [320.0, 240.0], [600.0, 470.0]] {
            let there = camera.project(geometry().unproject(at.into()).unwrap()).unwrap();
            assert!(there.distance(at.into()) < 1e-6 && off_px == 0.0, "{there} is not {at:?}");
        }
        let (lens, exposure) = (poses.lens().lens(), poses.lens().exposure());
        assert!((lens.f_number.unwrap() - 2.8).abs() < 1e-9 && lens.focus_distance_m == Some(1.5));
        assert!((exposure.shutter_angle_deg.unwrap() - 144.0).abs() < 1e-9 && exposure.iso == Some(400.0));
    }
}

/// The stamp of the first sample is ahead, and the sample is delivered before later ones show that.
#[test]
fn first_sample_stamped_ahead_is_odd_and_no_step_of_the_clock() {
    let mut receiver = Receiver::new(ListenOptions::parse("opentrackio://?wait_s=0.02").unwrap());
    let from = SocketAddr::from(([127, 0, 0, 1], 4000));
    for i in 0..300_u32 {
        let now_s = 0.01 * f64::from(i);
        let stamp_s = 50.0 + now_s + if i == 0 { 0.1 } else { 0.0 };
        let sample = format!(
            r#"{{"protocol": {{"name": "OpenTrackIO", "version": [1, 0, 1]}}, "sourceId": "urn:uuid:1", "sourceNumber": 1,
            "timing": {{"sequenceNumber": {i}, "sampleTimestamp": {{"seconds": {}, "nanoseconds": {:.0}}}}},
            "transforms": [{{"translation": {{"x": 0, "y": 0, "z": 1}}, "rotation": {{"pan": 0, "tilt": 0, "roll": 0}},
            "id": "Camera"}}]}}"#,
            stamp_s.floor(),
            1e9 * stamp_s.fract()
        );
        packets(Encoding::Json, i as u16, sample.as_bytes()).iter().for_each(|p| receiver.take(p, from, now_s));
        while receiver.next(now_s).is_some() {}
    }
    let report = receiver.report();
    assert_eq!((report.steps, report.jumps, report.count(DropReason::OddTime)), (0, 0, 1), "{report:?}");
    assert!(report.poses > 290, "{report:?}");
}

#[test]
fn freed_round_trips() {
    let (received_poses, poses) = send_walk("freed://127.0.0.1:0", |at| format!("freed://{at}?number=3"), 60);
    // Half of 1/64 mm, half of 1/32768 degree about three axes.
    assert_walked(&received_poses, 8e-6 * 3f64.sqrt(), 1e-6);
    assert!(
        received_poses
            .iter()
            .all(|tracked| tracked.clock == Clock::Arrival && tracked.message.freed().unwrap().camera == 3)
    );
    assert!(received_poses.windows(2).all(|pair| pair[0].time_s < pair[1].time_s));
    assert!(poses.report().dropped.is_empty(), "{:?}", poses.report());
}

#[test]
fn multicast_group_reaches_all_members() {
    // Any free port, shared by both listeners.
    let port = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let url = format!("opentrackio://239.135.1.77:{port}?interface=127.0.0.1");
    let (mut first, mut second) = (Poses::open(&url).unwrap(), Poses::open(&url).unwrap());
    let mut sender = Sender::open(&url, "walk", 50.0, None).unwrap();
    for i in 0..20 {
        let (time_s, pose) = walked(i);
        sender.send(time_s, &pose).unwrap();
    }
    for poses in [&mut first, &mut second] {
        assert_walked(&received(poses, 20), 1e-12, 1e-12);
    }
}

#[test]
fn official_samples_round_trip() {
    let Some(folder) = common::data("opentrackio/test/resources/classic/examples") else { return };
    let mut count = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let text = std::fs::read(&path).unwrap();
        let expected: serde_json::Value = serde_json::from_slice(&text).unwrap();
        let sample = Sample::decode(Encoding::Json, &text).unwrap();
        let as_json = |sample: &Sample| -> serde_json::Value {
            serde_json::from_slice(&sample.encode(Encoding::Json).unwrap()).unwrap()
        };
        assert_eq!(as_json(&sample), expected, "{}", path.display());
        let by_cbor = Sample::decode(Encoding::Cbor, &sample.encode(Encoding::Cbor).unwrap()).unwrap();
        assert_eq!(as_json(&by_cbor), expected, "{}", path.display());

        // In packets over the network, to a receiver.
        let mut receiver = Receiver::new(ListenOptions::parse("opentrackio://?wait_s=0").unwrap());
        let from = SocketAddr::from(([127, 0, 0, 1], 4000));
        let pieces = packets(Encoding::Json, 1, &text);
        assert!(pieces.len() > 1 || text.len() < 1456);
        pieces.iter().for_each(|piece| receiver.take(piece, from, 1.0));
        let tracked = receiver.next(1.0).unwrap();
        assert_eq!(as_json(&tracked.message.sample().unwrap()), expected, "{}", path.display());
        assert_eq!(receiver.report().version.as_deref(), Some("0.9.3"));
        let lens = receiver.lens();
        assert_eq!((lens.focal_length_mm, lens.f_stop), (Some(24.305), Some(4.0)));
        assert_eq!((lens.focus_distance_m, lens.entrance_pupil_m), (Some(10.0), Some(0.123)));
        let is_static = path.file_name().unwrap().to_str().unwrap().contains("complete_static");
        assert_eq!(
            (lens.iso, lens.shutter_angle_deg),
            if is_static { (Some(4000.0), Some(45.0)) } else { (None, None) }
        );
        // The entrance pupil is in front of the sensor, whatever its direction.
        let chain = pose_of(sample.get(&["transforms"]).unwrap()).unwrap();
        let along_m = lens.at_pupil(&chain).position_in_world_m() - chain.position_in_world_m();
        assert!((along_m.length() - 0.123).abs() < 1e-12);
        count += 1;
    }
    assert_eq!(count, 4);
}

fn from(last: u8, port: u16) -> SocketAddr {
    SocketAddr::from(([10, 0, 0, last], port))
}

/// A sample of OpenTrackIO in one packet.
fn packet(source: &str, sequence: u16, time_s: f64, x: f64) -> Vec<u8> {
    let (seconds, nanoseconds) = (time_s.floor(), (1e9 * time_s.fract()).round());
    let text = format!(
        r#"{{"sourceId":"urn:uuid:{source}","sourceNumber":1,"timing":{{"sequenceNumber":{sequence},"sampleTimestamp":{{"seconds":{seconds},"nanoseconds":{nanoseconds}}}}},"transforms":[{{"translation":{{"x":{x},"y":0,"z":0}},"rotation":{{"pan":0,"tilt":0,"roll":0}}}}]}}"#
    );
    packets(Encoding::Json, sequence, text.as_bytes()).remove(0)
}

fn receiver(url: &str) -> Receiver {
    Receiver::new(ListenOptions::parse(url).unwrap())
}

fn places(receiver: &mut Receiver, now_s: f64) -> Vec<(u32, f64)> {
    let at = |tracked: StreamPose| (tracked.epoch, tracked.pose.position_in_world_m().x);
    std::iter::from_fn(|| receiver.next(now_s)).map(at).collect()
}

#[test]
fn other_senders_are_ignored() {
    for (url, expected) in [
        // The first sender.
        ("opentrackio://?wait_s=0", vec![(0, 1.0), (0, 2.0)]),
        ("opentrackio://?wait_s=0&source=b", vec![(0, 7.0), (0, 8.0)]),
        ("opentrackio://?wait_s=0&source=urn:uuid:B", vec![(0, 7.0), (0, 8.0)]),
        ("opentrackio://?wait_s=0&from=10.0.0.2", vec![(0, 7.0), (0, 8.0)]),
    ] {
        let mut r = receiver(url);
        r.take(&packet("a", 1, 5.00, 1.0), from(1, 50), 0.00);
        r.take(&packet("b", 1, 90.00, 7.0), from(2, 50), 0.00);
        // After a restart a sender has another port.
        r.take(&packet("a", 2, 5.02, 2.0), from(1, 51), 0.02);
        r.take(&packet("b", 2, 90.02, 8.0), from(2, 51), 0.02);
        assert_eq!(places(&mut r, 0.02), expected, "{url}");
        let aside = r.report().count(DropReason::OtherSource) + r.report().count(DropReason::OtherAddress);
        assert_eq!((r.report().poses, aside), (2, 2), "{url}");
    }
}

#[test]
fn other_sender_replaces_a_silent_one() {
    let mut r = receiver("opentrackio://?wait_s=0");
    r.take(&packet("a", 1, 5.0, 1.0), from(1, 50), 0.0);
    assert_eq!(places(&mut r, 0.0), [(0, 1.0)]);
    r.take(&packet("b", 1, 90.0, 7.0), from(2, 50), 1.9);
    assert_eq!(places(&mut r, 1.9), []);
    // Its clock differs, which is a new epoch and no jump.
    r.take(&packet("b", 2, 90.5, 8.0), from(2, 50), 2.4);
    assert_eq!(places(&mut r, 2.4), [(1, 8.0)]);
    assert_eq!((r.report().changes, r.report().jumps), (1, 0));
    // A sender requested by name is waited for.
    let mut r = receiver("opentrackio://?wait_s=0&source=a");
    r.take(&packet("b", 2, 90.5, 8.0), from(2, 50), 100.0);
    assert_eq!(places(&mut r, 100.0), []);
}

#[test]
fn late_lost_repeated_and_odd_poses_are_counted() {
    let mut r = receiver("opentrackio://?wait_s=0.02&delay_s=0.25");
    for (sequence, time_s, now_s) in [(1, 5.00, 0.00), (2, 5.02, 0.02), (4, 5.06, 0.06)] {
        r.take(&packet("a", sequence, time_s, f64::from(sequence)), from(1, 50), now_s);
    }
    let first = r.next(0.06).unwrap();
    assert_eq!((first.time_s, first.arrived_s), (5.25, 0.0));
    assert_eq!(places(&mut r, 0.06), [(0, 2.0)]);
    // 3 was overtaken, and is in time.
    r.take(&packet("a", 3, 5.04, 3.0), from(1, 50), 0.07);
    assert_eq!(places(&mut r, 0.07), [(0, 3.0), (0, 4.0)]);
    // 5 is lost; 3 comes again, and 6 twice; one has an odd time.
    r.take(&packet("a", 6, 5.10, 6.0), from(1, 50), 0.10);
    assert_eq!(places(&mut r, 0.13), [(0, 6.0)]);
    r.take(&packet("a", 3, 5.04, 3.0), from(1, 50), 0.13);
    r.take(&packet("a", 6, 5.10, 6.0), from(1, 50), 0.13);
    r.take(&packet("a", 7, 999.0, 7.0), from(1, 50), 0.13);
    r.take(&packet("a", 8, 5.14, 8.0), from(1, 50), 0.14);
    assert_eq!(places(&mut r, 0.2), [(0, 8.0)]);
    let report = r.report();
    assert_eq!((report.poses, report.missed, report.jumps), (6, 2, 0), "5 and 7");
    let counts = [DropReason::Late, DropReason::Repeated, DropReason::OddTime].map(|why| report.count(why));
    assert_eq!(counts, [1, 1, 1]);
    // The clock jumps, and continues from there.
    r.take(&packet("a", 9, 70.0, 9.0), from(1, 50), 0.30);
    r.take(&packet("a", 10, 70.02, 10.0), from(1, 50), 0.32);
    assert_eq!(places(&mut r, 0.4), [(1, 9.0), (1, 10.0)]);
    assert_eq!((r.report().jumps, r.report().count(DropReason::OddTime)), (1, 1));
}

#[test]
fn samples_without_a_time_use_the_arrival_and_those_without_a_pose_update_the_lens() {
    let mut r = receiver("opentrackio://?wait_s=0");
    let mut take = |text: &str, now_s| {
        packets(Encoding::Json, 1, text.as_bytes()).iter().for_each(|p| r.take(p, from(1, 50), now_s));
        r.next(now_s)
    };
    assert_eq!(take(r#"{"lens":{"fStop":8,"entrancePupilOffset":0.5}}"#, 0.5), None);
    let place = r#"{"transforms":[{"translation":{"x":0,"y":0,"z":0},"rotation":{"pan":0,"tilt":0,"roll":0}}]}"#;
    let tracked = take(place, 0.75).unwrap();
    assert_eq!((tracked.time_s, tracked.clock, tracked.lens.f_stop), (0.75, Clock::Arrival, Some(8.0)));
    assert!((tracked.pose.position_in_world_m() - DVec3::new(0.0, 0.5, 0.0)).length() < 1e-12);
    assert_eq!(take(r#"{"transforms":[{"translation":{"x":"here"},"rotation":{}}]}"#, 1.0), None);
    assert_eq!(r.report().count(DropReason::NoPose), 2);
    assert_eq!(r.report().last_problem.as_deref(), Some("transforms[0].translation is not a map of finite numbers"));
}

/// Deterministic pseudo-random numbers.
struct PseudoRandom(u64);

impl PseudoRandom {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        self.0 >> 33
    }
}

#[test]
fn flood_of_garbage_costs_bounded_time_and_hides_no_pose() {
    let mut noise = PseudoRandom(1);
    for url in ["opentrackio://?wait_s=0&source=walk", "freed://?wait_s=0&source=3"] {
        let mut r = receiver(url);
        let began = Instant::now();
        let datagrams = tier::fast_or_full(6_000u32, 30_000);
        for i in 0..datagrams {
            let length = (noise.next() % 1500) as usize;
            let mut bytes: Vec<u8> = (0..length).map(|_| noise.next() as u8).collect();
            match i % 4 {
                // Complete packets of invalid samples; samples of other sources, one a datagram;
                // damaged ones.
                0 => {
                    bytes = packets(if i % 8 == 0 { Encoding::Json } else { Encoding::Cbor }, i as u16, &bytes).concat()
                }
                1 => bytes = packet(&format!("{i}"), i as u16, f64::from(i), 0.0),
                2 if length > 29 => {
                    bytes = packet("walk", i as u16, f64::from(i), 0.0);
                    let at = noise.next() as usize % bytes.len();
                    bytes[at] ^= 1 << (i % 8);
                }
                _ => {}
            }
            r.take(&bytes, from((i % 250) as u8, i as u16), 1e-4 * f64::from(i));
            while r.next(1e-4 * f64::from(i)).is_some() {}
        }
        // About 45 MB in the full tier. A hundred times as long would still be no hang.
        assert!(began.elapsed() < Duration::from_secs(60), "{:?}", began.elapsed());
        assert!(r.report().sources.len() <= 16 && r.report().datagrams == u64::from(datagrams));
        // The requested sender is received at once.
        let now_s = 10.0;
        let (_, pose) = walked(3);
        let good = D1::of_pose(3, &pose).unwrap().bytes();
        match url.starts_with("freed") {
            true => r.take(&good, from(9, 9), now_s),
            false => r.take(&packet("walk", 1, 1.0, 4.0), from(9, 9), now_s),
        }
        assert!(r.next(now_s).is_some(), "{url}");
    }
}

#[test]
fn deadline_is_kept_during_garbage() {
    let mut poses = Poses::open("opentrackio://127.0.0.1:0").unwrap();
    let noisy = UdpSocket::bind("127.0.0.1:0").unwrap();
    for _ in 0..100 {
        noisy.send_to(b"OTrk and nothing", poses.address()).unwrap();
    }
    let until = Instant::now() + Duration::from_millis(200);
    assert_eq!(poses.next(until).unwrap(), None);
    assert!(Instant::now() >= until && poses.report().poses == 0);
    assert_eq!(poses.report().count(DropReason::NoPacket), poses.report().datagrams);
    assert!(poses.report().datagrams > 0);
}

#[test]
fn port_in_use_and_foreign_address_are_refused_with_advice() {
    let taken = Poses::open("freed://127.0.0.1:0").unwrap();
    let error = Poses::open(&format!("freed://{}", taken.address())).err().unwrap().to_string();
    assert!(error.contains("in use") && error.contains("another port"), "{error}");
    let error = Poses::open("freed://203.0.113.9:4000").err().unwrap().to_string();
    assert!(error.contains("203.0.113.9:4000") && error.contains("0.0.0.0"), "{error}");
}

#[test]
fn unrepresentable_poses_are_not_sent() {
    let poses = Poses::open("freed://127.0.0.1:0").unwrap();
    let mut freed = Sender::open(&format!("freed://{}", poses.address()), "walk", 50.0, None).unwrap();
    let far = Pose::from_camera_in_world(DVec3::new(0.0, 200.0, 0.0), DQuat::IDENTITY);
    let error = freed.send(1.5, &far).unwrap_err().to_string();
    assert!(error.contains("1.5 s") && error.contains("y of 200 m"), "{error}");
    let mut open = Sender::open("opentrackio://127.0.0.1:9", "walk", 50.0, None).unwrap();
    for time_s in [-1.0, f64::NAN, 1e300] {
        assert!(open.check(time_s, &Pose::IDENTITY).is_err() && open.send(time_s, &Pose::IDENTITY).is_err());
    }
}

/// A receiver after 100 Hz of poses from 0 to 2 s, on a clock 95 s ahead, each with a delay of 1
/// ms.
fn settled_receiver(url: &str) -> Receiver {
    let mut r = receiver(url);
    (0..200).for_each(|i| _ = send_at(&mut r, i, 95.0));
    assert_eq!(r.report().drops(), "none");
    r
}

/// Sends number `i` at 0.01 `i` s, with its stamp shifted by `ahead_s`. Returns the poses delivered
/// by then: their lateness on the receiver's clock, and their number.
fn send_at(r: &mut Receiver, i: u16, ahead_s: f64) -> Vec<(f64, f64)> {
    let sent_s = 0.01 * f64::from(i);
    r.take(&packet("a", i, sent_s + ahead_s, f64::from(i)), from(1, 50), sent_s + 0.001);
    let late = |tracked: StreamPose| {
        let x = tracked.pose.position_in_world_m().x;
        (tracked.time_s + tracked.offset_s - 0.01 * x, x)
    };
    std::iter::from_fn(|| r.next(sent_s + 0.0015)).map(late).collect()
}

#[test]
fn single_stamp_ahead_changes_no_other_pose() {
    for ahead_s in [0.1, -0.1, 0.5] {
        let mut r = settled_receiver("opentrackio://?wait_s=0");
        send_at(&mut r, 200, 95.0 + ahead_s);
        for i in 201..1400 {
            let late: Vec<_> = send_at(&mut r, i, 95.0);
            assert!(
                matches!(late[..], [(late_s, x)] if (late_s - 0.001).abs() < 1e-6 && (x - f64::from(i)).abs() < 1e-6),
                "{late:?}"
            );
        }
        assert_eq!((r.report().steps, r.report().jumps), (0, 0), "{ahead_s}");
        assert!(r.report().drops().contains(if ahead_s > 0.0 {
            "1 at a time far from the others"
        } else {
            "1 too late"
        }));
    }
}

#[test]
fn clock_step_is_followed_and_counted() {
    for (by_s, after) in [(0.1, 199), (-0.1, 199)] {
        let mut r = settled_receiver("opentrackio://?wait_s=0");
        let late: Vec<_> = (200..600).flat_map(|i| send_at(&mut r, i, 95.0 + by_s)).collect();
        let wrong = late.iter().filter(|(late_s, x)| *x > f64::from(after) && (late_s - 0.001).abs() > 1e-6);
        assert_eq!(wrong.count(), 0, "{by_s}");
        assert!(late.iter().any(|(_, x)| (x - 599.0).abs() < 1e-6));
        assert_eq!((r.report().steps, r.report().jumps), (1, 0));
        assert!((r.report().last_step_s - by_s).abs() < 1e-6, "{}", r.report().last_step_s);
        assert!(r.report().summary().contains("its clock was reset 1 time"), "{}", r.report().summary());
    }
}

#[test]
fn samples_without_a_number_wait_and_are_not_late() {
    let mut r = receiver("opentrackio://?wait_s=0.02");
    let mut count = 0;
    for i in 0..100 {
        let sent_s = 0.01 * f64::from(i);
        let stamp = format!(r#""sampleTimestamp":{{"seconds":95,"nanoseconds":{}}}"#, 10_000_000 * i);
        let place = r#""transforms":[{"translation":{"x":0,"y":0,"z":0},"rotation":{"pan":0,"tilt":0,"roll":0}}]"#;
        let sample = format!(r#"{{"timing":{{{stamp}}},{place}}}"#);
        packets(Encoding::Json, i as u16, sample.as_bytes())
            .iter()
            .for_each(|p| r.take(p, from(1, 50), sent_s + 0.001));
        while let Some(tracked) = r.next(sent_s + 0.001) {
            // The time is that of arrival, although the pose has waited since.
            assert!((tracked.time_s + tracked.offset_s - tracked.arrived_s).abs() < 1e-6, "{tracked:?}");
            count += 1;
        }
    }
    assert!(count > 90, "{count}");
}

/// A message of a camera at x, m.
fn freed(camera: u8, x_m: f64) -> [u8; 29] {
    D1::of_pose(camera, &Pose { translation_m: DVec3::new(-x_m, 0.0, 0.0), ..Pose::IDENTITY }).unwrap().bytes()
}

#[test]
fn freed_messages_of_one_datagram_are_all_read_with_times_between_datagrams() {
    let mut r = receiver("freed://?wait_s=0");
    let mut received_poses = Vec::new();
    for i in 0..3u8 {
        let (x, now_s) = (f64::from(i), 0.5 + 0.04 * f64::from(i));
        let messages = [freed(1, x), freed(1, x + 0.25), freed(1, x + 0.5), freed(1, x + 0.75)];
        r.take(&messages.concat(), from(1, 50), now_s);
        received_poses.extend(std::iter::from_fn(|| r.next(now_s)).map(|t| (t.time_s, t.pose.position_in_world_m().x)));
    }
    // The first datagram's messages are spread over 20 ms, the others' over the time since the
    // previous one.
    let times_s = [0.485, 0.49, 0.495, 0.5, 0.51, 0.52, 0.53, 0.54, 0.55, 0.56, 0.57, 0.58];
    assert_eq!(received_poses.len(), 12, "{received_poses:?}");
    for (i, (received_poses, time_s)) in received_poses.iter().zip(times_s).enumerate() {
        assert!(
            (received_poses.0 - time_s).abs() < 1e-9 && (received_poses.1 - 0.25 * i as f64).abs() < 1e-4,
            "{received_poses:?}"
        );
    }
    assert_eq!(r.report().drops(), "none");
}

#[test]
fn freed_datagram_of_two_cameras_yields_the_followed_one_and_counts_the_other() {
    for (url, x) in [("freed://?wait_s=0", 1.0), ("freed://?wait_s=0&source=2", 2.0)] {
        let mut r = receiver(url);
        // Trailing bytes that are no message are reported, and the messages before them are used.
        r.take(&[&freed(1, 1.0)[..], &freed(2, 2.0), b"rest"].concat(), from(1, 50), 0.5);
        let received_poses: Vec<_> = std::iter::from_fn(|| r.next(0.5)).collect();
        assert!(matches!(received_poses.as_slice(), [one] if one.time_s == 0.5), "{received_poses:?}");
        assert!((received_poses[0].pose.position_in_world_m().x - x).abs() < 1e-4);
        assert_eq!((r.report().count(DropReason::OtherSource), r.report().count(DropReason::NoPacket)), (1, 1));
        assert!(
            r.report().last_problem.as_deref().unwrap().ends_with("29 bytes, not 4"),
            "{:?}",
            r.report().last_problem
        );
    }
}

#[test]
fn truncated_samples_are_dropped_and_never_mixed() {
    let mut r = receiver("opentrackio://?wait_s=0");
    for i in 0..22u16 {
        let text = format!(
            r#"{{"tracker":{{"notes":"{}"}},"timing":{{"sampleTimestamp":{{"seconds":{},"nanoseconds":0}}}},"transforms":[{{"translation":{{"x":{},"y":0,"z":0}},"rotation":{{"pan":0,"tilt":0,"roll":0}}}}]}}"#,
            "n".repeat(3000),
            1000 + i,
            f64::from(i)
        );
        let mut pieces = packets(Encoding::Json, i, text.as_bytes());
        assert_eq!(pieces.len(), 3);
        // The last packet of 20 and the first two of 21 are lost.
        match i {
            20 => drop(pieces.pop()),
            21 => drop(pieces.drain(..2)),
            _ => {}
        }
        pieces.iter().for_each(|piece| r.take(piece, from(1, 50), f64::from(i)));
        for tracked in std::iter::from_fn(|| r.next(f64::from(i))) {
            assert!((tracked.time_s - 1000.0 - tracked.pose.position_in_world_m().x).abs() < 1e-6, "{tracked:?}");
        }
    }
    assert_eq!(r.report().poses, 20);
    // Both are counted once no further packet can complete them.
    assert!(r.next(30.0).is_none());
    assert_eq!(r.report().drops(), "2 with pieces missing");
}
