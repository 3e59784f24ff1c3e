//! Starts the program anew in its own place, with the same arguments: a graphics device that is lost does not come back to
//! a program that had it.

use std::time::{SystemTime, UNIX_EPOCH};

use eframe::egui_wgpu::RenderState;

use locard_engine::cleanup::undo_all;
use locard_engine::gpu::Gpu;

/// Says to the program that is started when that was, in seconds since 1970.
const AGAIN: &str = "LOCARD_STARTED_AGAIN_S";
/// A device that is lost sooner than this will be lost again.
const SETTLED_S: u64 = 60;

/// Where this is set, a development build loses its device so many seconds after its window was opened.
#[cfg(development)]
const TRIES: &str = "LOCARD_LOSES_DEVICE_AFTER_S";

/// Loses the device once it is time, if the environment says so: nothing else does it on purpose.
#[cfg(development)]
pub fn try_it(gpu: &Gpu, ctx: &eframe::egui::Context) {
    let after_s = || std::env::var(TRIES).ok()?.parse().ok();
    static AFTER_S: std::sync::OnceLock<Option<f64>> = std::sync::OnceLock::new();
    let Some(after_s) = *AFTER_S.get_or_init(after_s) else { return };
    let left_s = after_s - ctx.input(|i| i.time);
    match left_s > 0.0 {
        true => ctx.request_repaint_after_secs(left_s as f32),
        false => gpu.device.destroy(),
    }
}

fn may(now_s: u64, before: Option<&str>) -> bool {
    before.and_then(|before| before.parse().ok()).is_none_or(|before: u64| now_s.saturating_sub(before) >= SETTLED_S)
}

/// Returns only where it is not done, with the reason.
pub fn again() -> String {
    let now_s = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
    if !may(now_s, std::env::var(AGAIN).ok().as_deref()) {
        return "it was lost a moment ago, too".to_owned();
    }
    let program = match std::env::current_exe() {
        Ok(program) => program,
        Err(error) => return error.to_string(),
    };
    let mut command = std::process::Command::new(program);
    command.args(std::env::args_os().skip(1)).env(AGAIN, now_s.to_string());
    let nothing_begins = undo_all();
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
    drop(nothing_begins);
    failed.to_string()
}

/// After a window has broken off: starts anew if its device is gone.
pub fn where_lost(window: &RenderState) {
    let gpu = Gpu::adopt(&window.adapter, window.device.clone(), window.queue.clone());
    // That it is gone may have been told before, to somebody else.
    if gpu.apart(|| gpu.buffer("a word", &[0; 4], wgpu::BufferUsages::COPY_SRC)).is_err() {
        eprintln!("locard: the graphics device was lost; start it again ({})", again());
    }
}

#[cfg(test)]
mod tests {
    use super::may;

    #[test]
    fn it_does_not_start_over_and_over() {
        assert!(may(1000, None) && may(1000, Some("900")) && may(1000, Some("no number")));
        assert!(!may(1000, Some("990")) && !may(1000, Some("2000")));
    }
}
