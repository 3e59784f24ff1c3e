//! The program itself, for tests.

#![allow(dead_code, reason = "each test file uses some of it")]

use std::process::{Command, Output};

/// Not started yet.
pub fn program() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_locard"));
    // As a newcomer has it, in a container at worst: the program itself keeps Mesa's device selection quiet.
    command.env_remove("NODEVICE_SELECT").env_remove("XDG_RUNTIME_DIR");
    command
}

pub fn locard(arguments: &[&str]) -> Output {
    program().args(arguments).output().unwrap()
}

/// What it says on its standard output when all goes well.
pub fn said(arguments: &[&str]) -> String {
    let output = locard(arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// What it says when it refuses, with exit 2.
pub fn refused(arguments: &[&str]) -> String {
    let output = locard(arguments);
    let text = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {text}");
    text
}
