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

/// Takes all that was typed out of the window's input, in order.
pub fn taken(ctx: &Context) -> Vec<Stroke> {
    let mut strokes = Vec::new();
    ctx.input_mut(|i| {
        i.events.retain(|event| {
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
    strokes
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
