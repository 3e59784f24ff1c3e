//! What is being done to a thing and what has been done, in words.

use super::amount;
use super::tool::{Along, Kind, Tool};

/// What has been done, as the history names it.
pub fn done(tool: &Tool) -> String {
    match tool.kind {
        Kind::Move => format!("moved {}", amount::length(tool.amount().abs())),
        Kind::Turn => format!("turned {}", amount::angle(tool.amount())),
        Kind::Scale => format!("scaled to {}", amount::factor(tool.amount())),
    }
}

/// What is being done and how far, as it is told meanwhile.
pub fn told(tool: &Tool) -> String {
    let (verb, amount) = match tool.kind {
        Kind::Move => ("Move", amount::length(tool.amount())),
        Kind::Turn => ("Turn", amount::angle(tool.amount())),
        Kind::Scale => ("Scale", amount::factor(tool.amount())),
    };
    let way = way(tool);
    if tool.typed.is_empty() {
        format!("{verb}{way}: {amount}")
    } else {
        format!("{verb}{way}: [{}]  {amount}", tool.typed.text())
    }
}

/// What a person can do besides.
pub fn hint(tool: &Tool) -> &'static str {
    match tool.kind {
        Kind::Move => "X Y Z: along an axis · Shift: level · Ctrl: whole centimetres · numbers · Esc: back",
        Kind::Turn => "X Y Z: about an axis · Ctrl: steps of 5° · numbers · Esc: back",
        Kind::Scale => "X Y Z: along one of its axes · Ctrl: steps of 10 % · numbers · Esc: back",
    }
}

/// Along or about what.
fn way(tool: &Tool) -> String {
    let name = |axis: usize| ["x", "y", "z"][axis % 3];
    let whose = |own: bool| if own { "its own " } else { "" };
    match (tool.kind, tool.along) {
        (Kind::Move, Along::Free) if !tool.typed.is_empty() => " along x".to_owned(),
        (Kind::Move, Along::Level) => " level".to_owned(),
        (Kind::Move | Kind::Scale, Along::Free | Along::Level) => String::new(),
        (Kind::Turn, Along::Free | Along::Level) => " about up".to_owned(),
        (Kind::Turn, Along::Axis { axis, own } | Along::Without { axis, own }) => {
            format!(" about {}{}", whose(own), name(axis))
        }
        (_, Along::Axis { axis, own }) => format!(" along {}{}", whose(own), name(axis)),
        (_, Along::Without { axis, own }) => {
            format!(" along {}{} and {}", whose(own), name(axis + 1), name(axis + 2))
        }
    }
}
