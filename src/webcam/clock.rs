//! The clock by which cameras tell the time.

/// Seconds of the system's monotonic clock, which nobody sets: Linux' CLOCK_MONOTONIC, by which V4L2 drivers stamp their
/// pictures. Elsewhere, since the program first asked.
pub fn monotonic_s() -> f64 {
    #[cfg(target_os = "linux")]
    {
        let now = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
        now.tv_sec as f64 + 1e-9 * now.tv_nsec as f64
    }
    #[cfg(not(target_os = "linux"))]
    {
        static FIRST: std::sync::OnceLock<std::time::Instant> = std::sync::OnceLock::new();
        FIRST.get_or_init(std::time::Instant::now).elapsed().as_secs_f64()
    }
}
