//! `cargo +nightly fuzz run picture fuzz/corpus/picture fuzz/seeds/picture`
#![no_main]

#[path = "../bodies.rs"]
mod bodies;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| bodies::picture(bytes));
