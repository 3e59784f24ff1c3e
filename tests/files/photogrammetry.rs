//! Exports of photogrammetry programs, plain folders of laboratories, and calibrations of other
//! programs as profiles.

use std::path::Path;

use crate::common;
use crate::files::{open, options, picture, refused, write};
use glam::{DMat4, DVec2, DVec3};
use locard::pixels::Pixels;
use locard::profile::Rig;
use locard::recording::Recording;

/// Three small frames `frame_000000.png` to `frame_000002.png`.
fn three_frames(folder: &Path) {
    let pictures: Vec<Pixels> = (0..3).map(|i| picture(i, 8, 6, 8)).collect();
    write(folder, &options(8, 6, 8), &pictures);
}

/// Position of the camera in a frame, and the pixel of a point 2 m ahead, 0.4 m to the right and
/// 0.2 m down.
fn projection(recording: &Recording, frame: usize) -> (DVec3, DVec2) {
    let pose = recording.pose_at_frame(frame).unwrap();
    let point = pose.inverse_transform_point(DVec3::new(0.4, 0.2, 2.0));
    let geometry = recording.geometry_at_frame(frame).unwrap();
    (pose.position_in_world_m(), geometry.project(pose.transform_point(point)).unwrap())
}

fn metashape(cameras: &str) -> String {
    format!(
        "<document version=\"2.0.0\"><chunk><sensors><sensor id=\"0\" type=\"frame\"><calibration class=\"adjusted\">\
         <resolution width=\"8\" height=\"6\"/><f>10</f><cx>0.5</cx></calibration></sensor></sensors><transform>\
         <scale>2</scale></transform><cameras>{cameras}</cameras></chunk></document>"
    )
}

#[test]
fn metashape_export_opens_beside_its_pictures() {
    let folder = tempfile::tempdir().unwrap();
    three_frames(&folder.path().join("images"));
    let at = |label: &str, x: f64, more: &str| {
        format!(
            "<camera sensor_id=\"0\" label=\"{label}\"{more}><transform>1 0 0 {x} 0 1 0 0 0 0 1 0 0 0 0 1</transform></camera>"
        )
    };
    let cameras =
        at("frame_000002", 3.0, "") + &at("frame_000000.png", 1.0, "") + &at("frame_000001", 2.0, " enabled=\"0\"");
    let file = folder.path().join("cameras.xml");
    std::fs::write(&file, metashape(&cameras)).unwrap();
    for path in [folder.path(), &file] {
        let r = open(path);
        assert_eq!((r.kind.name(), r.frame_count(), r.up), ("Metashape", 3, Some(DVec3::Z)));
        assert!(!r.kind.has_times() && !r.kind.is_metric());
        // Twice the chunk's unit; u = 4.5 + 10·0.2, v = 3 + 10·0.1.
        for (frame, x) in [(0, 2.0), (2, 6.0)] {
            let (position, at) = projection(&r, frame);
            assert!(
                (position - DVec3::new(x, 0.0, 0.0)).length() < 1e-12 && (at - DVec2::new(6.5, 4.0)).length() < 1e-9
            );
        }
        assert!(
            r.pose_at_frame(1).is_err() && r.warnings.iter().any(|w| w.contains("1 disabled (first: frame_000001)"))
        );
    }
    std::fs::write(&file, metashape(&at("other", 1.0, ""))).unwrap();
    assert!(
        refused(folder.path()).contains("none of its 1 pictures (first: other) is in "),
        "{}",
        refused(folder.path())
    );
    std::fs::write(&file, metashape("<camera sensor_id=\"0\" label=\"frame_000000\"/>")).unwrap();
    assert!(
        refused(folder.path()).contains("none of its 1 camera is aligned (1 not aligned)"),
        "{}",
        refused(folder.path())
    );
}

