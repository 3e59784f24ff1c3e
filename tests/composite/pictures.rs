//! Pictures, layers and reports of the program have the hashes of tests/pictures/hashes.txt, on the
//! driver and kind of processor that made the table.

use crate::common;
use crate::tier::fast_or_full;
use std::path::Path;
use std::process::Command;

/// The fast tier makes all effects in one composite and each projection once, the full tier all
/// small cases of `scripts/hashes`. With another driver or processor nothing is compared, and the
/// fast tier makes nothing. To store intended changes:
/// `scripts/hashes target/release/locard FOLDER --size small && cp FOLDER/hashes.txt
/// tests/pictures/`.
// Slow: nine composites and renderings by the program, on the table's processor.
#[test]
fn pictures_layers_and_reports_match_their_hashes() {
    // Without the real recordings the script leaves their cases out.
    let _ = common::data_if_any("tum-fr1-rpy");
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
    let stdout = String::from_utf8_lossy(&output.stdout);
    println!("{stdout}");
    match output.status.code() {
        Some(0) => {}
        // Another driver or processor.
        Some(3) => eprintln!("skipped: {stdout}"),
        code => panic!("exit {code:?}\n{stdout}{}", String::from_utf8_lossy(&output.stderr)),
    }
}
