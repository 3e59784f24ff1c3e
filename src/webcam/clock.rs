//! The clock of pictures' times.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// Seconds of the system's monotonic clock: CLOCK_MONOTONIC on Linux, by which V4L2 drivers stamp
/// their pictures. Elsewhere, seconds since the first call.
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

/// Readings of both clocks closer together than this are simultaneous, seconds.
const SIMULTANEOUS_S: f64 = 1e-4;
const MAX_READINGS: usize = 5;

/// The wall clock (seconds since 1970) minus the monotonic clock. Of several readings the one that
/// took least time.
pub fn wall_offset_s() -> f64 {
    let mut best = (f64::INFINITY, 0.0);
    for _ in 0..MAX_READINGS {
        let before_s = monotonic_s();
        let wall_s = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or(Duration::ZERO).as_secs_f64();
        let took_s = monotonic_s() - before_s;
        if took_s < best.0 {
            best = (took_s, wall_s - before_s - 0.5 * took_s);
        }
        if took_s < SIMULTANEOUS_S {
            break;
        }
    }
    best.1
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wall_clock_and_monotonic_clock_agree_by_their_offset() {
        let wall_s = SystemTime::now().duration_since(UNIX_EPOCH).unwrap().as_secs_f64();
        let now_s = monotonic_s();
        let error_s = wall_s - now_s - wall_offset_s();
        assert!(error_s.abs() < 0.5, "{error_s}");
    }
}
