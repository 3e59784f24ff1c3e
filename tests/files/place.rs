//! `locard place`: evidence on the surface at a pixel.

use std::path::Path;

use crate::common;
use crate::program;
use crate::program::{refused, stdout_of};
use crate::shot;
use crate::tier;
use locard::scene::document;

const DEMO: [&str; 4] = ["place", "recordings/demo", "--frame", "30"];

fn place<'a>(scene: &'a str, rest: &[&'a str]) -> Vec<&'a str> {
    [&DEMO[..], rest, &["--scene", scene]].concat()
}

#[test]
fn placed_objects_rest_on_the_floor_and_the_file_keeps_its_comments() {
    let temp = tempfile::tempdir().unwrap();
    let file = temp.path().join("scene.toml");
    let scene = file.to_str().unwrap();
    let text = "# the site\nversion = 1 # so far\nup = \"z\"\n";
    std::fs::write(&file, text).unwrap();
    let stdout = stdout_of(&place(scene, &["--at", "320,300", "--model", "scenes/marker-1.glb", "--heading", "30"]));
    assert!(stdout.contains("tilted by 0.") && stdout.contains("placed"), "{stdout}");
    stdout_of(&place(
        scene,
        &["--at", "300,330", "--model", "scenes/cartridge-case-9mm.glb", "--flat", "--name", "case"],
    ));
    let written = std::fs::read_to_string(&file).unwrap();
    assert!(written.starts_with(text), "{written}");
    let objects = document::read(&file).unwrap().value().objects.clone();
    assert_eq!((objects[0].heading_deg, objects[1].name.as_deref()), (Some(30.0), Some("case")));
    // The simulated floor is z = 0, and its depth has a noise of 1.5 mm.
    for object in &objects {
        assert!(object.position_m.unwrap()[2].abs() < 1e-3, "{object:?}");
    }
    // The written scene can be composited.
    let report = temp.path().join("report.json");
    let out = temp.path().join("out");
    let frames = ["--frames", "30..31", "-o", out.to_str().unwrap(), "--report", report.to_str().unwrap()];
    stdout_of(&[&["composite", "recordings/demo", "--scene", scene], &frames[..], tier::no_shadows()].concat());
    assert!(std::fs::read_to_string(&report).unwrap().contains("\"objects_in_sight\": true"));
}

#[test]
fn object_without_a_heading_faces_the_camera() {
    let temp = tempfile::tempdir().unwrap();
    let file = temp.path().join("scene.toml");
    stdout_of(&place(file.to_str().unwrap(), &["--at", "320,300", "--model", "scenes/marker-1.glb"]));
    let placed = document::read(&file).unwrap().value().objects[0].clone();
    // From above: the front faces −y, turned by the heading counter-clockwise.
    let (sin, cos) = placed.heading_deg.unwrap().to_radians().sin_cos();
    let [x, y, _] = placed.position_m.unwrap();
    let to_camera = shot::demo("scenes/demo.toml").posed_camera(30).unwrap().position_m() - glam::DVec3::new(x, y, 0.0);
    let off = (sin * to_camera.x - cos * to_camera.y) / to_camera.truncate().length();
    assert!(off > 0.99999, "{placed:?} {to_camera}");
}

#[test]
fn surface_on_a_real_desk_is_found() {
    let Some(folder) = common::data("tum-fr1-rpy") else { return };
    let temp = tempfile::tempdir().unwrap();
    let scene = temp.path().join("scene.toml");
    let arguments = ["--frame", "20", "--at", "320,300", "--model", "scenes/l-scale.glb", "--flat", "--profile"];
    let folder = [folder.to_str().unwrap(), "profiles/tum-fr1.toml", scene.to_str().unwrap()];
    let stdout = stdout_of(&[&["place", folder[0]], &arguments[..], &[folder[1], "--scene", folder[2]]].concat());
    assert!(stdout.contains("of the surroundings") && scene.exists(), "{stdout}");
}

#[test]
fn recording_without_an_up_takes_the_normal_of_the_first_surface() {
    let Some(folder) = common::data("redkitchen") else { return };
    let temp = tempfile::tempdir().unwrap();
    let file = temp.path().join("scene.toml");
    let at = ["--frame", "22", "--at", "440,290", "--model", "scenes/marker-1.glb", "--scene", file.to_str().unwrap()];
    let stdout = stdout_of(&[&["place", folder.to_str().unwrap()], &at[..]].concat());
    assert!(stdout.contains("up is unknown: [") && stdout.contains("written as `up`"), "{stdout}");
    let up = document::read(&file).unwrap().value().up.unwrap().axis(&file, "up").unwrap();
    // The table's normal by a plane through 2,000 of its points.
    let off_deg = up.angle_between(glam::DVec3::new(0.035, -0.887, -0.46)).to_degrees();
    assert!(off_deg < 4.0, "{up}: {off_deg}");
    // Later objects use the same up axis, and earlier ones are not rotated.
    let stdout = stdout_of(&[&["place", folder.to_str().unwrap()], &at[..]].concat());
    assert!(!stdout.contains("up is unknown"), "{stdout}");
    std::fs::write(&file, "version = 1\n[[objects]]\nmodel = \"marker-1.glb\"\n").unwrap();
    std::fs::copy("scenes/marker-1.glb", temp.path().join("marker-1.glb")).unwrap();
    let stdout = stdout_of(&[&["place", folder.to_str().unwrap()], &at[..]].concat());
    assert!(stdout.contains("z is assumed") && document::read(&file).unwrap().value().up.is_none(), "{stdout}");
}

#[test]
fn refused_placement_changes_nothing() {
    let temp = tempfile::tempdir().unwrap();
    let file = temp.path().join("scene.toml");
    let scene = file.to_str().unwrap();
    let marker = ["--model", "scenes/marker-1.glb"];
    let outside = refused(&place(scene, &[&["--at", "9000,3"], &marker[..]].concat()));
    assert!(
        outside.contains("9000,3 lies outside the picture of 640x480 px: expected X from 0 to 640, Y from 0 to 480"),
        "{outside}"
    );
    let missing = refused(&place(scene, &["--at", "320,300", "--model", "scenes/none.glb"]));
    assert!(missing.contains("none.glb"), "{missing}");
    let both = refused(&place(scene, &[&["--at", "320,300", "--flat", "--upright"], &marker[..]].concat()));
    assert!(both.contains("--flat") && both.contains("--upright"), "{both}");
    let at = [&["--at", "320,300"], &marker[..]].concat();
    for (odd, message) in [
        (["--heading", "1e300"], "--heading 1e300: expected -360 to 360 degrees"),
        (["--heading", "nan"], "--heading NaN: expected"),
        (["--name", " "], "--name: "),
        (["--at", "-1,3"], "-1,3 lies outside the picture"),
    ] {
        let odd = if odd[0] == "--at" { [&odd[..], &marker].concat() } else { [&at[..], &odd].concat() };
        let text = refused(&place(scene, &odd));
        assert!(text.contains(message), "{text}");
    }
    assert!(!file.exists());
    // A scene file must end in .toml, as commands require, and must not be among the frames.
    for (other, message) in [
        (temp.path().join("x.glb"), "ends in .toml"),
        (temp.path().join("scene"), "ends in .toml"),
        (Path::new("recordings/demo/rgb/scene.toml").to_owned(), "the folder of the recording's frames"),
    ] {
        let text = refused(&place(other.to_str().unwrap(), &at));
        assert!(text.contains(message) && !other.exists(), "{text}");
    }
    std::fs::write(&file, "version = 2\n").unwrap();
    refused(&place(scene, &[&["--at", "320,300"], &marker[..]].concat()));
    assert_eq!(std::fs::read_to_string(Path::new(scene)).unwrap(), "version = 2\n");
}

#[cfg(unix)]
#[test]
fn model_name_is_escaped_on_the_terminal() {
    let temp = tempfile::tempdir().unwrap();
    let (scene, model) = (temp.path().join("scene.toml"), temp.path().join("a\u{1b}]0;pwn\u{7}.glb"));
    std::fs::copy("scenes/marker-1.glb", &model).unwrap();
    let at = ["--at", "320,300", "--model", model.to_str().unwrap()];
    // The second is inside the first, which is reported with their names.
    let stdout = [(); 2].map(|()| stdout_of(&place(scene.to_str().unwrap(), &at))).concat();
    assert!(
        stdout.contains("placed     a\\u{1b}]0;pwn\\u{7}.glb at ") && stdout.contains("odd        a\\u{1b}"),
        "{stdout}"
    );
    assert!(stdout.chars().all(|c| c == '\n' || !c.is_control()), "{stdout:?}");
}

/// The floor of the demonstration is z = 0.
#[test]
fn two_frames_triangulate_a_point_and_three_points_give_a_plane() {
    let temp = tempfile::tempdir().unwrap();
    let scene = temp.path().join("scene.toml");
    let scene = scene.to_str().unwrap();
    let shot = shot::demo("scenes/demo.toml");
    let view = |frame: usize, point: [f64; 3]| {
        let at = shot.posed_camera(frame).unwrap().project(point.into()).unwrap();
        format!("{:.3},{:.3}", at.x, at.y)
    };
    let points = [[0.1, -0.1, 0.0], [0.3, 0.2, 0.0], [-0.2, 0.1, 0.0]];
    let picks = points.map(|point| format!("{}+50:{}", view(30, point), view(50, point)));
    let at = ["--at", &picks[0], "--model", "scenes/marker-1.glb"];
    let stdout = stdout_of(&place(scene, &at));
    assert!(stdout.contains("taken for level; the point is known within"), "{stdout}");
    let placed = document::read(Path::new(scene)).unwrap().value().objects[0].position_m.unwrap();
    assert!(placed.iter().zip(points[0]).all(|(a, b)| (a - b).abs() < 1e-3), "{placed:?}");

    let mut inspect = vec!["inspect", "recordings/demo", "--frame", "30"];
    picks.iter().for_each(|pick| inspect.extend(["--pick", pick.as_str()]));
    let stdout = stdout_of(&inspect);
    // By Pythagoras: 0.2, 0.3 and 0.5, 0.1 and 0.3, 0.2.
    for (apart_m, which) in [(0.3606, "1 to 2"), (0.5099, "2 to 3"), (0.3606, "1 to 3")] {
        let line = stdout.lines().find(|line| line.ends_with(which)).unwrap();
        let found_m: f64 = line.split_whitespace().nth(1).unwrap().parse().unwrap();
        assert!(line.starts_with("distance ") && (found_m - apart_m).abs() < 2e-4, "{line}");
    }
    let plane = stdout.lines().find_map(|line| line.strip_prefix("plane      --plane ")).unwrap();
    let on_plane = view(40, [0.0, 0.3, 0.0]);
    let other = temp.path().join("other.toml");
    let other = other.to_str().unwrap();
    let frame = ["place", "recordings/demo", "--frame", "40", "--at", &on_plane, "--plane", plane];
    stdout_of(&[&frame[..], &["--model", "scenes/marker-1.glb", "--scene", other]].concat());
    let placed = document::read(Path::new(other)).unwrap().value().objects[0].position_m.unwrap();
    assert!(placed.iter().zip([0.0, 0.3, 0.0]).all(|(a, b)| (a - b).abs() < 1e-3), "{placed:?}");

    let two = [&inspect[..8], &["--distance", "0.7212"]].concat();
    assert!(
        stdout_of(&two).contains("scale      -50.0 % off: the recording is in metres already"),
        "{}",
        stdout_of(&two)
    );
    assert!(refused(&[&inspect[..6], &["--distance", "1"]].concat()).contains("give --pick twice"));
    assert!(refused(&["inspect", "recordings/demo", "--frame", "30", "--pick", "3,4+99:5,6"]).contains("99"));
}

// Slow: starts the program many times.
#[test]
fn misplaced_objects_are_reported_and_previewed() {
    let temp = tempfile::tempdir().unwrap();
    let file = temp.path().join("scene.toml");
    let scene = file.to_str().unwrap();
    let preview = temp.path().join("preview.png");
    let preview = preview.to_str().unwrap();
    let marker = ["--at", "320,300", "--model", "scenes/marker-1.glb"];
    assert!(!stdout_of(&place(scene, &marker)).contains("odd"));
    let composite = ["composite", "recordings/demo", "--preview", "30", "--force", "-o", preview, "--scene"];
    let sound = program::locard(&[&composite[..], &["scenes/demo.toml"], tier::no_shadows()].concat());
    let stderr = String::from_utf8(sound.stderr).unwrap();
    assert!(!stderr.contains("stand") && !stderr.contains("hovers") && !stderr.contains("sunk"), "{stderr}");
    // A second one in the same place.
    let twice = stdout_of(&place(scene, &[&marker[..], &["--name", "second"]].concat()));
    assert!(twice.contains("odd        marker-1 and second overlap"), "{twice}");
    assert!(stdout_of(&["inspect", scene]).contains("odd        marker-1 and second overlap by "));
    // 20 cm above the floor, and 3 cm below.
    let text = std::fs::read_to_string(&file).unwrap();
    let at = |z: &str| {
        let lines = text.lines().map(|line| match line.strip_prefix("position_m = [") {
            Some(rest) => format!("position_m = [{}, {z}]", rest.rsplit_once(',').unwrap().0),
            None => line.to_owned(),
        });
        std::fs::write(&file, lines.collect::<Vec<_>>().join("\n").replacen("second", "hidden\"\nhidden = true #", 1))
            .unwrap();
        let done = program::locard(&[&composite[..], &[scene], tier::no_shadows()].concat());
        assert!(done.status.success());
        String::from_utf8(done.stderr).unwrap()
    };
    let hovers = at("0.2");
    assert!(hovers.contains("marker-1 hovers 200 mm over the surface in the depth of frame 30"), "{hovers}");
    assert!(!hovers.contains(" overlap"), "{hovers}");
    // Also if no ground as low is visible around it.
    for (z, mm) in [("-0.06", 60), ("-0.2", 200), ("-0.5", 500)] {
        let sunk = at(z);
        assert!(sunk.contains(&format!("marker-1 is sunk {mm} mm into the surface")), "{sunk}");
    }
    let picture = image::open(preview).unwrap().to_rgb8();
    // The axes' colours occur nowhere in the demonstration.
    let has = |ink: [u8; 3]| picture.pixels().any(|p| p.0.iter().zip(ink).all(|(a, b)| a.abs_diff(b) < 12));
    assert!(picture.dimensions() == (640, 480) && has([255, 70, 70]) && has([90, 220, 90]) && has([90, 140, 255]));
}

#[test]
fn overhanging_object_is_supported_by_the_surface_below_it() {
    let temp = tempfile::tempdir().unwrap();
    let file = temp.path().join("scene.toml");
    let model = std::path::absolute("scenes/l-scale.glb").unwrap();
    // The stool's top is at z = 0.41, and its left edge at x = 0.35; the floor is below.
    let notes = |x: f64, z: f64| {
        let text = format!(
            "version = 1\nup = \"z\"\n[[objects]]\nmodel = {:?}\nposition_m = [{x}, -0.28, {z}]\n",
            model.display().to_string()
        );
        std::fs::write(&file, text).unwrap();
        let shot = shot::demo(file.to_str().unwrap());
        let frame = shot.read(30).unwrap();
        shot.object_issues(&frame).into_iter().map(|wrong| wrong.note.to_string()).collect::<Vec<_>>()
    };
    for x in [0.4, 0.35, 0.34, 0.33] {
        assert_eq!(notes(x, 0.41), Vec::<String>::new(), "{x}");
    }
    let over = |notes: Vec<String>, mm: std::ops::Range<i32>| {
        let far =
            notes.first().and_then(|notes| notes.strip_prefix("l-scale hovers ")?.split_once(" mm")?.0.parse().ok());
        assert!(far.is_some_and(|far: i32| mm.contains(&far)), "{notes:?}");
    };
    // Half over the stool, 8 cm above it; beside it, as high as its top.
    over(notes(0.34, 0.49), 77..84);
    over(notes(0.22, 0.41), 408..413);
}

#[test]
fn unused_analysis_is_reported() {
    let temp = tempfile::tempdir().unwrap();
    let [site, analysis] = ["site", "site.analysis"].map(|name| temp.path().join(name));
    program::copied(Path::new("recordings/demo"), &site);
    std::fs::create_dir(&analysis).unwrap();
    std::fs::write(analysis.join("analysis.toml"), "version = 0\n").unwrap();
    let file = temp.path().join("scene.toml");
    let [site, scene] = [&site, &file].map(|path| path.to_str().unwrap());
    let done = program::locard(&[
        "place",
        site,
        "--frame",
        "30",
        "--at",
        "320,300",
        "--model",
        "scenes/marker-1.glb",
        "--scene",
        scene,
    ]);
    let stderr = String::from_utf8(done.stderr).unwrap();
    assert!(
        done.status.success() && stderr.contains("site.analysis is not used") && stderr.contains("again"),
        "{stderr}"
    );
}

#[test]
fn object_in_front_of_a_steep_surface_hovers_over_the_floor() {
    let temp = tempfile::tempdir().unwrap();
    let file = temp.path().join("scene.toml");
    let model = std::path::absolute("scenes/cartridge-case-9mm.glb").unwrap();
    let notes = |position: [f64; 3]| {
        let text = format!(
            "version = 1\nup = \"z\"\n[[objects]]\nmodel = {:?}\nposition_m = {position:?}\n",
            model.display().to_string()
        );
        std::fs::write(&file, text).unwrap();
        let shot = shot::demo(file.to_str().unwrap());
        let frame = shot.read(30).unwrap();
        shot.object_issues(&frame).into_iter().map(|wrong| wrong.note.to_string()).collect::<Vec<_>>()
    };
    // Frame 30 shows a box's side there. On the side, and 10 cm towards the camera, 19 cm over the
    // floor.
    assert_eq!(notes([0.536, 0.520, 0.135]), Vec::<String>::new());
    let notes = notes([0.503, 0.444, 0.19]);
    let mm = notes.first().and_then(|notes| notes.split_once(" hovers ")?.1.split_once(" mm")?.0.parse::<i32>().ok());
    assert!(mm.is_some_and(|mm| (185..195).contains(&mm)), "{notes:?}");
}

/// A scene file is UTF-8, and a Unix file's name need not be.
#[cfg(unix)]
#[test]
fn model_with_a_non_utf8_name_is_refused_with_advice() {
    use std::os::unix::ffi::OsStrExt;
    let temp = tempfile::tempdir().unwrap();
    let model = temp.path().join(std::ffi::OsStr::from_bytes(b"a\xff.glb"));
    std::fs::copy("scenes/marker-1.glb", &model).unwrap();
    let scene = temp.path().join("scene.toml");
    let mut command = program::program();
    command.args(DEMO).args(["--at", "320,300", "--scene"]).arg(&scene).arg("--model").arg(&model);
    let output = command.output().unwrap();
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code() == Some(2) && text.contains("not UTF-8; rename the file"), "{text}");
    assert!(!scene.exists());
}
