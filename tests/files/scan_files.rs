//! Scans of a place by scanners.

use glam::DVec3;

use crate::common::data;
use locard::site::scan_file::read;

#[test]
fn real_scans_are_read_and_a_corrupt_page_is_refused() {
    let Some(folder) = data("bring/scans") else { return };
    let bunny = read(&folder.join("bunnyInt21.e57")).unwrap();
    assert_eq!((bunny.positions.len(), bunny.triangles.len(), bunny.origin), (30_571, 0, DVec3::ZERO));
    assert!(bunny.warnings.is_empty(), "{:?}", bunny.warnings);
    assert!(!read(&folder.join("tiny_pc_and_images.e57")).unwrap().positions.is_empty());
    let error = read(&folder.join("corrupt_crc.e57")).unwrap_err().to_string();
    assert!(error.contains("corrupt_crc.e57") && error.contains("invalid checksum"), "{error}");
    assert!(error.contains("export it again"), "{error}");
}
