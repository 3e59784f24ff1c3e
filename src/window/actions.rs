//! Key bindings: one table, which the page of keys shows too.

use eframe::egui::{Context, Key, Modifiers, Popup};

use super::handles::TransformCommand;

/// Action of a key binding.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Action {
    Play,
    /// Freezes the camera, or shows it again.
    Camera,
    /// Steps by frames; backwards if negative.
    Step(isize),
    /// Sets the start of the loop.
    LoopFrom,
    /// Sets the end of the loop.
    LoopTo,
    LoopAll,
    Wipe,
    Loupe,
    /// Compares two settings, A and B.
    Compare,
    /// Edits the other one of A and B.
    Exchange,
    /// Hides the panels.
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
    /// Begins a transform of the selection.
    Transform(TransformCommand),
    /// Moves the selection by steps to the right and up in the picture; to the left and down if
    /// negative.
    Nudge(i8, i8),
    Delete,
    /// Hides the selection, or shows it again.
    Hide,
    Keys,
    /// Cancels the current mode.
    Leave,
}

/// A key with its modifiers and action. Adjacent bindings with equal text share a line of the page
/// of keys.
struct KeyBinding {
    modifiers: Modifiers,
    key: Key,
    action: Action,
    does: &'static str,
}

const fn bind(modifiers: Modifiers, key: Key, action: Action, does: &'static str) -> KeyBinding {
    KeyBinding { modifiers, key, action, does }
}

const NONE: Modifiers = Modifiers::NONE;
const SHIFT: Modifiers = Modifiers::SHIFT;
const COMMAND: Modifiers = Modifiers::COMMAND;
const ALT: Modifiers = Modifiers::ALT;
const COMMAND_SHIFT: Modifiers = Modifiers::COMMAND.plus(Modifiers::SHIFT);

/// For each key the bindings with more modifiers come first, since a binding also matches with an
/// additional Shift.
const BINDINGS: &[KeyBinding] = &[
    bind(NONE, Key::G, Action::Transform(TransformCommand::Move), "move the selection; then X, Y, Z, numbers"),
    bind(NONE, Key::R, Action::Transform(TransformCommand::Turn), "turn the selection"),
    bind(NONE, Key::S, Action::Transform(TransformCommand::Scale), "scale the selection"),
    bind(SHIFT, Key::D, Action::Transform(TransformCommand::Duplicate), "duplicate the selection"),
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
    bind(SHIFT, Key::B, Action::Exchange, "switch between A and B"),
    bind(NONE, Key::B, Action::Compare, "two settings, A and B, beside each other"),
    bind(NONE, Key::L, Action::Loupe, "loupe: pixel values (8 bit) at the pointer"),
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
    bind(NONE, Key::T, Action::Theme, "theme"),
    bind(NONE, Key::Questionmark, Action::Keys, "these keys"),
    bind(NONE, Key::F1, Action::Keys, "these keys"),
    bind(NONE, Key::Escape, Action::Leave, "cancel, close, deselect"),
];

/// Lines of the page for the pointer and for held keys.
const POINTER_LINES: &[(&str, &str)] =
    &[("\\ held", "the camera's own picture"), ("Wheel", "zoom about the pointer"), ("Drag", "move the picture")];

/// Lines of the page for transforms.
const TRANSFORM_LINES: &[(&str, &str)] = &[
    ("Ctrl", "during a transform: whole steps"),
    ("Shift", "during a transform: level"),
    ("X twice", "along its own axis"),
    ("Enter, Esc", "confirm, cancel"),
    ("Arrows, Enter", "while a point is picked: move and click"),
];

/// Consumes the pressed keys and returns their actions, one for each press. While a text field has
/// the focus only keys with Ctrl count. Esc belongs to an open menu, and to a text field
/// (`was_typing`: the field had the focus before this frame and lost it by Esc).
pub fn pressed(ctx: &Context, was_typing: bool) -> Vec<Action> {
    let typing = ctx.egui_wants_keyboard_input();
    let in_menu = was_typing || Popup::is_any_open(ctx);
    let usable = BINDINGS.iter().filter(|binding| !typing || binding.modifiers.command);
    let usable = usable.filter(|binding| !in_menu || binding.key != Key::Escape);
    let times = |binding: &KeyBinding| ctx.input_mut(|i| i.count_and_consume_key(binding.modifiers, binding.key));
    usable.flat_map(|binding| std::iter::repeat_n(binding.action, times(binding))).collect()
}

/// A section of the page of keys.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Section {
    Time,
    Picture,
    Evidence,
    Work,
}

/// The sections in the order of the page, with their titles.
const SECTIONS: [(Section, &str); 4] =
    [(Section::Time, "Time"), (Section::Picture, "Picture"), (Section::Evidence, "Evidence"), (Section::Work, "Work")];

fn section(action: Action) -> Section {
    match action {
        Action::Play | Action::Camera | Action::Step(_) | Action::LoopFrom | Action::LoopTo | Action::LoopAll => {
            Section::Time
        }
        Action::Wipe
        | Action::Loupe
        | Action::Compare
        | Action::Exchange
        | Action::Alone
        | Action::Fit
        | Action::OneToOne
        | Action::Larger
        | Action::Smaller => Section::Picture,
        Action::Transform(_) | Action::Nudge(..) | Action::Delete | Action::Hide => Section::Evidence,
        Action::Undo
        | Action::Redo
        | Action::Save
        | Action::Open
        | Action::Export
        | Action::Theme
        | Action::Keys
        | Action::Leave => Section::Work,
    }
}

/// The page of keys by section: keys, and their text.
pub fn page() -> Vec<(&'static str, Vec<(String, &'static str)>)> {
    let lines = |page_section: Section| {
        let mut lines: Vec<(String, &'static str)> = Vec::new();
        for KeyBinding { modifiers, key, does, .. } in
            BINDINGS.iter().filter(|binding| section(binding.action) == page_section)
        {
            let key = key_name(*modifiers, *key);
            match lines.iter_mut().find(|(_, same)| same == does) {
                Some((keys, _)) => *keys = format!("{keys}, {key}"),
                None => lines.push((key, does)),
            }
        }
        if page_section == Section::Picture {
            lines.extend(POINTER_LINES.iter().map(|(key, does)| ((*key).to_owned(), *does)));
        }
        if page_section == Section::Evidence {
            lines.extend(TRANSFORM_LINES.iter().map(|(key, does)| ((*key).to_owned(), *does)));
        }
        lines
    };
    SECTIONS.into_iter().map(|(page_section, title)| (title, lines(page_section))).collect()
}

/// Name of a key with its modifiers, as on a keyboard.
fn key_name(modifiers: Modifiers, key: Key) -> String {
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
    fn no_binding_shadows_a_later_one() {
        for (n, binding) in BINDINGS.iter().enumerate() {
            let hides = |earlier: &&KeyBinding| {
                earlier.key == binding.key && binding.modifiers.matches_logically(earlier.modifiers)
            };
            let hidden = BINDINGS[..n].iter().find(hides);
            assert!(hidden.is_none(), "{} never does: {}", key_name(binding.modifiers, binding.key), binding.does);
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
