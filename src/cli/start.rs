//! What is done before anything else.

/// Starts the program anew with Mesa's device selection off, where it would complain: a layer of Vulkan that Mesa puts
/// into every program, which looks for a Wayland display, and says on stderr that `XDG_RUNTIME_DIR` is unset, twice, in
/// containers, by ssh and in CI. It puts one adapter before the others, and Locard chooses among all of them itself. The
/// layer is told so by its environment alone, and a program that runs cannot change its own safely; the new one keeps
/// the process' number, and takes 1.5 ms longer to start.
pub fn without_device_selection() {
    #[cfg(target_os = "linux")]
    {
        use std::env;
        use std::os::unix::process::CommandExt;
        const OFF: &str = "NODEVICE_SELECT";
        let has_folder =
            env::var_os("XDG_RUNTIME_DIR").is_some_and(|folder| std::path::Path::new(&folder).is_absolute());
        // Never twice.
        if has_folder || env::var_os(OFF).is_some() {
            return;
        }
        let Ok(program) = env::current_exe() else { return };
        let mut arguments = env::args_os();
        let mut command = std::process::Command::new(program);
        if let Some(name) = arguments.next() {
            command.arg0(name);
        }
        // Comes back only where that cannot be; then there are two lines more.
        let _ = command.args(arguments).env(OFF, "1").exec();
    }
}
