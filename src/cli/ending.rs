//! How the program ends early.

use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::Context;

use super::{FAILED, say};
use locard_engine::cleanup::undo_all;

/// Whether the first request to end is left to the command, and whether it has come.
static GENTLY: AtomicBool = AtomicBool::new(false);
static ASKED: AtomicBool = AtomicBool::new(false);

/// From here on, the first Ctrl-C only asks ([`is_asked`]): for what runs until somebody ends it. A second one ends the
/// program at once.
pub fn gently() {
    GENTLY.store(true, Ordering::SeqCst);
}

/// Whether somebody has asked the program to end, after [`gently`].
pub fn is_asked() -> bool {
    ASKED.load(Ordering::SeqCst)
}

/// From here on, Ctrl-C or a request to terminate ends the program at once, whatever it is doing: a frame may take
/// minutes. Unfinished output is removed. From here on, a file that reaches the size limit is a write error.
pub fn listen() -> anyhow::Result<()> {
    // Without any handler, the system kills the program silently when `ulimit -f` is reached.
    #[cfg(unix)]
    signal_hook::flag::register(signal_hook::consts::SIGXFSZ, std::sync::Arc::default())?;
    ctrlc::set_handler(|| {
        if GENTLY.load(Ordering::SeqCst) && !ASKED.swap(true, Ordering::SeqCst) {
            return;
        }
        // First, so that the user sees it. After that nothing is finished any more.
        say("interrupted; what was finished stays, and nothing else");
        let _nothing_begins = undo_all();
        end_at_once();
    })
    .context("the program cannot listen for Ctrl-C, which needs a thread")
}

/// Ends with [`FAILED`], whatever other threads are doing. A normal exit would first run the cleanup of C libraries,
/// pulling it away from under a graphics driver's threads, and crash now and then. Replacing the process by another
/// program cleans nothing up.
fn end_at_once() -> ! {
    #[cfg(unix)]
    {
        use std::os::unix::process::CommandExt;
        // Returns only if there is no shell.
        let _ = std::process::Command::new("sh").args(["-c", &format!("exit {FAILED}")]).exec();
    }
    std::process::exit(i32::from(FAILED))
}
