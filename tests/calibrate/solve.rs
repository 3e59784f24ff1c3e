//! `locard solve`, with a program in COLMAP's place that returns a model made from the true poses.

use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::Output;

use glam::{DMat3, DQuat, DVec2, DVec3};
use locard::recording::{OpenOptions, Recording};
use locard::tags::{Paper, Sheet};

use crate::filmed::{AWAY, FPS, FRAMES, Site, place};
use crate::program::program;
use crate::sheet::CAMERA;

/// The model's frame: x ↦ (R · x + t) / SCALE.
const SCALE: f64 = 3.7;

fn in_model(point: DVec3) -> DVec3 {
    (DQuat::from_euler(glam::EulerRot::ZYX, 1.1, -0.4, 0.7) * point + DVec3::new(0.4, -0.2, 1.0)) / SCALE
}

/// Every other corner of the printed cells: landmarks.
fn landmarks() -> Vec<DVec3> {
    let board = Sheet::new(Paper::A4).board;
    let cells = board.family.cells();
    let mut points = Vec::new();
    for tag in &board.tags {
        let [left_top, right_top, _, left_bottom] = tag.corners_m();
        let steps = || (0..=cells).step_by(2).map(|i| f64::from(i) / f64::from(cells));
        for (y, x) in steps().flat_map(|y| steps().map(move |x| (y, x))) {
            points.push(left_top + x * (right_top - left_top) + y * (left_bottom - left_top));
        }
    }
    points
}

struct Bytes(Vec<u8>);

impl Bytes {
    fn u32(&mut self, value: u32) -> &mut Self {
        self.0.extend(value.to_le_bytes());
        self
    }

    fn u64(&mut self, value: u64) -> &mut Self {
        self.0.extend(value.to_le_bytes());
        self
    }

    fn numbers(&mut self, values: &[f64]) -> &mut Self {
        self.0.extend(values.iter().flat_map(|value| value.to_le_bytes()));
        self
    }
}

/// Writes a model of these frames, in COLMAP's binary form.
fn write_model(folder: &Path, frames: &[usize]) {
    let points = landmarks();
    let mut cameras = Bytes(Vec::new());
    // OPENCV.
    cameras.u64(1).u32(1).u32(4).u64(640).u64(480);
    let (f, c) = (CAMERA.focal_px, CAMERA.centre_px);
    cameras.numbers(&[f, f, c.x, c.y, CAMERA.k1, CAMERA.k2, CAMERA.p1, CAMERA.p2]);
    let mut images = Bytes(Vec::new());
    images.u64(frames.len() as u64);
    for frame in frames {
        let truth = place(*frame as f64 / FPS);
        // Columns of the camera's axes in the model.
        let turned = |axis: DVec3| (in_model(axis) - in_model(DVec3::ZERO)) * SCALE;
        let axes = DMat3::from_cols(turned(truth.axes.x_axis), turned(truth.axes.y_axis), turned(truth.axes.z_axis));
        let rotation = DQuat::from_mat3(&axes).conjugate();
        let translation = -(rotation * in_model(truth.at_m));
        images.u32(*frame as u32 + 1).numbers(&[rotation.w, rotation.x, rotation.y, rotation.z]);
        images.numbers(&translation.to_array()).u32(1);
        images.0.extend(format!("{frame:06}.png\0").as_bytes());
        let inside = |at: &DVec2| at.x > 0.0 && at.y > 0.0 && at.x < 640.0 && at.y < 480.0;
        let projections: Vec<(usize, DVec2)> = points
            .iter()
            .enumerate()
            .map(|(i, point)| (i, truth.project(&CAMERA, *point)))
            .filter(|(_, at)| inside(at))
            .collect();
        images.u64(projections.len() as u64);
        for (i, at) in projections {
            images.numbers(&[at.x, at.y]).u64(i as u64);
        }
    }
    let mut landmarks = Bytes(Vec::new());
    landmarks.u64(points.len() as u64);
    for (i, point) in points.iter().enumerate() {
        landmarks.u64(i as u64).numbers(&in_model(*point).to_array());
        landmarks.0.extend([0, 0, 0]);
        landmarks.numbers(&[0.1]).u64(0);
    }
    for (name, bytes) in [("cameras.bin", cameras), ("images.bin", images), ("points3D.bin", landmarks)] {
        std::fs::write(folder.join(name), bytes.0).unwrap();
    }
}

/// A folder with a `colmap` that returns the model of a folder, or none, beside ffmpeg alone.
fn programs(at: &Path, model: Option<&Path>) -> PathBuf {
    let folder = at.join("bin");
    std::fs::create_dir_all(&folder).unwrap();
    for name in ["ffmpeg", "ffprobe"] {
        let path = std::env::var_os("PATH").unwrap();
        let real = std::env::split_paths(&path).map(|folder| folder.join(name)).find(|file| file.is_file()).unwrap();
        let _ = std::os::unix::fs::symlink(real, folder.join(name));
    }
    let mapped = match model {
        Some(model) => format!("/bin/mkdir \"$to/0\"; /bin/cp {}/*.bin \"$to/0/\"", model.display()),
        None => "echo 'No good initial image pair found.' >&2; exit 1".to_owned(),
    };
    let script = format!(
        "#!/bin/sh\nfor argument do\n[ \"$before\" = --output_path ] && to=$argument\nbefore=$argument\ndone\n\
         case \"$1 $2\" in\n-h*) echo 'COLMAP 3.8 (without CUDA)';;\n'feature_extractor -h') echo '--SiftExtraction.use_gpu';;\n\
         feature_extractor*) echo 'Processed file [1/2]';;\nmapper*) {mapped};;\nesac\n"
    );
    let file = folder.join("colmap");
    std::fs::write(&file, script).unwrap();
    std::fs::set_permissions(&file, std::fs::Permissions::from_mode(0o755)).unwrap();
    folder
}

