//! Captures of apps that are recognised but not supported, each with conversion advice.

use std::io::Read;
use std::path::Path;

use crate::source::file;

/// A kind of capture.
struct UnsupportedCapture {
    is_at: fn(&Path) -> bool,
    refusal: &'static str,
}

fn has(folder: &Path, names: &[&str]) -> bool {
    names.iter().all(|name| folder.join(name).exists())
}

fn ends_with(path: &Path, ending: &str) -> bool {
    path.is_file() && path.extension().is_some_and(|own| own.eq_ignore_ascii_case(ending))
}

/// The first bytes of a file of RED, after the length of its first block.
const RED_SIGNATURES: [&[u8]; 2] = [b"RED1", b"RED2"];

fn is_red(path: &Path) -> bool {
    let start = file::open(path).ok().and_then(|mut file| {
        let mut start = [0; 8];
        file.read_exact(&mut start).ok().map(|()| start)
    });
    ends_with(path, "r3d") && start.is_some_and(|start| RED_SIGNATURES.contains(&&start[4..]))
}

static CAPTURES: [UnsupportedCapture; 8] = [
    UnsupportedCapture {
        is_at: is_red,
        refusal: "it is raw footage of RED, which ffmpeg cannot decode; REDCINE-X or DaVinci Resolve exports it as ProRes with \
                  the camera's log curve (docs/recordings.md, Colour)",
    },
    UnsupportedCapture {
        is_at: |path| ends_with(path, "braw"),
        refusal: "it is raw footage of Blackmagic, which ffmpeg cannot decode; DaVinci Resolve exports it as ProRes",
    },
    UnsupportedCapture {
        is_at: |path| has(path, &["keyframes/images"]) || has(path, &["images", "corrected_cameras"]),
        refusal: "it is a capture of Polycam; `ns-process-data polycam --data CAPTURE.zip --output-dir NEW` (nerfstudio) makes \
                  a recording of the raw export",
    },
    UnsupportedCapture {
        is_at: |path| {
            has(path, &["EXR_RGBD"]) || (has(path, &["rgb", "depth", "metadata.json"])) || ends_with(path, "r3d")
        },
        refusal: "it is a capture of Record3D; export it as EXR + JPG, and `ns-process-data record3d --data EXPORT --output-dir \
                  NEW` (nerfstudio) makes a recording of it",
    },
    UnsupportedCapture {
        is_at: |path| has(path, &["lowres_wide.traj"]),
        refusal: "it is a scan of ARKitScenes; a recording.toml that names the pictures, the depth and a trajectory of \
                  lowres_wide.traj makes a recording of it",
    },
    UnsupportedCapture {
        is_at: |path| ends_with(path, "psx") || ends_with(path, "psz"),
        refusal: "it is a project of Metashape; export its cameras (File > Export > Export Cameras, Agisoft XML) as cameras.xml \
                  beside the pictures",
    },
    UnsupportedCapture {
        is_at: |path| has(path, &["rgb", "K.txt"]) || has(path, &["rgb", "intrinsics.txt"]),
        refusal: "it has pictures and a camera matrix, and no poses; expected poses.txt, a pose of 12 or 16 numbers a line for \
                  each picture, or pose/ with a file for each",
    },
    UnsupportedCapture {
        is_at: |path| has(path, &["database.db"]) && !has(path, &["sparse"]),
        refusal: "it is a COLMAP project without a model; `colmap mapper --database_path database.db --image_path images --output_path \
                  sparse` makes one",
    },
];

/// Reason and advice for a capture that is not supported; `None` if the path is no known capture.
pub fn refusal(path: &Path) -> Option<&'static str> {
    CAPTURES.iter().find(|capture| (capture.is_at)(path)).map(|capture| capture.refusal)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn captures_are_recognised_by_their_files() {
        for (file, said) in [
            ("keyframes/images/1.jpg", "ns-process-data polycam"),
            ("EXR_RGBD/metadata.json", "ns-process-data record3d"),
            ("lowres_wide.traj", "lowres_wide.traj"),
            ("database.db", "colmap mapper"),
        ] {
            let folder = tempfile::tempdir().unwrap();
            assert_eq!(refusal(folder.path()), None);
            let file = folder.path().join(file);
            std::fs::create_dir_all(file.parent().unwrap()).unwrap();
            std::fs::write(file, "").unwrap();
            assert!(refusal(folder.path()).unwrap().contains(said), "{said}");
        }
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("a.r3d"), "").unwrap();
        assert!(refusal(&folder.path().join("a.r3d")).unwrap().contains("Record3D"));
        std::fs::write(folder.path().join("b.R3D"), b"\0\0\x02\0RED2\0\0").unwrap();
        assert!(refusal(&folder.path().join("b.R3D")).unwrap().contains("REDCINE-X"));
        std::fs::write(folder.path().join("a.psx"), "").unwrap();
        assert!(refusal(&folder.path().join("a.psx")).unwrap().contains("cameras.xml"));
        std::fs::create_dir(folder.path().join("rgb")).unwrap();
        std::fs::write(folder.path().join("K.txt"), "").unwrap();
        assert!(refusal(folder.path()).unwrap().contains("expected poses.txt"));
    }
}