#[test]
fn realitycapture_table_and_sidecars_give_the_same_cameras() {
    let folder = tempfile::tempdir().unwrap();
    three_frames(folder.path());
    // f = 36 mm is 8 px, the principal point is at (4.8, 2.2). Level, to the north.
    let table = "#name,x,y,alt,heading,pitch,roll,f,px,py,k1,k2,k3,k4,t1,t2\nframe_000000.png,1,2,3,0,90,0,36,0.1,-0.1,0,0,0,0,0,0\n\
                 frame_000002.png,4,5,6,0,90,0,36,0.1,-0.1,0,0,0,0,0,0\n";
    let file = folder.path().join("registration.csv");
    std::fs::write(&file, table).unwrap();
    let of_table = open(folder.path());
    assert_eq!(open(&file).frame_count(), 3);
    std::fs::remove_file(&file).unwrap();
    for (name, position) in [("frame_000000", "1 2 3"), ("frame_000002.png", "4 5 6")] {
        let sidecar = format!(
            "<x:xmpmeta xmlns:x=\"adobe:ns:meta/\"><rdf:RDF xmlns:rdf=\"http://www.w3.org/1999/02/22-rdf-syntax-ns#\">\
             <rdf:Description xcr:FocalLength35mm=\"36\" xcr:PrincipalPointU=\"0.1\" xcr:PrincipalPointV=\"-0.1\" \
             xcr:Rotation=\"1 0 0 0 0 -1 0 1 0\" xcr:Position=\"{position}\" \
             xmlns:xcr=\"http://www.capturingreality.com/ns/xcr/1.1#\"/></rdf:RDF></x:xmpmeta>"
        );
        std::fs::write(folder.path().join(format!("{name}.xmp")), sidecar).unwrap();
    }
    let of_sidecars = open(folder.path());
    assert_eq!(open(&folder.path().join("frame_000000.xmp")).frame_count(), 3);
    for r in [&of_table, &of_sidecars] {
        assert_eq!((r.kind.name(), r.frame_count(), r.up), ("RealityCapture", 3, Some(DVec3::Z)));
        assert!(r.pose_at_frame(1).is_err());
        for (frame, expected) in [(0, DVec3::new(1.0, 2.0, 3.0)), (2, DVec3::new(4.0, 5.0, 6.0))] {
            let (position, at) = projection(r, frame);
            assert!((position - expected).length() < 1e-9 && (at - DVec2::new(6.4, 3.0)).length() < 1e-9, "{at}");
            let ahead = r.pose_at_frame(frame).unwrap().inverse_transform_point(DVec3::new(0.5, -0.25, 4.0));
            assert!((ahead - expected - DVec3::new(0.5, 4.0, 0.25)).length() < 1e-9, "{ahead}");
        }
    }
    // Sidecars of a raw converter.
    for name in ["frame_000000.xmp", "frame_000002.png.xmp"] {
        std::fs::write(folder.path().join(name), "<x:xmpmeta xmlns:x=\"adobe:ns:meta/\"/>").unwrap();
    }
    assert!(refused(folder.path()).contains("not a recording"), "{}", refused(folder.path()));
}

#[test]
fn plain_folder_opens_with_poses_in_one_file_or_many() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    three_frames(&at("rgb"));
    std::fs::write(at("K.txt"), "10 0 3.5\n0 10 2.5\n0 0 1\n").unwrap();
    let row = |x: usize| format!("1 0 0 {x} 0 1 0 0 0 0 1 0");
    std::fs::write(at("poses.txt"), format!("{}\n{}\n{}\n", row(1), row(2), row(3))).unwrap();
    let check = |r: &Recording| {
        assert_eq!((r.kind.name(), r.frame_count(), r.up), ("plain folder", 3, None));
        for frame in 0..3 {
            // The principal point is half a pixel further: u = 4 + 10·0.2, v = 3 + 10·0.1.
            let (position, at) = projection(r, frame);
            assert!((position - DVec3::new(frame as f64 + 1.0, 0.0, 0.0)).length() < 1e-12);
            assert!((at - DVec2::new(6.0, 4.0)).length() < 1e-9, "{at}");
        }
    };
    for path in [folder.path(), &at("poses.txt"), &at("K.txt")] {
        let r = open(path);
        check(&r);
        assert!(r.warnings.iter().any(|w| w.contains("no depth confirms it")), "{:?}", r.warnings);
    }
    let inverse = |x: usize| format!("1 0 0 -{x} 0 1 0 0 0 0 1 0 0 0 0 1");
    let stated = format!("# world_to_camera\n{}\n{}\n{}\n", inverse(1), inverse(2), inverse(3));
    std::fs::write(at("poses.txt"), stated).unwrap();
    check(&open(folder.path()));
    std::fs::write(at("poses.txt"), row(1)).unwrap();
    assert!(refused(folder.path()).contains("holds 1 pose, beside 3 pictures; a pose for each is expected"));
    std::fs::remove_file(at("poses.txt")).unwrap();
    std::fs::create_dir(at("pose")).unwrap();
    for i in 0..3 {
        std::fs::write(at(&format!("pose/{i:04}.txt")), row(i + 1)).unwrap();
    }
    check(&open(folder.path()));
    std::fs::remove_file(at("pose/0001.txt")).unwrap();
    let r = open(folder.path());
    assert!(r.pose_at_frame(1).is_err() && r.warnings.iter().any(|w| w.contains("no pose file for 1 of 3 pictures")));
    std::fs::remove_file(at("K.txt")).unwrap();
    assert!(open(folder.path()).geometry.is_none());
}

