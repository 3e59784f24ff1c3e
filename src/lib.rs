//! Locard puts virtual evidence into real footage so that it appears photographed there by the same
//! camera at the same moment.
//!
//! This crate is the program: its command line, and all of the engine and the window under one
//! name.

pub mod cli;
#[doc(inline)]
pub use locard_engine::*;
#[cfg(feature = "window")]
pub use locard_window as window;
