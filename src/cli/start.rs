//! Restarts the program if its environment must change.

/// Restarts the program without Mesa's device selection if that would print warnings. It is a
/// Vulkan layer that Mesa adds to every program. It tries to open a Wayland display, and prints
/// twice on stderr that `XDG_RUNTIME_DIR` is unset: in containers, over ssh and in CI. The layer
/// only reorders the adapters, and Locard chooses among all of them itself. It is controlled only
/// by the environment, which a running program cannot change safely. The new program keeps the
/// process id and takes 1.5 ms longer to start.
pub fn without_device_selection() {
    #[cfg(target_os = "linux")]
    {
        use std::env;
        use std::os::unix::process::CommandExt;
        const OFF: &str = "NODEVICE_SELECT";
        let has_folder =
            env::var_os("XDG_RUNTIME_DIR").is_some_and(|folder| std::path::Path::new(&folder).is_absolute());
        // Restarts at most once.
        if has_folder || env::var_os(OFF).is_some() {
            return;
        }
        let Ok(program) = env::current_exe() else { return };
        let mut arguments = env::args_os();
        let mut command = std::process::Command::new(program);
        if let Some(name) = arguments.next() {
            command.arg0(name);
        }
        // Returns only on failure. The two warnings are then printed.
        let _ = command.args(arguments).env(OFF, "1").exec();
    }
}
