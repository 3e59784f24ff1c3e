//! Replaces the process by a new one with the same arguments after a lost graphics device, which a
//! process cannot recover.

use std::time::{SystemTime, UNIX_EPOCH};

use eframe::egui_wgpu::RenderState;

use locard_engine::cleanup::undo_all;
use locard_engine::gpu::Gpu;

/// Environment variable with the time of the restart, seconds since 1970.
const RESTARTED_VARIABLE: &str = "LOCARD_STARTED_AGAIN_S";
/// Shortest time between two restarts: a device that is lost sooner will be lost again.
const MIN_RESTART_INTERVAL_S: u64 = 60;

/// Environment variable: seconds after which a development build loses its device.
#[cfg(development)]
const LOSS_VARIABLE: &str = "LOCARD_LOSES_DEVICE_AFTER_S";

/// Destroys the device at the time of the environment variable, for tests of the restart.
#[cfg(development)]
pub fn lose_device_when_due(gpu: &Gpu, ctx: &eframe::egui::Context) {
    let after_s = || std::env::var(LOSS_VARIABLE).ok()?.parse().ok();
    static AFTER_S: std::sync::OnceLock<Option<f64>> = std::sync::OnceLock::new();
    let Some(after_s) = *AFTER_S.get_or_init(after_s) else { return };
    let left_s = after_s - ctx.input(|i| i.time);
    if left_s > 0.0 {
        ctx.request_repaint_after_secs(left_s as f32);
    } else {
        gpu.device.destroy();
    }
}

fn may_restart(now_s: u64, before: Option<&str>) -> bool {
    before
        .and_then(|before| before.parse().ok())
        .is_none_or(|before: u64| now_s.saturating_sub(before) >= MIN_RESTART_INTERVAL_S)
}

/// Restarts the program. Returns only on failure, with the reason.
pub fn restart() -> String {
    let now_s = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
    if !may_restart(now_s, std::env::var(RESTARTED_VARIABLE).ok().as_deref()) {
        return "it was lost a moment ago, too".to_owned();
    }
    let program = match std::env::current_exe() {
        Ok(program) => program,
        Err(error) => return error.to_string(),
    };
    let mut command = std::process::Command::new(program);
    command.args(std::env::args_os().skip(1)).env(RESTARTED_VARIABLE, now_s.to_string());
    let cleanup_guard = undo_all();
    #[cfg(unix)]
    let failed = {
        use std::os::unix::process::CommandExt;
        command.exec()
    };
    #[cfg(not(unix))]
    let failed = match command.spawn() {
        Ok(_) => std::process::exit(0),
        Err(error) => error,
    };
    drop(cleanup_guard);
    failed.to_string()
}

/// Restarts after a panic of the window if the device is lost.
pub fn restart_if_lost(window: &RenderState) {
    let gpu = Gpu::from_device(&window.adapter, window.device.clone(), window.queue.clone());
    // The loss may have been reported to another caller before.
    if gpu.in_error_scope(|| gpu.buffer("a word", &[0; 4], wgpu::BufferUsages::COPY_SRC)).is_err() {
        eprintln!("locard: the graphics device was lost; start Locard again ({})", restart());
    }
}

#[cfg(test)]
mod tests {
    use super::may_restart;

    #[test]
    fn restart_soon_after_another_is_refused() {
        assert!(may_restart(1000, None) && may_restart(1000, Some("900")) && may_restart(1000, Some("no number")));
        assert!(!may_restart(1000, Some("990")) && !may_restart(1000, Some("2000")));
    }
}
