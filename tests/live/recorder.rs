//! Recordings during writing: read back bit for bit, killed at any moment, on a full disk.

use std::io::{self, BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Command, Stdio};

use crate::tier;
use glam::{DQuat, DVec3};
use locard::pose::Pose;
use locard::recording::recorder::{Folder, Recorder, RecorderError, RecordingInfo, Store, discard};
use locard::recording::write::{Covariance, Line, covariances};
use locard::recording::{OpenOptions, Recording};

const INTERVAL_S: f64 = 1.0 / 30.0;

fn about() -> RecordingInfo {
    RecordingInfo {
        interval_s: INTERVAL_S,
        max_gap_s: 0.1,
        up: Some(DVec3::Z),
        has_floor: true,
        camera: Some("a \"camera\"".to_owned()),
        delivered: Some("2x2 rgb".to_owned()),
        has_exposure: true,
        has_cameras: false,
        profile: None,
    }
}

fn png() -> Vec<u8> {
    let mut file = Vec::new();
    let encoder = image::codecs::png::PngEncoder::new(&mut file);
    image::ImageEncoder::write_image(encoder, &[7; 12], 2, 2, image::ExtendedColorType::Rgb8).unwrap();
    file
}

/// Times as given by a monotonic clock, with all significant bits.
fn time_s(i: usize) -> f64 {
    40_213.7 + INTERVAL_S * i as f64 + 1e-7 * ((i * 7919) % 100) as f64
}

fn line(i: usize) -> Line {
    let t = i as f64 / 50.0;
    let pose = Pose::from_camera_in_world(DVec3::new(t.sin(), t, 1.6), DQuat::from_rotation_y(0.37 * t));
    Line::new(time_s(i) - 0.01, &pose)
}

fn add<S: Store>(recorder: &mut Recorder<S>, i: usize, picture: &[u8]) -> Result<(), RecorderError> {
    recorder.pose(line(i));
    recorder.frame(time_s(i), "png", picture, Some(0.01 + 1e-5 * i as f64), Some(1.0))
}

fn open(path: &Path) -> Recording {
    Recording::open(path, &OpenOptions::default()).unwrap()
}

#[test]
fn recording_reads_back_bit_for_bit() {
    let temp = tempfile::tempdir().unwrap();
    let path = temp.path().join("site");
    let mut recorder = Recorder::create(&path, &about()).unwrap();
    let picture = png();
    // Every third frame is dropped: its time is missing, and nothing else.
    let taken: Vec<usize> = (0..100).filter(|i| i % 3 != 1).collect();
    taken.iter().for_each(|i| add(&mut recorder, *i, &picture).unwrap());
    assert_eq!(recorder.finish().unwrap(), taken.len());

    let recording = open(&path);
    let times: Vec<f64> = taken.iter().map(|i| time_s(*i)).collect();
    assert_eq!(&*recording.timestamps_s, times);
    let poses: Vec<(f64, Pose)> = taken.iter().map(|i| (line(*i).time_s, line(*i).pose())).collect();
    assert_eq!(recording.track.poses(), poses);
    for (i, exposure) in taken.iter().zip(&*recording.exposure) {
        assert_eq!(exposure.time_s, Some(0.01 + 1e-5 * *i as f64));
    }
    // A dropped frame does not lengthen the exposure.
    let intervals = [0, 1, taken.len() - 1].map(|frame| recording.interval_s(frame));
    assert_eq!((intervals, recording.frame_interval_s), ([INTERVAL_S; 3], INTERVAL_S));
    assert_eq!(recording.up, Some(DVec3::Z));
    // A gap of 0.0767 s is bridged, since max_gap_s = 0.1.
    assert!(recording.pose_at_frame(1).is_ok());
    assert!(recording.check_ends().1.is_empty());

    let error = Recorder::create(&path, &about()).unwrap_err().to_string();
    assert!(error.ends_with("site: exists already, and is kept; name a new folder"), "{error}");
}

