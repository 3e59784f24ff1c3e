//! The two tiers of the tests. The fast tier proves each claim on inputs as small as the claim allows; the full tier,
//! `scripts/test --full`, repeats it over the breadth of recordings, sites and parameters.
//!
//! A test that runs in the full tier alone is `#[ignore = "full tier: ..."]`. A test that runs in both and differs in
//! size picks its input with [`fast_or_full`].

#![allow(dead_code, reason = "each test binary uses some of it")]

/// True in the full tier: the environment variable `LOCARD_TEST_TIER` is `full`.
///
/// # Panics
/// If the variable has any other value but `fast`.
pub fn is_full() -> bool {
    match std::env::var("LOCARD_TEST_TIER").as_deref() {
        Ok("full") => true,
        Ok("fast") | Err(std::env::VarError::NotPresent) => false,
        other => panic!("LOCARD_TEST_TIER is {other:?}; it takes `fast` or `full`"),
    }
}

/// The first value in the fast tier, the second in the full one.
pub fn fast_or_full<T>(fast: T, full: T) -> T {
    if is_full() { full } else { fast }
}

/// Arguments that turn shadows off in the fast tier, for commands whose claim does not involve them.
/// Shadows take most of a frame's time on a software driver.
pub fn no_shadows() -> &'static [&'static str] {
    fast_or_full(&["--set", "shadow.cast=false", "--set", "shadow.on_things=false"], &[])
}

/// A scene for commands whose claim depends on no scene: one marker on the demonstration's floor in
/// the fast tier, its seven objects and its panorama in the full one.
pub fn any_scene() -> &'static str {
    fast_or_full("tests/common/marker.toml", "scenes/demo.toml")
}
