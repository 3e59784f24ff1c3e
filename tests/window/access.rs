//! The window operated by keys alone, its accessibility tree, and legible text sizes.

use std::sync::{Arc, Mutex};

use crate::harness::{Device, demo, demo_frame, has_label, scene_or_none, settle, wait_for_label, window};
use eframe::egui::epaint::Shape;
use eframe::egui::{self, FullOutput, Key, Modifiers, accesskit::Role};
use egui_kittest::Harness;
use egui_kittest::kittest::{NodeT, Queryable};
use locard::recording::OpenOptions;
use locard::shot::ShotOptions;
use locard::window::{App, DEMO_SCENE, Project, Start};

const SIZE: egui::Vec2 = egui::vec2(1280.0, 720.0);

fn project() -> Project {
    let options = ShotOptions { scene: Some(DEMO_SCENE.into()), ..ShotOptions::default() };
    Project::open(&demo(), &OpenOptions::default(), &options).unwrap()
}

/// Project of tests that check nothing virtual.
fn plain() -> Project {
    let options = ShotOptions { scene: scene_or_none(), ..ShotOptions::default() };
    Project::open(&demo(), &OpenOptions::default(), &options).unwrap()
}

/// Label of the widget with the keyboard focus.
fn focused<S>(window: &Harness<'_, S>) -> Option<String> {
    window.root().children_recursive().find(|node| node.accesskit_node().is_focused())?.accesskit_node().label()
}

fn press(window: &mut Harness<'_, App>, key: Key) {
    window.key_press(key);
    window.run_steps(3);
}

#[test]
fn library_is_navigated_by_keys() {
    let mut window = window(project(), SIZE);
    window.get_by_label("Place…").focus();
    window.run_steps(2);
    press(&mut window, Key::Enter);
    let models = [0, 1, 3, 4].map(|n| {
        let all: Vec<_> =
            window.query_all_by_role(Role::Button).filter_map(|node| node.accesskit_node().label()).collect();
        let first = all.iter().position(|name| name == "cartridge-case-9mm").expect("the library is open");
        all[first + n].clone()
    });
    assert_eq!(focused(&window).as_ref(), Some(&models[0]), "opened by a key, it has the keyboard");
    for (key, n) in [(Key::ArrowRight, 1), (Key::ArrowDown, 3), (Key::ArrowLeft, 2), (Key::Tab, 3), (Key::ArrowUp, 1)] {
        press(&mut window, key);
        assert_eq!(focused(&window).as_ref(), Some(&models[n]), "{key:?}");
    }
    // Esc returns the focus and closes nothing else.
    window.state_mut().show_start(true);
    press(&mut window, Key::Escape);
    assert!(focused(&window).as_deref() == Some("Place…") && !has_label(&window, &models[0]), "{:?}", focused(&window));
    assert!(has_label(&window, "Open a recording…"));
    window.state_mut().show_start(false);
    // Enter picks one; then the arrows move a cursor over the picture.
    press(&mut window, Key::Enter);
    press(&mut window, Key::ArrowRight);
    press(&mut window, Key::Enter);
    assert!(
        has_label(&window, "Click in the picture, or press and drag to turn it; Esc ends it.")
            && focused(&window).is_none()
    );
    let before = window.state().project().edit().scene.entries().len();
    window.state_mut().player_mut().seek(demo_frame(30));
    settle(&mut window);
    press(&mut window, Key::ArrowDown);
    press(&mut window, Key::Enter);
    assert_eq!(window.state().project().edit().scene.entries().len(), before + 1, "{:?}", window.state().message());
}

/// True if a dialog has this name.
fn is_dialog<S>(window: &Harness<'_, S>, name: &str) -> bool {
    window.query_all_by_role(Role::Dialog).any(|node| node.accesskit_node().label().as_deref() == Some(name))
}

#[test]
fn dialogs_have_the_dialog_role_and_a_name() {
    let mut window = window(plain(), SIZE);
    window.key_press_modifiers(Modifiers::COMMAND, Key::O);
    window.run_steps(3);
    assert!(is_dialog(&window, "Open a recording"));
    press(&mut window, Key::Escape);
    window.state_mut().show_start(true);
    window.run_steps(2);
    assert!(is_dialog(&window, "Welcome"));
    press(&mut window, Key::Escape);
    window.state_mut().project_mut().set("noise", "scale", &locard::params::Value::Number(0.5)).unwrap();
    press(&mut window, Key::L);
    window.key_press_modifiers(Modifiers::COMMAND, Key::Z);
    window.run_steps(2);
    window.get_by_label("Undone: Noise: Amount").click();
    window.run_steps(3);
    assert!(is_dialog(&window, "Message"));
    press(&mut window, Key::Escape);
    assert!(!is_dialog(&window, "Message"));
    window.state_mut().project_mut().set("noise", "scale", &locard::params::Value::Number(0.5)).unwrap();
    let root = window.input_mut().viewports.entry(egui::ViewportId::ROOT).or_default();
    root.events.push(egui::ViewportEvent::Close);
    window.step();
    window.input_mut().viewports.entry(egui::ViewportId::ROOT).or_default().events.clear();
    window.run_steps(3);
    assert!(is_dialog(&window, "Save changes?"));
}