#[test]
fn frame_is_listed_once_its_opacity_is_settled() {
    let temp = tempfile::tempdir().unwrap();
    let mut recorder = Recorder::create(temp.path(), &about()).unwrap();
    let picture = png();
    let frame =
        |recorder: &mut Recorder<Folder>, i| recorder.frame(time_s(i), "png", &picture, Some(0.01), None).unwrap();
    frame(&mut recorder, 0);
    frame(&mut recorder, 1);
    recorder.commit().unwrap();
    // Not a recording yet.
    assert!(Recording::open(temp.path(), &OpenOptions::default()).is_err());
    assert!(!temp.path().join("recording.toml").exists());
    recorder.set_opacity(time_s(0), 1.0).unwrap();
    assert_eq!(open(temp.path()).frame_count(), 1);
    // The opacity of later frames is not settled, so none of them is listed.
    let share = |i: usize| (i as f64 * 0.37).sin().abs();
    for i in 2..40 {
        recorder.set_opacity(time_s(i - 1), share(i - 1)).unwrap();
        frame(&mut recorder, i);
    }
    let recording = open(temp.path());
    assert!((25..40).contains(&recording.frame_count()), "{}", recording.frame_count());
    recorder.set_opacity(time_s(39), share(39)).unwrap();
    recorder.commit().unwrap();
    frame(&mut recorder, 40);
    // The last opacity is not settled.
    drop(recorder);
    let recording = open(temp.path());
    assert_eq!(recording.frame_count(), 41);
    assert_eq!([0, 40].map(|i| recording.opacity(i)), [1.0; 2]);
    let frames = recording.frames(0..40).unwrap().skip(1).zip(1..);
    frames.for_each(|(frame, i)| assert_eq!(frame.unwrap().opacity, share(i)));
    let list = std::fs::read_to_string(temp.path().join("frames.txt")).unwrap();
    assert_eq!(list.matches("opacity=").count(), 39);
}

#[test]
fn covariances_are_listed_if_present() {
    let temp = tempfile::tempdir().unwrap();
    let mut recorder = Recorder::create(temp.path(), &about()).unwrap();
    let list = temp.path().join("covariance.txt");
    add(&mut recorder, 0, &png()).unwrap();
    assert!(!list.exists());
    let of =
        |i: usize| Covariance { time_s: line(i).time_s, upper: std::array::from_fn(|k| 1e-7 / (i * 21 + k) as f64) };
    for i in 1..50 {
        recorder.covariance(of(i));
        add(&mut recorder, i, &png()).unwrap();
    }
    recorder.finish().unwrap();
    let all: Vec<Covariance> = (1..50).map(of).collect();
    assert_eq!(std::fs::read_to_string(&list).unwrap(), covariances(&all, true));
    let read: Vec<f64> = covariances(&all[..1], false).split_whitespace().map(|n| n.parse().unwrap()).collect();
    assert!(read[0] == all[0].time_s && read[1..] == all[0].upper);
    assert_eq!(open(temp.path()).frame_count(), 50);
}

#[test]
fn frame_with_an_earlier_time_is_refused_without_effect() {
    let temp = tempfile::tempdir().unwrap();
    let mut recorder = Recorder::create(temp.path(), &about()).unwrap();
    add(&mut recorder, 5, &png()).unwrap();
    for back in [5, 4] {
        let error = recorder.frame(time_s(back), "png", &png(), None, Some(1.0)).unwrap_err();
        assert!(matches!(error, RecorderError::Backwards { .. }), "{error}");
    }
    add(&mut recorder, 6, &png()).unwrap();
    recorder.finish().unwrap();
    assert_eq!(open(temp.path()).frame_count(), 2);
}

