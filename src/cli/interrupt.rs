//! Early end of the program by Ctrl-C or a request to terminate.

use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::Context;

use super::{FAILED, print_message};
use locard_engine::cleanup::undo_all;

/// True if the command handles the first request to end.
static IS_DEFERRED: AtomicBool = AtomicBool::new(false);
/// True after the first request to end, if it is deferred.
static IS_REQUESTED: AtomicBool = AtomicBool::new(false);

/// From here on the first Ctrl-C only sets [`is_requested`], for commands that run until they are
/// interrupted. A second one ends the program immediately.
pub fn defer_first() {
    IS_DEFERRED.store(true, Ordering::SeqCst);
}

/// True after a request to end, if it is deferred by [`defer_first`].
pub fn is_requested() -> bool {
    IS_REQUESTED.load(Ordering::SeqCst)
}

/// Installs the handlers. From here on Ctrl-C or a request to terminate ends the program
/// immediately, since a frame may take minutes, and removes unfinished output. A file that reaches
/// the size limit is a write error.
pub fn install_handlers() -> anyhow::Result<()> {
    // Without any handler, the system kills the program silently when `ulimit -f` is reached.
    #[cfg(unix)]
    signal_hook::flag::register(signal_hook::consts::SIGXFSZ, std::sync::Arc::default())?;
    ctrlc::set_handler(|| {
        if IS_DEFERRED.load(Ordering::SeqCst) && !IS_REQUESTED.swap(true, Ordering::SeqCst) {
            return;
        }
        // The message comes first. From here on no output is finished any more.
        print_message("interrupted; finished files are kept, unfinished ones are removed");
        let _no_new_output = undo_all();
        end_immediately();
    })
    .context("the program cannot listen for Ctrl-C, which needs a thread")
}

/// Ends with [`FAILED`] while other threads run. A normal exit would first run the cleanup of C
/// libraries, which the threads of a graphics driver still use, and crash now and then. Replacing
/// the process by another program runs no cleanup.
fn end_immediately() -> ! {
    #[cfg(unix)]
    {
        use std::os::unix::process::CommandExt;
        // Returns only if there is no shell.
        let _ = std::process::Command::new("sh").args(["-c", &format!("exit {FAILED}")]).exec();
    }
    std::process::exit(i32::from(FAILED))
}
