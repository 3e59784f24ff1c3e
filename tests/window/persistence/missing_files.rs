//! Scenes that name files which cannot be read: the rest is shown, nothing is exported, and the
//! file can be located.

use super::*;
use locard::export::Export;
use locard::photo::PhotoRequest;
use locard::scene::SceneFile;
use locard::sink::OutPath;
use locard::window::{JobKind, Jobs};

/// Position in the picture of the demonstration's first frame.
const PLACE: [f64; 3] = [0.1046, -0.0958, 0.0];

struct Case {
    folder: tempfile::TempDir,
    scene: PathBuf,
}

impl Case {
    /// A marker that exists, and an object whose model is missing.
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let scene = folder.path().join("case.toml");
        let marker = std::fs::canonicalize("scenes/marker-1.glb").unwrap();
        let text = format!(
            "version = 1\nup = \"z\"\n\n[[objects]]\nmodel = {marker:?}\nposition_m = [0.3, 0.2, 0.0]\nground = true\n\n\
             # the knife\n[[objects]]\nmodel = \"models/knife.glb\"\nposition_m = {PLACE:?}\nground = true\n"
        );
        std::fs::write(&scene, text).unwrap();
        Self { folder, scene }
    }
}

/// Number of pixels in the stand-in's colour.
fn stand_in_pixels(codes: &[[u8; 3]]) -> usize {
    codes.iter().filter(|[r, g, b]| *r > 180 && *g < 90 && *b > 180).count()
}

fn composite_error(scene: &Path) -> String {
    let options = ShotOptions { scene: Some(scene.to_owned()), ..ShotOptions::default() };
    Shot::open(&harness::demo(), &OpenOptions::default(), &options).unwrap_err().to_string()
}

#[test]
fn missing_model_is_a_marked_box_until_it_is_located() {
    let case = Case::new();
    let mut window = open(None, &case.scene);
    assert!(has_label(&window, "knife.glb is missing") && has_label(&window, "knife: model missing"));
    assert!(stand_in_pixels(&shown_codes(&window)) > 5, "{}", stand_in_pixels(&shown_codes(&window)));
    // Exports are refused, and the command line refuses the scene.
    let error = window.state().project().shot().check(0..1).unwrap_err().to_string();
    assert!(error.contains("knife.glb") && composite_error(&case.scene).contains("knife.glb"), "{error}");
    let replacement = case.folder.path().join("elsewhere.glb");
    std::fs::copy("scenes/l-scale.glb", &replacement).unwrap();
    press(&mut window, "Locate knife.glb…");
    // The dialog starts in the scene's folder: the model's own does not exist.
    wait_for_label(&mut window, case.folder.path().canonicalize().unwrap().file_name().unwrap().to_str().unwrap());
    answer(&mut window, &replacement, "Open");
    run_until(&mut window, |app| app.project().shot().scene.missing.is_empty());
    settle(&mut window);
    assert_eq!(window.state().project().edit().scene.objects[1].model, "elsewhere.glb");
    assert!(stand_in_pixels(&shown_codes(&window)) == 0 && !has_label(&window, "knife.glb is missing"));
    window.state().project().shot().check(0..1).unwrap();
    press(&mut window, "Undo");
    settle(&mut window);
    assert!(stand_in_pixels(&shown_codes(&window)) > 5 && has_label(&window, "knife.glb is missing"));
}

// Slow: files on disk are checked every 2 s, and the picture is made twice.
#[test]
fn missing_model_is_reloaded_when_it_reappears() {
    let case = Case::new();
    let mut window = open(None, &case.scene);
    assert!(has_label(&window, "knife.glb is missing"));
    let folder = case.folder.path().join("models");
    std::fs::create_dir(&folder).unwrap();
    std::fs::copy("scenes/l-scale.glb", folder.join("knife.glb")).unwrap();
    run_until(&mut window, |app| app.project().shot().scene.missing.is_empty());
    settle(&mut window);
    window.run_steps(2);
    assert!(stand_in_pixels(&shown_codes(&window)) == 0 && !has_label(&window, "knife.glb is missing"));
    assert_eq!(harness::steps(&window), ["opened"], "it is no step of the history");
    assert!(window.state().project().is_saved());
}

#[test]
fn hidden_objects_need_no_model_but_new_ones_do() {
    let case = Case::new();
    let mut project = project(None, Some(&case.scene));
    let entry = project.edit().scene.entries()[1];
    project.change_scene("hidden", |scene| scene.set_hidden(entry, true)).unwrap();
    project.shot().check(0..1).unwrap();
    project.save_scene(&case.scene).unwrap();
    let options = ShotOptions { scene: Some(case.scene.clone()), ..ShotOptions::default() };
    Shot::open(&harness::demo(), &OpenOptions::default(), &options).unwrap();
    // A newly placed model must exist.
    let placed = PlacedModel { model: "none.glb".to_owned(), ..PlacedModel::default() };
    let place = |scene: &mut SceneFile| scene.objects.push(placed);
    let error = project.change_scene("placed", place).unwrap_err().to_string();
    assert!(error.contains("none.glb") && project.edit().scene.objects.len() == 2, "{error}");
}

