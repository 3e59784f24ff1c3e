//! What is typed while something is moved: nothing of it is a key of the window's.

use eframe::egui::{Context, Event, Key, Modifiers};

use super::tool::Kind;

/// What a key or a letter is for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Stroke {
    /// To another kind of change.
    Kind(Kind),
    /// An axis, or all but it.
    Axis {
        axis: usize,
        without: bool,
    },
    /// Of a number.
    Letter(char),
    Back,
    Done,
    Cancel,
}

/// Takes all that was typed out of the window's input, in order. Where nothing is being changed yet, the key that begins a
/// change stays, and what was typed behind it is taken: a quick hand types more than one key between two pictures. What was
/// typed behind the end of a change comes `later`: with the window's next picture.
pub fn taken(ctx: &Context, is_running: bool, later: &mut Vec<Event>) -> Vec<Stroke> {
    let (mut strokes, mut has_begun, mut own_letter) = (Vec::new(), is_running, false);
    ctx.input_mut(|i| {
        i.events.splice(0..0, std::mem::take(later));
        i.events.retain(|event| {
            if matches!(strokes.last(), Some(Stroke::Done | Stroke::Cancel)) {
                let is_typed = matches!(event, Event::Text(_) | Event::Key { .. });
                later.extend(is_typed.then(|| event.clone()));
                return !is_typed;
            }
            // The letter of the key that begins comes behind it.
            if std::mem::take(&mut own_letter) && matches!(event, Event::Text(_)) {
                return true;
            }
            if !has_begun {
                has_begun = begins(event);
                own_letter = has_begun;
                return true;
            }
            match event {
                Event::Text(text) => strokes.extend(text.chars().map(Stroke::Letter)),
                Event::Key { key, pressed: true, repeat, modifiers, .. } => {
                    strokes.extend(of_key(*key, *modifiers).filter(|stroke| !repeat || *stroke == Stroke::Back));
                }
                // A key that is let go of is known to be up.
                Event::Key { pressed: false, .. } => {}
                _ => return true,
            }
            false
        });
    });
    if !later.is_empty() {
        ctx.request_repaint();
    }
    strokes
}

/// Whether a key begins a change of what is selected.
fn begins(event: &Event) -> bool {
    let Event::Key { key, pressed: true, modifiers, .. } = event else { return false };
    let is_kind = matches!(of_key(*key, *modifiers), Some(Stroke::Kind(_)));
    is_kind || *key == Key::D && modifiers.shift && !modifiers.command && !modifiers.alt
}

fn of_key(key: Key, modifiers: Modifiers) -> Option<Stroke> {
    let axis = |axis| Some(Stroke::Axis { axis, without: modifiers.shift });
    match key {
        Key::Enter => Some(Stroke::Done),
        Key::Escape => Some(Stroke::Cancel),
        Key::Backspace => Some(Stroke::Back),
        // Ctrl is held for whole steps; what it does with a letter waits.
        _ if modifiers.command || modifiers.alt => None,
        Key::G => Some(Stroke::Kind(Kind::Move)),
        Key::R => Some(Stroke::Kind(Kind::Turn)),
        Key::S => Some(Stroke::Kind(Kind::Scale)),
        Key::X => axis(0),
        Key::Y => axis(1),
        Key::Z => axis(2),
        _ => None,
    }
}
