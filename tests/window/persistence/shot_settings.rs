//! Where changed settings are saved: those of the shot with its scene, those of the camera where
//! the user decides.

use super::*;
use locard::analyse::Analysis;
use locard::profile::Rig;

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

    /// A project of a recording whose camera has no noise.
    fn project_without_noise(&self) -> Project {
        let recording = self.profile.with_file_name("rec");
        if !recording.exists() {
            crate::program::copied(&harness::demo(), &recording);
        }
        let camera = std::fs::read_to_string(harness::demo().join("camera.toml")).unwrap();
        let without = camera.split("[camera.noise]").next().unwrap();
        std::fs::write(recording.join("camera.toml"), without).unwrap();
        let (profile, scene) = (Some(self.profile.clone()), Some(self.scene.clone()));
        let options = ShotOptions { profile, scene, ..ShotOptions::default() };
        Project::open(&recording, &OpenOptions::default(), &options).unwrap()
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
    run_until(&mut window, |app| app.project().is_saved());
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
    let options =
        ShotOptions { profile: Some(case.profile.clone()), scene: Some(case.scene.clone()), ..ShotOptions::default() };
    let shot = Shot::open(&harness::demo(), &OpenOptions::default(), &options).unwrap();
    assert!(shot.rig == again.edit().rig && shot.settings == again.edit().settings);
    // `--set` overrides the scene.
    let shorter = ShotOptions { sets: vec!["camera.exposure.time_s=0.03".to_owned()], ..options };
    let shot = Shot::open(&harness::demo(), &OpenOptions::default(), &shorter).unwrap();
    assert_eq!(shot.rig.exposure.time_s, Some(0.03));
}

#[test]
fn save_asks_where_to_store_camera_values() {
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
    run_until(&mut window, |app| app.project().is_saved());
    let [profile, scene] = case.texts();
    assert!(profile == PROFILE && scene.contains("[settings.camera]\nreadout_time_s = 0.02\n"), "{scene}");
    // A value saved to the profile is removed from the scene, which would override it.
    set(&mut window, "camera", "readout_time_s", 0.03);
    set(&mut window, "noise", "scale", 0.25);
    save(&mut window, "Save to the profile");
    run_until(&mut window, |app| app.project().is_saved());
    let [profile, scene] = case.texts();
    assert!(profile.contains("readout_time_s = 0.03") && profile.contains("scale = 0.5 # quieter"), "{profile}");
    assert!(scene.contains("[settings.noise]\nscale = 0.25\n") && !scene.contains("readout_time_s"), "{scene}");
    let again = case.project();
    assert!(again.is_saved() && again.edit().settings == window.state().project().edit().settings);
    assert_eq!(number(&again, "camera", "readout_time_s"), 0.03);
}

#[test]
fn enter_does_not_overwrite_the_profile_if_a_model_is_open_without_a_scene() {
    let case = Case::new();
    let mut window =
        window(project(Some(&case.profile), Some(Path::new("scenes/marker-1.glb"))), egui::vec2(1400.0, 900.0));
    window.state_mut().project_mut().switch("noise", false);
    window.key_press_modifiers(Modifiers::COMMAND, Key::S);
    window.run_steps(3);
    // Effects are written, not only values of the camera.
    assert!(has_label(&window, "Save settings to the profile?"));
    window.key_press(Key::Enter);
    window.run_steps(3);
    assert!(!has_label(&window, "Save settings to the profile?") && !window.state().project().is_saved());
    assert_eq!(case.texts()[0], PROFILE);
    window.key_press_modifiers(Modifiers::COMMAND, Key::S);
    window.run_steps(3);
    press(&mut window, "Save to the profile");
    run_until(&mut window, |app| app.project().is_saved());
    assert!(case.texts()[0].contains("on = false"), "{}", case.texts()[0]);
}

