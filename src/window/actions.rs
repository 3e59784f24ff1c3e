//! What keys do: one table, which the window's page of keys shows too.

use eframe::egui::{Context, Key, Modifiers, Popup};

use super::handles::Begin;

/// What a key does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Action {
    Play,
    /// Freezes the camera, or shows it again.
    Camera,
    /// Frames on; back where negative.
    Step(isize),
    /// The first frame of what is played over and over; the last; all frames.
    LoopFrom,
    LoopTo,
    LoopAll,
    Wipe,
    Loupe,
    /// Two settings beside each other; edits the other one.
    Compare,
    Exchange,
    /// Shows the picture alone, without the panels beside it.
    Alone,
    Fit,
    OneToOne,
    Larger,
    Smaller,
    Undo,
    Redo,
    Save,
    Open,
    Export,
    Theme,
    /// Begins to change what is selected.
    Begin(Begin),
    /// Moves what is selected a little to the right and up the picture; left and down where negative. Steps.
    Nudge(i8, i8),
    Delete,
    /// Leaves what is selected out of the picture, or shows it again.
    Hide,
    Keys,
    /// Ends what was begun.
    Leave,
}

/// A key with its modifiers, and what it does. Those of one line of the page follow each other with the same words.
struct Binding {
    modifiers: Modifiers,
    key: Key,
    action: Action,
    does: &'static str,
}

const fn bind(modifiers: Modifiers, key: Key, action: Action, does: &'static str) -> Binding {
    Binding { modifiers, key, action, does }
}

const NONE: Modifiers = Modifiers::NONE;
const SHIFT: Modifiers = Modifiers::SHIFT;
const COMMAND: Modifiers = Modifiers::COMMAND;
const ALT: Modifiers = Modifiers::ALT;
const COMMAND_SHIFT: Modifiers = Modifiers::COMMAND.plus(Modifiers::SHIFT);

/// Of one key the binding with more modifiers stands first: an additional Shift does not keep a key from working.
const BINDINGS: &[Binding] = &[
    bind(NONE, Key::G, Action::Begin(Begin::Move), "move the selection; then X, Y, Z, numbers"),
    bind(NONE, Key::R, Action::Begin(Begin::Turn), "turn the selection"),
    bind(NONE, Key::S, Action::Begin(Begin::Scale), "scale the selection"),
    bind(SHIFT, Key::D, Action::Begin(Begin::Duplicate), "duplicate the selection"),
    bind(NONE, Key::H, Action::Hide, "hide or show the selection"),
    bind(NONE, Key::Delete, Action::Delete, "delete the selection"),
    bind(ALT, Key::ArrowLeft, Action::Nudge(-1, 0), "move the selection by a millimetre"),
    bind(ALT, Key::ArrowRight, Action::Nudge(1, 0), "move the selection by a millimetre"),
    bind(ALT, Key::ArrowUp, Action::Nudge(0, 1), "move the selection by a millimetre"),
    bind(ALT, Key::ArrowDown, Action::Nudge(0, -1), "move the selection by a millimetre"),
    bind(NONE, Key::Space, Action::Play, "play, pause; freeze the camera"),
    bind(NONE, Key::C, Action::Camera, "freeze the camera, show it again"),
    bind(SHIFT, Key::ArrowLeft, Action::Step(-10), "10 frames back, forward"),
    bind(SHIFT, Key::ArrowRight, Action::Step(10), "10 frames back, forward"),
    bind(NONE, Key::ArrowLeft, Action::Step(-1), "one frame back, forward"),
    bind(NONE, Key::ArrowRight, Action::Step(1), "one frame back, forward"),
    bind(NONE, Key::Home, Action::Step(isize::MIN), "first, last frame"),
    bind(NONE, Key::End, Action::Step(isize::MAX), "first, last frame"),
    bind(SHIFT, Key::I, Action::LoopAll, "clear loop"),
    bind(NONE, Key::I, Action::LoopFrom, "loop start, end"),
    bind(NONE, Key::O, Action::LoopTo, "loop start, end"),
    bind(NONE, Key::W, Action::Wipe, "wipe between camera and composite"),
    bind(SHIFT, Key::B, Action::Exchange, "edit the other one of A and B"),
    bind(NONE, Key::B, Action::Compare, "two settings, A and B, beside each other"),
    bind(NONE, Key::L, Action::Loupe, "loupe: code values at the pointer"),
    bind(NONE, Key::P, Action::Alone, "the picture alone, without the panels"),
    bind(NONE, Key::F, Action::Fit, "fit"),
    bind(NONE, Key::Num1, Action::OneToOne, "100 %"),
    bind(NONE, Key::Plus, Action::Larger, "zoom in, out"),
    bind(NONE, Key::Equals, Action::Larger, "zoom in, out"),
    bind(NONE, Key::Minus, Action::Smaller, "zoom in, out"),
    bind(COMMAND_SHIFT, Key::Z, Action::Redo, "redo"),
    bind(COMMAND, Key::Y, Action::Redo, "redo"),
    bind(COMMAND, Key::Z, Action::Undo, "undo"),
    bind(COMMAND, Key::S, Action::Save, "save profile and scene"),
    bind(COMMAND, Key::O, Action::Open, "open a recording"),
    bind(COMMAND, Key::E, Action::Export, "export and photograph"),
    bind(NONE, Key::T, Action::Theme, "light or dark"),
    bind(NONE, Key::Questionmark, Action::Keys, "these keys"),
    bind(NONE, Key::F1, Action::Keys, "these keys"),
    bind(NONE, Key::Escape, Action::Leave, "cancel, close, deselect"),
];

