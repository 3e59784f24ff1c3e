//! List files of a recording.

use std::fs;
use std::path::Path;

/// Space-separated fields of each line of a list file, without comment lines.
pub fn columns(folder: &Path, list: &str) -> Vec<Vec<String>> {
    let text = fs::read_to_string(folder.join(list)).unwrap();
    let lines = text.lines().filter(|line| !line.starts_with('#'));
    lines.map(|line| line.split(' ').map(str::to_owned).collect()).collect()
}
