//! The fuzz targets' code for arbitrary bytes. It must not panic, hang or take much memory.

use locard::recording::{OpenOptions, Recording};
use locard::scene::{self, SceneError};
use locard::site::SiteScan;
use locard::site::scan_file::{self, ScanError};
use locard::source::still_format::StillFormat;
use locard::source::{exif, still};
use locard::stream::{Encoding, ListenOptions, Receiver, packets};

/// Loads the bytes as a model.
#[allow(dead_code, reason = "each target uses one")]
pub fn gltf(bytes: &[u8]) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join(if bytes.starts_with(b"glTF") { "model.glb" } else { "model.gltf" });
    std::fs::write(&path, bytes).expect("a temporary file");
    match scene::load(&path, None) {
        Ok(scene) => drop(scene::describe(&scene).to_string()),
        // A panic caught by the loader is a bug too.
        Err(SceneError::DecoderPanic { message, .. }) => panic!("caught inside: {message}"),
        Err(error) => drop(error.to_string()),
    }
}

/// Decodes the bytes as a picture, and reads them as a picture's file, unless another program would
/// have to develop it. True if it was decoded.
#[allow(dead_code, reason = "each target uses one")]
pub fn picture(bytes: &[u8]) -> bool {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("picture");
    std::fs::write(&path, bytes).expect("a temporary file");
    let format = StillFormat::of_content(bytes);
    if format.is_none_or(|format| matches!(format, StillFormat::Heif) || !format.is_developed()) {
        // The size of a HEIF picture is in its container.
        drop(exif::read(&path));
    }
    still::decode_pixels(bytes).is_ok()
}

/// Reads the bytes as a scan: a text without a signature as OBJ, STL or columns. True if it was
/// read.
#[allow(dead_code, reason = "each target uses one")]
pub fn scan(bytes: &[u8]) -> bool {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let is_read = |name: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).expect("a temporary file");
        match scan_file::read(&path) {
            Ok(geometry) => {
                let scan = SiteScan::of_geometry(&path, geometry, None);
                drop(scan.description());
                true
            }
            // A panic caught by the reader is a bug too.
            Err(ScanError::DecoderPanic { message, .. }) => panic!("caught inside: {message}"),
            Err(error) => {
                drop(error.to_string());
                false
            }
        }
    };
    ["scan.obj", "scan.stl", "scan.xyz"].into_iter().filter(|name| is_read(name)).count() > 0
}

/// Files by which the formats of recordings are recognised. The input is split at zero bytes, one
/// piece per file; the first byte of a piece selects the file (a is the first, b the next). The
/// bytes of a `.bin` are combined with [`BINARY_MASK`], since they may be zero.
const FILES: [&str; 26] = [
    "recording.toml",
    "trajectory.txt",
    "rgb.txt",
    "depth.txt",
    "groundtruth.txt",
    "transforms.json",
    "cameras.txt",
    "images.txt",
    "points3D.txt",
    "exposure.txt",
    "mav0/cam0/data.csv",
    "mav0/cam0/sensor.yaml",
    "mav0/state_groundtruth_estimate0/data.csv",
    "odometry.csv",
    "camera_matrix.csv",
    "depth.toml",
    "frame-000000.pose.txt",
    "frame-000001.pose.txt",
    "cameras.bin",
    "images.bin",
    "cameras.xml",
    "export.csv",
    "images/a.xmp",
    "images/b.xmp",
    "poses.txt",
    "K.txt",
];

/// Exclusive or of the bytes of binary files and those of the input.
const BINARY_MASK: u8 = 0xa5;