/// What is done by the pointer, or as long as a key is held.
const HELD: &[(&str, &str)] =
    &[("\\ held", "the camera's own picture"), ("Wheel", "zoom about the pointer"), ("Drag", "move the picture")];

/// The same of what is moved, turned or scaled.
const MOVING: &[(&str, &str)] = &[
    ("Ctrl", "while it moves: whole steps"),
    ("Shift", "while it moves: it stays on its level"),
    ("X twice", "along its own axis"),
    ("Enter, Esc", "confirm, cancel"),
    ("Arrows, Enter", "while a place is asked for: there"),
];

/// What was asked for by keys, each as often as its key was pressed. Where text is typed only keys with Ctrl count. Esc is the
/// field's in which `was_typing` somebody before it was pressed: it has lost the keyboard by it already.
pub fn pressed(ctx: &Context, was_typing: bool) -> Vec<Action> {
    let typing = ctx.egui_wants_keyboard_input();
    // And the menu's that is open.
    let in_menu = was_typing || Popup::is_any_open(ctx);
    let usable = BINDINGS.iter().filter(|binding| !typing || binding.modifiers.command);
    let usable = usable.filter(|binding| !in_menu || binding.key != Key::Escape);
    let times = |binding: &Binding| ctx.input_mut(|i| i.count_and_consume_key(binding.modifiers, binding.key));
    usable.flat_map(|binding| std::iter::repeat_n(binding.action, times(binding))).collect()
}

/// A part of the page of keys.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Part {
    Time,
    Picture,
    Evidence,
    Work,
}

/// The parts as they stand on the page, with their titles.
const PARTS: [(Part, &str); 4] =
    [(Part::Time, "Time"), (Part::Picture, "Picture"), (Part::Evidence, "Evidence"), (Part::Work, "Work")];

fn part(action: Action) -> Part {
    match action {
        Action::Play | Action::Camera | Action::Step(_) | Action::LoopFrom | Action::LoopTo | Action::LoopAll => {
            Part::Time
        }
        Action::Wipe
        | Action::Loupe
        | Action::Compare
        | Action::Exchange
        | Action::Alone
        | Action::Fit
        | Action::OneToOne
        | Action::Larger
        | Action::Smaller => Part::Picture,
        Action::Begin(_) | Action::Nudge(..) | Action::Delete | Action::Hide => Part::Evidence,
        Action::Undo
        | Action::Redo
        | Action::Save
        | Action::Open
        | Action::Export
        | Action::Theme
        | Action::Keys
        | Action::Leave => Part::Work,
    }
}

/// The page of keys, by its parts: keys, and what they do.
pub fn page() -> Vec<(&'static str, Vec<(String, &'static str)>)> {
    let lines = |wanted: Part| {
        let mut lines: Vec<(String, &'static str)> = Vec::new();
        for Binding { modifiers, key, does, .. } in BINDINGS.iter().filter(|binding| part(binding.action) == wanted) {
            let key = named(*modifiers, *key);
            match lines.iter_mut().find(|(_, same)| same == does) {
                Some((keys, _)) => *keys = format!("{keys}, {key}"),
                None => lines.push((key, does)),
            }
        }
        if wanted == Part::Picture {
            lines.extend(HELD.iter().map(|(key, does)| ((*key).to_owned(), *does)));
        }
        if wanted == Part::Evidence {
            lines.extend(MOVING.iter().map(|(key, does)| ((*key).to_owned(), *does)));
        }
        lines
    };
    PARTS.into_iter().map(|(wanted, title)| (title, lines(wanted))).collect()
}

/// As it stands on a keyboard.
fn named(modifiers: Modifiers, key: Key) -> String {
    let name = match key {
        Key::ArrowLeft => "Left",
        Key::ArrowRight => "Right",
        Key::ArrowUp => "Up",
        Key::ArrowDown => "Down",
        Key::Plus => "+",
        Key::Equals => "=",
        Key::Minus => "-",
        Key::Questionmark => "?",
        Key::Escape => "Esc",
        Key::Delete => "Del",
        other => other.name(),
    };
    let before = [(modifiers.command, "Ctrl+"), (modifiers.alt, "Alt+"), (modifiers.shift, "Shift+")];
    before.iter().filter(|(held, _)| *held).map(|(_, name)| *name).chain([name]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_binding_hides_a_later_one() {
        for (n, binding) in BINDINGS.iter().enumerate() {
            let hides = |earlier: &&Binding| {
                earlier.key == binding.key && binding.modifiers.matches_logically(earlier.modifiers)
            };
            let hidden = BINDINGS[..n].iter().find(hides);
            assert!(hidden.is_none(), "{} never does: {}", named(binding.modifiers, binding.key), binding.does);
        }
        let page = page();
        let keys =
            |does: &str| page.iter().flat_map(|(_, lines)| lines).find(|line| line.1 == does).unwrap().0.as_str();
        assert_eq!(
            (keys("10 frames back, forward"), keys("redo")),
            ("Shift+Left, Shift+Right", "Ctrl+Shift+Z, Ctrl+Y")
        );
    }
}