#[test]
fn unterminated_line_is_left_out_and_reported() {
    let temp = tempfile::tempdir().unwrap();
    let mut recorder = Recorder::create(temp.path(), &about()).unwrap();
    (0..9).for_each(|i| add(&mut recorder, i, &png()).unwrap());
    recorder.finish().unwrap();
    for list in ["frames.txt", "poses.txt", "exposure.txt"] {
        let file = temp.path().join(list);
        let whole = std::fs::read_to_string(&file).unwrap();
        // Even one that would parse as a number.
        let cut = whole.trim_end();
        let start = cut.rfind('\n').unwrap() + 1;
        for end in start + 1..=cut.len() {
            std::fs::write(&file, &cut[..end]).unwrap();
            let recording = open(temp.path());
            let message = format!("{list}: the last line, 10, is incomplete and left out");
            assert!(recording.warnings.iter().any(|w| w.ends_with(&message)), "{:?}", recording.warnings);
            let counts = [recording.frame_count(), recording.track.poses().len()];
            let expected = match list {
                "frames.txt" => [8, 9],
                "poses.txt" => [9, 8],
                _ => [9, 9],
            };
            assert_eq!(counts, expected, "{list} cut at {end}");
        }
        std::fs::write(&file, &whole).unwrap();
    }
    assert!(open(temp.path()).warnings.is_empty(), "{:?}", open(temp.path()).warnings);
}

/// The test runs its own executable again as the recorder to kill.
const CHILD: &str = "LOCARD_TEST_RECORDS_INTO";

/// Frames per second.
const SECOND: usize = 30;

#[test]
fn killed_recorder_loses_less_than_a_second() {
    if let Some(folder) = std::env::var_os(CHILD) {
        let mut recorder = Recorder::create(Path::new(&folder), &about()).unwrap();
        let picture = png();
        for i in 0.. {
            add(&mut recorder, i, &picture).unwrap();
            println!("\nrecorded {}", i + 1);
            io::stdout().flush().unwrap();
        }
    }
    let mut state = 12_345u64;
    for round in 0..tier::fast_or_full(5, 20) {
        let temp = tempfile::tempdir().unwrap();
        let path = temp.path().join("site");
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "recorder::killed_recorder_loses_less_than_a_second", "--nocapture"])
            .env(CHILD, &path)
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        // Lehmer's generator.
        state = state * 48_271 % 2_147_483_647;
        // Every fourth round in its first half second.
        let until = 1 + state as usize % if round % 4 == 0 { 15 } else { 115 };
        let lines = BufReader::new(child.stdout.take().unwrap()).lines().map_while(Result::ok);
        let mut counts = lines.filter_map(|line| line.strip_prefix("recorded ")?.parse::<usize>().ok());
        assert!(counts.any(|count| count >= until), "the recorder ended by itself");
        child.kill().unwrap();
        child.wait().unwrap();
        let last_count = counts.last().unwrap_or(until);
        let recording = open(&path);
        let kept = recording.frame_count();
        assert!(
            kept + SECOND > last_count && kept <= last_count + 1,
            "round {round}: {kept} of {last_count} frames are left"
        );
        let (number, damaged) = recording.check_ends();
        assert!(damaged.is_empty() && number == kept, "round {round}: {damaged:?}");
        let times: Vec<f64> = (0..kept).map(time_s).collect();
        assert_eq!(&*recording.timestamps_s, times);
        // Every remaining frame has its pose.
        assert!(recording.track.poses().len() >= kept);
    }
}

/// A disk with limited space, bytes.
struct SmallDisk {
    folder: Folder,
    path: std::path::PathBuf,
    room: usize,
}

impl SmallDisk {
    fn take(&mut self, bytes: usize) -> io::Result<()> {
        let fits = bytes <= self.room;
        self.room = self.room.saturating_sub(bytes);
        if fits { Ok(()) } else { Err(io::ErrorKind::StorageFull.into()) }
    }
}

