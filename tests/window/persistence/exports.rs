//! Output of the window: files and command lines.

use super::*;
use crate::program;

// Slow: each of four exports has a compositor of its own.
#[test]
fn exports_use_the_settings_at_their_start() {
    let temp = tempfile::tempdir().unwrap();
    let mut window = demo();
    let frame = demo_frame(31);
    window.state_mut().player_mut().seek(frame);
    settle(&mut window);
    let before = shown_codes(&window);
    window.key_press_modifiers(Modifiers::COMMAND, Key::E);
    window.run_steps(3);
    press(&mut window, &format!("Current (frame {frame})"));
    press(&mut window, "Image sequence…");
    choose(&mut window, &temp.path().join("out"));
    // Later changes do not affect it; they do affect a second one.
    set(&mut window, "noise", "scale", 0.0);
    window.key_press(Key::W);
    window.run_steps(2);
    press(&mut window, "Snapshot…");
    choose(&mut window, &temp.path().join("quiet"));
    run_until(&mut window, all_over);
    settle(&mut window);
    let exported = picture(&temp.path().join(format!("out/frame_{frame:06}.png")));
    assert!(exported == before && exported == written(&[], frame));
    let snapshot = picture(&temp.path().join("quiet.png"));
    assert!(snapshot == shown_codes(&window) && snapshot != before, "the wipe is not in it");

    // A folder that cannot be created is reported, and the next export proceeds.
    std::fs::write(temp.path().join("file"), "").unwrap();
    press(&mut window, "Image sequence…");
    choose(&mut window, &temp.path().join("file/out"));
    run_until(&mut window, all_over);
    let entries = &window.state().documents().jobs().unwrap().entries;
    assert!(matches!(&entries[2].state, JobState::Failed(why) if why.contains("file/out")), "{:?}", entries[2]);
    assert!(entries[..2].iter().all(|entry| matches!(entry.state, JobState::Done(_))), "{entries:?}");

    // A cancelled video leaves no file.
    press(&mut window, &format!("All ({} frames)", demo_frame(72)));
    press(&mut window, "Video…");
    let video = temp.path().join("cut.mkv");
    choose(&mut window, &video);
    press(&mut window, &format!("Cancel {}", video.display()));
    run_until(&mut window, all_over);
    assert_eq!(window.state().documents().jobs().unwrap().entries[3].state, JobState::Cancelled);
    let mut names: Vec<_> = std::fs::read_dir(temp.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    names.sort();
    assert_eq!(names, ["file", "out", "out.record.json", "quiet.png"]);
}

#[test]
fn photo_from_the_window_matches_the_command_line() {
    let temp = tempfile::tempdir().unwrap();
    let mut window = demo();
    set(&mut window, "noise", "scale", 0.5);
    window.key_press_modifiers(Modifiers::COMMAND, Key::E);
    window.run_steps(3);
    for (dial, text) in [("Width, px", "320"), ("Light, lx", "300"), ("Aperture", "f/4"), ("Focal length, mm", "30000")]
    {
        window.get_by_role_and_label(Role::TextInput, dial).focus();
        window.step();
        window.get_by_role_and_label(Role::TextInput, dial).type_text(text);
        window.run_steps(2);
    }
    // Beyond the range of focal lengths.
    assert!(has_label(&window, "Focal length: expected 1 to 5000"));
    let focal = window.get_by_role_and_label(Role::TextInput, "Focal length, mm");
    focal.focus();
    window.step();
    window.key_press_modifiers(Modifiers::COMMAND, Key::A);
    window.key_press(Key::Delete);
    window.run_steps(3);
    press(&mut window, "Photograph…");
    let taken = temp.path().join("taken.png");
    choose(&mut window, &taken);
    run_until(&mut window, all_over);
    let state = window.state().documents().jobs().unwrap().entries[0].state.clone();
    assert!(matches!(&state, JobState::Done(message) if message.contains("f/4")), "{state:?}");
    let by_program = temp.path().join("program.png");
    let dials = ["--aperture", "4", "--lux", "300", "--width", "320", "--set", "noise.scale=0.5"];
    let recording = harness::demo();
    let of = [
        "photo",
        recording.to_str().unwrap(),
        "--frame",
        "0",
        "--scene",
        DEMO_SCENE,
        "-o",
        by_program.to_str().unwrap(),
    ];
    program::stdout_of(&[&of[..], &dials].concat());
    assert!(picture(&taken) == picture(&by_program));
    let exif =
        exif::Reader::new().read_from_container(&mut BufReader::new(std::fs::File::open(&taken).unwrap())).unwrap();
    let f_number = exif.get_field(exif::Tag::FNumber, exif::In::PRIMARY).unwrap();
    assert_eq!(f_number.display_value().with_unit(&exif).to_string(), "f/4");
}

#[test]
fn command_line_reproduces_the_shown_picture() {
    let temp = tempfile::tempdir().unwrap();
    let folder = temp.path().join("it's a case");
    std::fs::create_dir(&folder).unwrap();
    let profile = folder.join("mine.toml");
    std::fs::write(&profile, "version = 1\n[noise]\nscale = 0.5\n[halation]\non = false\n").unwrap();
    let mut window = open(Some(&profile), Path::new(DEMO_SCENE));
    let project = window.state_mut().project_mut();
    for (table, name, value) in [
        ("noise", "scale", Value::Number(0.0)),
        ("camera.lens", "f_number", Value::Number(1.4)),
        ("camera.lens", "focus_distance_m", Value::Number(0.8)),
        ("camera", "fx_px", Value::Number(540.1)),
        ("camera.exposure", "time_s", Value::Number(0.02)),
        ("motion_blur", "method", Value::Text("copies".to_owned())),
        ("depth", "occlusion", Value::Bool(false)),
    ] {
        project.set(table, name, &value).unwrap();
    }
    project.switch("edge_blend", false);
    project.switch("halation", true);
    let frame = demo_frame(31);
    window.state_mut().player_mut().seek(frame);
    settle(&mut window);
    let line = command_line(window.state().project(), frame);
    assert_eq!(line.before, [""; 0]);
    assert!(line.text.contains("--set noise.scale=0 ") && line.text.contains("edge_blend.on=false"), "{}", line.text);
    let text = line.text.strip_prefix("locard ").unwrap();
    let program = program::program().get_program().to_owned();
    let output = Command::new("sh").args(["-c", &format!("\"$0\" {text}")]).arg(program).current_dir(&folder).output();
    let output = output.unwrap();
    assert!(output.status.success(), "{text}: {}", String::from_utf8_lossy(&output.stderr));
    assert!(picture(&folder.join(format!("composited/frame_{frame:06}.png"))) == shown_codes(&window), "{text}");

    // Warnings of a file are reported.
    let project = window.state_mut().project_mut();
    project.change_scene("light", |scene| scene.light.environment_intensity = Some(0.5)).unwrap();
    assert_eq!(command_line(project, frame).before.len(), 1);
}

#[test]
fn series_asks_before_replacing_its_own_files() {
    let temp = tempfile::tempdir().unwrap();
    let mut window = demo();
    window.key_press_modifiers(Modifiers::COMMAND, Key::E);
    window.run_steps(3);
    for (dial, text) in [("Width, px", "64"), ("Light, lx", "300")] {
        window.get_by_role_and_label(Role::TextInput, dial).focus();
        window.step();
        window.get_by_role_and_label(Role::TextInput, dial).type_text(text);
        window.run_steps(2);
    }
    window.get_by_role_and_label(Role::ComboBox, "Bracket").click();
    window.run_steps(3);
    press(&mut window, "by ISO");
    // The second file of the series exists, but none of the given name itself.
    let there = temp.path().join("s-2.png");
    std::fs::write(&there, "what the user had").unwrap();
    press(&mut window, "Photograph…");
    choose(&mut window, &temp.path().join("s.png"));
    assert_eq!(std::fs::read_to_string(&there).unwrap(), "what the user had");
    // The dialog needs several frames for its new size.
    window.run_steps(10);
    assert!(window.query_by_label_contains("s-2.png is there already").is_some());
    press(&mut window, "Replace them");
    let had = b"what the user had".as_slice();
    run_until(&mut window, |_| std::fs::read(&there).is_ok_and(|bytes| bytes != had));
    // A cancelled series keeps its finished files.
    press(&mut window, &format!("Cancel the series s-1.png … in {}", temp.path().display()));
    run_until(&mut window, all_over);
    assert_eq!(window.state().documents().jobs().unwrap().entries[0].state, JobState::Cancelled);
    assert!(picture(&there).len() > 64 && picture(&temp.path().join("s-1.png")).len() > 64);
    assert!(!temp.path().join("s-sheet.png").exists());
}
