//! Texts about a transform: history label, status line, hint.

use super::amount;
use super::transform::{Constraint, Transform, TransformKind};

/// Label of a finished transform in the history.
pub fn history(transform: &Transform) -> String {
    match transform.kind {
        TransformKind::Move => format!("moved {}", amount::length(transform.amount().abs())),
        TransformKind::Turn => format!("turned {}", amount::angle(transform.amount())),
        TransformKind::Scale => format!("scaled to {}", amount::factor(transform.amount())),
    }
}

/// Status line during a transform: kind, constraint and amount.
pub fn status(transform: &Transform) -> String {
    let (verb, amount) = match transform.kind {
        TransformKind::Move => ("Move", amount::length(transform.amount())),
        TransformKind::Turn => ("Turn", amount::angle(transform.amount())),
        TransformKind::Scale => ("Scale", amount::factor(transform.amount())),
    };
    let constraint = constraint(transform);
    if transform.typed.is_empty() {
        format!("{verb}{constraint}: {amount}")
    } else {
        format!("{verb}{constraint}: [{}]  {amount}", transform.typed.text())
    }
}

/// Keys that are available during a transform.
pub fn hint(transform: &Transform) -> &'static str {
    match transform.kind {
        TransformKind::Move => "X Y Z: along an axis · Shift: level · Ctrl: whole centimetres · numbers · Esc: back",
        TransformKind::Turn => "X Y Z: about an axis · Ctrl: steps of 5° · numbers · Esc: back",
        TransformKind::Scale => "X Y Z: along one of its axes · Ctrl: steps of 10 % · numbers · Esc: back",
    }
}

fn constraint(transform: &Transform) -> String {
    let name = |axis: usize| ["x", "y", "z"][axis % 3];
    let whose = |is_local: bool| if is_local { "its own " } else { "" };
    match (transform.kind, transform.constraint) {
        (TransformKind::Move, Constraint::Free) if !transform.typed.is_empty() => " along x".to_owned(),
        (TransformKind::Move, Constraint::Level) => " level".to_owned(),
        (TransformKind::Move | TransformKind::Scale, Constraint::Free | Constraint::Level) => String::new(),
        (TransformKind::Turn, Constraint::Free | Constraint::Level) => " about up".to_owned(),
        (TransformKind::Turn, Constraint::Axis { axis, is_local } | Constraint::Plane { axis, is_local }) => {
            format!(" about {}{}", whose(is_local), name(axis))
        }
        (_, Constraint::Axis { axis, is_local }) => format!(" along {}{}", whose(is_local), name(axis)),
        (_, Constraint::Plane { axis, is_local }) => {
            format!(" along {}{} and {}", whose(is_local), name(axis + 1), name(axis + 2))
        }
    }
}
