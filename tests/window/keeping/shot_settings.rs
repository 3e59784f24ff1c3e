//! Where changed settings are saved: those of the shot with its scene, those of the camera where
//! the user decides.

use super::*;

const PROFILE: &str = "# my camera\nversion = 1\n\n[noise]\nscale = 0.5 # quieter\n";
const SCENE: &str = "# the desk\nversion = 1\nup = \"z\"\n";

struct Case {
    _folder: tempfile::TempDir,
    profile: PathBuf,
    scene: PathBuf,
}

impl Case {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let [profile, scene] = ["mine.toml", "case.toml"].map(|name| folder.path().join(name));
        std::fs::write(&profile, PROFILE).unwrap();
        std::fs::write(&scene, SCENE).unwrap();
        Self { _folder: folder, profile, scene }
    }

    fn project(&self) -> Project {
        project(Some(&self.profile), Some(&self.scene))
    }

    fn texts(&self) -> [String; 2] {
        [&self.profile, &self.scene].map(|path| std::fs::read_to_string(path).unwrap())
    }
}

fn number(project: &Project, table: &str, name: &str) -> f64 {
    match project.value(table, name) {
        Some(Value::Number(number)) => number,
        other => panic!("{table}.{name}: {other:?}"),
    }
}

#[test]
fn save_writes_exposure_and_effects_into_the_scene_and_leaves_the_profile() {
    let case = Case::new();
    let mut window = window(case.project(), egui::vec2(1400.0, 900.0));
    let project = window.state_mut().project_mut();
    project.set("camera.exposure", "time_s", &Value::Number(0.02)).unwrap();
    project.switch("noise", false);
    window.key_press_modifiers(Modifiers::COMMAND, Key::S);
    until(&mut window, |app| app.project().is_saved());
    let [profile, scene] = case.texts();
    assert_eq!(profile, PROFILE);
    assert!(scene.starts_with(SCENE), "{scene}");
    for line in ["[settings.camera.exposure]\ntime_s = 0.02\n", "[settings.noise]\non = false\n"] {
        assert!(scene.contains(line), "{scene}");
    }
    let again = case.project();
    assert!(again.is_saved() && again.edit() == window.state().project().edit());
    // The command line reads the same scene.
    let line = command_line(&again, 0);
    assert!(line.before.is_empty() && !line.text.contains("--set"), "{line:?}");
    let given = Given { profile: Some(case.profile.clone()), scene: Some(case.scene.clone()), ..Given::default() };
    let shot = Shot::open(&worked::demo(), &OpenOptions::default(), &given).unwrap();
    assert!(shot.rig == again.edit().rig && shot.settings == again.edit().settings);
    // `--set` overrides the scene.
    let given = Given { sets: vec!["camera.exposure.time_s=0.03".to_owned()], ..given };
    let shot = Shot::open(&worked::demo(), &OpenOptions::default(), &given).unwrap();
    assert_eq!(shot.rig.exposure.time_s, Some(0.03));
}

#[test]
fn save_asks_where_camera_values_belong() {
    let case = Case::new();
    let mut window = window(case.project(), egui::vec2(1400.0, 900.0));
    let save = |window: &mut Harness<'_, App>, answer: &str| {
        window.key_press_modifiers(Modifiers::COMMAND, Key::S);
        window.run_steps(3);
        press(window, answer);
    };
    set(&mut window, "camera", "readout_time_s", 0.02);
    save(&mut window, "Cancel");
    assert!(!window.state().project().is_saved() && case.texts() == [PROFILE, SCENE]);
    save(&mut window, "Save with the scene");
    until(&mut window, |app| app.project().is_saved());
    let [profile, scene] = case.texts();
    assert!(profile == PROFILE && scene.contains("[settings.camera]\nreadout_time_s = 0.02\n"), "{scene}");
    // In the profile it no longer stands in the scene, which would override it.
    set(&mut window, "camera", "readout_time_s", 0.03);
    set(&mut window, "noise", "scale", 0.25);
    save(&mut window, "Save to the profile");
    until(&mut window, |app| app.project().is_saved());
    let [profile, scene] = case.texts();
    assert!(profile.contains("readout_time_s = 0.03") && profile.contains("scale = 0.5 # quieter"), "{profile}");
    assert!(scene.contains("[settings.noise]\nscale = 0.25\n") && !scene.contains("readout_time_s"), "{scene}");
    let again = case.project();
    assert!(again.is_saved() && again.edit().settings == window.state().project().edit().settings);
    assert_eq!(number(&again, "camera", "readout_time_s"), 0.03);
}

#[test]
fn enter_does_not_overwrite_the_profile_of_a_model_that_is_open_alone() {
    let case = Case::new();
    let mut window =
        window(project(Some(&case.profile), Some(Path::new("scenes/marker-1.glb"))), egui::vec2(1400.0, 900.0));
    window.state_mut().project_mut().switch("noise", false);
    window.key_press_modifiers(Modifiers::COMMAND, Key::S);
    window.run_steps(3);
    // Effects are written, not only values of the camera.
    assert!(has(&window, "Save settings to the profile?"));
    window.key_press(Key::Enter);
    window.run_steps(3);
    assert!(!has(&window, "Save settings to the profile?") && !window.state().project().is_saved());
    assert_eq!(case.texts()[0], PROFILE);
    window.key_press_modifiers(Modifiers::COMMAND, Key::S);
    window.run_steps(3);
    press(&mut window, "Save to the profile");
    until(&mut window, |app| app.project().is_saved());
    assert!(case.texts()[0].contains("on = false"), "{}", case.texts()[0]);
}

#[test]
fn profile_saved_under_a_name_takes_all_and_the_scene_follows() {
    let case = Case::new();
    std::fs::write(&case.scene, format!("{SCENE}\n[settings.noise]\nscale = 0.75\n")).unwrap();
    let mut project = case.project();
    assert_eq!(
        (number(&project, "noise", "scale"), project.opened("noise", "scale")),
        (0.75, Some(Value::Number(0.5)))
    );
    project.set("noise", "scale", &Value::Number(2.0)).unwrap();
    project.save_profile(&case.profile).unwrap();
    assert!(case.texts()[0].contains("scale = 2.0 # quieter"), "{}", case.texts()[0]);
    // The scene still has the old value, which would override the profile's.
    assert!(!project.is_saved() && project.scene_is_changed());
    project.save_scene(&case.scene).unwrap();
    assert!(project.is_saved() && !case.texts()[1].contains("[settings"), "{}", case.texts()[1]);
    assert_eq!(number(&case.project(), "noise", "scale"), 2.0);
}