#[test]
fn key_help_opens_before_any_recording() {
    let builder = Harness::builder().with_size(SIZE).renderer(Device::new());
    let mut start = builder.build_eframe(|context| Start::new(context, None).unwrap());
    start.run_steps(3);
    assert!(is_dialog(&start, "Welcome") && !has_label(&start, "these keys"));
    for closes in [Key::Questionmark, Key::Escape, Key::F1] {
        start.key_press(Key::Questionmark);
        start.run_steps(3);
        assert!(has_label(&start, "these keys"));
        start.key_press(closes);
        start.run_steps(3);
        assert!(!has_label(&start, "these keys"), "{closes:?}");
    }
    start.key_press_modifiers(Modifiers::COMMAND, Key::O);
    start.run_steps(3);
    assert!(is_dialog(&start, "Open a recording"));
    // Text typed in the dialog is not a key of the window.
    start.event(egui::Event::Text("?".to_owned()));
    start.key_press(Key::Questionmark);
    start.run_steps(3);
    assert!(!has_label(&start, "these keys"));
}

/// The smallest font size painted since the last query, with its text.
#[derive(Clone, Default)]
struct SmallestText(Arc<Mutex<Option<(f32, String)>>>);

impl SmallestText {
    fn look(&self, shape: &Shape) {
        match shape {
            Shape::Vec(shapes) => shapes.iter().for_each(|shape| self.look(shape)),
            Shape::Text(text) => {
                let job = &text.galley.job;
                let mut smallest = self.0.lock().unwrap();
                for section in job.sections.iter().filter(|_| !job.text.trim().is_empty()) {
                    let size = section.format.font_id.size;
                    if smallest.as_ref().is_none_or(|(least, _)| size < *least) {
                        *smallest = Some((size, job.text.clone()));
                    }
                }
            }
            _ => {}
        }
    }
}

impl egui::Plugin for SmallestText {
    fn debug_name(&self) -> &'static str {
        "letters"
    }

    fn output_hook(&mut self, _: &egui::Context, output: &mut FullOutput) {
        output.shapes.iter().for_each(|shape| self.look(&shape.shape));
    }
}

#[test]
fn no_text_is_smaller_than_the_legible_size() {
    let letters = SmallestText::default();
    let (seen, project) = (letters.clone(), project());
    let builder = Harness::builder().with_size(SIZE).renderer(Device::new());
    let mut window = builder.build_eframe(move |context| {
        // Before the painter, which takes all shapes.
        context.egui_ctx.add_plugin(letters);
        App::new(context, project, None).unwrap()
    });
    settle(&mut window);
    let least = |what: &str| {
        let (size, text) = seen.0.lock().unwrap().take().expect(what);
        assert!(size >= 11.0, "{what}: {size} in {text:?}");
    };
    least("as it opens");
    for title in ["Match", "Calibrate", "Settings"] {
        window.get_by_label(title).click();
        window.run_steps(3);
        let folded: Vec<_> =
            window.query_all_by_role(Role::Button).filter_map(|node| node.accesskit_node().label()).collect();
        for section in folded
            .iter()
            .filter(|name| ["Brightness", "Edges", "Patch over time", "Render time"].contains(&name.as_str()))
        {
            window.get_by_label(section).click();
            window.run_steps(3);
        }
        least(title);
    }
    window.get_by_label("Place…").click();
    wait_for_label(&mut window, "marker-3");
    least("the library");
    press(&mut window, Key::Escape);
    for key in [Key::E, Key::O] {
        window.key_press_modifiers(Modifiers::COMMAND, key);
        window.run_steps(3);
        least(key.name());
        press(&mut window, Key::Escape);
    }
    press(&mut window, Key::Questionmark);
    least("keys");
    press(&mut window, Key::Escape);
    // Pixel values in pixels, and beside the pointer.
    press(&mut window, Key::L);
    window.state_mut().view_mut().zoom = Some(41.0);
    window.hover_at(egui::pos2(500.0, 400.0));
    window.run_steps(3);
    settle(&mut window);
    window.run_steps(3);
    least("pixel values");
}
