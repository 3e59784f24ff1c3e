//! The two test tiers. The fast tier checks each claim on the smallest sufficient input; the full
//! tier, `scripts/test --full`, repeats the check over many recordings, sites and parameters.
//!
//! A test of the full tier alone is `#[ignore = "full tier: ..."]`. A test of both tiers selects
//! its input with [`fast_or_full`].

#![allow(dead_code, reason = "each test binary uses some of it")]

/// Returns true in the full tier: the environment variable `LOCARD_TEST_TIER` is `full`.
///
/// # Panics
/// If the variable is set to anything but `full` or `fast`.
pub fn is_full() -> bool {
    match std::env::var("LOCARD_TEST_TIER").as_deref() {
        Ok("full") => true,
        Ok("fast") | Err(std::env::VarError::NotPresent) => false,
        other => panic!("LOCARD_TEST_TIER is {other:?}; it takes `fast` or `full`"),
    }
}

/// Returns the first value in the fast tier and the second in the full tier.
pub fn fast_or_full<T>(fast: T, full: T) -> T {
    if is_full() { full } else { fast }
}

/// Arguments that turn shadows off in the fast tier, for tests in which shadows play no part.
/// Shadows take most of a frame's time on a software driver.
pub fn no_shadows() -> &'static [&'static str] {
    fast_or_full(&["--set", "shadow.cast=false", "--set", "shadow.on_evidence=false"], &[])
}

/// Scene file for tests that hold for any scene: one marker on the demonstration's floor in the
/// fast tier, the demonstration's seven objects and panorama in the full tier.
pub fn any_scene() -> &'static str {
    fast_or_full("tests/common/marker.toml", "scenes/demo.toml")
}
