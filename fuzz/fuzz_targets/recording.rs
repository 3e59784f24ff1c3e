//! `cargo +nightly fuzz run recording fuzz/corpus/recording fuzz/seeds/recording`
#![no_main]

#[path = "../bodies.rs"]
mod bodies;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    bodies::recording(bytes);
});