#[test]
fn missing_models_in_one_folder_are_located_together() {
    let case = Case::new();
    let text = std::fs::read_to_string(&case.scene).unwrap();
    std::fs::write(&case.scene, format!("{text}\n[[objects]]\nmodel = \"models/case.glb\"\n")).unwrap();
    let moved = case.folder.path().join("moved");
    std::fs::create_dir(&moved).unwrap();
    for name in ["knife.glb", "case.glb"] {
        std::fs::copy("scenes/l-scale.glb", moved.join(name)).unwrap();
    }
    let mut project = project(None, Some(&case.scene));
    assert_eq!(project.shot().scene.missing.len(), 2);
    let message = project.locate(&case.folder.path().join("models/knife.glb"), &moved.join("knife.glb")).unwrap();
    assert!(message.ends_with("and 1 more in the same folder"), "{message}");
    let models: Vec<_> = project.edit().scene.objects[1..].iter().map(|object| object.model.as_str()).collect();
    assert_eq!(models, ["moved/knife.glb", "moved/case.glb"]);
    assert!(project.shot().scene.missing.is_empty() && project.history().can_undo());
}

#[test]
fn models_are_located_after_the_scene_is_saved_elsewhere() {
    let case = Case::new();
    let mut project = project(None, Some(&case.scene));
    let elsewhere = case.folder.path().join("elsewhere");
    std::fs::create_dir(&elsewhere).unwrap();
    project.save_scene(&elsewhere.join("moved.toml")).unwrap();
    let replacement = elsewhere.join("knife.glb");
    std::fs::copy("scenes/l-scale.glb", &replacement).unwrap();
    let missing = project.shot().scene.missing[0].file.clone();
    project.locate(&missing, &replacement).unwrap();
    assert_eq!(project.edit().scene.objects[1].model, "knife.glb");
    assert!(project.shot().scene.missing.is_empty());
    // A file that the scene does not name is an error.
    let error = project.locate(&missing, &replacement).unwrap_err();
    assert!(error.contains("knife.glb"), "{error}");
}

#[test]
fn unreadable_models_in_the_folder_do_not_prevent_locating_one() {
    let case = Case::new();
    let text = std::fs::read_to_string(&case.scene).unwrap();
    let more = ["./models/../models/cut.glb", "models/case.glb", "gone/other.glb"];
    let more = more.map(|model| format!("\n[[objects]]\nmodel = {model:?}\n")).concat();
    std::fs::write(&case.scene, format!("{text}{more}")).unwrap();
    let models = case.folder.path().join("models");
    std::fs::create_dir(&models).unwrap();
    // One at its named path and one to be located, both unreadable.
    for name in ["cut.glb", "other.glb"] {
        std::fs::write(models.join(name), "no model").unwrap();
    }
    let mut project = project(None, Some(&case.scene));
    std::fs::copy("scenes/l-scale.glb", models.join("blade.glb")).unwrap();
    std::fs::copy("scenes/l-scale.glb", models.join("case.glb")).unwrap();
    let message = project.locate(&models.join("knife.glb"), &models.join("blade.glb")).unwrap();
    assert!(message.ends_with("blade.glb"), "{message}");
    let named: Vec<_> = project.edit().scene.objects[1..].iter().map(|object| object.model.as_str()).collect();
    assert_eq!(named, ["models/blade.glb", "./models/../models/cut.glb", "models/case.glb", "gone/other.glb"]);
    let missing = &project.shot().scene.missing;
    assert_eq!(missing.len(), 2, "{missing:?}");
}

#[test]
fn exports_and_photographs_with_a_stand_in_are_refused() {
    let case = Case::new();
    let project = project(None, Some(&case.scene));
    let out = |name: &str| case.folder.path().join(name);
    let tasks = [
        JobKind::Export(Export::new(0..1, OutPath::Folder(out("frames")))),
        JobKind::Photograph(PhotoRequest::new(0, out("photo.png"))),
        JobKind::Snapshot { frame: 0, path: out("frame.png"), force: false },
    ];
    let mut jobs = Jobs::new(|| {}).unwrap();
    for task in tasks {
        jobs.add("with a stand-in".to_owned(), project.shot(), task);
    }
    let begun = Instant::now();
    while jobs.is_busy() && begun.elapsed() < Duration::from_secs(60) {
        jobs.take();
        std::thread::sleep(Duration::from_millis(5));
    }
    for entry in &jobs.entries {
        assert!(matches!(&entry.state, JobState::Failed(why) if why.contains("knife.glb")), "{entry:?}");
    }
    assert!(["frames", "photo.png", "frame.png"].iter().all(|name| !out(name).exists()));
}

#[test]
fn truncated_model_is_refused_when_dropped() {
    let folder = tempfile::tempdir().unwrap();
    let cut = folder.path().join("kaputt.glb");
    let whole = std::fs::read("scenes/marker-1.glb").unwrap();
    std::fs::write(&cut, &whole[..2000]).unwrap();
    let mut window = plain();
    drop_file(&mut window, cut);
    run_until(&mut window, |app| app.problem().is_some());
    let message =
        format!("kaputt.glb is incomplete (2 of {} kB); copy or download it again", (whole.len() + 500) / 1000);
    assert_eq!(window.state().problem(), Some(message.as_str()));
    window.run_steps(2);
    assert!(has_label(&window, "Place…"), "nothing is being placed");
}