#[test]
fn profile_saved_under_a_name_takes_all_settings_from_the_scene() {
    let case = Case::new();
    std::fs::write(&case.scene, format!("{SCENE}\n[settings.noise]\nscale = 0.75\n")).unwrap();
    let mut project = case.project();
    assert_eq!(
        (number(&project, "noise", "scale"), project.baseline_value("noise", "scale")),
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

#[test]
fn scene_settings_equal_to_the_profile_are_kept() {
    let case = Case::new();
    let exposure = "\n[camera.exposure]\ntime_s = 0.01\n";
    std::fs::write(&case.profile, format!("{PROFILE}{exposure}")).unwrap();
    let settings = "[settings.noise]\nscale = 0.5\n\n[settings.camera.exposure]\ntime_s = 0.01\n";
    std::fs::write(&case.scene, format!("{SCENE}\n{settings}")).unwrap();
    let mut project = case.project();
    assert!(project.edit().settings.overrule_recorded_exposure);
    project.change_scene("up", |scene| scene.metres_per_unit = Some(1.0)).unwrap();
    project.save_scene(&case.scene).unwrap();
    let again = case.project();
    assert!(again.edit().settings.overrule_recorded_exposure && again.edit() == project.edit());
    let scene = &case.texts()[1];
    assert!(scene.contains("scale = 0.5") && scene.contains("time_s = 0.01"), "{scene}");
    // A later change of the profile leaves the shot unchanged.
    std::fs::write(&case.profile, PROFILE.replace("0.5", "0.25")).unwrap();
    assert_eq!(number(&case.project(), "noise", "scale"), 0.5);
    // A setting changed and set back to the profile's is removed.
    project.set("noise", "scale", &Value::Number(0.75)).unwrap();
    project.save_scene(&case.scene).unwrap();
    project.set("noise", "scale", &Value::Number(0.5)).unwrap();
    project.save_scene(&case.scene).unwrap();
    assert!(!case.texts()[1].contains("scale"), "{}", case.texts()[1]);
}

#[test]
fn command_line_omits_the_exposure_if_the_recorded_one_is_used() {
    let case = Case::new();
    std::fs::write(&case.profile, format!("{PROFILE}\n[camera.exposure]\ntime_s = 0.01\n")).unwrap();
    std::fs::write(&case.scene, format!("{SCENE}\n[settings.camera.exposure]\ntime_s = 0.02\n")).unwrap();
    let mut project = case.project();
    project.set("camera.exposure", "time_s", &Value::Number(0.01)).unwrap();
    assert!(!project.edit().settings.overrule_recorded_exposure);
    let line = command_line(&project, 0);
    assert!(!line.text.contains("--set") && line.before[0].contains("Save the scene first"), "{line:?}");
    project.save_scene(&case.scene).unwrap();
    let line = command_line(&project, 0);
    assert!(!line.text.contains("--set") && line.before.is_empty(), "{line:?}");
    assert!(!case.project().edit().settings.overrule_recorded_exposure);
}

#[test]
fn film_speed_takes_effect_when_set() {
    let mut project = Case::new().project();
    let recorded = project.shot().exposure_settings(0).iso;
    project.set("camera.exposure", "time_s", &Value::Number(0.125)).unwrap();
    project.set("camera.exposure", "iso", &Value::Number(1234.0)).unwrap();
    let taken = project.shot().exposure_settings(0);
    assert_eq!((taken.time_s, taken.iso), (Some(0.125), Some(1234.0)));
    project.undo();
    project.undo();
    assert_eq!(project.shot().exposure_settings(0).iso, recorded);
}

#[test]
fn undone_noise_is_removed_from_the_profile() {
    let case = Case::new();
    let noise = Rig::of_file(&harness::demo().join("camera.toml")).unwrap().noise.unwrap();
    let mut project = case.project_without_noise();
    project.set_noise(noise.clone());
    save_camera(&mut project, &case.profile);
    assert!(case.texts()[0].contains("[camera.noise]") && project.is_saved());
    project.undo();
    assert_eq!(project.camera_changes(), ["Camera: noise"]);
    save_camera(&mut project, &case.profile);
    assert!(!case.texts()[0].contains("[camera.noise]") && project.is_saved(), "{}", case.texts()[0]);
    // Saved with the scene, it overrides the profile's.
    project.redo();
    save_camera(&mut project, &case.profile);
    project.undo();
    project.save_scene(&case.scene).unwrap();
    assert!(case.texts()[1].contains("[settings.camera]\nnoise = \"none\"\n"), "{}", case.texts()[1]);
    let again = case.project_without_noise();
    assert!(again.edit().rig.noise.is_none() && again.edit() == project.edit());
}

fn save_camera(project: &mut Project, profile: &Path) {
    let written = project.profile_draft(profile, ProfileScope::Camera).write().unwrap();
    project.written(written);
}

/// An analysis of [`harness::demo`] with a readout time, a sharpness and noise.
fn analysis(folder: &Path, project: &Project) -> Analysis {
    std::fs::create_dir_all(folder).unwrap();
    let poses = std::fs::read_to_string(harness::demo().join("groundtruth.txt")).unwrap();
    let count = poses.lines().filter(|line| !line.starts_with('#') && !line.is_empty()).count();
    std::fs::write(folder.join("poses.txt"), poses).unwrap();
    let mut geometry = project.shot().geometry_at(0).unwrap();
    geometry.intrinsics.readout_time_s = 0.0125;
    let frames = project.shot().recording.frame_count();
    let text = format!(
        "version = 13\nrecording = \"\"\nframes = {frames}\n[registration]\nposes = \"refined\"\nlinks = 0\n\
         missing_links = 0\ndepth_later_s = 0.0\npose_lines = {count}\n[spread]\nsigma_px = 0.75\n\
         [noise]\nframes = 1\n[noise.table]\ncode = [128.0]\nsigma = [[2.0], [2.0], [2.0]]\n\
         channel_correlation = [0.0, 0.0, 0.0]\nneighbour_correlation = [0.0, 0.0]\n"
    );
    let mut table: toml::Table = text.parse().unwrap();
    table.insert("camera".to_owned(), toml::Value::try_from(&geometry).unwrap());
    std::fs::write(folder.join("analysis.toml"), table.to_string()).unwrap();
    Analysis::read(folder).unwrap()
}

#[test]
fn readout_time_saved_to_the_profile_is_kept_in_the_scene_over_an_analysis() {
    let case = Case::new();
    let mut project = case.project();
    let folder = case.profile.with_file_name("found");
    let analysis = analysis(&folder, &project);
    project.adopt_analysis(folder, analysis).unwrap();
    assert_eq!(number(&project, "camera", "readout_time_s"), 0.0125);
    project.set("camera", "readout_time_s", &Value::Number(0.02)).unwrap();
    save_camera(&mut project, &case.profile);
    assert!(case.texts()[0].contains("readout_time_s = 0.02"), "{}", case.texts()[0]);
    // The analysis overrides the profile: the scene has to keep the value.
    assert_eq!(project.baseline_value("camera", "readout_time_s"), Some(Value::Number(0.0125)));
    assert!(!project.is_saved() && project.scene_is_changed());
    project.save_scene(&case.scene).unwrap();
    assert!(project.is_saved() && case.texts()[1].contains("[settings.camera]\nreadout_time_s = 0.02\n"));
    assert!(!command_line(&project, 0).text.contains("--set"));
}

#[test]
fn analysis_keeps_settings_of_the_scene_and_of_a_newer_profile() {
    let case = Case::new();
    std::fs::write(&case.profile, format!("{PROFILE}\n[camera]\nreadout_time_s = 0.01\n")).unwrap();
    std::fs::write(&case.scene, format!("{SCENE}\n[settings.camera]\nreadout_time_s = 0.01\n")).unwrap();
    let mut project = case.project();
    let folder = case.profile.with_file_name("found");
    let analysis = analysis(&folder, &project);
    project.set("point_spread", "sigma_px", &Value::Number(1.5)).unwrap();
    save_camera(&mut project, &case.profile.with_file_name("other.toml"));
    project.adopt_analysis(folder, analysis).unwrap();
    let names = [("camera", "readout_time_s"), ("point_spread", "sigma_px")];
    assert_eq!(names.map(|(table, name)| number(&project, table, name)), [0.01, 1.5]);
    assert_eq!(project.baseline_value("point_spread", "sigma_px"), Some(Value::Number(1.5)));
    assert_eq!(project.shot().estimates().len(), 1);
}

#[test]
fn estimated_noise_reaches_every_step_without_noise_of_its_own() {
    let case = Case::new();
    let mut project = case.project_without_noise();
    let folder = case.profile.with_file_name("found");
    let analysis = analysis(&folder, &project);
    let own = Rig::of_file(&harness::demo().join("camera.toml")).unwrap().noise.unwrap();
    project.set_noise(own.clone());
    project.adopt_analysis(folder.clone(), analysis.clone()).unwrap();
    assert_eq!(project.edit().rig.noise, Some(own));
    project.undo();
    let estimated = project.shot().estimated_noise().unwrap();
    assert!(project.edit().rig.noise.as_ref() == Some(estimated) && project.is_saved());
    // A scene may remove the camera's noise. This is its own setting, too.
    std::fs::write(&case.scene, format!("{SCENE}\n[settings.camera]\nnoise = \"none\"\n")).unwrap();
    let mut project = case.project_without_noise();
    project.adopt_analysis(folder, analysis).unwrap();
    assert!(project.edit().rig.noise.is_none() && project.shot().rig.noise.is_none() && project.is_saved());
}

#[test]
fn save_without_a_scene_names_the_unsaved_settings() {
    let case = Case::new();
    let model = Path::new("scenes/marker-1.glb");
    let mut project = project(Some(&case.profile), Some(model));
    let folder = case.profile.with_file_name("found");
    let analysis = analysis(&folder, &project);
    project.adopt_analysis(folder, analysis).unwrap();
    let mut window = window(project, egui::vec2(1400.0, 900.0));
    set(&mut window, "camera.exposure", "time_s", 0.02);
    set(&mut window, "camera", "readout_time_s", 0.02);
    set(&mut window, "noise", "scale", 0.25);
    window.key_press_modifiers(Modifiers::COMMAND, Key::S);
    window.run_steps(3);
    press(&mut window, "Save to the profile");
    run_until(&mut window, |app| app.message().is_some_and(|text| text.contains("Not saved without a scene: ")));
    let text = window.state().message().unwrap().to_owned();
    assert!(text.starts_with("Saved the profile mine.toml") && text.contains("eadout"), "{text}");
    let profile = &case.texts()[0];
    assert!(profile.contains("scale = 0.25") && !profile.contains("time_s"), "{profile}");
    // The second time it is reported at once, and nothing is written.
    window.key_press_modifiers(Modifiers::COMMAND, Key::S);
    window.run_steps(3);
    let text = window.state().message().unwrap();
    assert!(text.contains("Not saved without a scene: ") && !has_label(&window, "Save to the profile"), "{text}");
}

#[test]
fn reloaded_profile_values_affect_the_exposure() {
    let case = Case::new();
    let exposure = |iso: u32| format!("{PROFILE}\n[camera.exposure]\niso = {iso}\n\n[camera.lens]\nf_number = 4.0\n");
    std::fs::write(&case.profile, exposure(400)).unwrap();
    std::fs::write(&case.scene, format!("{SCENE}\n[settings.camera.lens]\nf_number = 8.0\n")).unwrap();
    let mut project = case.project();
    assert_eq!(
        (project.shot().exposure_settings(0).iso, project.shot().exposure_settings(0).f_number),
        (Some(400.0), Some(8.0))
    );
    std::fs::write(&case.profile, exposure(800)).unwrap();
    project.adopt_files(case.project());
    assert_eq!(
        (project.shot().exposure_settings(0).iso, project.shot().exposure_settings(0).f_number),
        (Some(800.0), Some(8.0))
    );
    assert_eq!(project.shot().baseline().unwrap().rig.exposure.iso, Some(800.0));
    // Without the scene's own value the profile's is used.
    project.reset("camera.lens", "f_number", &Value::Number(4.0)).unwrap();
    assert_eq!(project.shot().exposure_settings(0).f_number, Some(4.0));
}

#[test]
fn scene_setting_equal_to_the_profile_is_removed_in_one_step() {
    let case = Case::new();
    let pinned = format!("{SCENE}\n[settings.noise]\nscale = 0.5\n");
    std::fs::write(&case.scene, &pinned).unwrap();
    let mut project = case.project();
    assert!(project.is_pinned("noise", "scale") && project.is_saved());
    project.reset("noise", "scale", &Value::Number(0.5)).unwrap();
    project.close_step();
    assert!(!project.is_pinned("noise", "scale") && project.scene_is_changed() && project.history().can_undo());
    project.undo();
    assert!(project.is_pinned("noise", "scale") && project.is_saved());
    project.redo();
    project.save_scene(&case.scene).unwrap();
    assert!(project.is_saved() && !case.texts()[1].contains("scale"), "{}", case.texts()[1]);
    std::fs::write(&case.profile, PROFILE.replace("0.5", "0.25")).unwrap();
    assert_eq!(number(&case.project(), "noise", "scale"), 0.25);
    // Undo restores it even after saving.
    project.undo();
    project.save_scene(&case.scene).unwrap();
    assert!(project.is_saved() && case.texts()[1].contains("scale = 0.5"), "{}", case.texts()[1]);
}

#[test]
fn scene_switch_equal_to_the_profile_is_removed_in_one_step() {
    let case = Case::new();
    std::fs::write(&case.scene, format!("{SCENE}\n[settings.noise]\non = true\n")).unwrap();
    let mut project = case.project();
    project.reset_switch("noise").unwrap();
    project.save_scene(&case.scene).unwrap();
    assert!(project.is_saved() && !case.texts()[1].contains("[settings"), "{}", case.texts()[1]);
}

#[test]
fn scene_setting_overridden_for_the_session_stays_in_its_file() {
    let case = Case::new();
    let lens = "[settings.camera.lens]\naperture_diameter_mm = 5.0\n";
    std::fs::write(&case.scene, format!("{SCENE}\n[settings.noise]\nscale = 0.75\n\n{lens}")).unwrap();
    let sets = vec!["noise.scale=2".to_owned(), "camera.lens.f_number=4".to_owned()];
    let options = ShotOptions {
        profile: Some(case.profile.clone()),
        scene: Some(case.scene.clone()),
        sets,
        ..ShotOptions::default()
    };
    let open = || Project::open(&harness::demo(), &OpenOptions::default(), &options).unwrap();
    let mut project = open();
    assert_eq!((number(&project, "noise", "scale"), project.is_saved()), (2.0, true));
    project.switch("halation", false);
    project.save_scene(&case.scene).unwrap();
    let scene = &case.texts()[1];
    assert!(scene.contains("scale = 0.75") && scene.contains("aperture_diameter_mm = 5.0"), "{scene}");
    assert!(project.is_saved() && case.project().is_saved());
    // The command line has them, as this window does.
    let line = command_line(&project, 0);
    assert!(line.text.contains("--set noise.scale=2 --set camera.lens.f_number=4"), "{line:?}");
    // After a reload they still override the scene.
    project.adopt_files(open());
    assert_eq!(number(&project, "noise", "scale"), 2.0);
    // Values set by the user replace the scene's.
    project.set("noise", "scale", &Value::Number(3.0)).unwrap();
    project.set("camera.lens", "f_number", &Value::Number(8.0)).unwrap();
    project.save_scene(&case.scene).unwrap();
    let scene = &case.texts()[1];
    assert!(scene.contains("scale = 3.0") && scene.contains("f_number = 8.0"), "{scene}");
    assert!(!scene.contains("aperture_diameter_mm = 5.0"), "{scene}");
    case.project();
}
