//! Tells a development build from a release: `cfg(development)`.
//!
//! `cfg(debug_assertions)` would do, but it also has the standard library check each access of a slice that is known to be in order,
//! which every loop over pixels pays for: tests take a tenth longer with it.

fn main() {
    // No file and no variable changes it.
    println!("cargo::rerun-if-env-changed=PROFILE");
    println!("cargo::rustc-check-cfg=cfg(development)");
    if std::env::var("PROFILE").is_ok_and(|profile| profile == "debug") {
        println!("cargo::rustc-cfg=development");
    }
}
