//! `cargo +nightly fuzz run recording`: any text as each of the files that describe a recording.
#![no_main]

use libfuzzer_sys::fuzz_target;
use locard::recording::{OpenOptions, Recording};

/// The files that the formats are told by. The input is split at zero bytes, one piece a file;
/// the first byte of a piece says which.
const FILES: [&str; 9] = [
    "recording.toml",
    "trajectory.txt",
    "rgb.txt",
    "depth.txt",
    "groundtruth.txt",
    "transforms.json",
    "cameras.txt",
    "images.txt",
    "points3D.txt",
];

fuzz_target!(|bytes: &[u8]| {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for piece in bytes.split(|&byte| byte == 0) {
        if let Some((&which, content)) = piece.split_first() {
            let path = folder.path().join(FILES[usize::from(which) % FILES.len()]);
            std::fs::write(path, content).expect("a temporary file");
        }
    }
    drop(Recording::open(folder.path(), &OpenOptions::default()));
});
