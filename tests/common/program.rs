//! Runs the program `locard`.

#![allow(dead_code, reason = "each test file uses some of it")]

use std::path::Path;
use std::process::{Command, Output};

/// A command that runs the program; not started.
pub fn program() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_locard"));
    // As on a new user's system or in a container: the program itself must silence Mesa's device
    // selection.
    command.env_remove("NODEVICE_SELECT").env_remove("XDG_RUNTIME_DIR");
    command
}

pub fn locard(arguments: &[&str]) -> Output {
    program().args(arguments).output().unwrap()
}

/// Runs the program. Returns whether it succeeded, and its standard error.
pub fn success_and_stderr(arguments: &[&str]) -> (bool, String) {
    let output = locard(arguments);
    (output.status.success(), String::from_utf8(output.stderr).unwrap())
}

/// Runs the program, asserts success and returns its standard output.
pub fn stdout_of(arguments: &[&str]) -> String {
    let output = locard(arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// Runs the program, asserts exit code 2 and returns its standard error.
pub fn refused(arguments: &[&str]) -> String {
    let output = locard(arguments);
    let text = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {text}");
    text
}

/// Writes a recording of six of the demonstration's frames, the fourth of which is truncated.
pub fn with_a_truncated_frame(folder: &Path) {
    std::fs::create_dir(folder.join("rgb")).unwrap();
    let mut list = String::new();
    for i in 0..6 {
        let bytes = std::fs::read(format!("recordings/demo/rgb/{i:05}.jpg")).unwrap();
        let whole = if i == 3 { bytes.len() / 2 } else { bytes.len() };
        std::fs::write(folder.join(format!("rgb/{i:05}.jpg")), &bytes[..whole]).unwrap();
        list += &format!("{} rgb/{i:05}.jpg\n", f64::from(i) / 30.0);
    }
    std::fs::write(folder.join("rgb.txt"), list).unwrap();
    std::fs::write(folder.join("poses.txt"), "0 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n").unwrap();
    let text = "version = 1\n[frames]\nlist = \"rgb.txt\"\n[poses]\ntrajectory = \"poses.txt\"\nmax_gap_s = 2.0\n";
    std::fs::write(folder.join("recording.toml"), text).unwrap();
}

/// Copies a folder recursively.
pub fn copied(from: &Path, to: &Path) {
    std::fs::create_dir(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        let to = to.join(path.file_name().unwrap());
        if path.is_dir() {
            copied(&path, &to);
        } else {
            std::fs::copy(&path, &to).unwrap();
        }
    }
}
