//! Sets `cfg(development)` in development builds.
//!
//! `cfg(debug_assertions)` is not used for it: it also enables the standard library's checks of
//! slice accesses that are already known to be in bounds. Every loop over pixels pays for them, and
//! tests take a tenth longer.

fn main() {
    // Depends on the profile alone: without this line cargo reruns it when any source file changes.
    println!("cargo::rerun-if-env-changed=PROFILE");
    println!("cargo::rustc-check-cfg=cfg(development)");
    if std::env::var("PROFILE").is_ok_and(|profile| profile == "debug") {
        println!("cargo::rustc-cfg=development");
    }
}