/// Files that those may name: pictures of 4×3 px and a depth map.
const PICTURES: [(&str, &[u8]); 15] = [
    ("a.png", include_bytes!("picture.png")),
    ("b.png", include_bytes!("picture.png")),
    ("d.png", include_bytes!("depth.png")),
    ("images/a.png", include_bytes!("picture.png")),
    ("images/b.png", include_bytes!("picture.png")),
    ("mav0/cam0/data/a.png", include_bytes!("picture.png")),
    ("mav0/cam0/data/b.png", include_bytes!("picture.png")),
    ("rgb/1.png", include_bytes!("picture.png")),
    ("rgb/2.png", include_bytes!("picture.png")),
    ("depth/1.png", include_bytes!("depth.png")),
    ("depth/2.png", include_bytes!("depth.png")),
    ("frame-000000.color.png", include_bytes!("picture.png")),
    ("frame-000001.color.png", include_bytes!("picture.png")),
    ("frame-000000.depth.png", include_bytes!("depth.png")),
    ("frame-000001.depth.png", include_bytes!("depth.png")),
];

/// Opens the bytes as the files of a recording. Returns the number of readable frames.
#[allow(dead_code, reason = "each target uses one")]
pub fn recording(bytes: &[u8]) -> usize {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for inner in ["images", "rgb", "depth", "mav0/cam0/data", "mav0/state_groundtruth_estimate0"] {
        std::fs::create_dir_all(folder.path().join(inner)).expect("a temporary folder");
    }
    for (name, content) in PICTURES {
        std::fs::write(folder.path().join(name), content).expect("a temporary file");
    }
    for piece in bytes.split(|&byte| byte == 0) {
        if let Some((&which, content)) = piece.split_first() {
            let name = FILES[usize::from(which.wrapping_sub(b'a')) % FILES.len()];
            let mask = if name.ends_with(".bin") { BINARY_MASK } else { 0 };
            let content: Vec<u8> = content.iter().map(|byte| byte ^ mask).collect();
            std::fs::write(folder.path().join(name), content).expect("a temporary file");
        }
    }
    let Ok(recording) = Recording::open(folder.path(), &OpenOptions::default()) else { return 0 };
    let count = recording.frame_count().min(8);
    for frame in 0..count {
        let _ = (recording.pose_at_frame(frame), recording.geometry_at_frame(frame));
    }
    recording.frames(0..count).map_or(0, |frames| frames.filter(Result::is_ok).count())
}

/// Receives the bytes as consecutive datagrams: a kind byte, a length of two bytes, the content.
/// Kind 0 is a raw OpenTrackIO datagram, 1 and 2 are samples in JSON and CBOR that are split into
/// packets here, 3 is a FreeD message. The upper bits of the kind select the sender and the time
/// step. Formats the lens and the report, and returns the number of poses.
#[allow(dead_code, reason = "each target uses one")]
pub fn stream(mut bytes: &[u8]) -> usize {
    let open = |url| Receiver::new(ListenOptions::parse(url).expect("a good address"));
    let (mut tracker, mut head) = (open("opentrackio://"), open("freed://"));
    let (mut now_s, mut poses) = (0.0, 0);
    while let Some((&[kind, upper, lower], rest)) = bytes.split_first_chunk() {
        let (content, rest) = rest.split_at(rest.len().min(usize::from(u16::from_be_bytes([upper, lower]))));
        bytes = rest;
        now_s += [0.001, 0.02, 0.7, 3.0][usize::from(kind >> 6)];
        let from = ([10, 0, 0, kind >> 4 & 3], 5000).into();
        let all = match kind & 3 {
            1 => packets(Encoding::Json, lower.into(), content),
            2 => packets(Encoding::Cbor, lower.into(), content),
            _ => vec![content.to_vec()],
        };
        for datagram in all {
            let receiver = if kind & 3 == 3 { &mut head } else { &mut tracker };
            receiver.take(&datagram, from, now_s);
        }
        for receiver in [&mut tracker, &mut head] {
            while let Some(tracked) = receiver.next(now_s) {
                assert!(tracked.pose.rotation.is_finite() && tracked.pose.translation_m.is_finite());
                poses += 1;
            }
        }
    }
    for receiver in [&mut tracker, &mut head] {
        poses += std::iter::from_fn(|| receiver.next(now_s + 1.0)).count();
        let _ = (receiver.lens().geometry(64, 48), receiver.lens().to_string(), format!("{:?}", receiver.report()));
    }
    poses
}