/// A sequence of 7-Scenes as a plain folder: its depth confirms the convention, and refuses the
/// inverse poses.
#[test]
fn depth_of_a_real_sequence_decides_between_conventions() {
    let Some(source) = common::data("redkitchen") else { return };
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    for inner in ["rgb", "depth", "intrinsic"] {
        std::fs::create_dir(at(inner)).unwrap();
    }
    std::fs::write(at("intrinsic/intrinsic_color.txt"), "525 0 319.5 0\n0 525 239.5 0\n0 0 1 0\n0 0 0 1\n").unwrap();
    std::fs::write(at("intrinsic/intrinsic_depth.txt"), "585 0 319.5 0\n0 585 239.5 0\n0 0 1 0\n0 0 0 1\n").unwrap();
    let (mut poses, mut inverse) = (String::new(), String::new());
    for (i, frame) in (0..80).step_by(8).enumerate() {
        let of = |ending: &str| source.join(format!("frame-{frame:06}.{ending}"));
        std::fs::copy(of("color.jpg"), at(&format!("rgb/{i}.jpg"))).unwrap();
        std::fs::copy(of("depth.png"), at(&format!("depth/{i}.png"))).unwrap();
        let text = std::fs::read_to_string(of("pose.txt")).unwrap();
        let values: Vec<f64> = text.split_whitespace().map(|word| word.parse().unwrap()).collect();
        // The recorded axes are not quite at right angles; their inverses would differ.
        let (_, rotation, translation) = DMat4::from_cols_slice(&values).transpose().to_scale_rotation_translation();
        let matrix = DMat4::from_rotation_translation(rotation.normalize(), translation);
        let row = |m: DMat4| m.transpose().to_cols_array().map(|value| value.to_string()).join(" ") + "\n";
        poses += &row(matrix);
        inverse += &row(matrix.inverse());
    }
    std::fs::write(at("poses.txt"), &poses).unwrap();
    let r = open(folder.path());
    assert!(r.has_depth() && !r.warnings.iter().any(|w| w.contains("convention")), "{:?}", r.warnings);
    let rounded =
        inverse.lines().map(|line| format!("{} 0 0 0 1\n", line.split(' ').take(12).collect::<Vec<_>>().join(" ")));
    std::fs::write(at("poses.txt"), rounded.collect::<String>()).unwrap();
    let error = refused(folder.path());
    assert!(
        error.contains("world to camera with OpenCV's axes") && error.contains("`# world_to_camera opencv`"),
        "{error}"
    );
    let stated = std::fs::read_to_string(at("poses.txt")).unwrap();
    std::fs::write(at("poses.txt"), format!("# world_to_camera\n{stated}")).unwrap();
    let again = open(folder.path());
    for frame in 0..r.frame_count() {
        let (a, b) = (r.pose_at_frame(frame).unwrap(), again.pose_at_frame(frame).unwrap());
        assert!((a.position_in_world_m() - b.position_in_world_m()).length() < 1e-5);
        assert!(a.rotation.dot(b.rotation).abs() > 1.0 - 1e-9);
    }
}

#[test]
fn calibration_of_another_program_is_read_as_a_profile() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("camera.yaml");
    let text = "image_width: 640\nimage_height: 480\ncamera_matrix:\n  data: [500, 0, 319.5, 0, 501, 239.5, 0, 0, 1]\n\
                distortion_model: plumb_bob\ndistortion_coefficients:\n  data: [-0.1, 0.4, 0.01, 0.02, 8]\n";
    std::fs::write(&file, text).unwrap();
    let geometry = Rig::of_file(&file).unwrap().camera().geometry.unwrap();
    let i = &geometry.intrinsics;
    assert_eq!((i.fx_px, i.fy_px, i.cx_px, i.cy_px), (500.0, 501.0, 320.0, 240.0));
    assert_eq!((geometry.distortion.k1, geometry.distortion.p1, geometry.distortion.k3), (-0.1, 0.01, 8.0));
    std::fs::write(&file, text.replace("[500", "[-500")).unwrap();
    let error = Rig::of_file(&file).unwrap_err().to_string();
    assert!(error.contains("camera.yaml: camera.fx_px = -500: expected"), "{error}");
    std::fs::write(&file, "a: 1\n").unwrap();
    let error = Rig::of_file(&file).unwrap_err().to_string();
    assert!(error.contains("camera.yaml: holds no camera: expected camera_matrix"), "{error}");
}
