//! Keyboard input of a transform. The window's key bindings do not receive it.

use eframe::egui::{Context, Event, Key, Modifiers};

use super::transform::TransformKind;

/// A key press during a transform.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum TransformKey {
    /// Switches to another kind of transform.
    Kind(TransformKind),
    /// Constrains to an axis, or to the plane of the other two.
    Axis {
        axis: usize,
        as_plane: bool,
    },
    /// A character of a number.
    Letter(char),
    Back,
    Done,
    Cancel,
}

/// Removes keyboard events of a transform from the window's input and returns them in order.
///
/// If no transform is active, the key that begins one stays, and the keys after it are removed:
/// several keys can arrive within one frame of the window. Keys after the end of the transform are
/// `deferred` to the next frame.
pub fn consume(ctx: &Context, is_active: bool, deferred: &mut Vec<Event>) -> Vec<TransformKey> {
    let mut keys = Vec::new();
    let mut has_begun = is_active;
    let mut expects_text = false;
    ctx.input_mut(|i| {
        i.events.splice(0..0, std::mem::take(deferred));
        i.events.retain(|event| {
            if matches!(keys.last(), Some(TransformKey::Done | TransformKey::Cancel)) {
                let is_typed = matches!(event, Event::Text(_) | Event::Key { .. });
                deferred.extend(is_typed.then(|| event.clone()));
                return !is_typed;
            }
            // The text event of the key that begins the transform follows it.
            if std::mem::take(&mut expects_text) && matches!(event, Event::Text(_)) {
                return true;
            }
            if !has_begun {
                has_begun = begins(event);
                expects_text = has_begun;
                return true;
            }
            match event {
                Event::Text(text) => keys.extend(text.chars().map(TransformKey::Letter)),
                Event::Key { key, pressed: true, repeat, modifiers, .. } => {
                    keys.extend(transform_key(*key, *modifiers).filter(|key| !repeat || *key == TransformKey::Back));
                }
                Event::Key { pressed: false, .. } => {}
                _ => return true,
            }
            false
        });
    });
    if !deferred.is_empty() {
        ctx.request_repaint();
    }
    keys
}

/// True if a key begins a transform.
fn begins(event: &Event) -> bool {
    let Event::Key { key, pressed: true, modifiers, .. } = event else { return false };
    let is_kind = matches!(transform_key(*key, *modifiers), Some(TransformKey::Kind(_)));
    is_kind || *key == Key::D && modifiers.shift && !modifiers.command && !modifiers.alt
}

fn transform_key(key: Key, modifiers: Modifiers) -> Option<TransformKey> {
    let axis = |axis| Some(TransformKey::Axis { axis, as_plane: modifiers.shift });
    match key {
        Key::Enter => Some(TransformKey::Done),
        Key::Escape => Some(TransformKey::Cancel),
        Key::Backspace => Some(TransformKey::Back),
        // Ctrl snaps to whole steps; its combinations with letters are ignored.
        _ if modifiers.command || modifiers.alt => None,
        Key::G => Some(TransformKey::Kind(TransformKind::Move)),
        Key::R => Some(TransformKey::Kind(TransformKind::Turn)),
        Key::S => Some(TransformKey::Kind(TransformKind::Scale)),
        Key::X => axis(0),
        Key::Y => axis(1),
        Key::Z => axis(2),
        _ => None,
    }
}