impl Store for SmallDisk {
    fn file(&mut self, name: &Path, bytes: &[u8]) -> io::Result<()> {
        let before = self.room;
        if let Err(error) = self.take(bytes.len()) {
            // The incomplete file is removed, and its space is free again.
            assert!(!self.path.join(name).exists());
            self.room = before;
            return Err(error);
        }
        self.folder.file(name, bytes)
    }

    fn remove(&mut self, name: &Path) -> io::Result<()> {
        self.room += std::fs::metadata(self.path.join(name))?.len() as usize;
        self.folder.remove(name)
    }

    fn append(&mut self, lines: [&str; 5]) -> io::Result<()> {
        let (bytes, before) = (lines.iter().map(|lines| lines.len()).sum(), self.room);
        if let Err(error) = self.take(bytes) {
            self.room = before;
            return Err(error);
        }
        self.folder.append(lines)
    }

    fn sync(&mut self) -> io::Result<()> {
        self.folder.sync()
    }
}

#[test]
fn full_disk_ends_the_recording_with_complete_frames() {
    let picture = png();
    let mut ends = std::collections::BTreeSet::new();
    for room in (900..9000).step_by(tier::fast_or_full(451, 301)) {
        let temp = tempfile::tempdir().unwrap();
        std::fs::create_dir(temp.path().join("frames")).unwrap();
        let store = SmallDisk { folder: Folder::new(temp.path()).unwrap(), path: temp.path().to_owned(), room };
        let mut recorder = Recorder::begin(store, temp.path(), &about()).unwrap();
        let error = (0..).find_map(|i| add(&mut recorder, i, &picture).err()).unwrap();
        assert!(error.to_string().contains("the disk is full; make room, or write elsewhere"), "{error}");
        let frames = recorder.frames();
        // It has ended, even if there is space again.
        assert!(matches!(recorder.frame(1e9, "png", &picture, None, Some(1.0)), Err(RecorderError::Ended)));
        drop(recorder);
        match Recording::open(temp.path(), &OpenOptions::default()) {
            Ok(recording) => {
                assert!(recording.frame_count() == frames && recording.check_ends().1.is_empty());
                let warnings = &recording.warnings;
                assert!(!warnings.iter().any(|warning| warning.contains("is incomplete")), "{warnings:?}");
                ends.insert(recording.frame_count());
            }
            Err(error) => {
                assert!(error.to_string().ends_with("the recording has no frames"), "{error}");
                ends.insert(0);
            }
        }
    }
    // It ended at many points, not only after lines were written.
    assert!(ends.len() > 10, "{ends:?}");
}

/// Records the calls of a store.
#[derive(Clone, Default)]
struct CallLog(std::rc::Rc<std::cell::RefCell<Vec<String>>>);

impl Store for CallLog {
    fn file(&mut self, name: &Path, _: &[u8]) -> io::Result<()> {
        self.0.borrow_mut().push(name.display().to_string());
        Ok(())
    }
    fn remove(&mut self, _: &Path) -> io::Result<()> {
        Ok(())
    }
    fn append(&mut self, lines: [&str; 5]) -> io::Result<()> {
        self.0.borrow_mut().push(format!("lines {}", lines[4].lines().filter(|line| !line.starts_with('#')).count()));
        Ok(())
    }
    fn sync(&mut self) -> io::Result<()> {
        self.0.borrow_mut().push("sync".to_owned());
        Ok(())
    }
}

#[test]
fn line_is_appended_after_its_picture_is_on_the_disk() {
    let noted = CallLog::default();
    let mut recorder = Recorder::begin(noted.clone(), Path::new("site"), &about()).unwrap();
    (0..40).for_each(|i| add(&mut recorder, i, &png()).unwrap());
    recorder.finish().unwrap();
    let (mut synced, mut written, mut listed) = (0, 0, 0);
    for what in noted.0.borrow().iter() {
        match what.strip_prefix("lines ") {
            Some(lines) => {
                listed += lines.parse::<usize>().unwrap();
                assert!(listed <= synced, "{listed} of {synced}");
            }
            None if what == "sync" => synced = written,
            None => written += usize::from(what.starts_with("frames/")),
        }
    }
    assert_eq!((listed, written), (40, 40));
}

