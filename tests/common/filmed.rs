//! A video of a printed sheet of tags, with the camera's profile and its true path.

#![allow(dead_code, reason = "each test file uses some of it")]

use std::io::Write;
use std::path::Path;
use std::process::{Command, Stdio};

use glam::DVec3;

use super::fixture;
use super::program::stdout_of;
use super::sheet::{Camera, CameraPose, Sheet};

pub const FRAMES: usize = 18;
pub const FPS: f64 = 30.0;
/// Frames in which the sheet is out of view.
pub const AWAY: std::ops::Range<usize> = 10..13;

/// Pose of a hand-held camera that moves around the sheet at a distance of 0.8 m.
pub fn place(time_s: f64) -> CameraPose {
    let (a, sway) = (0.8 + 0.5 * time_s, 0.02 * (9.0 * time_s).sin());
    let at = DVec3::new(0.45 * a.cos() + sway, -0.5 * a.sin(), 0.62 - sway);
    let away = AWAY.contains(&((time_s * FPS).round() as usize));
    CameraPose::look_at(
        at,
        if away { DVec3::new(3.0, 4.0, 0.0) } else { DVec3::new(0.03, 0.05 * time_s, 0.0) },
        0.2 * sway,
    )
}

/// A folder with the sheet, its board file, the camera's profile and a video of the sheet.
pub struct Site {
    pub folder: tempfile::TempDir,
}

impl Site {
    pub fn new(camera: &Camera) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let site = Self { folder };
        stdout_of(&["board", "-o", &site.path("board.png"), "--quiet"]);
        let printed = image::open(site.path("board.png")).unwrap().into_luma8();
        let sheet = Sheet::of(printed.width() as usize, printed.height() as usize, printed.into_raw());
        std::fs::write(site.path("camera.toml"), camera.profile()).unwrap();
        let frames = (0..FRAMES).map(|i| {
            let time_s = i as f64 / FPS;
            sheet.photograph(camera, 4, 1.0, i as u64, |t| place(time_s + t))
        });
        video(Path::new(&site.path("site.mkv")), frames);
        site
    }

    /// Copies the site of this camera from a fixture, which is made once per build of the program.
    pub fn shared(camera: &Camera) -> Self {
        let filmed = fixture::once("filmed", &[], camera.profile(), |folder| {
            copy_files(Self::new(camera).folder.path(), folder);
        });
        let folder = tempfile::tempdir().unwrap();
        copy_files(&filmed, folder.path());
        Self { folder }
    }

    /// Writes a scene with a marker beside the sheet and returns its path.
    pub fn scene(&self) -> String {
        let marker = Path::new("scenes/marker-1.glb").canonicalize().unwrap();
        let scene =
            format!("version = 1\n[[objects]]\nmodel = \"{}\"\nposition_m = [0.16, 0.0, 0.0]\n", marker.display());
        std::fs::write(self.path("scene.toml"), scene).unwrap();
        self.path("scene.toml")
    }

    /// Writes the video repeated 301 times, longer than any test, and returns its path.
    pub fn endless(&self) -> String {
        let (from, to) = (self.path("site.mkv"), self.path("endless.mkv"));
        let arguments = ["-v", "error", "-stream_loop", "300", "-i", &from, "-c", "copy", &to];
        assert!(Command::new("ffmpeg").args(arguments).status().unwrap().success());
        to
    }

    /// Writes the video repeated `times` times and returns its path.
    pub fn repeated(&self, times: usize) -> String {
        let (from, to, more) = (self.path("site.mkv"), self.path("repeated.mkv"), (times - 1).to_string());
        let arguments = ["-v", "error", "-stream_loop", &more, "-i", &from, "-c", "copy", &to];
        assert!(Command::new("ffmpeg").args(arguments).status().unwrap().success());
        to
    }

    pub fn path(&self, name: &str) -> String {
        self.folder.path().join(name).to_str().unwrap().to_owned()
    }

    pub fn track(&self, board: &str, to: &str) -> Vec<String> {
        let board = self.path(board);
        let (video, profile, to) = (self.path("site.mkv"), self.path("camera.toml"), self.path(to));
        ["track", &video, "--profile", &profile, "--board", &board, "-o", &to].map(str::to_owned).to_vec()
    }
}

/// Copies the files of a folder without subfolders.
fn copy_files(from: &Path, to: &Path) {
    for entry in std::fs::read_dir(from).unwrap() {
        let file = entry.unwrap();
        std::fs::copy(file.path(), to.join(file.file_name())).unwrap();
    }
}

/// Encodes a lossless video.
fn video(path: &Path, frames: impl Iterator<Item = Vec<u8>>) {
    let mut ffmpeg = Command::new("ffmpeg")
        .args(["-v", "error", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", "640x480", "-r", "30", "-i", "-"])
        .args(["-c:v", "libx264rgb", "-preset", "ultrafast", "-qp", "0"])
        .arg(path)
        .stdin(Stdio::piped())
        .spawn()
        .unwrap();
    let mut into = ffmpeg.stdin.take().unwrap();
    frames.for_each(|codes| into.write_all(&codes).unwrap());
    drop(into);
    assert!(ffmpeg.wait().unwrap().success());
}
