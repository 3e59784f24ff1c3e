//! `cargo +nightly fuzz run scan fuzz/corpus/scan fuzz/seeds/scan`
#![no_main]

#[path = "../bodies.rs"]
mod bodies;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| bodies::scan(bytes));
