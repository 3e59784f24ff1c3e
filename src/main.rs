//! The program `locard`.

fn main() -> std::process::ExitCode {
    locard::cli::main()
}
