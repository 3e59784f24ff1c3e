//! `cargo +nightly fuzz run gltf fuzz/corpus/gltf fuzz/seeds/gltf`
#![no_main]

#[path = "../bodies.rs"]
mod bodies;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| bodies::gltf(bytes));
