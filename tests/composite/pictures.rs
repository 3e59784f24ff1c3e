//! The bits of what the program makes are those of the table in tests/pictures/, on the machine that made it.

use crate::common;
use crate::tier::fast_or_full;
use std::path::Path;
use std::process::Command;

/// `scripts/hashes` has the list. The fast tier makes each effect and each projection once, and
/// nothing if the table was made on another machine. A change that is meant goes into the table:
/// `scripts/hashes target/release/locard FOLDER && cp FOLDER/hashes.txt tests/pictures/`.
#[test]
fn pictures_layers_and_reports_keep_their_bits() {
    // Without the real recordings the script leaves theirs out.
    let _ = common::data("tum-fr1-rpy");
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folder = tempfile::tempdir().unwrap();
    let output = Command::new("python3")
        .arg(root.join("scripts/hashes"))
        .arg(env!("CARGO_BIN_EXE_locard"))
        .arg(folder.path())
        .args(["--size", fast_or_full("fast", "small")])
        .arg("--against")
        .arg(root.join("tests/pictures/hashes.txt"))
        .output()
        .expect("python3 starts: this test needs it");
    let said = String::from_utf8_lossy(&output.stdout);
    println!("{said}");
    match output.status.code() {
        Some(0) => {}
        // Another driver or processor: it has said so.
        Some(3) => eprintln!("skipped: {said}"),
        code => panic!("exit {code:?}\n{said}{}", String::from_utf8_lossy(&output.stderr)),
    }
}