#[test]
fn lines_are_appended_after_64_pictures_regardless_of_time() {
    let temp = tempfile::tempdir().unwrap();
    let mut recorder = Recorder::create(temp.path(), &about()).unwrap();
    for i in 0..70 {
        recorder.pose(line(i));
        recorder.frame(1.0 + 1e-5 * i as f64, "png", &png(), Some(0.01), Some(1.0)).unwrap();
    }
    assert_eq!(open(temp.path()).frame_count(), 65, "the first, and sixty-four at once");
    recorder.finish().unwrap();
    assert_eq!(open(temp.path()).frame_count(), 70);
}

#[test]
fn first_settled_opacity_of_a_frame_is_kept() {
    let temp = tempfile::tempdir().unwrap();
    let mut recorder = Recorder::create(temp.path(), &about()).unwrap();
    add(&mut recorder, 0, &png()).unwrap();
    recorder.frame(time_s(1), "png", &png(), Some(0.01), None).unwrap();
    recorder.set_opacity(time_s(1), 0.25).unwrap();
    recorder.set_opacity(time_s(1), 0.75).unwrap();
    recorder.finish().unwrap();
    assert_eq!(open(temp.path()).opacity(1), 0.25);
}

#[test]
fn recording_without_frames_is_removed_and_other_files_kept() {
    let temp = tempfile::tempdir().unwrap();
    let path = temp.path().join("site");
    let begun = |frames: usize| {
        let about = RecordingInfo { profile: Some("version = 1\n".to_owned()), ..about() };
        let mut recorder = Recorder::create(&path, &about).unwrap();
        (0..frames).for_each(|i| add(&mut recorder, i, &png()).unwrap());
        recorder.finish().unwrap();
    };
    begun(0);
    assert!(path.join("poses.txt").exists());
    discard(&path, true);
    assert_eq!(std::fs::read_dir(&path).unwrap().count(), 0);
    begun(0);
    discard(&path, false);
    assert!(!path.exists());
    // A foreign file, and an existing recording.
    begun(0);
    std::fs::write(path.join("mine.txt"), "mine").unwrap();
    discard(&path, false);
    assert_eq!(std::fs::read_dir(&path).unwrap().count(), 1);
    std::fs::remove_dir_all(&path).unwrap();
    begun(1);
    discard(&path, false);
    assert_eq!(open(&path).frame_count(), 1);
}

/// A list that cannot be written does not affect those before it, and none after it is written:
/// frames come last.
#[test]
fn lists_are_appended_all_or_none_and_frames_last() {
    let temp = tempfile::tempdir().unwrap();
    let mut folder = Folder::new(temp.path()).unwrap();
    let read = |name: &str| std::fs::read_to_string(temp.path().join(name)).ok();
    folder.append(["a\n", "b\n", "", "", ""]).unwrap();
    std::fs::create_dir(temp.path().join("covariance.txt")).unwrap();
    assert!(folder.append(["aa\n", "bb\n", "cc\n", "", "dd\n"]).is_err());
    assert_eq!(["poses.txt", "exposure.txt", "frames.txt"].map(read), [Some("a\n".into()), Some("b\n".into()), None]);
    std::fs::remove_dir(temp.path().join("covariance.txt")).unwrap();
    folder.append(["aaa\n", "", "ccc\n", "", "ddd\n"]).unwrap();
    let all = ["poses.txt", "exposure.txt", "covariance.txt", "frames.txt"].map(read);
    assert_eq!(all.map(Option::unwrap), ["a\naaa\n", "b\n", "ccc\n", "ddd\n"]);
}
