//! `cargo +nightly fuzz run stream fuzz/corpus/stream fuzz/seeds/stream`
#![no_main]

#[path = "../bodies.rs"]
mod bodies;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    bodies::stream(bytes);
});