fn solve(path: &Path, site: &Site, more: &[&str]) -> Output {
    let (video, to) = (site.path("site.mkv"), site.path("solved"));
    program().args(["solve", &video, "-o", &to, "--no-analysis"]).args(more).env("PATH", path).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

// Slow: the program decodes a video of 18 frames three times and tracks landmarks through it.
#[test]
fn model_and_frames_between_become_a_recording_in_the_boards_world() {
    let site = Site::shared(&CAMERA);
    let model = tempfile::tempdir().unwrap();
    let posed: Vec<usize> = (0..FRAMES).filter(|i| !AWAY.contains(i)).collect();
    write_model(model.path(), &posed);
    let path = programs(model.path(), Some(model.path()));
    let output = solve(&path, &site, &[]);
    let stdout = text(&output.stdout);
    assert!(output.status.success(), "{}", text(&output.stderr));
    for line in [
        "poses      15 of 18 frames: ",
        "scale      by 6 tags of the board",
        "lost       frames 10 to 12 (0.333 to 0.400 s)",
    ] {
        assert!(stdout.contains(line), "{stdout}");
    }
    let recording = Recording::open(Path::new(&site.path("solved")), &OpenOptions::default()).unwrap();
    assert_eq!((recording.frame_count(), recording.up), (FRAMES, Some(DVec3::Z)));
    let points = [DVec3::ZERO, DVec3::new(0.2, 0.05, 0.0), DVec3::new(-0.15, -0.1, 0.1), DVec3::new(0.1, 0.2, 0.0)];
    for i in 0..FRAMES {
        let pose = recording.pose_at_frame(i);
        assert_eq!(pose.is_err(), AWAY.contains(&i), "frame {i}");
        let Ok(pose) = pose else { continue };
        for point in points {
            let own = pose.transform_point(point);
            let off_px =
                CAMERA.project_ray(own.truncate() / own.z).distance(place(i as f64 / FPS).project(&CAMERA, point));
            assert!(off_px < 0.5, "frame {i}: {off_px:.3} px off");
        }
    }
    let profile = std::fs::read_to_string(site.path("solved/camera.toml")).unwrap();
    assert!(profile.contains("fx_px = 560") && profile.contains("k1 = -0.21"), "{profile}");

    // A measured distance in the board's place: the diagonal of a tag, stated twice as long. A
    // frame that was not chosen is refused; the message names the nearest one that was.
    let path_m = |recording: &Recording| -> f64 {
        let at: Vec<DVec3> = recording.track.poses().iter().map(|(_, pose)| pose.position_in_world_m()).collect();
        at.windows(2).map(|pair| pair[0].distance(pair[1])).sum()
    };
    let by_board_m = path_m(&recording);
    let corners = [landmarks()[0], landmarks()[24]];
    let distance = |frame: usize| {
        let [a, b] = corners.map(|corner| place(frame as f64 / FPS).project(&CAMERA, corner));
        format!("{frame}:{},{}:{},{}={}", a.x, a.y, b.x, b.y, 2.0 * corners[0].distance(corners[1]))
    };
    let unsolved = format!("{}:1,2:3,4=1", AWAY.start);
    let refused = text(&solve(&path, &site, &["--force", "--distance", &unsolved]).stderr);
    let (_, nearest) = refused.trim_end().rsplit_once("the nearest is ").unwrap_or_else(|| panic!("{refused}"));
    let output = solve(&path, &site, &["--force", "--distance", &distance(nearest.parse().unwrap())]);
    let stdout = text(&output.stdout);
    assert!(stdout.contains("scale      by the measured distance of"), "{stdout}{}", text(&output.stderr));
    let measured = Recording::open(Path::new(&site.path("solved")), &OpenOptions::default()).unwrap();
    let ratio = path_m(&measured) / by_board_m;
    assert!((ratio - 2.0).abs() < 0.02, "{ratio}");
}

#[test]
fn failures_name_their_cause_and_remedy_and_write_nothing() {
    let site = Site::shared(&CAMERA);
    let folder = tempfile::tempdir().unwrap();
    let path = programs(folder.path(), None);
    let refused = |path: &Path, more: &[&str]| {
        let output = solve(path, &site, more);
        assert_eq!(output.status.code(), Some(2), "{}", text(&output.stdout));
        assert!(!Path::new(&site.path("solved")).exists());
        text(&output.stderr)
    };
    let error = refused(&path, &[]);
    assert!(error.contains("no frames fit together") && error.contains("sideways"), "{error}");
    // A model of two frames, and none of the chosen.
    let model = tempfile::tempdir().unwrap();
    write_model(model.path(), &[0]);
    programs(folder.path(), Some(model.path()));
    assert!(refused(&path, &[]).contains("fit together"));
    std::fs::remove_file(path.join("colmap")).unwrap();
    let error = refused(&path, &[]);
    assert!(error.contains("`colmap` is missing") && error.contains("apt-get install colmap"), "{error}");
    let error = refused(&path, &["--distance", "3:1,2=1"]);
    assert!(error.contains("30:210,330:330,260=0.42"), "{error}");
    for outside in ["18:1,2:3,4=1", "3:1,2:640,4=1"] {
        let error = refused(&path, &["--distance", outside]);
        assert!(error.contains("below 18") && error.contains("640x480"), "{error}");
    }
    let small = folder.path().join("small.toml");
    std::fs::write(&small, CAMERA.profile().replace("width_px = 640", "width_px = 320")).unwrap();
    let error = refused(&path, &["--profile", small.to_str().unwrap()]);
    assert!(error.contains("640x480") && error.contains("320x480"), "{error}");
}
